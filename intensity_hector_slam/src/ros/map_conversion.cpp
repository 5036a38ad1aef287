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

// @param value of the cell at a place in the tile's arrays
template <class Value>
std::vector<std::int8_t> valuesOf(const Eigen::AlignedBox2i& cells, const Value& value) {
  std::vector<std::int8_t> values(static_cast<std::size_t>((cells.sizes().array() + 1).prod()));
  std::int8_t* to = values.data();
  for (int y = cells.min().y(); y <= cells.max().y(); ++y) {
    const std::size_t first = GridMap::indexIn(cells.min().x(), y);
    for (int i = 0; i <= cells.sizes().x(); ++i) *to++ = value(first + i);
  }
  return values;
}

template <class ValuesOf>
nav_msgs::OccupancyGrid toGrid(const GridMap& map, const ValuesOf& values_of) {
  nav_msgs::OccupancyGrid grid = unknownGrid(map.resolution(), map.box());
  map.forTiles([&](const GridMap::Tile& tile, const Eigen::AlignedBox2i& cells) {
    draw(cells, values_of(tile, cells), map.box(), grid);
  });
  return grid;
}

}  // namespace

nav_msgs::OccupancyGrid unknownGrid(double resolution, const Eigen::AlignedBox2i& box) {
  nav_msgs::OccupancyGrid grid;
  grid.info.resolution = static_cast<float>(resolution);
  grid.info.width = box.sizes().x() + 1;
  grid.info.height = box.sizes().y() + 1;
  grid.info.origin.position.x = resolution * box.min().x();
  grid.info.origin.position.y = resolution * box.min().y();
  grid.info.origin.orientation.w = 1.0;
  grid.data.assign(static_cast<std::size_t>(grid.info.width) * grid.info.height, kUnknown);
  return grid;
}

std::vector<std::int8_t> occupancyOf(const GridMap::Tile& tile, const Eigen::AlignedBox2i& cells) {
  return valuesOf(cells, [&tile](std::size_t at) -> std::int8_t {
    const GridMap::Cell& cell = tile.cells[at];
    return GridMap::isKnown(cell) ? (GridMap::isOccupied(cell) ? 100 : 0) : kUnknown;
  });
}

std::vector<std::int8_t> reflectivityOf(const GridMap::Tile& tile, const Eigen::AlignedBox2i& cells) {
  return valuesOf(cells, [&tile](std::size_t at) -> std::int8_t {
    if (tile.counts[at] == 0) return kUnknown;
    return static_cast<std::int8_t>(100.0f * std::clamp(tile.cells[at].reflectivity, 0.0f, 1.0f) + 0.5f);
  });
}

void draw(const Eigen::AlignedBox2i& cells, const std::vector<std::int8_t>& values,
          const Eigen::AlignedBox2i& box, nav_msgs::OccupancyGrid& grid) {
  const std::ptrdiff_t columns = cells.sizes().x() + 1;
  const Eigen::Vector2i first = cells.min() - box.min();
  for (std::ptrdiff_t row = 0; row <= cells.sizes().y(); ++row)
    std::copy_n(values.begin() + row * columns, columns,
                grid.data.begin() + (first.y() + row) * grid.info.width + first.x());
}

nav_msgs::OccupancyGrid toOccupancyGrid(const GridMap& map) {
  return toGrid(map, occupancyOf);
}

nav_msgs::OccupancyGrid toReflectivityGrid(const GridMap& map) {
  return toGrid(map, reflectivityOf);
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
