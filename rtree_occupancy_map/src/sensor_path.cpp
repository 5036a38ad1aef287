// SPDX-License-Identifier: BSD-3-Clause
#include "rtree_occupancy_map/sensor_path.h"

#include <algorithm>

namespace rtree_occupancy_map {

void SensorPath::add(double time, const Eigen::Isometry3d& pose) {
  poses_.push_back({time, pose.translation(), Eigen::Quaterniond(pose.rotation())});
}

Eigen::Isometry3d SensorPath::at(double time) const {
  const auto after =
      std::find_if(poses_.begin(), poses_.end(), [time](const Pose& p) { return p.time > time; });
  const Pose& a = after == poses_.begin() ? *after : after[-1];
  const Pose& b = after == poses_.end() ? a : *after;
  const double share = a.time < b.time ? (time - a.time) / (b.time - a.time) : 0.0;
  Eigen::Isometry3d pose(a.rotation.slerp(share, b.rotation));
  pose.translation() = a.position + share * (b.position - a.position);
  return pose;
}

}  // namespace rtree_occupancy_map
