// SPDX-License-Identifier: BSD-3-Clause
//
// The two plain structs that everything here is made of: an axis-aligned cuboid in voxel coordinates, and a
// grid cell (section 2.4: the tuple (R_i, o_i)).
#pragma once

#include <algorithm>
#include <array>
#include <cstdint>
#include <limits>

namespace rtree_occupancy_map {

/// Integer voxel coordinates x, y, z; voxel v spans [v, v + 1) * resolution along each axis.
using Voxel = std::array<int, 3>;

/// Voxel coordinates lie in [kMinVoxel, kMaxVoxel): 6.5 km to each side of the map's origin at 20 cm.
constexpr int kMinVoxel = -32736;
constexpr int kMaxVoxel = 32736;

/// Axis-aligned cuboid of voxels, half-open: min is inside, max is not.
struct VoxelBox {
  std::array<std::int16_t, 3> min{{0, 0, 0}};
  std::array<std::int16_t, 3> max{{0, 0, 0}};

  /// The neutral element of unite(): contains nothing.
  static VoxelBox empty() {
    constexpr std::int16_t lo = std::numeric_limits<std::int16_t>::min(),
                           hi = std::numeric_limits<std::int16_t>::max();
    return {{{hi, hi, hi}}, {{lo, lo, lo}}};
  }
  static VoxelBox all() {
    constexpr std::int16_t lo = std::numeric_limits<std::int16_t>::min(),
                           hi = std::numeric_limits<std::int16_t>::max();
    return {{{lo, lo, lo}}, {{hi, hi, hi}}};
  }
  static VoxelBox unit(const Voxel& v) {
    const auto s = [](int c) { return static_cast<std::int16_t>(c); };
    return {{{s(v[0]), s(v[1]), s(v[2])}}, {{s(v[0] + 1), s(v[1] + 1), s(v[2] + 1)}}};
  }

  int width(int axis) const { return max[axis] - min[axis]; }
  /// In voxels.
  std::int64_t volume() const { return std::int64_t{1} * width(0) * width(1) * width(2); }
  /// Sum of the widths: the R* split's margin, up to a factor.
  int margin() const { return width(0) + width(1) + width(2); }
  bool isEmpty() const { return width(0) <= 0 || width(1) <= 0 || width(2) <= 0; }

  bool operator==(const VoxelBox& o) const { return min == o.min && max == o.max; }
  bool operator!=(const VoxelBox& o) const { return !(*this == o); }
  bool overlaps(const VoxelBox& o) const {
    return (min[0] < o.max[0]) & (o.min[0] < max[0]) & (min[1] < o.max[1]) & (o.min[1] < max[1]) &
           (min[2] < o.max[2]) & (o.min[2] < max[2]);
  }
  bool contains(const VoxelBox& o) const {
    return (min[0] <= o.min[0]) & (o.max[0] <= max[0]) & (min[1] <= o.min[1]) & (o.max[1] <= max[1]) &
           (min[2] <= o.min[2]) & (o.max[2] <= max[2]);
  }
  bool contains(const Voxel& v) const {
    return (min[0] <= v[0]) & (v[0] < max[0]) & (min[1] <= v[1]) & (v[1] < max[1]) & (min[2] <= v[2]) &
           (v[2] < max[2]);
  }
};

inline VoxelBox unite(const VoxelBox& a, const VoxelBox& b) {
  VoxelBox u;
  for (int i = 0; i < 3; ++i) {
    u.min[i] = std::min(a.min[i], b.min[i]);
    u.max[i] = std::max(a.max[i], b.max[i]);
  }
  return u;
}

/// The common part; isEmpty() where there is none.
inline VoxelBox intersect(const VoxelBox& a, const VoxelBox& b) {
  VoxelBox u;
  for (int i = 0; i < 3; ++i) {
    u.min[i] = std::max(a.min[i], b.min[i]);
    u.max[i] = std::min(a.max[i], b.max[i]);
  }
  return u;
}

/// Mean of the returns of a cell's surface; no returns, no mean. In a fused cell: the mean over its voxels
/// that had returns, and their mean number of returns.
struct Reflectivity {
  float mean = std::numeric_limits<float>::quiet_NaN();
  std::uint32_t hits = 0;
};

/// One cell of the grid, an entry of a leaf of the R-tree. All voxels in its box share its log odds.
struct Cell {
  VoxelBox box;
  float log_odds = 0.0F;
  Reflectivity reflectivity;
};

}  // namespace rtree_occupancy_map
