// SPDX-License-Identifier: BSD-3-Clause
//
// Depth by stereo, and the relative pose that comes of it, in a rendered street whose geometry is known.
#include <gtest/gtest.h>

#include <algorithm>
#include <stdexcept>
#include <vector>

#include "ibuild_loop_closure/loop_detector.h"
#include "simulated_street.h"
#include "test_images.h"

namespace ibuild_loop_closure {
namespace {

constexpr double kBaseline = 0.3;  // m

class Street : public ::testing::Test {
 protected:
  Street() {
    street_.camera().fx = street_.camera().fy = camera_.fx;
    street_.camera().cx = camera_.cx;
    street_.camera().cy = camera_.cy;
  }
  cv::Mat rightOf(const Eigen::Isometry3d& left, double exposure = 1.0) {
    return street_.imageAt(left * Eigen::Translation3d(kBaseline, 0, 0), exposure);
  }
  const Camera camera_{400, 400, 319.5, 179.5};
  SimulatedStreet street_;
};

TEST_F(Street, DisparitiesAreThoseOfItsGeometry) {
  const Eigen::Isometry3d pose = street_.poseAt(10, 0, 0.1);
  const cv::Mat left = street_.imageAt(pose),
                right = rightOf(pose, 0.8);  // the two cameras expose differently
  const Features features = FeatureExtractor().extract(left);
  const std::vector<float> disparities = disparitiesAt(left, right, features.points, {});
  ASSERT_EQ(features.size(), disparities.size());
  int known = 0, good = 0;
  for (std::size_t i = 0; i < disparities.size(); ++i) {
    if (disparities[i] <= 0.0f) continue;
    ++known;
    good +=
        std::abs(disparities[i] - camera_.fx * kBaseline / street_.depthAt(pose, features.points[i])) < 0.5;
  }
  EXPECT_GT(known, 0.5 * features.size());
  EXPECT_GT(good, 0.95 * known);
}

TEST_F(Street, GivesTheRelativePose) {
  const FeatureExtractor extractor;
  const auto viewAt = [&](const cv::Mat& image) {
    View view;
    view.features = extractor.extract(image);
    view.size = image.size();
    return view;
  };
  for (const double x : {5.0, 30.0}) {
    const Eigen::Isometry3d match_pose = street_.poseAt(x, -0.4, 0.02),
                            query_pose = street_.poseAt(x + 0.6, 0.5, -0.03);
    const cv::Mat left = street_.imageAt(match_pose);
    View match = viewAt(left);
    match.depths = disparitiesAt(left, rightOf(match_pose), match.features.points, {});
    for (float& d : match.depths) d = d > 0.0f ? static_cast<float>(camera_.fx * kBaseline / d) : 0.0f;
    const View query = viewAt(street_.imageAt(query_pose, 0.7));
    GeometryResult result = checkLayout(query, match, {});
    verify(query, match, camera_, {}, result);
    ASSERT_TRUE(result.pose) << x;
    const Eigen::Isometry3d error = (match_pose.inverse() * query_pose).inverse() * result.pose->transform;
    EXPECT_LT(error.translation().norm(), 0.1) << x;
    EXPECT_LT(Eigen::AngleAxisd(error.linear()).angle(), 0.01) << x;
  }
}

TEST(Disparities, AreUnknownWhereTheyAreAmbiguousOrWrong) {
  const cv::Mat left = renderPlace(0), other = renderPlace(5);
  const Features features = FeatureExtractor().extract(left);
  const auto known = [&](const cv::Mat& right, const std::vector<cv::Point2f>& points) {
    const auto disparities = disparitiesAt(left, right, points, {});
    return std::count_if(disparities.begin(), disparities.end(), [](float d) { return d > 0.0f; });
  };
  EXPECT_GT(known(renderPlace(0, 12), features.points), 0.6 * features.size());
  EXPECT_LT(known(other, features.points), 0.1 * features.size());
  EXPECT_EQ(0, known(left, features.points));                                      // infinitely far away
  EXPECT_LT(known(renderPlace(0, -12), features.points), 0.12 * features.size());  // left and right exchanged
  EXPECT_EQ(0, known(left, {{0, 0}, {319, 239}, {2, 120}, {318, 5}}));             // at the border
  cv::Mat fence(240, 320, CV_8UC1, cv::Scalar(80));
  for (int x = 0; x < 320; x += 16) fence.colRange(x, x + 4).setTo(200);
  const auto disparities = disparitiesAt(fence, fence, {{162, 120}, {146, 60}}, {});
  EXPECT_EQ((std::vector<float>{0.0f, 0.0f}), disparities);
}

TEST(Stereo, GivesThePoseOfALoop) {  // a wall 2 m away: a shift of the image is one of the camera
  const Camera camera = {300.0, 300.0, 160.0, 120.0};
  constexpr int kWalk = 24, kDisparity = 15;
  constexpr double kPixel = 2.0 / 300.0;  // m
  LoopDetector detector;
  int with_pose = 0;
  for (int i = 0; i < 2 * kWalk; ++i) {
    const int offset = i < kWalk ? 0 : 4;
    Frame frame{renderWalk(i % kWalk, offset), {}, camera};
    frame.right = {renderWalk(i % kWalk, offset + kDisparity), kDisparity * kPixel, camera.cx};
    const Detection d = detector.process(frame);
    if (!d.accepted || !d.best->geometry.pose) continue;
    ++with_pose;
    const auto shift = [](int image) { return 6 * (image % 4) + (image >= kWalk ? 4 : 0); };
    const Eigen::Vector3d t = d.best->geometry.pose->transform.translation();
    EXPECT_NEAR(kPixel * (shift(i) - shift(d.best->match)), t.x(), 0.03);
    EXPECT_NEAR(0.0, t.z(), 0.05);
  }
  EXPECT_GT(with_pose, kWalk / 2);
}

TEST(Stereo, RefusesAPairThatIsNone) {
  LoopDetector detector;
  const cv::Mat image = renderWalk(0);
  const auto refuses = [&](const cv::Mat& depth, const RightImage& right) {
    Frame frame{image, depth, Camera{300, 300, 160, 120}};
    frame.right = right;
    EXPECT_THROW(detector.process(frame), std::invalid_argument);
  };
  refuses(cv::Mat(240, 320, CV_32FC1, cv::Scalar(1)), {image, 0.1, 160});  // depth and stereo
  refuses({}, {image(cv::Rect(0, 0, 100, 100)), 0.1, 160});
  refuses({}, {cv::Mat(), 0.1, 160});
  refuses({}, {image, 0.0, 160});
  EXPECT_EQ(0, detector.images());
  StereoOptions options;
  options.window = 10;
  EXPECT_THROW(mapping_common::validate(options), std::invalid_argument);
}

}  // namespace
}  // namespace ibuild_loop_closure
