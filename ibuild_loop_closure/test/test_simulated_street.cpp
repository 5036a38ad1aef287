// SPDX-License-Identifier: BSD-3-Clause
//
// The simulated street: its images are those of the poses that come with them, and the detector knows it
// again.
#include <gtest/gtest.h>

#include <opencv2/imgproc.hpp>
#include <vector>

#include "ibuild_loop_closure/evaluation.h"
#include "ibuild_loop_closure/loop_detector.h"
#include "simulated_street.h"

namespace ibuild_loop_closure {
namespace {

constexpr double kFronts = 5.5;  // y of the houses on the left, m

// Pixel to pixel, for points on the plane normal . p = distance.
cv::Mat homography(const mapping_simulation::CameraModel& camera, const Eigen::Isometry3d& from,
                   const Eigen::Isometry3d& to, const Eigen::Vector3d& normal, double distance) {
  const Eigen::Isometry3d motion = to.inverse() * from;
  const Eigen::Vector3d n = from.linear().transpose() * normal;
  const double d = distance - normal.dot(from.translation());
  const Eigen::Matrix3d h = motion.linear() + motion.translation() * n.transpose() / d;
  const cv::Mat k = (cv::Mat_<double>(3, 3) << camera.fx, 0, camera.cx, 0, camera.fy, camera.cy, 0, 0, 1);
  cv::Mat h_cv(3, 3, CV_64F);
  for (int i = 0; i < 9; ++i) h_cv.at<double>(i / 3, i % 3) = h(i / 3, i % 3);
  return k * h_cv * k.inv();
}

double correlation(const cv::Mat& a, const cv::Mat& b) {
  cv::Mat result;
  cv::matchTemplate(a, b, result, cv::TM_CCOEFF_NORMED);
  return result.at<float>(0, 0);
}

// What the first image shows of the left house fronts, moved by the plane's homography, is what others show.
TEST(SimulatedStreet, ImagesAreThoseOfThePoses) {
  SimulatedStreet street;
  street.camera().noise = 0.0;
  const Eigen::Isometry3d first = street.poseAt(33, 0, 0.03);
  const cv::Mat image = street.imageAt(first);
  const cv::Rect fronts(100, 60, 90, 120);
  for (const Eigen::Isometry3d& pose : {street.poseAt(34.5, 0.2, -0.05), street.poseAt(33.4, 1.0, 0.02)}) {
    const cv::Mat other = street.imageAt(pose);
    const auto likeness = [&](const Eigen::Isometry3d& to) {
      cv::Mat moved;
      cv::warpPerspective(image, moved,
                          homography(street.camera(), first, to, Eigen::Vector3d::UnitY(), kFronts),
                          image.size());
      return correlation(moved(fronts), other(fronts));
    };
    EXPECT_GT(likeness(pose), 0.9);
    EXPECT_LT(likeness(Eigen::Translation3d(0.3, 0, 0) * pose), 0.9);
  }
}

TEST(SimulatedStreet, TheDetectorFindsTheSecondWalk) {
  constexpr int kImages = 24;
  constexpr double kInterval = 1.0 / 1.5, kFrom = 24.0, kSecondWalk = 40.0;  // s
  SimulatedStreet street(2);
  std::vector<Eigen::Isometry3d> poses;
  std::vector<Proposal> loops;
  LoopDetector detector;
  for (int i = 0; i < 2 * kImages; ++i) {
    const double time = kFrom + i % kImages * kInterval + (i < kImages ? 0.0 : kSecondWalk);
    poses.push_back(street.walkAt(time));
    const Detection d = detector.process({street.imageAt(poses.back(), 1.0, time), {}, {}});
    if (d.accepted) loops.push_back({i, d.best->match, d.best->similarity, true});
  }
  const GroundTruth truth = GroundTruth::fromPoses(poses, 3.0, 0.5, kImages / 2);
  EXPECT_EQ(kImages, truth.loops());
  const PrecisionRecall result = evaluate(loops, truth);
  EXPECT_EQ(result.detected, result.correct);
  EXPECT_GE(result.recall(), 0.5);
}

// Doors and panels come again every ten metres, and what is far away stays in view.
TEST(SimulatedCorridor, ThatIsWalkedAlongOnceHasNoLoop) {
  constexpr int kImages = 50;
  SimulatedStreet corridor(1, "corridor_textured");
  corridor.camera().width /= 2;
  corridor.camera().height /= 2;
  for (double* length :
       {&corridor.camera().fx, &corridor.camera().fy, &corridor.camera().cx, &corridor.camera().cy})
    *length /= 2.0;
  LoopDetectorOptions options;
  options.features.descriptor = "upright_brisk";  // the easiest to deceive
  options.geometry.delta = 115;
  LoopDetector detector(options);
  options.leave_first = false;
  LoopDetector trustful(options);
  int deceived = 0;
  for (int i = 0; i < kImages; ++i) {
    const cv::Mat image = corridor.imageAt(corridor.walkAt(i), 1.0, i);  // 0.8 m after the last one
    EXPECT_FALSE(detector.process({image, {}, {}}).accepted) << i;
    deceived += trustful.process({image, {}, {}}).accepted;
  }
  EXPECT_GT(deceived, kImages / 4);
}

}  // namespace
}  // namespace ibuild_loop_closure
