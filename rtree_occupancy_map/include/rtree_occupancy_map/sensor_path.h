// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Geometry>
#include <vector>

namespace rtree_occupancy_map {

/// Where a frame was in the map while a scan was measured: poses at a few times, and between them positions
/// interpolated linearly and rotations by slerp.
class SensorPath {
 public:
  /// @param time s, later than that of the pose before
  void add(double time, const Eigen::Isometry3d& pose);
  /// Before the first pose, and after the last, as there. Of a path that has poses.
  Eigen::Isometry3d at(double time) const;

 private:
  struct Pose {
    double time;
    Eigen::Vector3d position;
    Eigen::Quaterniond rotation;
  };
  std::vector<Pose> poses_;
};

}  // namespace rtree_occupancy_map
