// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstdint>
#include <functional>
#include <memory>
#include <unordered_map>
#include <vector>

#include "block_grid.h"
#include "block_voxels.h"
#include "rtree_occupancy_map/occupancy_map.h"
#include "worker_pool.h"

namespace rtree_occupancy_map {

/// So many blocks at least are worth other threads' help.
constexpr std::size_t kBlocksWorthSharing = 16;

/// The blocks that the last scans have touched, taken apart into voxels. The next scan will touch most of
/// them again, so they go back into the R-tree only when somebody asks for their cells or they leave the set.
class WorkingSet {
 public:
  struct Entry {
    Block block;
    BlockVoxels voxels;
    bool loaded = false;        // voxels are what the R-tree holds, or newer
    bool changed = false;       // newer
    std::vector<int> selected;  // voxels whose cells may expand (FusionStrategy::kExpansion)
    std::uint64_t last_scan = 0;
  };

  WorkingSet(const Options& options, WorkerPool& pool);

  /// Blocks that are asked for from now on are used by a new scan.
  void startScan() { ++scan_; }
  /// The block's entry, which load() has still to fill if it is new. Valid until the next trim() or clear().
  Entry& at(const Block& block);
  void load(Entry& entry, const RTree& tree, DenseBlock& buffer) const;
  /// Says that an entry's cells in the tree are out of date.
  void setChanged(Entry& entry);

  /// Brings the tree up to date in those blocks whose boxes pass `asked_for`.
  void writeBack(const std::function<bool(const VoxelBox&)>& asked_for, RTree& tree);
  /// Blocks that haven't been used for some scans leave the set, then as many more as exceed its memory.
  void trim(RTree& tree);
  /// These leave the set.
  void release(const std::vector<Block>& blocks, RTree& tree);
  bool contains(const Block& block) const;
  void clear();

  std::size_t memoryUsage() const;  ///< bytes

 private:
  void writeBack(const std::vector<Entry*>& entries, RTree& tree);
  void letGo(const std::vector<Entry*>& entries, RTree& tree);
  void fuse(Entry& entry, const RTree& tree, BlockGrid& grid, std::vector<Cell>& cells) const;
  // Whether what becomes of a block depends on the cells that the scan before has left there.
  bool dependsOnCells() const {
    return options_.fusion_strategy == FusionStrategy::kExpansion || options_.reflectivity;
  }

  const Options options_;
  const LogOddsModel model_;
  std::uint64_t scan_ = 0;
  std::unordered_map<std::uint64_t, std::unique_ptr<Entry>> entries_;
  std::vector<Entry*> changed_;
  WorkerPool& pool_;
  std::vector<std::unique_ptr<BlockGrid>> grids_;  // one for each worker
};

}  // namespace rtree_occupancy_map
