// SPDX-License-Identifier: BSD-3-Clause
//
// Colours of what is occupied (Options::color), voxel by voxel. They are beside the R-tree, not in its cells:
// maps without colours, and the cells of those with them, are what they would be anyway.
#pragma once

#include <algorithm>
#include <array>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <optional>
#include <vector>

#include "rtree_occupancy_map/cell.h"

namespace rtree_occupancy_map {

/// Red, green, blue, 0 to 255.
using Color = std::array<std::uint8_t, 3>;

/// Where exported files and messages have to have a colour and there is none, as in OctoMap.
constexpr Color kNoColor = {255, 255, 255};

/// As PCL and sensor_msgs/PointCloud2 have it in the fields rgb and rgba: 0xAARRGGBB, also where a field is
/// called a float32.
inline std::uint32_t packedColor(const Color& c) {
  return 0xff000000U | std::uint32_t{c[0]} << 16 | std::uint32_t{c[1]} << 8 | c[2];
}
inline Color unpackedColor(std::uint32_t packed) {
  const auto byte = [packed](int shift) { return static_cast<std::uint8_t>(packed >> shift); };
  return {byte(16), byte(8), byte(0)};
}

/// The colours of a voxel's returns, summed up: their mean doesn't depend on the order in which they came.
struct ColorSum {
  std::array<std::uint32_t, 3> sum{{0, 0, 0}};
  std::uint32_t returns = 0;

  /// Of one or more returns; there is none of no return.
  Color mean() const {
    Color color;
    for (int i = 0; i < 3; ++i) color[i] = static_cast<std::uint8_t>((sum[i] + returns / 2) / returns);
    return color;
  }
  void add(const Color& color) { add({{color[0], color[1], color[2]}, 1}); }
  /// Of more returns than fit, 16 million, all count half as much from then on.
  void add(const ColorSum& more) {
    constexpr std::uint64_t kMost = std::numeric_limits<std::uint32_t>::max() / 256;
    const int shift = std::uint64_t{returns} + more.returns > kMost ? 1 : 0;
    const auto together = [shift](std::uint32_t a, std::uint32_t b) {
      return static_cast<std::uint32_t>((std::uint64_t{a} + b) >> shift);
    };
    for (int i = 0; i < 3; ++i) sum[i] = together(sum[i], more.sum[i]);
    returns = together(returns, more.returns);
    for (int i = 0; i < 3; ++i) sum[i] = std::min(sum[i], 255 * returns);  // after rounding
  }
  /// Whether a mean can be that: of any bytes of a file.
  bool isSound() const {
    return returns > 0 && returns <= std::numeric_limits<std::uint32_t>::max() / 256 &&
           *std::max_element(sum.begin(), sum.end()) <= 255 * returns;
  }
  bool operator==(const ColorSum& o) const { return sum == o.sum && returns == o.returns; }
};

/// Of one voxel of a map.
struct ColoredVoxel {
  Voxel voxel;
  ColorSum color;
};

/// The colours of a block's voxels.
class BlockColors {
 public:
  /// A voxel of the block, row by row: (y * 32 + x) * 32 + z, with x, y, z in the block.
  using Index = std::uint16_t;
  struct Entry {
    Index voxel;
    ColorSum color;
  };

  bool empty() const { return voxels_.empty(); }
  std::size_t size() const { return voxels_.size(); }
  Index voxel(std::size_t i) const { return voxels_[i]; }
  const ColorSum& color(std::size_t i) const { return colors_[i]; }
  /// The mean over the voxels in a box in the block's coordinates that have one, each by its own mean.
  std::optional<Color> meanIn(const VoxelBox& box) const;

  /// Adds what was seen, sorted by voxel, and forgets what isn't in `occupied`, a bit z of word y * 32 + x
  /// for each voxel. @return whether any voxel's mean is another one
  bool update(const std::vector<Entry>& seen, const std::array<std::uint32_t, 1024>& occupied);

  std::size_t memoryUsage() const {  ///< bytes, with what it lies in
    return sizeof(*this) + voxels_.capacity() * sizeof(Index) + colors_.capacity() * sizeof(ColorSum);
  }

 private:
  std::vector<Index> voxels_;  // ascending
  std::vector<ColorSum> colors_;
};

}  // namespace rtree_occupancy_map
