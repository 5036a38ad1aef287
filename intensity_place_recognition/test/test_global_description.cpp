// SPDX-License-Identifier: BSD-3-Clause
#include <gtest/gtest.h>

#include <cmath>

#include "intensity_place_recognition/global_description.h"

namespace intensity_place_recognition {
namespace {

using Views = std::vector<cv::Mat1f>;

float distance(const GlobalSignature& a, const GlobalSignature& b) {
  return static_cast<float>(cv::norm(cv::Mat(a.key()), cv::Mat(b.key())));
}

TEST(GlobalSignature, HasAKeyThatTurnsDontChange) {
  cv::Mat1f a(20, 60), b(20, 60);
  cv::randu(a, 0.0, 1.0);
  for (int i = 0; i < 60; ++i) a.col(i).copyTo(b.col((i + 17) % 60));
  const GlobalSignature here(Views{a}), turned(Views{b});
  EXPECT_LT(distance(here, turned), 1e-5f);
  EXPECT_NEAR(-17.0 * 2.0 * M_PI / 60.0, here.bestTurns(turned, 1).at(0).yaw, 1e-3);
}

TEST(GlobalSignature, ComparesAtAllTurnsAsTheCosineDoes) {
  cv::Mat1f a(3, 8), b(3, 8);
  cv::randu(a, 0.0, 1.0);
  cv::randu(b, 0.0, 1.0);
  const std::vector<float> all = GlobalSignature(Views{a}).similarities(GlobalSignature(Views{b}));
  const auto centred = [](cv::Mat1f m) {
    for (int r = 0; r < m.rows; ++r) m.row(r) -= cv::mean(m.row(r))[0];
    return m;
  };
  const cv::Mat1f x = centred(a.clone()), y = centred(b.clone());
  for (int s = 0; s < 8; ++s) {
    double sum = 0.0;
    for (int r = 0; r < 3; ++r)
      for (int i = 0; i < 8; ++i) sum += x(r, i) * y(r, (i + s) % 8);
    EXPECT_NEAR(sum / cv::norm(x) / cv::norm(y), all[s], 1e-5);
  }
  EXPECT_THROW(GlobalSignature(Views{cv::Mat1f(3, 8, 1.0f)}), std::invalid_argument);
  EXPECT_THROW(GlobalSignature(Views{a}).similarities(GlobalSignature(Views{a.colRange(0, 6).clone()})),
               std::invalid_argument);
  EXPECT_THROW(GlobalSignature(Views{a}).similarities(GlobalSignature(Views{a, b})), std::invalid_argument);
}

TEST(PackedSignature, IsComparedAsTheWholeOne) {
  cv::Mat1f a(40, 120), b(40, 120);
  cv::randn(a, 0.0, 1.0);
  cv::randn(b, 0.0, 1.0);
  const GlobalSignature here(Views{a}), there(Views{b + a});
  const PackedSignature packed(there);
  EXPECT_TRUE(packed.isSound());
  const std::vector<float> expected = here.similarities(there), found = here.similarities(packed);
  ASSERT_EQ(expected.size(), found.size());
  for (std::size_t i = 0; i < found.size(); ++i) EXPECT_NEAR(expected[i], found[i], 2e-3) << i;
  EXPECT_NEAR(1.0, there.bestTurns(packed, 1).at(0).similarity, 2e-3);
  EXPECT_LT(packed.bytes(), 5000u);
}

TEST(GlobalSignature, RecognisesEitherView) {
  cv::Mat1f views[3];
  for (cv::Mat1f& view : views) {
    view.create(40, 1);
    cv::randu(view, 0.0, 1.0);
  }
  const GlobalSignature there(Views{views[0], views[1]}), back(Views{views[2], views[0]});
  const auto cosine = [](const cv::Mat1f& a, const cv::Mat1f& b) {
    return static_cast<float>(a.dot(b) / cv::norm(a) / cv::norm(b));
  };
  const std::vector<float> all = back.similarities(there);
  ASSERT_EQ(2u, all.size());
  EXPECT_NEAR(std::max(cosine(views[2], views[0]), cosine(views[0], views[1])), all[0], 1e-5);
  EXPECT_NEAR(1.0, all[1], 1e-5);
  EXPECT_NEAR(M_PI, std::abs(back.bestTurns(there, 2).at(0).yaw), 1e-9);
  EXPECT_NEAR(
      1.0, GlobalSignature(Views{views[0]}).bestTurns(GlobalSignature(Views{views[0]}), 3).at(0).similarity,
      1e-5);
}

}  // namespace
}  // namespace intensity_place_recognition
