// SPDX-License-Identifier: BSD-3-Clause
#include <gtest/gtest.h>

#include <cmath>
#include <stdexcept>

#include "intensity_place_recognition/scene_description.h"
#include "test_street.h"

namespace intensity_place_recognition {
namespace {

const mapping_common::ArchiveFormat kFormat{"DESCRIBE", "a description", 2, 2};

// As a recogniser uses it.
class Described {
 public:
  explicit Described(const DescriptionOptions& options)
      : options_(options), description_(makeDescription(options)) {}

  std::shared_ptr<const Signature> describe(const Cloud& cloud) const {
    const PanoramaOptions panorama;
    return description_->describe(
        {cloud, panorama.min_range, [&] { return viewsOf(toPanorama(cloud, panorama, 4), options_); }});
  }
  void add(unsigned seed, const Eigen::Isometry3d& pose) {
    description_->add(describe(Street(seed).scan(pose)));
  }
  std::vector<Candidate> candidates(unsigned seed, const Eigen::Isometry3d& pose, int count = 1,
                                    int before = 100) const {
    return description_->candidates(*describe(Street(seed).scan(pose)), before, count, 2);
  }
  SceneDescription& operator*() const { return *description_; }
  SceneDescription* operator->() const { return description_.get(); }

 private:
  DescriptionOptions options_;
  std::unique_ptr<SceneDescription> description_;
};

DescriptionOptions optionsOf(const std::string& type) {
  DescriptionOptions options;
  options.type = type;
  options.psi = 0.4;  // as dense as the scans of streets are
  return options;
}

double apart(double a, double b) {
  return std::abs(std::remainder(a - b, 2.0 * M_PI));
}

class Description : public ::testing::TestWithParam<std::string> {};

TEST_P(Description, TellsTheYawOfATurnedScan) {
  Described description(optionsOf(GetParam()));
  for (unsigned seed = 1; seed <= 3; ++seed) description.add(seed, Street::at(0.0, 0.0, 0.0));
  for (const double yaw : {0.7, -1.9}) {
    const auto found = description.candidates(1, Street::at(0.0, 0.0, yaw));
    ASSERT_EQ(1u, found.size());
    EXPECT_EQ(0, found[0].place);
    EXPECT_LT(apart(yaw, found[0].yaws.at(0)), 0.035) << found[0].yaws[0];
  }
}

TEST_P(Description, IsMoreLikeItselfThanOthers) {
  Described description(optionsOf(GetParam()));
  for (unsigned seed = 1; seed < 6; ++seed) description.add(seed, Street::at(0.0, 0.0, 0.0));
  EXPECT_EQ(5, description->places());
  const Eigen::Isometry3d beside = Street::at(0.5, 0.3, 2.0);
  const auto found = description.candidates(3, beside, 5);
  ASSERT_FALSE(found.empty());
  EXPECT_EQ(2, found[0].place);
  EXPECT_LT(apart(2.0, found[0].yaws.at(0)), 0.05);
  for (std::size_t i = 1; i < found.size(); ++i) EXPECT_GT(found[0].similarity, found[i].similarity);
  for (const Candidate& candidate : description.candidates(3, beside, 5, 2)) EXPECT_LT(candidate.place, 2);
  description.add(3, beside);
  for (int i = 0; i < 5; ++i) {
    EXPECT_NEAR(description->similarity(5, i), description->similarity(i, 5), 1e-5);
    EXPECT_GE(description->similarity(5, 2), description->similarity(5, i));
  }
}

TEST_P(Description, IsTheSameFromAFile) {
  Described written(optionsOf(GetParam())), read(optionsOf(GetParam()));
  for (unsigned seed = 1; seed <= 3; ++seed) written.add(seed, Street::at(0.0, 0.0, 0.0));
  const std::string file =
      mapping_common::toArchive(kFormat, [&](mapping_common::ArchiveWriter& out) { written->write(out); });
  mapping_common::readArchive(file.data(), file.data() + file.size(), "it", kFormat,
                              [&](mapping_common::ArchiveReader& in) { read->read(in); });
  ASSERT_EQ(3, read->places());
  const Eigen::Isometry3d again = Street::at(0.3, -0.2, 1.0);
  const auto a = written.candidates(2, again, 3), b = read.candidates(2, again, 3);
  ASSERT_EQ(a.size(), b.size());
  for (std::size_t i = 0; i < a.size(); ++i) {
    EXPECT_EQ(a[i].place, b[i].place);
    EXPECT_EQ(a[i].similarity, b[i].similarity);
    EXPECT_EQ(a[i].yaws, b[i].yaws);
  }
}

INSTANTIATE_TEST_SUITE_P(All, Description, ::testing::ValuesIn(namesOf(sceneDescriptions())));

class ViewDescription : public ::testing::TestWithParam<std::string> {};

TEST_P(ViewDescription, FindsPlacesInViewsAheadAndBack) {
  DescriptionOptions options = optionsOf(GetParam());
  options.views = Views::kFrontAndBack;
  Described both(options);
  options.views = Views::kFront;
  Described front(options);
  for (unsigned seed = 1; seed < 6; ++seed) {
    both.add(seed, Street::at(0.0, 0.0, 0.0));
    front.add(seed, Street::at(0.0, 0.0, 0.0));
  }
  const Eigen::Isometry3d ahead = Street::at(0.4, 0.1, 0.05), back = Street::at(0.4, 0.1, M_PI + 0.05);
  for (const Described* description : {&both, &front}) {
    const auto found = description->candidates(4, ahead);
    ASSERT_EQ(1u, found.size());
    EXPECT_EQ(3, found[0].place);
    EXPECT_LT(apart(0.0, found[0].yaws.at(0)), 0.1);
  }
  const auto found = both.candidates(4, back);
  ASSERT_EQ(1u, found.size());
  EXPECT_EQ(3, found[0].place);
  EXPECT_LT(apart(M_PI, found[0].yaws.at(0)), 0.1);
  both.add(4, back);
  front.add(4, back);
  EXPECT_GT(both->similarity(5, 3), 1.01f * front->similarity(5, 3));
}

INSTANTIATE_TEST_SUITE_P(All, ViewDescription, ::testing::Values("hog", "gist", "words", "binary"));

TEST(View, TellsTheAzimuthOfItsPixels) {
  Panorama panorama = toPanorama(Street(1).scan(Street::at(0.0, 0.0, 0.0)), {}, 4);
  DescriptionOptions options;
  const View all = viewsOf(panorama, options).at(0);
  const Eigen::Vector3d middle = panorama.directionOf({100.0, 30.0});
  EXPECT_NEAR(std::atan2(middle.y(), middle.x()), all.azimuthAt(100.0), 1e-9);
  options.views = Views::kFrontAndBack;
  const std::vector<View> views = viewsOf(panorama, options);
  ASSERT_EQ(2u, views.size());
  EXPECT_NEAR(M_PI / 4.0, views[0].azimuthAt(-0.5), 1e-6);
  EXPECT_NEAR(0.0, views[0].azimuthAt(0.5 * views[0].image.cols - 0.5), 1e-9);
  EXPECT_NEAR(-3.0 * M_PI / 4.0, views[1].azimuthAt(-0.5), 1e-6);
  // The edge of a panorama is what is on its other side, that of a view itself.
  EXPECT_EQ(all.image(5, 0), all.padded(3, 2)(7, all.image.cols + 3));
  EXPECT_EQ(views[0].image(0, 0), views[0].padded(3, 2)(0, 0));
}

TEST(DescriptionOptions, AreRefusedWhereTheyDontFit) {
  DescriptionOptions options;
  options.views = Views::kFront;
  for (const char* type : {"polar", "shot", "shot_colour", "surf"}) {
    options.type = type;
    EXPECT_THROW(makeDescription(options), std::invalid_argument) << type;
  }
  options.type = "words";
  EXPECT_NO_THROW(makeDescription(options));
  for (double* bad : {&options.delta, &options.psi, &options.field_of_view}) {
    const double good = *bad;
    *bad = 0.0;
    EXPECT_THROW(makeDescription(options), std::invalid_argument);
    *bad = good;
  }
}

}  // namespace
}  // namespace intensity_place_recognition
