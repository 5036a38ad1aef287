// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>
#include <array>
#include <cmath>
#include <cstdint>
#include <memory>
#include <vector>

#include "block_index.h"
#include "block_rows.h"

namespace rtree_occupancy_map {

/// Marks the voxels that the beams of a scan cross.
///
/// Which voxels those are is decided as OctoMap does: step by step over the nearest border (Amanatides and
/// Woo 1987), in double precision. A beam is first traced run by run along its dominant axis, in fixed point,
/// with a bound on the difference to those steps; where two borders are nearer to each other than that, it is
/// traced step by step.
class BeamTracer {
 public:
  struct Beam {
    Voxel end;                  // is not crossed
    Eigen::Vector3f end_point;  // m, in this voxel
  };

  /// @param resolution m
  explicit BeamTracer(double resolution) : resolution_(resolution) {}

  /// Begins a new scan.
  void start();
  /// From now on beams start at `origin` (m), inside of the map's coordinates.
  void setOrigin(const Eigen::Vector3f& origin);
  /// Marks the voxels from the origin's to the one before the end.
  void trace(const Beam& beam);

  std::size_t size() const { return index_.size(); }
  const Block& block(std::size_t number) const { return index_[number]; }
  /// Adds the voxels of a block that are crossed.
  void addTo(std::size_t number, BlockRows& crossed) const;

 private:
  /// A block's crossed voxels, by the dominant axis A of the beams: bit a of word high * 32 + low, where
  /// `low` is z, z, x and `high` is y, x, y for A = x, y, z.
  using Plane = BlockRows;
  static constexpr std::uint32_t kNone = ~0u;
  struct Slot {
    std::array<Plane*, 3> planes{};
    std::array<std::uint32_t, 6> neighbours{{kNone, kNone, kNone, kNone, kNone, kNone}};
  };
  struct Walk;

  bool prepare(const Beam& beam, Walk& walk) const;
  template <int A, bool kForward>
  bool traceRuns(const Walk& walk);
  void traceSteps(const Beam& beam, Walk walk);
  std::uint32_t slotOf(const Block& block);
  std::uint32_t neighbourOf(std::uint32_t slot, int axis, int sign);
  std::uint32_t* wordsOf(std::uint32_t slot, int axis);

  const double resolution_;
  Eigen::Vector3f origin_;
  Voxel origin_voxel_{};
  std::uint32_t origin_slot_ = 0;
  BlockIndex index_;
  std::vector<Slot> slots_;
  std::vector<std::unique_ptr<Plane>> planes_;  // the first used_planes_ are in use by this scan
  std::size_t used_planes_ = 0;
};

/// In just these steps, so that beams which graze an edge or a border fall to the same side as OctoMap's.
inline double lengthOf(const Eigen::Vector3f& v) {
  const double length = std::sqrt(static_cast<double>(v.x() * v.x() + v.y() * v.y() + v.z() * v.z()));
  return std::isfinite(length) ? length : static_cast<double>(v.stableNorm());
}
inline Eigen::Vector3f unitVector(const Eigen::Vector3f& v) {
  return v / static_cast<float>(lengthOf(v));
}

/// In place of ==, for which the compiler calls the C library.
inline bool isSame(const Voxel& a, const Voxel& b) {
  return ((a[0] ^ b[0]) | (a[1] ^ b[1]) | (a[2] ^ b[2])) == 0;
}

/// floor(coordinate / resolution); kMaxVoxel where that isn't in the map's coordinates. Without a branch, so
/// that compilers do several at once.
inline int toVoxelCoordinate(float coordinate, double inverse_resolution) {
  const double c = coordinate * inverse_resolution;
  const bool inside = static_cast<int>(c >= kMinVoxel) & static_cast<int>(c < kMaxVoxel);
  const double cut = inside ? c : kMaxVoxel;
  const int truncated = static_cast<int>(cut);
  return truncated - static_cast<int>(cut < truncated);
}

/// floor(coordinate / resolution), and whether that lies in the map's coordinates.
inline bool toVoxel(const Eigen::Vector3f& point, double inverse_resolution, Voxel& voxel) {
  bool inside = true;
  for (int i = 0; i < 3; ++i) {
    voxel[i] = toVoxelCoordinate(point[i], inverse_resolution);
    inside &= voxel[i] != kMaxVoxel;
  }
  return inside;
}

}  // namespace rtree_occupancy_map
