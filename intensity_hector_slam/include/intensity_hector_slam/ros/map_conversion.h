// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <geometry_msgs/Pose.h>
#include <intensity_hector_slam/grid_map.h>
#include <intensity_hector_slam/key_poses.h>
#include <mapping_msgs/EdgeConstraint.h>
#include <nav_msgs/OccupancyGrid.h>

#include <Eigen/Geometry>
#include <string>
#include <vector>

namespace intensity_hector_slam {

/// Of a map's finest level: -1 everywhere, never observed. @param box the map's
nav_msgs::OccupancyGrid unknownGrid(double resolution, const Eigen::AlignedBox2i& box);
/// Of cells of a tile, row by row, as hector_mapping has it: 100 occupied, 0 free, -1 never observed.
std::vector<std::int8_t> occupancyOf(const GridMap::Tile& tile, const Eigen::AlignedBox2i& cells);
/// The same: 0 (black) to 100 (white, reflectivity 1 and more), -1 where nothing was hit.
std::vector<std::int8_t> reflectivityOf(const GridMap::Tile& tile, const Eigen::AlignedBox2i& cells);
/// Puts these cells, row by row, into a grid. @param box of the grid, in which the cells are
void draw(const Eigen::AlignedBox2i& cells, const std::vector<std::int8_t>& values,
          const Eigen::AlignedBox2i& box, nav_msgs::OccupancyGrid& grid);
/// The whole map, as `occupancyOf` has it.
nav_msgs::OccupancyGrid toOccupancyGrid(const GridMap& map);
/// The same, as `reflectivityOf` has it.
nav_msgs::OccupancyGrid toReflectivityGrid(const GridMap& map);

/// The motion is in the plane: there is no information on z, roll and pitch.
mapping_msgs::EdgeConstraint toMessage(const Edge& edge, const std::string& map_frame,
                                       const std::string& base_frame);

geometry_msgs::Pose toMessage(const Pose& pose);
/// x, y and yaw. @throws std::invalid_argument where it isn't a pose
Pose toPose(const geometry_msgs::Pose& message);

}  // namespace intensity_hector_slam
