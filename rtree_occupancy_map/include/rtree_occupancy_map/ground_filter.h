// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <mapping_common/options.h>

#include <Eigen/Geometry>
#include <cstddef>

#include "rtree_occupancy_map/scan.h"

namespace rtree_occupancy_map {

/// Which hits are the ground: names, defaults and method are octomap_server's.
struct GroundFilterOptions {
  double distance = 0.04;        ///< m
  double angle = 0.15;           ///< rad
  double plane_distance = 0.07;  ///< m

  void describe(mapping_common::OptionList& o) {
    o("distance", distance, "m", "of points from the plane that is taken for the ground").within(0.001, 10.0);
    o("angle", angle, "rad", "between that plane's normal and the z axis of base_frame_id, at most")
        .within(0.001, 1.5);
    o("plane_distance", plane_distance, "m",
      "of that plane from the origin of base_frame_id, at most; where no such plane is found, what is as "
      "near to z = "
      "0 is the ground")
        .within(0.0, 10.0);
  }
};

/// Makes misses of the hits on the ground, which then clear and don't occupy: the largest plane that the
/// options allow, found by RANSAC (PCL), or else what is near to z = 0.
/// @param base_in_map pose of a frame in the map, at whose z = 0 the ground is
/// @return how many
std::size_t clearGround(const GroundFilterOptions& options, const Eigen::Isometry3d& base_in_map, Scan& scan);

}  // namespace rtree_occupancy_map
