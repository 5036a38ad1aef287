// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <geometry_msgs/Pose.h>
#include <intensity_hector_slam/grid_map.h>
#include <intensity_hector_slam/key_poses.h>
#include <mapping_msgs/EdgeConstraint.h>
#include <nav_msgs/OccupancyGrid.h>

#include <string>

namespace intensity_hector_slam {

/// As hector_mapping has it: 100 occupied, 0 free, -1 never observed.
nav_msgs::OccupancyGrid toOccupancyGrid(const GridMap& map);
/// 0 (black) to 100 (white, reflectivity 1 and more), -1 where nothing was hit.
nav_msgs::OccupancyGrid toReflectivityGrid(const GridMap& map);

/// The motion is in the plane: there is no information on z, roll and pitch.
mapping_msgs::EdgeConstraint toMessage(const Edge& edge, const std::string& map_frame,
                                       const std::string& base_frame);

geometry_msgs::Pose toMessage(const Pose& pose);
/// x, y and yaw. @throws std::invalid_argument where it isn't a pose
Pose toPose(const geometry_msgs::Pose& message);

}  // namespace intensity_hector_slam
