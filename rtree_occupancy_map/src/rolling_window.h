// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstddef>
#include <cstdint>
#include <functional>
#include <memory>
#include <string>
#include <unordered_map>
#include <vector>

#include "block_store.h"
#include "rtree_occupancy_map/occupancy_map.h"
#include "rtree_occupancy_map/window.h"
#include "working_set.h"

namespace rtree_occupancy_map {

/// Which blocks are in the R-tree, inside of the window, and which are in the store alone, outside. Scans
/// bring blocks in; queries read those outside and leave them there. Where the store can't be read or written
/// functions throw std::runtime_error that names it; no block is lost then.
class RollingWindow {
 public:
  using Cells = std::shared_ptr<const std::vector<Cell>>;

  /// All blocks of the store are outside.
  RollingWindow(const WindowOptions& options, const Options& map, BlockStore::Access access);

  /// Whether this is the store's file.
  bool isIn(const std::string& path) const;
  /// Blocks that are brought in from now on are used by a new scan.
  void startScan() { ++scan_; }
  void bringIn(const std::vector<Block>& blocks, RTree& tree);
  void bringInAll(RTree& tree);
  /// Of a block that was brought in.
  void setChanged(const Block& block);
  /// Blocks that are too far from a position (m), or too many, leave.
  void trim(const Eigen::Vector3d& position, WorkingSet& working_set, RTree& tree);
  /// Writes what has changed.
  void flush(WorkingSet& working_set, RTree& tree);
  void clear();

  /// The blocks outside as cells of an R-tree of their own: tight boxes, log odds 1 where something in it is
  /// occupied, otherwise 0.
  const RTree& outside() const { return index_; }
  Cells cellsOf(const Block& block) const;
  /// Calls visit(cell) for each cell outside that overlaps the box. @return false if it was stopped
  bool visit(const VoxelBox& box, bool occupied_only, const std::function<bool(const Cell&)>& visit) const;
  /// Of the cells outside.
  const Statistics& totals() const { return totals_; }
  /// Those outside are added, in no order.
  void addBlocks(std::vector<Block>& blocks) const;

  std::size_t memoryUsage() const;  ///< bytes, without the R-tree that the blocks inside are in

 private:
  struct Inside {
    Block block;
    bool changed = false;  // since it was written, if ever it was
    std::uint64_t last_scan = 0;
    BlockSummary summary;  // as of the store
  };

  double distance(const Block& block, const Eigen::Vector3d& position) const;  // m
  void letGo(const std::vector<Inside*>& leaving, WorkingSet& working_set, RTree& tree);
  void write(const std::vector<Inside*>& blocks, const RTree& tree);
  void count(const BlockSummary& summary, int sign);

  const WindowOptions options_;
  const double resolution_;  // m
  const float occupied_log_odds_;
  std::unique_ptr<BlockStore> store_;
  std::uint64_t scan_ = 0;
  std::unordered_map<std::uint64_t, Inside> inside_;
  std::unordered_map<std::uint64_t, BlockSummary> outside_;
  RTree index_;
  Statistics totals_;
  mutable std::unordered_map<std::uint64_t, Cells> read_;  // for queries
  mutable std::size_t read_bytes_ = 0;
};

}  // namespace rtree_occupancy_map
