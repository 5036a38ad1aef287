// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <geometry_msgs/Point.h>
#include <rtree_occupancy_map/MapCell.h>
#include <rtree_occupancy_map/occupancy_map.h>
#include <sensor_msgs/PointCloud2.h>

#include <Eigen/Core>
#include <vector>

namespace rtree_occupancy_map {

/// Of a geometry_msgs/Point or Vector3.
template <class Message>
Eigen::Vector3d toEigen(const Message& m) {
  return {m.x, m.y, m.z};
}
geometry_msgs::Point toPoint(const Eigen::Vector3d& p);
MapCell toMessage(const OccupancyMap& map, const Cell& cell);

/// A cloud of the cells' centres: float32 x y z, size_x size_y size_z (m), probability, reflectivity (NaN
/// without). The header is left to the caller.
sensor_msgs::PointCloud2 toPointCloud2(const OccupancyMap& map, const std::vector<Cell>& cells);

/// All blocks with at least one cell, sorted.
std::vector<Block> knownBlocks(const OccupancyMap& map);

/// Appends the block's occupied cells.
void appendOccupied(const OccupancyMap& map, const Block& block, std::vector<Cell>& cells);

}  // namespace rtree_occupancy_map
