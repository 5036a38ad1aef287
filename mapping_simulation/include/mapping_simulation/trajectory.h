// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Geometry>
#include <cstdint>
#include <string>
#include <vector>

namespace mapping_simulation {

/// Pose at a time: frame of the moving body -> map frame.
struct TimedPose {
  double time = 0.0;  ///< s
  Eigen::Isometry3d pose = Eigen::Isometry3d::Identity();
};

/// Motion through SE(3): timed poses, translations interpolated linearly, rotations by slerp.
class Trajectory {
 public:
  /// Stands still at the origin.
  Trajectory() : Trajectory({TimedPose()}) {}
  /// Throws std::invalid_argument if `poses` is empty or its times don't increase.
  /// With `loop` the motion begins anew at the end (at least two poses); without, the body stays there.
  explicit Trajectory(std::vector<TimedPose> poses, bool loop = false);

  /// Pose at any time; before the start, and without `loop` after the end, the body stands still.
  Eigen::Isometry3d at(double time) const;

  double startTime() const { return poses_.front().time; }
  double endTime() const { return poses_.back().time; }
  const std::vector<TimedPose>& poses() const { return poses_; }

 private:
  std::vector<TimedPose> poses_;
  bool loop_;
};

/// A point that the path goes through, and the speed there.
struct Waypoint {
  Eigen::Vector3d position;  ///< map frame, m
  double speed;              ///< m/s, > 0; changes linearly over the way between waypoints
};

/// Drives through the waypoints from time 0 on a centripetal Catmull-Rom spline (Yuksel et al. 2011), the
/// body's x axis along the path and its z axis up. With `closed` the path returns to the first waypoint and
/// is driven for ever. Throws std::invalid_argument on fewer than two waypoints, equal neighbours or a speed
/// that isn't positive.
Trajectory driveThrough(const std::vector<Waypoint>& waypoints, bool closed = false);

/// How a body sways around its path: standard deviations, each remembered for about `memory`.
struct Sway {
  double side = 0.0, height = 0.0;            ///< m
  double roll = 0.0, pitch = 0.0, yaw = 0.0;  ///< rad
  double memory = 1.0;                        ///< s, > 0
};

/// The path with sway, from its start to its end.
Trajectory swaying(const Trajectory& path, const Sway& sway, std::uint64_t seed);

/// Reads a *.tum file (lines `time x y z qx qy qz qw`, # comments), or the key `trajectory` of any YAML file:
///   {poses: [[t, x, y, z, yaw_deg], ...], loop: false}        or t x y z, or t x y z roll pitch yaw
///   {waypoints: [[x, y, z], [x, y, z, speed], ...], speed: 1.0, closed: false}
/// and, with either, sway: {side: m, height: m, roll_deg:, pitch_deg:, yaw_deg:, memory: s, seed:}.
/// Throws std::runtime_error that names file and line.
Trajectory loadTrajectory(const std::string& file);

/// Writes poses in the TUM format to a temporary file that then takes the name `file`. Throws
/// std::runtime_error.
void writeTum(const std::string& file, const std::vector<TimedPose>& poses);

}  // namespace mapping_simulation
