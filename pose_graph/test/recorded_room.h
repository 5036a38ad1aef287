// SPDX-License-Identifier: BSD-3-Clause
//
// A drive in an empty room, as a session keeps it.
#pragma once

#include <algorithm>
#include <cmath>
#include <string>
#include <vector>

#include "pose_graph/maps.h"

namespace pose_graph {

/// Walls at x = -5.03 and 5.03, y = -4.03 and 4.03 (m), seen from a pose in it.
inline intensity_hector_slam::Scan lookAtRoom(const Pose& pose, double stamp, int beams = 360) {
  intensity_hector_slam::Scan scan;
  scan.stamp = stamp;
  for (int i = 0; i < beams; ++i) {
    const double angle = 2.0 * M_PI * (i + 0.5) / beams, heading = pose.yaw() + angle;
    const double dx = std::cos(heading), dy = std::sin(heading);
    const double to_x = ((dx > 0.0 ? 5.03 : -5.03) - pose.translation.x()) / dx,
                 to_y = ((dy > 0.0 ? 4.03 : -4.03) - pose.translation.y()) / dy;
    const double range = std::min(to_x, to_y);
    scan.points.push_back((range * Eigen::Vector2d(std::cos(angle), std::sin(angle))).cast<float>());
    scan.reflectivities.push_back(to_x < to_y ? 0.3F : 0.8F);
  }
  return scan;
}

inline rtree_occupancy_map::Scan cloudOfRoom(const Pose& pose, double stamp) {
  rtree_occupancy_map::Scan cloud;
  cloud.time = stamp;
  for (const double z : {-0.5, 0.0, 0.5}) {
    const auto scan = lookAtRoom(pose, stamp);
    for (const auto& point : scan.points) cloud.hits.emplace_back(point.x(), point.y(), z);
    cloud.reflectivity.insert(cloud.reflectivity.end(), scan.reflectivities.begin(),
                              scan.reflectivities.end());
  }
  return cloud;
}

/// Around the middle of the room, a pose each second.
inline std::vector<Pose> circle(int poses = 12) {
  std::vector<Pose> path;
  for (int i = 0; i < poses; ++i) {
    const double angle = 2.0 * M_PI * i / poses;
    path.push_back(planarPose(2.0 * std::cos(angle), 2.0 * std::sin(angle), angle + M_PI / 2.0));
  }
  return path;
}

/// Writes a run with a scan and a cloud at each pose, consecutive edges, and a loop from the last to the
/// first.
/// @param drift of the poses that are written, in the map, from one to the next
inline void writeRun(SessionWriter& writer, const std::vector<Pose>& path, const Pose& drift = {},
                     double start = 100.0) {
  const auto ns = [](double seconds) { return static_cast<std::int64_t>(std::llround(1e9 * seconds)); };
  const std::int64_t run = writer.beginRun(ns(start), "room"), first = writer.nextKeyPose();
  Pose error;
  const auto connect = [&](std::size_t from, std::size_t to, EdgeType type) {
    SessionEdge edge;
    edge.id = writer.nextEdge();
    edge.from = first + static_cast<std::int64_t>(from), edge.to = first + static_cast<std::int64_t>(to);
    edge.type = type;
    edge.source = type == EdgeType::kConsecutive ? "odometry" : "loops";
    edge.transform = path[from].inverse() * path[to];
    edge.information *= type == EdgeType::kConsecutive ? 100.0 : 10000.0;
    writer.put(edge);
  };
  for (std::size_t i = 0; i < path.size(); ++i) {
    const double stamp = start + i;
    const auto id = first + static_cast<std::int64_t>(i);
    writer.put(KeyPose{id, run, ns(stamp), error * path[i], error * path[i], false});
    for (KeyData data : {toKeyData(lookAtRoom(path[i], stamp)), toKeyData(cloudOfRoom(path[i], stamp))}) {
      data.key_pose = id;
      data.frame = "base_link";
      writer.put(std::move(data));
    }
    if (i > 0) connect(i - 1, i, EdgeType::kConsecutive);
    error = error * drift;
  }
  connect(0, path.size() - 1, EdgeType::kLoopClosure);
}

}  // namespace pose_graph
