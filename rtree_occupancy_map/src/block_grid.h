// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <array>
#include <cstdint>
#include <utility>
#include <vector>

#include "log_odds.h"
#include "rtree_occupancy_map/occupancy_map.h"
#include "scan_raster.h"

namespace rtree_occupancy_map {

/// One block of the map, unpacked into voxels to be updated and fused. Between scans the cells live in the
/// R-tree.
class BlockGrid {
 public:
  static constexpr int kSize = kBlockSize;
  /// One bit a voxel: row y * kSize + x, bit z.
  using Rows = std::array<std::uint32_t, kSize * kSize>;
  /// A voxel's number in the block: row * kSize + z.
  static int indexOf(const Voxel& v) { return ((v[1] & 31) * kSize + (v[0] & 31)) * kSize + (v[2] & 31); }

  explicit BlockGrid(const Options& options);

  void start(const Block& block);
  void add(const VoxelBox& cell, float log_odds, const Reflectivity& reflectivity);
  /// Those cells of the leaf that lie in the block.
  void add(const RTree::Leaf& leaf, const VoxelBox& block);

  /// Eq. 2.7 for every voxel of the mask, once. @return whether any log odds changed
  bool update(const ScanRaster::Mask& mask);
  /// Takes one return into the mean reflectivity of a voxel.
  void addReflectivity(int index, float value);
  /// Makes known voxels of the box free. @return whether any log odds changed
  bool setFree(const VoxelBox& box);

  /// The cells after fusion, such that cells near each other in the list are near each other in space.
  /// @param selected voxels whose cells may expand (FusionStrategy::kExpansion)
  void fuse(const std::vector<int>& selected, std::vector<Cell>& cells);

  std::int64_t knownVoxels() const;
  /// Voxels at the lower clamping threshold.
  const Rows& settledFree() const { return low_; }

 private:
  // Half-open, in the block's own coordinates.
  struct LocalBox {
    int min[3], max[3];
  };
  enum class Class { kLow, kHigh, kBetween };

  struct Piece {  // a cell to be
    LocalBox box;
    Class c;
  };

  const Rows& rowsOf(Class c) const { return c == Class::kLow ? low_ : c == Class::kHigh ? high_ : between_; }
  Rows& rowsOf(Class c) { return const_cast<Rows&>(std::as_const(*this).rowsOf(c)); }
  void set(int row, int z, float log_odds);
  float logOddsOf(Class c, int index) const {
    return c == Class::kLow ? model_.min : c == Class::kHigh ? model_.max : value_[index];
  }
  bool fusible(Class c) const;
  bool slabFits(Class c, float log_odds, const LocalBox& slab) const;
  void linkNeighbours();
  template <bool kLinked, class Sink>
  void fuseGreedily(Rows& open, const LocalBox& within, Sink&& sink) const;
  template <class Sink>
  void fuseClass(Rows& open, Class c, const LocalBox& within, Sink&& sink) const;
  void splitPieces();
  void expand(const std::vector<int>& selected);
  bool expandOnce(int number);
  void own(int number, const LocalBox& box);
  void emit(const LocalBox& box, Class c);
  void order(std::vector<Cell>& cells);

  const Options options_;  // not a reference: the map that owns both may be moved
  const LogOddsModel model_;
  std::array<int, 3> axes_;  // of the search order

  std::array<int, 3> base_{};                       // voxel coordinates of the block's min corner
  Rows low_, high_, between_;                       // known voxels, by class
  std::array<float, kSize * kSize * kSize> value_;  // log odds, of voxels between the thresholds
  Rows textured_;                                   // voxels with a reflectivity
  std::vector<Reflectivity> reflectivity_;
  std::array<Rows, 3> linked_;        // voxels of equal log odds as their next one along each axis
  std::vector<Piece> pieces_;         // the cells of the block, during fusion
  std::vector<std::uint16_t> owner_;  // of a voxel: number of its piece; expansion only
  std::vector<Cell> out_;
  std::vector<std::uint8_t> ranks_;
};

}  // namespace rtree_occupancy_map
