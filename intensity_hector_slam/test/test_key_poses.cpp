// SPDX-License-Identifier: BSD-3-Clause
#include <gtest/gtest.h>

#include <Eigen/Eigenvalues>
#include <Eigen/LU>
#include <cmath>
#include <vector>

#include "intensity_hector_slam/key_poses.h"

namespace intensity_hector_slam {
namespace {

SlamResult at(const Pose& pose) {
  SlamResult result;
  result.status = Status::kMatched;
  result.pose = pose;
  result.covariance = Eigen::Vector3d(0.01, 0.04, 0.001).asDiagonal();
  return result;
}

TEST(KeyPoses, AreApart) {
  KeyPoses key_poses(0.5, 0.3);
  EXPECT_FALSE(key_poses.add(1.0, at({0.0, 0.0, 0.0})));
  EXPECT_FALSE(key_poses.add(2.0, at({0.4, 0.0, 0.2})));
  const auto moved = key_poses.add(3.0, at({0.6, 0.0, 0.2}));
  ASSERT_TRUE(moved);
  EXPECT_EQ(0u, moved->from.id);
  EXPECT_EQ(1u, moved->to.id);
  EXPECT_EQ(1.0, moved->from.stamp);
  EXPECT_EQ(3.0, moved->to.stamp);
  EXPECT_TRUE(key_poses.add(4.0, at({0.6, 0.0, -0.2})));
}

TEST(KeyPoses, WaitForTheEndOfAQuickTurn) {
  KeyPoses key_poses(0.5, 0.5);
  key_poses.add(0.0, at(Pose::Zero()));
  double yaw = 0.0;
  int quick = 1;
  for (; yaw < 1.0; ++quick, yaw += 0.1)  // 4 rad/s
    EXPECT_FALSE(key_poses.add(0.025 * quick, at({0.0, 0.0, yaw}))) << yaw;
  const auto slow = key_poses.add(0.025 * quick, at({0.0, 0.0, yaw - 0.09}));
  ASSERT_TRUE(slow);
  EXPECT_NEAR(yaw - 0.09, slow->transform.z(), 1e-9);
  // A body that turns on is seen again before the scans have too little in common.
  int edges = 0;
  for (int i = 1; i <= 40; ++i)
    edges += key_poses.add(0.025 * (quick + i), at({0.0, 0.0, yaw - 0.09 + 0.1 * i})).has_value();
  EXPECT_EQ(2, edges);
}

TEST(KeyPoses, EdgesAreInTheFrameOfTheEarlierPose) {
  KeyPoses key_poses;
  key_poses.add(1.0, at({1.0, 1.0, M_PI / 2.0}));
  const auto edge = key_poses.add(2.0, at({1.0, 3.0, M_PI}));
  ASSERT_TRUE(edge);
  EXPECT_LT((edge->transform - Pose(2.0, 0.0, M_PI / 2.0)).norm(), 1e-12);
  // The map's y is its x. Both poses add their part, and the angle of the first turns the way of 2 m.
  const Eigen::Matrix3d covariance = edge->information.inverse();
  EXPECT_NEAR(0.04 + 0.04, covariance(0, 0), 1e-9);
  EXPECT_NEAR(0.01 + 0.01 + 2.0 * 2.0 * 0.001, covariance(1, 1), 1e-9);
  EXPECT_NEAR(0.001 + 0.001, covariance(2, 2), 1e-9);
  EXPECT_NEAR(2.0 * 0.001, covariance(1, 2), 1e-9);
}

TEST(KeyPoses, LeaveOutWhatWasNotMatched) {
  KeyPoses key_poses;
  key_poses.add(1.0, at(Pose::Zero()));
  SlamResult rejected = at({5.0, 0.0, 0.0});
  rejected.status = Status::kRejected;
  EXPECT_FALSE(key_poses.add(2.0, rejected));
  key_poses.breakChain();
  EXPECT_FALSE(key_poses.add(3.0, at({5.0, 0.0, 0.0})));
  EXPECT_EQ(2u, key_poses.add(4.0, at({6.0, 0.0, 0.0}))->to.id);
}

// Its covariance is zero, but a map of one scan is as uncertain as a match.
TEST(KeyPoses, TheStartIsAsUnsureAsWhatIsMatchedToIt) {
  KeyPoses key_poses;
  SlamResult start = at(Pose::Zero());
  start.status = Status::kStarted;
  start.covariance.setZero();
  key_poses.add(1.0, start);
  const auto edge = key_poses.add(2.0, at({2.0, 0.0, 0.0}));
  ASSERT_TRUE(edge);
  const Eigen::Matrix3d covariance = edge->information.inverse();
  EXPECT_NEAR(2.0 * 0.01, covariance(0, 0), 1e-9);
  EXPECT_NEAR(2.0 * 0.04 + 4.0 * 0.001, covariance(1, 1), 1e-9);
}

// By a metre along a wall, which turns the body a little, and by a tenth of a millimetre across it.
TEST(KeyPoses, WhatIsKnownInOneDirectionAloneHasAnInformation) {
  KeyPoses key_poses;
  SlamResult result = at({0.4, 1.6, 0.9});
  const Eigen::Vector3d along(0.84, -0.54, -0.009);
  result.covariance = 1e-8 * Eigen::Matrix3d::Identity() + along * along.transpose();
  key_poses.add(1.0, result);
  result.pose = {0.41, 1.61, 0.3};
  result.covariance = 1e-8 * Eigen::Matrix3d::Identity();
  const auto edge = key_poses.add(2.0, result);
  ASSERT_TRUE(edge);
  const Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d> solver(edge->information);
  EXPECT_NEAR(1.0, solver.eigenvalues()[0], 0.01);
  EXPECT_NEAR(0.5e8, solver.eigenvalues()[1], 1e6);
  EXPECT_NEAR(0.5e8, solver.eigenvalues()[2], 1e6);
}

TEST(KeyPoses, DriftGrowsWithTheWay) {
  KeyPoses key_poses(0.5, 0.5, {0.1, 0.2, 0.3});
  key_poses.add(1.0, at(Pose::Zero()));
  const auto edge = key_poses.add(2.0, at({4.0, 0.0, 0.5}));
  ASSERT_TRUE(edge);
  const Eigen::Matrix3d covariance = edge->information.inverse();
  EXPECT_NEAR(2.0 * 0.01 + 4.0 * 0.01, covariance(0, 0), 1e-9);
  EXPECT_NEAR(2.0 * 0.001 + 4.0 * 0.04 + 0.5 * 0.09, covariance(2, 2), 1e-9);
}

// SLAM goes on where a loop has the pose, and the next edge is of the way, not of the jump.
TEST(KeyPoses, EdgesAreNotOfAJump) {
  KeyPoses key_poses;
  key_poses.add(1.0, at({5.0, 1.0, 0.0}));
  Edge loop;
  loop.from.pose = {2.0, 0.0, M_PI / 2.0};
  loop.to.pose = {5.0, 1.0, 0.0};
  loop.transform = {1.0, -1.0, -M_PI / 2.0};
  ASSERT_TRUE(isJump(loop));
  const Pose correction = correctionOf(loop);
  EXPECT_LT((compose(correction, loop.to.pose) - Pose(3.0, 1.0, 0.0)).norm(), 1e-12);
  key_poses.correct(correction);
  const auto edge = key_poses.add(2.0, at({4.0, 1.0, 0.0}));
  ASSERT_TRUE(edge);
  EXPECT_LT((edge->transform - Pose(1.0, 0.0, 0.0)).norm(), 1e-12);
  loop.transform = between(loop.from.pose, loop.to.pose);
  EXPECT_FALSE(isJump(loop));
}

// The body went straight on by odometry, and the match moved it aside: the edge may be of either.
TEST(KeyPoses, AnEdgeIsAsUnsureAsAJump) {
  const auto sigmas = [](bool odometry, double aside, double back = 0.0) {
    KeyPoses key_poses(0.45, 0.5);
    std::vector<Eigen::Vector3d> result;
    Pose pose(0.0, 0.0, M_PI / 2.0);
    for (int i = 0; i <= 10; ++i) {
      SlamResult step = at(pose);
      step.covariance = Eigen::Vector3d(1e-4, 1e-4, 1e-6).asDiagonal();
      step.guess = pose;
      step.guess_is_odometry = odometry;
      if (i == 3) step.pose.x() = pose.x() -= aside;
      if (i == 4) step.pose.x() = pose.x() += back;
      if (const auto edge = key_poses.add(0.1 * i, step))
        result.push_back(edge->information.inverse().diagonal().cwiseSqrt());
      pose.y() += 0.1;
    }
    EXPECT_EQ(2u, result.size());
    return result;
  };
  EXPECT_NEAR(std::hypot(0.07, 0.0142), sigmas(true, 0.07)[0].y(), 5e-4);
  EXPECT_LT(sigmas(true, 0.07)[0].x(), 0.015);
  EXPECT_LT(sigmas(true, 0.07)[1].y(), 0.015);        // the next is sure again
  EXPECT_LT(sigmas(true, 0.02)[0].y(), 0.015);        // within the errors of both matches
  EXPECT_LT(sigmas(false, 0.07)[0].y(), 0.015);       // the guess knows nothing of the way
  EXPECT_LT(sigmas(true, 0.07, 0.07)[0].y(), 0.015);  // a scan between the key poses alone was off
}

TEST(KeyPoses, SayWhatIsWrong) {
  EXPECT_THROW(KeyPoses(0.0, 1.0), std::invalid_argument);
}

TEST(KeyPoses, TheNextEdgeIsTheSameInACorrectedMap) {
  SlamResult first, second;
  first.status = second.status = Status::kMatched;
  first.pose = {1.0, 2.0, 0.3};
  first.covariance = Eigen::Vector3d(1e-4, 4e-4, 1e-5).asDiagonal();
  second.pose = {2.0, 2.5, 0.6};
  second.covariance = Eigen::Vector3d(2e-4, 1e-4, 1e-5).asDiagonal();
  KeyPoses old_map, corrected;
  old_map.add(1.0, first);
  corrected.add(1.0, first);
  const auto expected = old_map.add(2.0, second);

  const Pose correction(-3.0, 1.0, 0.7);
  corrected.correct(correction);
  second.pose = compose(correction, second.pose);
  Eigen::Matrix3d turn = Eigen::Matrix3d::Identity();
  turn.topLeftCorner<2, 2>() = Eigen::Rotation2Dd(0.7).toRotationMatrix();
  second.covariance = turn * second.covariance * turn.transpose();
  const auto edge = corrected.add(2.0, second);
  ASSERT_TRUE(expected && edge);
  EXPECT_LT((expected->transform - edge->transform).norm(), 1e-12);
  EXPECT_LT((expected->information - edge->information).norm(), 1e-9 * expected->information.norm());
  EXPECT_EQ(expected->from.id, edge->from.id);
}

}  // namespace
}  // namespace intensity_hector_slam
