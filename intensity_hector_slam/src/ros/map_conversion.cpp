// SPDX-License-Identifier: BSD-3-Clause
#include "intensity_hector_slam/ros/map_conversion.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <stdexcept>
#include <vector>

namespace intensity_hector_slam {
namespace {

constexpr std::int8_t kUnknown = -1;

// @param value of the cell in a column and a row; not called where nothing was observed
template <class Value>
nav_msgs::OccupancyGrid toGrid(const GridMap& map, const Value& value) {
  nav_msgs::OccupancyGrid grid;
  grid.info.resolution = static_cast<float>(map.resolution());
  grid.info.width = map.width();
  grid.info.height = map.height();
  grid.info.origin.position.x = map.origin().x();
  grid.info.origin.position.y = map.origin().y();
  grid.info.origin.orientation.w = 1.0;
  grid.data.assign(static_cast<std::size_t>(map.width()) * map.height(), kUnknown);
  map.forTiles([&](const GridMap::Tile&, const Eigen::AlignedBox2i& box) {
    const Eigen::Vector2i first = map.box().min();
    for (int y = box.min().y(); y <= box.max().y(); ++y) {
      std::int8_t* to =
          &grid.data[static_cast<std::size_t>(y - first.y()) * map.width() + box.min().x() - first.x()];
      for (int x = box.min().x(); x <= box.max().x(); ++x) *to++ = value(x, y);
    }
  });
  return grid;
}

}  // namespace

nav_msgs::OccupancyGrid toOccupancyGrid(const GridMap& map) {
  return toGrid(map, [&map](int x, int y) -> std::int8_t {
    const GridMap::Cell& cell = map.cell(x, y);
    return GridMap::isKnown(cell) ? (GridMap::isOccupied(cell) ? 100 : 0) : kUnknown;
  });
}

nav_msgs::OccupancyGrid toReflectivityGrid(const GridMap& map) {
  return toGrid(map, [&map](int x, int y) -> std::int8_t {
    if (map.count(x, y) == 0) return kUnknown;
    return static_cast<std::int8_t>(
        std::lround(100.0f * std::clamp(map.cell(x, y).reflectivity, 0.0f, 1.0f)));
  });
}

mapping_msgs::EdgeConstraint toMessage(const Edge& edge, const std::string& map_frame,
                                       const std::string& base_frame) {
  mapping_msgs::EdgeConstraint message;
  message.header.frame_id = map_frame;
  message.from_stamp.fromSec(edge.from.stamp);
  message.to_stamp.fromSec(edge.to.stamp);
  message.header.stamp = message.to_stamp;
  message.from_id = edge.from.id;
  message.to_id = edge.to.id;
  message.frame_id = base_frame;
  message.type = edge.type == EdgeType::kLoopClosure ? mapping_msgs::EdgeConstraint::LOOP_CLOSURE
                                                     : mapping_msgs::EdgeConstraint::CONSECUTIVE;
  message.has_transform = true;
  message.transform = toMessage(edge.transform);
  const Eigen::Matrix3d information = informationAtEnd(edge);
  constexpr std::array<int, 3> kRows = {0, 1, 5};  // x, y, yaw
  for (int row = 0; row < 3; ++row) {
    for (int column = 0; column < 3; ++column) {
      message.information[6 * kRows[row] + kRows[column]] = information(row, column);
    }
  }
  message.similarity = static_cast<float>(edge.similarity);
  return message;
}

geometry_msgs::Pose toMessage(const Pose& pose) {
  geometry_msgs::Pose message;
  message.position.x = pose.x();
  message.position.y = pose.y();
  message.orientation.z = std::sin(0.5 * pose.z());
  message.orientation.w = std::cos(0.5 * pose.z());
  return message;
}

Pose toPose(const geometry_msgs::Pose& message) {
  const auto& q = message.orientation;
  const double norm = q.x * q.x + q.y * q.y + q.z * q.z + q.w * q.w;
  const Pose pose(message.position.x, message.position.y,
                  std::atan2(2.0 * (q.w * q.z + q.x * q.y), 1.0 - 2.0 * (q.y * q.y + q.z * q.z)));
  if (!pose.allFinite() || !(norm > 0.9 && norm < 1.1)) {
    throw std::invalid_argument("not a pose: not finite, or an orientation that isn't a unit quaternion");
  }
  return pose;
}

}  // namespace intensity_hector_slam
