// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Geometry>

#include "rtree_occupancy_map/occupancy_map.h"

namespace rtree_occupancy_map {

/// A map in another frame, with other voxels or other options. A voxel is what the source says where its
/// centre is, or, if that is more, the greatest log odds of the source's voxels whose centres are in it: as
/// OctoMap's larger nodes, nothing occupied gets lost in a coarser map. Colours are those of all returns
/// there.
/// @param transform from the map's frame to the new one
/// @throws std::invalid_argument where the options won't do, or the map reaches beyond the new one's
/// coordinates
OccupancyMap transformed(const OccupancyMap& map, const Eigen::Isometry3d& transform, const Options& options);

/// What either map knows. What both know is the sum of their log odds, as of independent observations (Eq.
/// 2.7), and the mean reflectivity and colour of all returns.
/// @param b as `a` in its frame and resolution; the options are those of `a`
/// @throws std::invalid_argument where the resolutions differ
OccupancyMap merged(const OccupancyMap& a, const OccupancyMap& b);

}  // namespace rtree_occupancy_map
