// SPDX-License-Identifier: BSD-3-Clause
//
// What is done to the 32 voxels of a row at once.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>

#include "block_rows.h"
#include "log_odds.h"

namespace rtree_occupancy_map {

/// A row of voxels by class, the log odds between the thresholds that it has, and those that it gets.
struct RowUpdate {
  std::uint32_t low, high, between;
  const float* in;  // behind what was read, afterwards
  float* out;       // behind what was written, afterwards
};

/// Log odds are written in pieces: so many floats behind the last one may be overwritten.
constexpr int kRowOverhang = 16;

struct RowKernels {
  /// Eq. 2.7 for the voxels of `hit` and of `miss`, which have none in common, and nothing else in the row.
  void (*update)(RowUpdate& row, std::uint32_t hit, std::uint32_t miss, const LogOddsModel& model);
  /// Writes number after number to the places, by indexInBlock, of the voxels in `rows`. The others in their
  /// rows may be overwritten.
  void (*unpack)(const BlockRows& rows, const float* in, float* out);
  /// Of the voxels in `rows`, those of equal log odds as the next one along x, y and z, if that is in `rows`.
  /// Rows without voxels stay as they are.
  /// @param log_odds by indexInBlock; one more than there are voxels can be read
  void (*link)(const BlockRows& rows, const float* log_odds, std::array<BlockRows, 3>& linked);
  /// Of so many coordinates (m) those in voxels, as toVoxelCoordinate has them.
  void (*to_voxels)(const float* coordinates, std::size_t count, double inverse_resolution, int* voxels);
};

/// For any processor.
const RowKernels& portableRowKernels();
/// For this one: those of AVX-512 where it has that. The results are the same, to the bit.
const RowKernels& rowKernels();

}  // namespace rtree_occupancy_map
