// SPDX-License-Identifier: BSD-3-Clause
#include <gtest/gtest.h>

#include <cmath>

#include "intensity_place_recognition/scene_description.h"
#include "test_street.h"

namespace intensity_place_recognition {
namespace {

Signature signatureOf(const SceneDescription& description, const Cloud& cloud) {
  const Panorama panorama = toPanorama(cloud, {}, 4);
  return Signature(description.describe({cloud, panorama}));
}

float distance(const Signature& a, const Signature& b) {
  return static_cast<float>(cv::norm(cv::Mat(a.key()), cv::Mat(b.key())));
}

class Description : public ::testing::TestWithParam<std::string> {
 protected:
  Description() {
    options_.type = GetParam();
    description_ = makeDescription(options_);
  }
  DescriptionOptions options_;
  std::unique_ptr<SceneDescription> description_;
};

TEST_P(Description, TellsTheYawOfATurnedScan) {
  const Signature there = signatureOf(*description_, Street(1).scan(Street::at(0.0, 0.0, 0.0)));
  const Signature other = signatureOf(*description_, Street(2).scan(Street::at(0.0, 0.0, 0.0)));
  EXPECT_NEAR(1.0f, there.bestTurns(there, 1).at(0).similarity, 1e-4);
  for (const double yaw : {0.7, 2.6, -1.9}) {
    const Signature turned = signatureOf(*description_, Street(1).scan(Street::at(0.0, 0.0, yaw)));
    const auto turns = turned.bestTurns(there, 2);
    EXPECT_NEAR(0.0, std::remainder(yaw - turns.at(0).yaw, 2.0 * M_PI), 0.035);
    EXPECT_GT(turns[0].similarity, 0.6f);
    EXPECT_LT(distance(there, turned), distance(there, other));
  }
}

TEST(Signature, HasAKeyThatTurnsDontChange) {
  cv::Mat1f a(20, 60), b(20, 60);
  cv::randu(a, 0.0, 1.0);
  for (int i = 0; i < 60; ++i) a.col(i).copyTo(b.col((i + 17) % 60));
  EXPECT_LT(distance(Signature(a), Signature(b)), 1e-5f);
  EXPECT_NEAR(-17.0 * 2.0 * M_PI / 60.0, Signature(a).bestTurns(Signature(b), 1).at(0).yaw, 1e-3);
}

TEST_P(Description, IsMoreLikeItselfThanOthers) {
  const Signature there = signatureOf(*description_, Street(1).scan(Street::at(0.0, 0.0, 0.0)));
  const Signature beside = signatureOf(*description_, Street(1).scan(Street::at(0.5, 0.3, 2.0)));
  const float same = beside.bestTurns(there, 1).at(0).similarity;
  for (unsigned seed = 2; seed < 8; ++seed) {
    const Signature other = signatureOf(*description_, Street(seed).scan(Street::at(0.0, 0.0, 0.0)));
    EXPECT_GT(same, other.bestTurns(there, 1).at(0).similarity + 0.02f) << seed;
  }
}

INSTANTIATE_TEST_SUITE_P(All, Description, ::testing::ValuesIn(namesOf(sceneDescriptions())));

TEST(Signature, ComparesAtAllTurnsAsTheCosineDoes) {
  cv::Mat1f a(3, 8), b(3, 8);
  cv::randu(a, 0.0, 1.0);
  cv::randu(b, 0.0, 1.0);
  const std::vector<float> all = Signature(a).similarities(Signature(b));
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
  EXPECT_THROW(Signature(cv::Mat1f(3, 8, 1.0f)), std::invalid_argument);
  EXPECT_THROW(Signature(a).similarities(Signature(a.colRange(0, 6).clone())), std::invalid_argument);
}

}  // namespace
}  // namespace intensity_place_recognition
