// SPDX-License-Identifier: BSD-3-Clause
//
// The simulated street: its images are those of the poses that come with them, and the detector knows it
// again.
#include <gtest/gtest.h>
#include <mapping_common/files.h>
#include <mapping_common/testing/temp_dir.h>

#include <cstdlib>
#include <numeric>
#include <opencv2/imgcodecs.hpp>
#include <opencv2/imgproc.hpp>
#include <string>
#include <vector>

#include "../tools/scene.h"
#include "../tools/street.h"
#include "ibuild_loop_closure/evaluation.h"
#include "ibuild_loop_closure/loop_detector.h"

namespace ibuild_loop_closure {
namespace {

class SimulateWalks : public ::testing::Test {
 protected:
  // Its exit status.
  int run(const std::string& arguments) const {
    const std::string command =
        std::string(SIMULATE_WALKS) + ' ' + arguments + " > " + dir_.path("log") + " 2>&1";
    return WEXITSTATUS(std::system(command.c_str()));
  }
  std::string walks(const std::string& name, const std::string& arguments) const {
    EXPECT_EQ(0, run("--out " + dir_.path(name) + ' ' + arguments)) << log();
    return dir_.path(name);
  }
  std::string log() const { return mapping_common::readFile(dir_.path("log")); }
  const mapping_common::TempDir dir_;
};

std::string imageFile(const std::string& walks, bool second, int image) {
  return walks + (second ? "/second" : "/first") + cv::format("/%04d.jpg", image);
}

std::vector<Eigen::Isometry3d> posesOf(const std::string& walks, int images) {
  std::vector<int> ids(2 * images);
  std::iota(ids.begin(), ids.end(), 0);
  return loadPoses(walks + "/poses.txt", ids);
}

// Pixel to pixel, for points on the plane normal . p = distance.
cv::Mat homography(const cv::Mat& k, const Eigen::Isometry3d& from, const Eigen::Isometry3d& to,
                   const Eigen::Vector3d& normal, double distance) {
  const Eigen::Isometry3d motion = to.inverse() * from;
  const Eigen::Vector3d n = from.linear().transpose() * normal;
  const double d = distance - normal.dot(from.translation());
  const Eigen::Matrix3d h = motion.linear() + motion.translation() * n.transpose() / d;
  cv::Mat h_cv(3, 3, CV_64F);
  for (int i = 0; i < 9; ++i) h_cv.at<double>(i / 3, i % 3) = h(i / 3, i % 3);
  return k * h_cv * k.inv();
}

double correlation(const cv::Mat& a, const cv::Mat& b) {
  cv::Mat result;
  cv::matchTemplate(a, b, result, cv::TM_CCOEFF_NORMED);
  return result.at<float>(0, 0);
}

TEST(Scene, APointLandsWhereThePoseSays) {
  constexpr double kResolution = 50;
  cv::Mat wall(200, 400, CV_8UC4, cv::Scalar(0, 0, 0, 255));
  cv::circle(wall, {300, 80}, 5, cv::Scalar(255, 255, 255, 255), cv::FILLED);
  const Eigen::Vector3d corner(2, 3, 4), along(1, 0, 0), down(0, 0, -1);
  const Eigen::Vector3d dot = corner + (300.5 * along + 80.5 * down) / kResolution;
  const Pinhole camera{{640, 360}, 400, 319.5, 179.5};
  Eigen::Isometry3d pose = Eigen::Isometry3d::Identity();
  pose.linear().col(0) = Eigen::Vector3d(0.6, -0.8, 0);
  pose.linear().col(1) = Eigen::Vector3d(0, 0, -1);
  pose.linear().col(2) = Eigen::Vector3d(0.8, 0.6, 0);
  pose.linear() = pose.linear() * Eigen::AngleAxisd(0.1, Eigen::Vector3d(0.5, 0.3, 0.7).normalized());
  pose.translation() << 1, -1, 1.5;
  const cv::Mat image =
      render({{corner, along, down, std::make_shared<Texture>(wall, kResolution)}}, camera, pose);

  const Eigen::Vector3d seen = pose.inverse() * dot;
  const double u = 400 * seen.x() / seen.z() + 319.5, v = 400 * seen.y() / seen.z() + 179.5;
  cv::Mat grey;
  cv::cvtColor(image, grey, cv::COLOR_BGR2GRAY);
  const cv::Rect around(cvRound(u) - 12, cvRound(v) - 12, 25, 25);
  const cv::Moments m = cv::moments(grey(around));
  ASSERT_GT(m.m00, 255 * 10);
  EXPECT_NEAR(u, around.x + m.m10 / m.m00, 0.2);
  EXPECT_NEAR(v, around.y + m.m01 / m.m00, 0.2);
}

TEST(Scene, NearerSurfacesHideFartherOnes) {
  const auto texture = [](const cv::Scalar& color) {
    return std::make_shared<Texture>(cv::Mat(64, 64, CV_8UC4, color), 16);
  };
  const Eigen::Vector3d x = Eigen::Vector3d::UnitX(), y = Eigen::Vector3d::UnitY();
  const Surface near{{-1, -1, 2}, x, y, texture({0, 0, 0, 0})},
      middle{{-2, -2, 3}, x, y, texture({0, 200, 0, 255})}, far{{-2, -2, 4}, x, y, texture({200, 0, 0, 255})},
      behind{{-2, -2, -3}, x, y, texture({0, 0, 200, 255})};
  const cv::Mat image =
      render({far, behind, near, middle}, {{33, 33}, 40, 16, 16}, Eigen::Isometry3d::Identity());
  EXPECT_EQ(cv::Vec3b(0, 200, 0), image.at<cv::Vec3b>(16, 16));
}

TEST_F(SimulateWalks, SameSeedSameImages) {
  const std::string small = "--images 2 --width 160 --height 90 --seed ";
  const std::string a = walks("a", small + "5"), b = walks("b", small + "5"), c = walks("c", small + "6");
  const auto bytes = [](const std::string& dir) {
    return mapping_common::readFile(imageFile(dir, false, 1)) +
           mapping_common::readFile(imageFile(dir, true, 1)) + mapping_common::readFile(dir + "/poses.txt");
  };
  EXPECT_EQ(bytes(a), bytes(b));
  EXPECT_NE(bytes(a), bytes(c));
}

// What the first image shows of the left house fronts, moved by the plane's homography, is what others show.
TEST_F(SimulateWalks, ImagesAreThoseOfThePoses) {
  const std::string dir = walks("w", "--images 4 --people 0 --noise 0 --exposure 1 --sway 5 --seed 3");
  const std::vector<Eigen::Isometry3d> poses = posesOf(dir, 4);
  const cv::Mat k = (cv::Mat_<double>(3, 3) << 0.62 * 640, 0, 319.5, 0, 0.62 * 640, 179.5, 0, 0, 1);
  const cv::Mat first = cv::imread(imageFile(dir, false, 0), cv::IMREAD_GRAYSCALE);
  for (int other : {3, 4, 7}) {  // counted over both walks
    const cv::Mat image = cv::imread(imageFile(dir, other >= 4, other % 4), cv::IMREAD_GRAYSCALE);
    cv::Mat moved, same_place;
    const auto warped = [&](const Eigen::Isometry3d& to) {
      cv::Mat out;
      cv::warpPerspective(first, out, homography(k, poses[0], to, Eigen::Vector3d::UnitY(), kStreetLeft),
                          image.size());
      return out;
    };
    const cv::Rect fronts(100, 100, 90, 120);
    EXPECT_GT(correlation(warped(poses[other])(fronts), image(fronts)), 0.9) << other;
    Eigen::Isometry3d wrong = poses[other];
    wrong.translation().x() += 0.3;
    EXPECT_LT(correlation(warped(wrong)(fronts), image(fronts)), 0.9) << other;
  }
}

TEST_F(SimulateWalks, TheDetectorFindsTheSecondWalk) {
  constexpr int kImages = 24;
  const std::string dir = walks("w", "--images 24 --step 1 --people 6 --seed 2");
  const GroundTruth truth = GroundTruth::fromPoses(posesOf(dir, kImages), 3.0, 0.5, kImages / 2);
  EXPECT_EQ(kImages, truth.loops());
  LoopDetector detector;
  std::vector<Proposal> loops;
  for (int i = 0; i < 2 * kImages; ++i) {
    const cv::Mat image = cv::imread(imageFile(dir, i >= kImages, i % kImages), cv::IMREAD_GRAYSCALE);
    const Detection d = detector.process({image, {}, {}});
    if (d.accepted) loops.push_back({i, d.best->match, d.best->similarity, true});
  }
  const PrecisionRecall result = evaluate(loops, truth);
  EXPECT_EQ(result.detected, result.correct);
  EXPECT_GE(result.recall(), 0.5);
}

TEST_F(SimulateWalks, SaysWhatIsWrong) {
  EXPECT_EQ(2, run("--seed 1"));
  EXPECT_NE(std::string::npos, log().find("out")) << log();
  EXPECT_EQ(1, run("--images 0 --out " + dir_.path("w")));
  EXPECT_NE(std::string::npos, log().find("--images is 0, allowed is 1 to 1000")) << log();
  EXPECT_EQ(0, run("--help"));
  EXPECT_NE(std::string::npos, log().find("--seed")) << log();
}

}  // namespace
}  // namespace ibuild_loop_closure
