// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <mapping_common/database.h>

#include <cstddef>
#include <cstdint>
#include <functional>
#include <memory>
#include <string>
#include <vector>

#include "rtree_occupancy_map/occupancy_map.h"

namespace rtree_occupancy_map {

/// What is known of a block without its cells.
struct BlockSummary {
  VoxelBox box = VoxelBox::empty();  // tight around its cells
  std::uint32_t cells = 0, occupied_cells = 0;
  std::uint32_t occupied_volume = 0, free_volume = 0;  // voxels
};

/// The cells of blocks in an SQLite file. Its write-ahead log keeps it whole whenever the program ends: a
/// block's cells are those of before or after a transaction. All functions throw std::runtime_error that
/// names the file and says what is wrong with it.
class BlockStore {
 public:
  enum class Access { kRead, kWrite };

  /// Writes a store of all blocks of a map, whole or not at all, in place of any of that name, which nobody
  /// may have open.
  static void create(const std::string& path, const OccupancyMap& map);

  static std::unique_ptr<BlockStore> open(const std::string& path, Access access);

  bool writes() const { return writes_; }
  /// What the map was built with.
  Options options() const;
  void visitSummaries(const std::function<void(const Block&, const BlockSummary&)>& visit) const;
  std::vector<Cell> read(const Block& block) const;

  /// Does all that `work` does, or nothing.
  void transaction(const std::function<void()>& work) { database_.transaction(work); }
  /// Without cells the block is erased. @return of the cells
  BlockSummary write(const Block& block, const std::vector<Cell>& cells);
  void clear();

 private:
  BlockStore(const std::string& path, mapping_common::Database::Access access);
  void prepareAll();

  bool writes_ = false;
  mapping_common::Database database_;
  float occupied_log_odds_ = 0.0F, min_log_odds_ = 0.0F, max_log_odds_ = 0.0F;
  bool reflectivity_ = false;
  mapping_common::Database::Statement read_, write_summary_, write_cells_, erase_summary_, erase_cells_;
};

}  // namespace rtree_occupancy_map
