// SPDX-License-Identifier: BSD-3-Clause
//
// Occupancy maps voxel by voxel, however their cells fused.
#pragma once

#include <gtest/gtest.h>
#include <rtree_occupancy_map/occupancy_map.h>

#include <algorithm>
#include <cstddef>
#include <vector>

namespace rosbag_tests {

struct KnownVoxel {
  rtree_occupancy_map::Voxel voxel;
  float log_odds;
  bool occupied;

  bool operator==(const KnownVoxel& o) const {
    return voxel == o.voxel && log_odds == o.log_odds && occupied == o.occupied;
  }
};

/// All known voxels that lie in the box (in voxels), in order.
inline std::vector<KnownVoxel> knownVoxels(
    const rtree_occupancy_map::OccupancyMap& map,
    const rtree_occupancy_map::VoxelBox& box = rtree_occupancy_map::VoxelBox::all()) {
  std::vector<KnownVoxel> voxels;
  map.tree().visitOverlapping(box, [&](const rtree_occupancy_map::Cell& cell) {
    const rtree_occupancy_map::VoxelBox part = intersect(cell.box, box);
    for (int x = part.min[0]; x < part.max[0]; ++x)
      for (int y = part.min[1]; y < part.max[1]; ++y)
        for (int z = part.min[2]; z < part.max[2]; ++z)
          voxels.push_back({{x, y, z}, cell.log_odds, map.isOccupied(cell)});
    return true;
  });
  std::sort(voxels.begin(), voxels.end(),
            [](const KnownVoxel& a, const KnownVoxel& b) { return a.voxel < b.voxel; });
  return voxels;
}

/// Whether the same voxels are known, with the same log odds and state.
inline testing::AssertionResult sameVoxels(const std::vector<KnownVoxel>& a,
                                           const std::vector<KnownVoxel>& b) {
  std::size_t i = 0;
  while (i < a.size() && i < b.size() && a[i] == b[i]) ++i;
  if (i == a.size() && i == b.size()) return testing::AssertionSuccess();
  testing::AssertionResult failure = testing::AssertionFailure();
  failure << a.size() << " and " << b.size() << " known voxels; the first that differs is";
  for (const std::vector<KnownVoxel>* voxels : {&a, &b}) {
    if (i == voxels->size()) {
      failure << " (none)";
      continue;
    }
    const KnownVoxel& v = (*voxels)[i];
    failure << " (" << v.voxel[0] << ' ' << v.voxel[1] << ' ' << v.voxel[2] << ": " << v.log_odds << ')';
  }
  return failure;
}

}  // namespace rosbag_tests
