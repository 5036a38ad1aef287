// SPDX-License-Identifier: BSD-3-Clause
//
// Sets of voxels of a block as bits.
#pragma once

#include <array>
#include <cstdint>

#include "rtree_occupancy_map/occupancy_map.h"

namespace rtree_occupancy_map {

/// One bit a voxel: row y * kBlockSize + x, bit z.
constexpr int kBlockRows = kBlockSize * kBlockSize;
using BlockRows = std::array<std::uint32_t, kBlockRows>;

/// What a scan does to the voxels of a block: ends in them, or only crosses them. No voxel is in both.
struct ScanMask {
  std::uint32_t layers = 0;  // bit y: of which rows y * kBlockSize + x are set below; the others aren't
  BlockRows hit, crossed;
};

/// Whether there is any voxel in the rows y * kBlockSize + x.
inline bool anyInLayer(const BlockRows& rows, int y) {
  std::uint32_t any = 0;
  for (int x = 0; x < kBlockSize; ++x) any |= rows[y * kBlockSize + x];
  return any != 0;
}

/// Bits z0 to z1 - 1.
inline std::uint32_t bits(int z0, int z1) {
  return (z1 - z0 == 32 ? ~0u : (1u << (z1 - z0)) - 1) << z0;
}

template <class Function>
void forEachBit(std::uint32_t word, Function&& f) {
  for (; word != 0; word &= word - 1) f(__builtin_ctz(word));
}

/// A voxel's number in its block: row * kBlockSize + z.
inline int indexInBlock(const Voxel& v) {
  constexpr int kMask = kBlockSize - 1;
  return ((v[1] & kMask) * kBlockSize + (v[0] & kMask)) * kBlockSize + (v[2] & kMask);
}

/// A box in the coordinates of the block that it lies in.
inline VoxelBox localBox(const VoxelBox& box, const VoxelBox& block) {
  VoxelBox local;
  for (int i = 0; i < 3; ++i) {
    local.min[i] = static_cast<std::int16_t>(box.min[i] - block.min[i]);
    local.max[i] = static_cast<std::int16_t>(box.max[i] - block.min[i]);
  }
  return local;
}

}  // namespace rtree_occupancy_map
