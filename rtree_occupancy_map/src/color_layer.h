// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstddef>
#include <functional>
#include <map>
#include <optional>
#include <vector>

#include "block_rows.h"
#include "rtree_occupancy_map/color.h"
#include "rtree_occupancy_map/occupancy_map.h"

namespace rtree_occupancy_map {

/// The colours of a map's occupied voxels, block by block (Options::color).
class ColorLayer {
 public:
  /// A block's colours, for it to be updated; valid until forgetEmpty() or clear().
  BlockColors& at(const Block& block) { return blocks_[block]; }
  /// nullptr where a block has none.
  const BlockColors* find(const Block& block) const {
    const auto found = blocks_.find(block);
    return found != blocks_.end() ? &found->second : nullptr;
  }
  /// Forgets what isn't in `occupied` of a block.
  void keep(const Block& block, const BlockRows& occupied);
  void forgetEmpty(const Block& block);
  void clear() { blocks_.clear(); }

  /// In order of the blocks.
  const std::map<Block, BlockColors>& blocks() const { return blocks_; }
  std::size_t memoryUsage() const;  ///< bytes

 private:
  std::map<Block, BlockColors> blocks_;
};

/// The other way round than indexInBlock().
inline Voxel voxelIn(const Block& block, BlockColors::Index index) {
  return {block[0] * kBlockSize + (index / kBlockSize) % kBlockSize,
          block[1] * kBlockSize + index / kBlockRows, block[2] * kBlockSize + index % kBlockSize};
}

}  // namespace rtree_occupancy_map
