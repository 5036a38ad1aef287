// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <array>
#include <cstdint>
#include <vector>

#include "block_rows.h"
#include "block_voxels.h"
#include "log_odds.h"
#include "rtree_occupancy_map/occupancy_map.h"

namespace rtree_occupancy_map {

/// Divides the voxels of a block into the cells that the R-tree holds.
class BlockGrid {
 public:
  static constexpr int kSize = kBlockSize;

  explicit BlockGrid(const Options& options);

  /// The cells of a block after fusion, such that cells near each other in the list are near each other in
  /// space.
  /// @param before the boxes of the cells that the block has had (FusionStrategy::kExpansion)
  /// @param selected voxels whose cells may expand (FusionStrategy::kExpansion)
  void fuse(const Block& block, const BlockVoxels& voxels, const std::vector<VoxelBox>& before,
            const std::vector<int>& selected, std::vector<Cell>& cells);

 private:
  using Rows = BlockRows;
  using Class = VoxelClass;
  // Half-open, in the block's own coordinates.
  struct LocalBox {
    int min[3], max[3];
  };
  struct Piece {  // a cell to be
    LocalBox box;
    Class c;
  };
  // A cell on its way into the list, short, as there are many.
  struct Found {
    std::array<std::uint8_t, 3> min, max;
    std::uint8_t rank;  // in the order of the list
    float log_odds;
  };

  float logOddsOf(Class c, int index) const {
    return c == Class::kLow ? model_.min : c == Class::kHigh ? model_.max : dense_.log_odds[index];
  }
  bool fusible(Class c) const;
  bool slabFits(Class c, float log_odds, const LocalBox& slab) const;
  template <bool kLinked, class Sink, class Singles>
  void fuseGreedily(Rows& open, const LocalBox& within, Sink&& sink, Singles&& singles) const;
  template <class Sink, class Singles>
  void fuseClass(Rows& open, Class c, const LocalBox& within, Sink&& sink, Singles&& singles) const;
  void splitPieces(const std::vector<VoxelBox>& before);
  void expand(const std::vector<int>& selected);
  bool expandOnce(int number);
  void own(int number, const LocalBox& box);
  void emit(const LocalBox& box, Class c);
  void emitSingles(int x, int y, std::uint32_t voxels, Class c);
  Reflectivity reflectivityOf(const Found& cell) const;
  void order(std::vector<Cell>& cells);

  const Options options_;  // not a reference: the map that owns both may be moved
  const LogOddsModel model_;
  std::array<int, 3> axes_;  // of the search order

  std::array<int, 3> base_{};            // voxel coordinates of the block's min corner
  const BlockVoxels* voxels_ = nullptr;  // the block in work
  DenseBlock dense_;                     // its log odds between the thresholds, and its reflectivities
  std::array<Rows, 3> linked_;           // voxels of equal log odds as their next one along each axis
  std::vector<Piece> pieces_;            // the cells of the block, during fusion
  std::vector<std::uint16_t> owner_;     // of a voxel: number of its piece; expansion only
  std::vector<Found> found_;             // as many as there can be; the first num_found_ are of this block
  std::size_t num_found_ = 0;
};

}  // namespace rtree_occupancy_map
