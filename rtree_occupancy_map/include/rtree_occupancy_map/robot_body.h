// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Geometry>
#include <cstddef>
#include <string>
#include <vector>

#include "rtree_occupancy_map/occupancy_map.h"

namespace rtree_occupancy_map {

/// A part of the robot itself, whose returns are no obstacles.
struct BodyBox {
  std::string frame;
  Eigen::AlignedBox3d box;  ///< m, in that frame
};

/// @param text boxes with a ; between them, each "FRAME MIN_X MIN_Y MIN_Z MAX_X MAX_Y MAX_Z" (m)
/// @throws std::invalid_argument that names the box that won't do, and says what is expected
std::vector<BodyBox> parseRobotBody(const std::string& text);

/// Takes the hits in a box out of a scan, with their beams, which don't clear either.
/// @param box_in_map pose of the box's frame in the map
/// @return how many
std::size_t removeHitsIn(const Eigen::AlignedBox3d& box, const Eigen::Isometry3d& box_in_map, Scan& scan);

}  // namespace rtree_occupancy_map
