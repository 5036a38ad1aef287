// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstddef>
#include <string>

#include "rtree_occupancy_map/occupancy_map.h"

namespace rtree_occupancy_map {

/// Writes the centres of all occupied voxels (m) as a binary PCD file of PCL: x y z, and intensity where
/// cells have reflectivities, NaN for those without; rgb, as PCL packs it into four bytes, where the map has
/// colours, white for voxels without. A cell is as many points as it has voxels.
/// @return the number of points
/// @throws std::runtime_error that names the file
std::size_t writePcd(const OccupancyMap& map, const std::string& path);

}  // namespace rtree_occupancy_map
