// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <algorithm>
#include <cstdint>
#include <random>
#include <vector>

#include "block_grid.h"
#include "rtree_occupancy_map/occupancy_map.h"
#include "scan_raster.h"

namespace rtree_occupancy_map {

// What insertScan needs of a scan, and the buffers to gather it in.
struct OccupancyMap::Insertion {
  explicit Insertion(const Options& options)
      : raster(options.resolution), grid(options), random(options.seed) {}

  // A place in a block of the raster.
  struct Mark {
    std::uint32_t slot;
    std::int32_t voxel;  // BlockGrid::indexOf
    float value;
  };
  static void sortBySlot(std::vector<Mark>& marks) {
    std::stable_sort(marks.begin(), marks.end(),
                     [](const Mark& a, const Mark& b) { return a.slot < b.slot; });
  }

  ScanRaster raster;
  BlockGrid grid;
  std::mt19937_64 random;
  std::vector<Mark> reflectivity;  // returns
  std::vector<Mark> selected;      // voxels whose cells may expand
  std::vector<int> selected_in_block;
  std::vector<Cell> cells;
};

}  // namespace rtree_occupancy_map
