// SPDX-License-Identifier: BSD-3-Clause
#include "pose_graph/undistortion.h"

#include <Eigen/Geometry>
#include <cmath>

namespace pose_graph {

namespace slam = intensity_hector_slam;
using rtree_occupancy_map::SensorPath;

slam::Scan undistorted(const slam::Scan& scan, std::int64_t stamp, const Trajectory& front_end,
                       const slam::SlamOptions& options) {
  if (!options.deskew || scan.times.empty()) return scan;
  const auto velocity = front_end.velocity(stamp);
  if (!velocity || velocity->head<3>().norm() > options.max_speed ||
      velocity->tail<3>().norm() > options.max_turn_rate)
    return scan;
  slam::Scan still = slam::seenAt(0.0, scan, {velocity->x(), velocity->y(), (*velocity)(5)});
  still.times.clear();
  still.free_times.clear();
  return still;
}

std::optional<SensorPath> sensorPath(const Trajectory& front_end, std::int64_t stamp, const Pose& sensor,
                                     double first, double last) {
  constexpr int kPoses = 33;
  const auto here = front_end.at(stamp);
  if (!here) return std::nullopt;
  SensorPath path;
  for (int i = 0; i < kPoses; ++i) {
    const double time = first + (last - first) * i / (kPoses - 1.0);
    const auto there = front_end.at(stamp + static_cast<std::int64_t>(std::llround(1e9 * time)));
    if (!there) return std::nullopt;
    const Pose pose = here->inverse() * *there * sensor;
    path.add(time, Eigen::Translation3d(pose.translation) * pose.rotation);
    if (first == last) break;
  }
  return path;
}

}  // namespace pose_graph
