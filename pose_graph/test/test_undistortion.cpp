// SPDX-License-Identifier: BSD-3-Clause
#include <gtest/gtest.h>

#include "pose_graph/undistortion.h"
#include "recorded_room.h"

namespace pose_graph {
namespace {

namespace slam = intensity_hector_slam;

constexpr std::int64_t kMs = 1'000'000;
constexpr double kSweep = 0.025;  // s

// Turns while it drives, and gets faster.
Pose poseAt(double t) {
  return planarPose(-1.0 + 1.2 * t, 0.3 * t * t, 0.2 + 0.8 * t);
}

Trajectory drive() {
  Trajectory trajectory;
  for (int ms = 0; ms <= 2000; ms += 25) trajectory.add(ms * kMs, poseAt(1e-3 * ms));
  return trajectory;
}

// Each beam from where the body is at its time.
slam::Scan sweepAt(double stamp) {
  slam::Scan sweep = lookAtRoom(poseAt(stamp), stamp);
  const std::size_t n = sweep.points.size();
  for (std::size_t i = 0; i < n; ++i) {
    const double time = kSweep * static_cast<double>(i) / static_cast<double>(n);
    sweep.points[i] = lookAtRoom(poseAt(stamp + time), stamp).points[i];
    sweep.times.push_back(static_cast<float>(time));
  }
  return sweep;
}

// m, the mean distance of a scan's points from the walls, seen from a pose.
double distanceFromWalls(const slam::Scan& scan, const Pose& pose) {
  double sum = 0.0;
  for (const Eigen::Vector2f& point : scan.points) {
    const Eigen::Vector3d p = pose.translation + pose.rotation * Eigen::Vector3d(point.x(), point.y(), 0.0);
    sum += std::min(std::abs(std::abs(p.x()) - 5.03), std::abs(std::abs(p.y()) - 4.03));
  }
  return sum / static_cast<double>(scan.points.size());
}

TEST(Undistortion, PutsAScansPointsOnTheWalls) {
  const slam::Scan sweep = sweepAt(1.0);
  ASSERT_GT(distanceFromWalls(sweep, poseAt(1.0)), 0.01);
  const slam::Scan still = undistorted(sweep, 1000 * kMs, drive(), {});
  EXPECT_LT(distanceFromWalls(still, poseAt(1.0)), 0.001);
  EXPECT_TRUE(still.times.empty()) << "nobody moves them again";
  EXPECT_EQ(sweep.reflectivities, still.reflectivities);
}

TEST(Undistortion, KnowsTheMotionAtTheEndsOfTheWay) {
  for (const int ms : {0, 1975}) {
    const slam::Scan sweep = sweepAt(1e-3 * ms);
    EXPECT_LT(distanceFromWalls(undistorted(sweep, ms * kMs, drive(), {}), poseAt(1e-3 * ms)), 0.002) << ms;
  }
}

TEST(Undistortion, LeavesAScanWhereItDoesNotKnow) {
  const slam::Scan sweep = sweepAt(1.0);
  EXPECT_EQ(sweep.points, undistorted(sweep, 1000 * kMs, Trajectory(), {}).points);
  EXPECT_EQ(sweep.points, undistorted(sweep, 9000 * kMs, drive(), {}).points);
  slam::SlamOptions off;
  off.deskew = false;
  EXPECT_EQ(sweep.points, undistorted(sweep, 1000 * kMs, drive(), off).points);
  Trajectory jump;
  jump.add(950 * kMs, poseAt(0.95));
  jump.add(1050 * kMs, planarPose(3.0, 2.0, 0.0) * poseAt(1.05));
  const slam::Scan same = undistorted(sweep, 1000 * kMs, jump, {});
  EXPECT_EQ(sweep.points, same.points) << "the front end has found itself elsewhere";
  EXPECT_EQ(sweep.times, same.times);
}

TEST(Undistortion, FollowsASensorThroughASweep) {
  const Trajectory trajectory = drive();
  const Pose sensor = planarPose(0.4, -0.1, 1.0);
  const auto path = sensorPath(trajectory, 1000 * kMs, sensor, -0.2, 0.3);
  ASSERT_TRUE(path);
  for (const double time : {-0.2, -0.07, 0.0, 0.21, 0.3}) {
    const Pose expected = poseAt(1.0).inverse() * poseAt(1.0 + time) * sensor;
    const Eigen::Isometry3d at = path->at(time);
    // The front end's poses are kept each 0.1 s, and taken to lie on straight lines between.
    EXPECT_LT((at.translation() - expected.translation).norm(), 0.002) << time;
    EXPECT_LT(Eigen::Quaterniond(at.rotation()).angularDistance(expected.rotation), 0.001) << time;
  }
  EXPECT_FALSE(sensorPath(trajectory, 1000 * kMs, sensor, 0.0, 1.5)) << "the front end isn't there yet";
  EXPECT_TRUE(sensorPath(trajectory, 1000 * kMs, sensor, 0.0, 0.0));
}

}  // namespace
}  // namespace pose_graph
