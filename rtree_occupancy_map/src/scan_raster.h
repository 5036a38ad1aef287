// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>
#include <array>
#include <cmath>
#include <cstdint>
#include <memory>
#include <vector>

#include "rtree_occupancy_map/occupancy_map.h"

namespace rtree_occupancy_map {

/// The voxels that one scan touches, each once, as bit masks of blocks.
class ScanRaster {
 public:
  /// Bit z of crossed(x, y) or hit(x, y): the voxel (x, y, z) of the block is crossed or ended in.
  struct Mask {
    std::uint32_t words[kBlockSize][2 * kBlockSize];  // [y][x] crossed, [y][kBlockSize + x] hit
    std::uint32_t crossed(int x, int y) const { return words[y][x]; }
    std::uint32_t hit(int x, int y) const { return words[y][kBlockSize + x]; }
  };

  /// @param resolution m
  explicit ScanRaster(double resolution) : resolution_(resolution) {}

  /// Begins a new scan whose beams start at `origin` (m), inside of the map's coordinates.
  void start(const Eigen::Vector3f& origin);

  /// @return true the first time that this scan ends in this voxel
  bool markHit(const Voxel& voxel);

  /// Marks the voxels from the origin's to the one before `end`, which holds the point `end_point` (m), as
  /// crossed: at the latest by finish().
  void addBeam(const Voxel& end, const Eigen::Vector3f& end_point) { beams_.push_back({end, end_point}); }
  void finish();

  std::size_t size() const { return blocks_.size(); }
  const Block& block(std::size_t i) const { return blocks_[i]; }
  const Mask& mask(std::size_t i) const { return *masks_[i]; }
  /// The number of a block in this scan, taken up if it is new.
  std::uint32_t slotOf(const Block& block);

  static std::uint64_t key(const Block& b) {
    const auto u = [](int c) { return static_cast<std::uint64_t>(c + (1 << 15)); };
    return u(b[0]) | u(b[1]) << 20 | u(b[2]) << 40;
  }

 private:
  struct Bucket {
    std::uint64_t key = kFree;
    std::uint32_t slot = 0;
  };
  static constexpr std::uint64_t kFree = ~std::uint64_t{0};
  struct Beam {
    Voxel end;
    Eigen::Vector3f end_point;
  };
  void grow();
  struct Walk;
  void traceBeam(const Beam& beam);
  template <int A>
  void stride(Walk& walk);
  int step(Walk& walk);
  void leaveBlock(Walk& walk, int axis);

  const double resolution_;
  Eigen::Vector3f origin_;
  Voxel origin_voxel_{};
  std::uint32_t* origin_words_ = nullptr;
  std::vector<Block> blocks_;
  std::vector<std::unique_ptr<Mask>> masks_;  // at least as many as blocks; the rest is for the next scans
  std::vector<Bucket> table_;                 // open addressing, a power of two
  std::vector<Beam> beams_, sorted_beams_;
  Block last_hit_block_{};
  Mask* last_hit_mask_ = nullptr;
};

/// In just these steps, so that beams which graze an edge or a border fall to the same side as OctoMap's.
inline double lengthOf(const Eigen::Vector3f& v) {
  const double length = std::sqrt(static_cast<double>(v.x() * v.x() + v.y() * v.y() + v.z() * v.z()));
  return std::isfinite(length) ? length : static_cast<double>(v.stableNorm());
}
inline Eigen::Vector3f unitVector(const Eigen::Vector3f& v) {
  return v / static_cast<float>(lengthOf(v));
}

/// floor(coordinate / resolution), and whether that lies in the map's coordinates.
inline bool toVoxel(const Eigen::Vector3f& point, double inverse_resolution, Voxel& voxel) {
  for (int i = 0; i < 3; ++i) {
    const double c = point[i] * inverse_resolution;
    if (!(c >= kMinVoxel && c < kMaxVoxel)) return false;
    const int truncated = static_cast<int>(c);
    voxel[i] = truncated - (c < truncated);
  }
  return true;
}

}  // namespace rtree_occupancy_map
