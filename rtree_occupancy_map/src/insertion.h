// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <algorithm>
#include <cstdint>
#include <memory>
#include <random>
#include <utility>
#include <vector>

#include "block_voxels.h"
#include "color_layer.h"
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
      buffers.emplace_back(new Buffer{DenseBlock(options.reflectivity), {}, {}});
    if (options.color) colors = std::make_unique<ColorLayer>();
  }

  // A place in a block of the raster.
  struct Mark {
    std::uint32_t slot;
    std::int32_t voxel;  // indexInBlock
    float value;
  };
  struct ColorMark {
    std::uint32_t slot;
    std::int32_t voxel;
    Color color;
  };
  // For one block at a time.
  struct Buffer {
    DenseBlock dense;
    ScanMask mask;
    std::vector<ColorSum> colors;  // as large as it takes only where there are colours
  };

  /// Updates the block of this slot of the raster. @return whether that changes its cells
  bool update(std::uint32_t slot, WorkingSet::Entry& entry, const RTree& tree, Buffer& buffer) const;
  /// Forgets what has not been seen for a while. @return the blocks that changed
  std::vector<Block> forget(double time, RTree& tree, RollingWindow* window);
  /// Takes the scan's colours up, once its blocks are updated.
  /// @param changed whether the log odds of the block in a slot did
  /// @return the blocks that have other colours now
  std::vector<Block> recolor(const std::vector<WorkingSet::Entry*>& entries,
                             const std::vector<char>& changed);
  /// Forgets colours of what isn't occupied any more.
  void keepColors(const WorkingSet::Entry& entry) const {
    if (colors) colors->keep(entry.block, entry.voxels.occupied(model));
  }
  /// The marks of a slot, once they are sorted.
  template <class AnyMark>
  static std::pair<const AnyMark*, const AnyMark*> marksOf(std::uint32_t slot,
                                                           const std::vector<AnyMark>& marks) {
    const auto less = [](const AnyMark& a, const AnyMark& b) { return a.slot < b.slot; };
    return std::equal_range(marks.data(), marks.data() + marks.size(), AnyMark{slot, 0, {}}, less);
  }
  template <class AnyMark>
  static void sortBySlot(std::vector<AnyMark>& marks) {
    std::stable_sort(marks.begin(), marks.end(),
                     [](const AnyMark& a, const AnyMark& b) { return a.slot < b.slot; });
  }

  const LogOddsModel model;
  const bool settle;  // see BlockVoxels::update
  WorkerPool pool;
  WorkingSet working_set;
  Decay decay;
  ScanRaster raster;
  std::vector<std::unique_ptr<Buffer>> buffers;  // one for each worker
  std::mt19937_64 random;
  std::vector<Mark> reflectivity;      // returns
  std::vector<Mark> selected;          // voxels whose cells may expand
  std::unique_ptr<ColorLayer> colors;  // none without Options::color
  std::vector<ColorMark> colored;      // returns
};

}  // namespace rtree_occupancy_map
