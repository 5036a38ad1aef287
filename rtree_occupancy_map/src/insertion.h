// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <algorithm>
#include <cstdint>
#include <memory>
#include <random>
#include <utility>
#include <vector>

#include "block_voxels.h"
#include "decay.h"
#include "rtree_occupancy_map/occupancy_map.h"
#include "scan_raster.h"
#include "worker_pool.h"
#include "working_set.h"

namespace rtree_occupancy_map {

// What insertScan needs: the blocks in use, and the buffers to gather a scan in.
struct OccupancyMap::Insertion {
  explicit Insertion(const Options& options)
      : model(options),
        settle(!options.dynamic),
        pool(options.threads),
        working_set(options, pool),
        decay(options),
        raster(options.resolution, pool),
        random(options.seed) {
    for (int i = 0; i < pool.size(); ++i)
      buffers.emplace_back(new Buffer{DenseBlock(options.reflectivity), {}});
  }

  // A place in a block of the raster.
  struct Mark {
    std::uint32_t slot;
    std::int32_t voxel;  // indexInBlock
    float value;
  };
  // For one block at a time.
  struct Buffer {
    DenseBlock dense;
    ScanMask mask;
  };

  /// Updates the block of this slot of the raster. @return whether that changes its cells
  bool update(std::uint32_t slot, WorkingSet::Entry& entry, const RTree& tree, Buffer& buffer) const;
  /// Forgets what has not been seen for a while. @return the blocks that changed
  std::vector<Block> forget(double time, RTree& tree, RollingWindow* window);
  /// The marks of a slot, once they are sorted.
  static std::pair<const Mark*, const Mark*> marksOf(std::uint32_t slot, const std::vector<Mark>& marks) {
    const auto less = [](const Mark& a, const Mark& b) { return a.slot < b.slot; };
    return std::equal_range(marks.data(), marks.data() + marks.size(), Mark{slot, 0, 0.0F}, less);
  }
  static void sortBySlot(std::vector<Mark>& marks) {
    std::stable_sort(marks.begin(), marks.end(),
                     [](const Mark& a, const Mark& b) { return a.slot < b.slot; });
  }

  const LogOddsModel model;
  const bool settle;  // see BlockVoxels::update
  WorkerPool pool;
  WorkingSet working_set;
  Decay decay;
  ScanRaster raster;
  std::vector<std::unique_ptr<Buffer>> buffers;  // one for each worker
  std::mt19937_64 random;
  std::vector<Mark> reflectivity;  // returns
  std::vector<Mark> selected;      // voxels whose cells may expand
};

}  // namespace rtree_occupancy_map
