// SPDX-License-Identifier: BSD-3-Clause
#include <gtest/gtest.h>

#include <cmath>
#include <random>

#include "intensity_hector_slam/motion_filter.h"

namespace intensity_hector_slam {
namespace {

constexpr double kPeriod = 0.05;  // s

Eigen::Matrix3d sure() {
  return Eigen::Vector3d(4e-6, 4e-6, 1e-6).asDiagonal();  // 2 mm, 1 mrad
}

Pose noisy(const Pose& pose, std::mt19937& random) {
  std::normal_distribution<double> metres(0.0, 0.002), radians(0.0, 0.001);
  return pose + Pose(metres(random), metres(random), radians(random));
}

// Moves a body and lets both filters follow it.
struct Drive {
  MotionFilter wheels{true}, carried{false};
  Pose truth = Pose::Zero(), from = Pose::Zero();
  std::mt19937 random{1};

  Drive() {
    for (MotionFilter* filter : {&wheels, &carried}) filter->start(Eigen::Vector3d::Zero(), 1.0, 2.0);
  }
  void to(const Pose& pose) {
    truth = pose;
    const Pose measured = noisy(truth, random);
    wheels.update({}, from, measured, sure(), kPeriod);
    carried.update({}, from, measured, sure(), kPeriod);
    from = measured;
  }
};

TEST(MotionFilter, ABodyOnWheelsKeepsItsVelocityInItsOwnFrame) {
  Drive drive;
  for (int i = 1; i <= 200; ++i) {
    const double angle = 0.8 * kPeriod * i;
    drive.to({std::sin(angle) / 0.8, (1.0 - std::cos(angle)) / 0.8, wrapAngle(angle)});  // 1 m/s, 0.8 rad/s
  }
  EXPECT_GT(drive.wheels.score(), drive.carried.score());
  EXPECT_NEAR(1.0, drive.wheels.velocity().x(), 0.1);
  EXPECT_NEAR(0.0, drive.wheels.velocity().y(), 0.1);
  EXPECT_NEAR(0.8, drive.wheels.velocity().z(), 0.1);
}

TEST(MotionFilter, ABodyThatIsCarriedKeepsItsVelocityInTheMap) {
  Drive drive;
  for (int i = 1; i <= 200; ++i) drive.to({kPeriod * i, 0.0, wrapAngle(0.8 * kPeriod * i)});
  EXPECT_GT(drive.carried.score(), drive.wheels.score());
  const double angle = drive.truth.z();
  EXPECT_NEAR(std::cos(angle), drive.carried.velocity().x(), 0.1);
  EXPECT_NEAR(-std::sin(angle), drive.carried.velocity().y(), 0.1);
}

TEST(MotionFilter, GoesOnWhereAScanTellsLittle) {
  MotionFilter filter(true);
  filter.start(Eigen::Vector3d::Zero(), 1.0, 2.0);
  std::mt19937 random(2);
  Pose pose = Pose::Zero();
  for (int i = 1; i <= 40; ++i) {
    pose = filter.update({}, pose, noisy({0.7 * kPeriod * i, 0.0, 0.0}, random), sure(), kPeriod);
  }
  // For half a second all that is seen is a wall along the way, which holds the match where it was.
  Eigen::Matrix3d along = sure();
  along(0, 0) = 0.3 * 0.3;
  for (int i = 41; i <= 50; ++i) {
    pose = filter.update({}, pose, noisy({pose.x(), 0.0, 0.0}, random), along, kPeriod);
  }
  EXPECT_NEAR(0.7 * kPeriod * 50, pose.x(), 0.1);
  EXPECT_NEAR(0.0, pose.y(), 0.005);
}

TEST(MotionFilter, FollowsAPush) {
  MotionFilter filter(true);
  filter.start(Eigen::Vector3d::Zero(), 1.0, 2.0);
  Pose pose = Pose::Zero();
  for (int i = 0; i < 40; ++i) pose = filter.update({}, pose, Pose::Zero(), sure(), kPeriod);
  pose = filter.update({}, pose, {0.3, 0.1, 0.2}, sure(), kPeriod);
  EXPECT_NEAR(0.3, pose.x(), 0.005);
  EXPECT_NEAR(0.1, pose.y(), 0.005);
  EXPECT_NEAR(0.2, pose.z(), 0.005);
  // A pose that jumps is no velocity: 6 m/s would lead away.
  EXPECT_LE(filter.velocity().head<2>().norm(), MotionFilter::Noise().limits.linear * kPeriod + 0.01);
}

TEST(MotionFilter, IsReadyForTheWrapOfAnAngle) {
  MotionFilter filter(true);
  filter.start({0.0, 0.0, 1.0}, 1.0, 2.0);
  Pose pose(0.0, 0.0, M_PI - 0.12);
  for (int i = 1; i <= 5; ++i) {
    pose = filter.update({}, pose, {0.0, 0.0, wrapAngle(M_PI - 0.12 + kPeriod * i)}, sure(), kPeriod);
  }
  EXPECT_NEAR(wrapAngle(M_PI + 0.13), pose.z(), 0.005);
  EXPECT_NEAR(1.0, filter.velocity().z(), 0.05);
}

}  // namespace
}  // namespace intensity_hector_slam
