// SPDX-License-Identifier: BSD-3-Clause
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <random>

#include "ibuild_loop_closure/geometry.h"
#include "random_descriptors.h"

namespace ibuild_loop_closure {
namespace {

const Camera kCamera = {500.0, 500.0, 320.0, 240.0};

// Points in space seen by two cameras: the match at the origin, the query at `pose` from it.
struct Scene {
  View query, match;
};

Scene makeScene(const Eigen::Isometry3d& pose, int points, double noise, unsigned seed = 1) {
  std::mt19937_64 random(seed);
  std::uniform_real_distribution<double> x(-2.0, 2.0), y(-1.5, 1.5), z(3.0, 8.0);
  std::normal_distribution<double> error(0.0, noise > 0.0 ? noise : 1.0);
  Scene scene;
  scene.query.size = scene.match.size = {640, 480};
  const auto project = [&](const Eigen::Vector3d& p) {
    const double e = noise > 0.0 ? error(random) : 0.0, f = noise > 0.0 ? error(random) : 0.0;
    return cv::Point2f(static_cast<float>(kCamera.fx * p.x() / p.z() + kCamera.cx + e),
                       static_cast<float>(kCamera.fy * p.y() / p.z() + kCamera.cy + f));
  };
  for (int i = 0; i < points; ++i) {
    const Eigen::Vector3d p(x(random), y(random), z(random));
    const Descriptor d = randomDescriptor(random);
    scene.match.features.points.push_back(project(p));
    scene.match.features.descriptors.push_back(d);
    scene.match.depths.push_back(static_cast<float>(p.z()));
    scene.query.features.points.push_back(project(pose.inverse() * p));
    scene.query.features.descriptors.push_back(flip(d, 20));
  }
  return scene;
}

Eigen::Isometry3d smallMotion() {
  Eigen::Isometry3d pose(Eigen::AngleAxisd(0.08, Eigen::Vector3d(0.2, 1.0, 0.1).normalized()));
  pose.translation() << 0.3, -0.1, 0.25;
  return pose;
}

// Gives `count` features of the query the positions of others.
void confuse(View& view, int count) {
  for (int i = 0; i + 1 < count; ++i) std::swap(view.features.points[i], view.features.points[i + 1]);
}

TEST(Layout, OfTheSamePlaceIsSignificant) {
  const Scene scene = makeScene(smallMotion(), 60, 0.5);
  const GeometryResult result = checkLayout(scene.query, scene.match, {});
  EXPECT_EQ(60, result.matches);
  EXPECT_GT(result.significance, 20.0);
  EXPECT_NEAR(1.0, result.placement.scale, 0.15);
  EXPECT_GT(result.overlap, 0.7);
}

TEST(Layout, OfPositionsAtRandomIsNot) {
  for (unsigned seed = 1; seed <= 20; ++seed) {
    Scene scene = makeScene(smallMotion(), 60, 0.5, seed);
    std::mt19937_64 random(seed);
    std::shuffle(scene.query.features.points.begin(), scene.query.features.points.end(), random);
    EXPECT_LT(checkLayout(scene.query, scene.match, {}).significance, 4.0) << seed;
  }
}

// Of 24 features 7 are where the layout has them.
TEST(Layout, ThatIsLikeAnotherNeedsFewerFeatures) {
  int insignificant = 0;
  for (unsigned seed = 1; seed <= 20; ++seed) {
    Scene scene = makeScene(smallMotion(), 24, 0.5, seed);
    const Placement placement = checkLayout(scene.query, scene.match, {}).placement;
    std::mt19937_64 random(seed);
    std::shuffle(scene.query.features.points.begin() + 7, scene.query.features.points.end(), random);
    insignificant += checkLayout(scene.query, scene.match, {}).significance < 4.0;
    const GeometryResult like = checkLayout(scene.query, scene.match, {}, placement);
    EXPECT_GE(like.significance, 4.0) << seed;
    EXPECT_NEAR(placement.rotation, like.placement.rotation, 0.25) << seed;
    Placement other = placement;
    other.rotation += 1.0;
    EXPECT_LT(checkLayout(scene.query, scene.match, {}, other).significance, 4.0) << seed;
    std::shuffle(scene.query.features.points.begin(), scene.query.features.points.end(), random);
    EXPECT_LT(checkLayout(scene.query, scene.match, {}, placement).significance, 4.0) << seed;
  }
  EXPECT_GT(insignificant, 5);
}

TEST(Layout, SaysWhereItPutsTheImage) {
  Scene scene = makeScene(Eigen::Isometry3d::Identity(), 60, 0.0);
  for (cv::Point2f& p : scene.query.features.points)  // half the size, turned by 90 degrees
    p = cv::Point2f(320.0f + 0.5f * (p.y - 240.0f), 240.0f - 0.5f * (p.x - 320.0f) + 32.0f);
  GeometryOptions options;
  options.min_overlap = 0.0;
  const Placement placement = checkLayout(scene.query, scene.match, options).placement;
  EXPECT_NEAR(2.0, placement.scale, 1e-4);
  EXPECT_NEAR(CV_PI / 2.0, placement.rotation, 1e-4);
  EXPECT_NEAR(0.1, placement.shift.x, 1e-4);  // 2 * 32 of 640 pixels
  EXPECT_NEAR(0.0, placement.shift.y, 1e-4);
}

// A camera that goes 10 % of the way to a wall and turns to the right.
TEST(Motion, IsTheTurnAndTheExpansion) {
  Scene scene = makeScene(Eigen::Isometry3d::Identity(), 60, 0.0);
  std::vector<Match> matches;
  for (int i = 0; i < 60; ++i) {
    cv::Point2f& p = scene.query.features.points[i];
    p = (p - cv::Point2f(320.0f, 240.0f)) / 0.9f + cv::Point2f(320.0f - 64.0f, 240.0f);
    matches.push_back({i, i, 0});
  }
  confuse(scene.query, 12);
  const auto motion = motionSince(scene.match.features, scene.query, matches, {});
  ASSERT_TRUE(motion);
  EXPECT_NEAR(0.09, motion->turn, 0.01);  // 64 of 640 pixels, of those before
  EXPECT_NEAR(-std::log(0.9), motion->expansion, 0.02);
  matches.resize(3);
  EXPECT_FALSE(motionSince(scene.match.features, scene.query, matches, {}));
  EXPECT_FALSE(motionSince(scene.match.features, scene.query, {}, {}));
}

TEST(Layout, OfOneSpotIsNotSignificant) {
  Scene scene = makeScene(Eigen::Isometry3d::Identity(), 60, 0.0);
  for (std::size_t i = 0; i < 60; ++i) {
    scene.query.features.points[i] = scene.match.features.points[i] = {100.0f + 0.01f * i, 100.0f};
  }
  EXPECT_LE(checkLayout(scene.query, scene.match, {}).significance, 0.0);
}

TEST(Layout, OfFewOrNoFeaturesSaysNothing) {
  const Scene two = makeScene(smallMotion(), 2, 0.0);
  EXPECT_EQ(0.0, checkLayout(two.query, two.match, {}).significance);
  EXPECT_EQ(0.0, checkLayout({}, two.match, {}).significance);
  EXPECT_EQ(0.0, checkLayout(two.query, {}, {}).significance);
}

TEST(Layout, RejectsTooLittleOverlap) {
  Scene scene = makeScene(Eigen::Isometry3d::Identity(), 60, 0.5);
  for (cv::Point2f& p : scene.query.features.points) p.x += 450.0f;
  Scene near = makeScene(Eigen::Isometry3d::Identity(), 60, 0.5);  // half as far away
  for (cv::Point2f& p : near.query.features.points) p = 2.0f * p - cv::Point2f(320, 240);
  for (const Scene& s : {scene, near}) {
    GeometryOptions options;
    options.min_overlap = 0.0;
    EXPECT_GT(checkLayout(s.query, s.match, options).significance, 20.0);
    EXPECT_NEAR(0.28, checkLayout(s.query, s.match, options).overlap, 0.06);
    options.min_overlap = 0.5;  // of both: the nearer view shows only a part of the other
    EXPECT_EQ(0.0, checkLayout(s.query, s.match, options).significance);
    EXPECT_EQ(0.0, checkLayout(s.match, s.query, options).significance);
  }
}

TEST(Verify, SeparatesInliersByTheEpipolarGeometry) {
  for (const bool calibrated : {false, true}) {
    Scene scene = makeScene(smallMotion(), 80, 0.3);
    scene.match.depths.clear();
    GeometryResult result = checkLayout(scene.query, scene.match, {});
    verify(scene.query, scene.match, calibrated ? std::optional<Camera>(kCamera) : std::nullopt, {}, result);
    EXPECT_TRUE(result.verified);
    EXPECT_GT(result.inliers, 40);
    EXPECT_FALSE(result.pose.has_value());
  }
}

TEST(Verify, FindsThePoseWithDepth) {
  Scene scene = makeScene(smallMotion(), 100, 0.3);
  confuse(scene.query, 30);
  GeometryResult result = checkLayout(scene.query, scene.match, {});
  verify(scene.query, scene.match, kCamera, {}, result);
  ASSERT_TRUE(result.pose.has_value());
  const Eigen::Isometry3d error = smallMotion().inverse() * result.pose->transform;
  EXPECT_LT(error.translation().norm(), 0.02);
  EXPECT_LT(Eigen::AngleAxisd(error.linear()).angle(), 0.005);
  EXPECT_GE(result.pose->inliers, 50);
}

TEST(Verify, SaysHowCertainThePoseIs) {  // errors over many scenes agree with the information
  double sum = 0.0;
  constexpr int kScenes = 60;
  for (unsigned seed = 1; seed <= kScenes; ++seed) {
    const Scene scene = makeScene(smallMotion(), 60, 1.0, seed);
    GeometryResult result = checkLayout(scene.query, scene.match, {});
    GeometryOptions wide;
    wide.epipolar_tolerance = 0.02;
    verify(scene.query, scene.match, kCamera, wide, result);
    ASSERT_TRUE(result.pose.has_value());
    const Eigen::Isometry3d& estimate = result.pose->transform;
    Eigen::Matrix<double, 6, 1> error;
    error.head<3>() =
        smallMotion().linear().transpose() * (estimate.translation() - smallMotion().translation());
    const Eigen::AngleAxisd rotation(smallMotion().linear().transpose() * estimate.linear());
    error.tail<3>() = rotation.angle() * rotation.axis();
    sum += error.dot(result.pose->information * error);
  }
  // Chi-square of 6 degrees of freedom; the match's pixels have noise, too, which the points in space don't
  // say.
  EXPECT_GT(sum / kScenes, 3.0);
  EXPECT_LT(sum / kScenes, 12.0);
}

TEST(Verify, FallsBackWhereDepthIsUnknown) {
  Scene scene = makeScene(smallMotion(), 80, 0.3);
  std::fill(scene.match.depths.begin(), scene.match.depths.end(), 0.0f);
  GeometryResult result = checkLayout(scene.query, scene.match, {});
  verify(scene.query, scene.match, kCamera, {}, result);
  EXPECT_FALSE(result.pose.has_value());
  EXPECT_TRUE(result.verified);
}

}  // namespace
}  // namespace ibuild_loop_closure
