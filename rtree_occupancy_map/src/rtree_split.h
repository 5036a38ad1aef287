// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstdint>
#include <vector>

#include "rtree_occupancy_map/rtree.h"

namespace rtree_occupancy_map {

/// Divides the boxes of an overfull node in two groups of at least `min_entries` each.
/// @return the group, 0 or 1, of each box
std::vector<std::uint8_t> splitBoxes(SplitMethod method, const std::vector<VoxelBox>& boxes, int min_entries);

}  // namespace rtree_occupancy_map
