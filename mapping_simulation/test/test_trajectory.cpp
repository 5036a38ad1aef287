// SPDX-License-Identifier: BSD-3-Clause
#include <gtest/gtest.h>
#include <mapping_simulation/testing/worlds.h>
#include <mapping_simulation/trajectory.h>

#include <cmath>

namespace mapping_simulation {
namespace {

double yawOf(const Eigen::Isometry3d& pose) {
  return std::atan2(pose.linear()(1, 0), pose.linear()(0, 0));
}

TEST(Trajectory, InterpolatesLinearlyAndBySlerp) {
  const Eigen::Vector3d axis = Eigen::Vector3d(1.0, 2.0, -1.0).normalized();
  const Trajectory trajectory({{1.0, makePose(0.0, 0.0, 0.0)},
                               {3.0, Eigen::Translation3d(4.0, -2.0, 6.0) * Eigen::AngleAxisd(1.2, axis)}});
  const Eigen::Isometry3d expected = Eigen::Translation3d(1.0, -0.5, 1.5) * Eigen::AngleAxisd(0.3, axis);
  EXPECT_TRUE(trajectory.at(1.5).isApprox(expected, 1e-12));
  EXPECT_TRUE(trajectory.at(0.0).isApprox(trajectory.poses().front().pose));
  EXPECT_TRUE(trajectory.at(9.0).isApprox(trajectory.poses().back().pose));
}

TEST(Trajectory, Loops) {
  const Trajectory trajectory({{1.0, makePose(0, 0, 0)}, {5.0, makePose(8, 0, 0)}}, true);
  EXPECT_NEAR(trajectory.at(6.0).translation().x(), 2.0, 1e-12);
  EXPECT_NEAR(trajectory.at(4.0 * 1000 + 2.5).translation().x(), 3.0, 1e-9);
  EXPECT_NEAR(trajectory.at(5.0).translation().x(), 8.0, 1e-12);
}

TEST(Trajectory, RefusesBadTimes) {
  expectError([] { Trajectory(std::vector<TimedPose>()); }, "needs a pose");
  expectError([] { Trajectory({{0.0, makePose(0, 0, 0)}}, true); }, "needs two poses");
  expectError([] { Trajectory({{1.0, makePose(0, 0, 0)}, {1.0, makePose(1, 0, 0)}}); }, "pose 2 isn't after");
  expectError([] { Trajectory({{0.0, makePose(0, 0, 0)}, {NAN, makePose(1, 0, 0)}}); }, "pose 2 isn't after");
}

TEST(DriveThrough, StraightLineAtConstantSpeed) {
  const Trajectory trajectory = driveThrough({{{1, 1, 0}, 2.0}, {{4, 5, 0}, 2.0}});
  EXPECT_NEAR(trajectory.endTime(), 2.5, 1e-9);
  EXPECT_TRUE(trajectory.at(1.25).isApprox(makePose(2.5, 3.0, 0.0, std::atan2(4.0, 3.0)), 1e-9));
}

TEST(DriveThrough, SpeedChangesLinearlyOverTheWay) {
  // dv/ds = const: t = L / (v1 - v0) ln(v1 / v0)
  const Trajectory trajectory = driveThrough({{{0, 0, 0}, 1.0}, {{10, 0, 0}, 3.0}});
  EXPECT_NEAR(trajectory.endTime(), 5.0 * std::log(3.0), 1e-3);
}

TEST(DriveThrough, PassesWaypointsSmoothlyWithHeadingAlongThePath) {
  const std::vector<Waypoint> waypoints{
      {{0, 0, 0}, 1.5}, {{3, 0, 0}, 1.5}, {{5, 2, 0.5}, 1.5}, {{5, 6, 0}, 1.5}};
  const Trajectory trajectory = driveThrough(waypoints);
  for (const Waypoint& waypoint : waypoints) {
    double nearest = INFINITY;
    for (const TimedPose& pose : trajectory.poses()) {
      nearest = std::min(nearest, (pose.pose.translation() - waypoint.position).norm());
    }
    EXPECT_LT(nearest, 1e-9);
  }
  const double step = 0.02;
  for (double t = step; t < trajectory.endTime() - step; t += step) {
    const Eigen::Vector3d way =
        trajectory.at(t + step / 2).translation() - trajectory.at(t - step / 2).translation();
    EXPECT_NEAR(way.norm() / step, 1.5, 0.01) << "t = " << t;
    EXPECT_NEAR(std::remainder(std::atan2(way.y(), way.x()) - yawOf(trajectory.at(t)), 2 * M_PI), 0.0, 0.05);
    EXPECT_LT(std::abs(std::remainder(yawOf(trajectory.at(t + step)) - yawOf(trajectory.at(t)), 2 * M_PI)),
              0.15);
    EXPECT_NEAR(trajectory.at(t).linear()(2, 2), 1.0, 1e-12);
  }
}

TEST(DriveThrough, ClosedPathIsDrivenForEver) {
  const Trajectory trajectory =
      driveThrough({{{0, 0, 0}, 1}, {{4, 0, 0}, 1}, {{4, 4, 0}, 1}, {{0, 4, 0}, 1}}, true);
  const double round = trajectory.endTime();
  EXPECT_GT(round, 16.0);
  EXPECT_TRUE(trajectory.at(0.0).isApprox(trajectory.at(round), 1e-9));
  EXPECT_TRUE(trajectory.at(3.3).isApprox(trajectory.at(3.3 + 5 * round), 1e-6));
  // Four corners alike: a quarter of a round is a quarter of a turn about the centre.
  const Eigen::Isometry3d quarter = makePose(2, 2, 0) * makePose(0, 0, 0, M_PI / 2) * makePose(-2, -2, 0);
  EXPECT_TRUE(trajectory.at(1.0 + round / 4).isApprox(quarter * trajectory.at(1.0), 1e-3));
}

TEST(DriveThrough, RefusesBadWaypoints) {
  expectError([] { driveThrough({{{0, 0, 0}, 1}}); }, "two waypoints");
  expectError([] { driveThrough({{{0, 0, 0}, 1}, {{1, 0, 0}, 0}}); }, "waypoint 2 isn't positive");
  expectError([] { driveThrough({{{0, 0, 0}, 1}, {{0, 0, 0}, 1}}); }, "waypoint 1 equals");
}

TEST(LoadTrajectory, ReadsPosesOfAllLengths) {
  const TempDir dir;
  const std::string file = dir.write(
      "file.yaml", "trajectory: {poses: [[0, 1, 2, 3], [1, 1, 2, 3, 90], [2, 1, 2, 3, 90, 0, 90]]}");
  const Trajectory trajectory = loadTrajectory(file);
  ASSERT_EQ(trajectory.poses().size(), 3u);
  EXPECT_TRUE(trajectory.at(0.0).isApprox(makePose(1, 2, 3)));
  EXPECT_TRUE(trajectory.at(1.0).isApprox(makePose(1, 2, 3, M_PI / 2)));
  // Roll first, then yaw: the body's y axis points up, its x axis to y.
  EXPECT_TRUE((trajectory.at(2.0).linear() * Eigen::Vector3d::UnitY()).isApprox(Eigen::Vector3d::UnitZ()));
  EXPECT_TRUE((trajectory.at(2.0).linear() * Eigen::Vector3d::UnitX()).isApprox(Eigen::Vector3d::UnitY()));
}

TEST(LoadTrajectory, NamesFileLineAndKey) {
  const TempDir dir;
  const auto expect = [&](const std::string& yaml, const std::string& message) {
    const std::string file = dir.write("file.yaml", yaml);
    expectError([&] { loadTrajectory(file); }, file + message);
  };
  expect("objects: []", ":1: key 'trajectory' is missing");
  expect("trajectory:\n  speed: 1", ":2: give either poses or waypoints");
  expect("trajectory:\n  waypoints: [[0, 0, 0], [1, 0, 0]]\n  speed: -1",
         ":3: speed is '-1': must be a number in [0.001");
  expect("trajectory:\n  waypoints: [[0, 0, 0], [1, 0, 0]]\n  pace: 1", ":3: unknown key 'pace'");
  expect("trajectory:\n  waypoints:\n  - [0, 0, 0]\n  - [1, 0, 0, 0]", ":4: speed of a waypoint");
  expect("trajectory:\n  poses:\n  - [0, 0, 0, 0]\n  - [1, x, 0, 0]",
         ":4: a pose [t, x, y, z, (roll, pitch,) yaw] is 'x'");
  expect("trajectory:\n  poses:\n  - [0, 0, 0, 0, 1, 2]", ":3: a pose has");
  expect("trajectory:\n  poses: [[1, 0, 0, 0], [1, 0, 0, 0]]", ":2: time of pose 2");
  expect("trajectory: [", ":1: not YAML");
  expectError([] { loadTrajectory("/nowhere/t.yaml"); }, "/nowhere/t.yaml: can't be read");
}

TEST(Tum, WrittenPosesAreReadBack) {
  const TempDir dir;
  const std::vector<TimedPose> poses{
      {1.5, makePose(1, -2, 3, 0.7)},
      {2.5, Eigen::Isometry3d(Eigen::AngleAxisd(2.0, Eigen::Vector3d::UnitX()))}};
  const std::string file = dir.write("file.tum", "");
  writeTum(file, poses);
  const Trajectory read = loadTrajectory(file);
  ASSERT_EQ(read.poses().size(), 2u);
  for (int i = 0; i < 2; ++i) {
    EXPECT_DOUBLE_EQ(read.poses()[i].time, poses[i].time);
    EXPECT_TRUE(read.poses()[i].pose.isApprox(poses[i].pose, 1e-8));
  }
  EXPECT_FALSE(std::filesystem::exists(file + ".tmp"));
}

TEST(Tum, NamesTheBadLine) {
  const TempDir dir;
  const std::string truncated = dir.write("truncated.tum", "# time\n0 0 0 0 0 0 0 1\n1 0 0 0 0 0\n");
  expectError([&] { loadTrajectory(truncated); }, truncated + ":3: '1 0 0 0 0 0'");
  const std::string rotation = dir.write("rotation.tum", "0 0 0 0 0 0 0 2\n");
  expectError([&] { loadTrajectory(rotation); }, rotation + ":1:");
  const std::string words = dir.write("words.tum", "0 0 0 0 0 0 0 1 # start\n\n1 0 0 0 0 0 0 one\n");
  expectError([&] { loadTrajectory(words); }, words + ":3:");
  const std::string infinite = dir.write("infinite.tum", "0 nan 0 0 0 0 0 1\n");
  expectError([&] { loadTrajectory(infinite); }, infinite + ":1:");
  expectError([] { loadTrajectory("/nowhere.tum"); }, "/nowhere.tum can't be opened");
  expectError([] { writeTum("/nowhere/t.tum", {}); }, "/nowhere/t.tum can't be written");
}

}  // namespace
}  // namespace mapping_simulation

int main(int argc, char** argv) {
  testing::InitGoogleTest(&argc, argv);
  return RUN_ALL_TESTS();
}
