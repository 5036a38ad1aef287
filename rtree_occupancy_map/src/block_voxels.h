// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <array>
#include <cstdint>
#include <memory>
#include <utility>
#include <vector>

#include "block_rows.h"
#include "log_odds.h"
#include "row_kernels.h"

namespace rtree_occupancy_map {

/// A known voxel is at the lower clamping threshold, at the upper one, or between them.
enum class VoxelClass { kLow, kHigh, kBetween };

/// A block voxel by voxel, where memory doesn't matter: for one block at a time. Numbered as indexInBlock().
struct DenseBlock {
  explicit DenseBlock(bool with_reflectivity) {
    if (with_reflectivity) reflectivity.resize(log_odds.size());
  }
  std::array<float, kBlockRows * kBlockSize + kRowOverhang> log_odds;
  std::vector<Reflectivity> reflectivity;
};

/// One block of the map, taken apart into voxels to be updated. Log odds take memory only between the
/// thresholds, where few voxels are.
class BlockVoxels {
 public:
  const BlockRows& rows(VoxelClass c) const {
    return c == VoxelClass::kLow ? low_ : c == VoxelClass::kHigh ? high_ : between_;
  }
  /// Voxels with a reflectivity.
  const BlockRows* textured() const { return texture_ ? &texture_->rows : nullptr; }

  /// Begins with an unknown block; add() it cell by cell, in the block's coordinates, then pack().
  void start();
  void add(const VoxelBox& cell, float log_odds, const Reflectivity& reflectivity, const LogOddsModel& model,
           DenseBlock& dense);
  void pack(const DenseBlock& dense);
  /// Writes what pack() took.
  void unpack(DenseBlock& dense) const;

  /// Eq. 2.7 for every voxel of the mask, once. @param settle what has reached a threshold stays as it is
  /// @return whether any log odds changed
  bool update(const ScanMask& mask, const LogOddsModel& model, bool settle, DenseBlock& buffer);
  /// Makes known voxels of the box, in the block's coordinates, free. @return whether any log odds changed
  bool setFree(const VoxelBox& box);
  /// What is occupied and not in `seen` takes a miss, and is unknown when it is no longer occupied.
  /// @param seen null: nothing @return whether any log odds changed
  bool decay(const BlockRows* seen, const LogOddsModel& model, DenseBlock& buffer);
  bool anyOccupied(const LogOddsModel& model) const;
  BlockRows occupied(const LogOddsModel& model) const;
  /// Takes returns (index of a voxel, value) into the mean reflectivities, in this order.
  void addReflectivity(const std::vector<std::pair<int, float>>& returns, DenseBlock& buffer);

  std::int64_t knownVoxels() const;
  std::size_t memoryUsage() const;  ///< bytes

 private:
  struct Texture {
    BlockRows rows{};
    std::vector<Reflectivity> values;
  };
  void packTexture(const DenseBlock& dense);
  void unpackTexture(DenseBlock& dense) const;

  BlockRows low_, high_, between_;               // known voxels, by class
  std::array<std::uint16_t, kBlockRows> begin_;  // of a row in log_odds_
  std::vector<float> log_odds_;                  // of voxels between the thresholds, row by row
  std::unique_ptr<Texture> texture_;
};

}  // namespace rtree_occupancy_map
