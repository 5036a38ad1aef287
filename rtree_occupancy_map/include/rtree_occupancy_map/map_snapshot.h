// SPDX-License-Identifier: BSD-3-Clause
//
// What takes a map to another thread, or to whom it is shown.
#pragma once

#include <Eigen/Core>
#include <mutex>
#include <optional>
#include <utility>
#include <vector>

#include "rtree_occupancy_map/occupancy_map.h"

namespace rtree_occupancy_map {

/// All blocks with at least one cell, sorted.
std::vector<Block> knownBlocks(const OccupancyMap& map);

/// Copies of the cells of some blocks, and what it takes to show them while the map goes on changing.
struct MapSnapshot {
  struct BlockCells {
    Block block;
    std::vector<Cell> cells;
    BlockColors colors{};

    /// As OccupancyMap::colorOf.
    std::optional<Color> colorOf(const VoxelBox& box) const;
  };

  /// Of the whole map.
  MapSnapshot(const OccupancyMap& map)
      : MapSnapshot(map, knownBlocks(map)) {}  // NOLINT(google-explicit-constructor)
  /// Of these blocks, which are sorted; those without a cell are in it, too.
  MapSnapshot(const OccupancyMap& map, const std::vector<Block>& some);

  bool isOccupied(const Cell& cell) const { return cell.log_odds >= occupied_log_odds; }
  Eigen::Vector3d minCorner(const VoxelBox& b) const {
    return resolution * Eigen::Vector3d(b.min[0], b.min[1], b.min[2]);
  }
  Eigen::Vector3d maxCorner(const VoxelBox& b) const {
    return resolution * Eigen::Vector3d(b.max[0], b.max[1], b.max[2]);
  }
  Eigen::Vector3d center(const VoxelBox& b) const { return 0.5 * (minCorner(b) + maxCorner(b)); }

  bool colored;       ///< Options::color
  double resolution;  ///< m
  float occupied_log_odds;
  std::vector<BlockCells> blocks;  ///< sorted
};

/// A map that one thread changes while others look at it, each for as short as it can. They take turns.
class SharedMap {
 public:
  /// @return what use(map) returns, which nobody else uses meanwhile
  template <class Use>
  auto operator()(Use&& use) const {
    std::unique_lock<std::mutex> turn(turn_);
    const std::lock_guard<std::mutex> lock(mutex_);
    turn.unlock();  // whoever comes next waits here, and the one who has just been waits behind
    return use(map_);
  }

  /// Some blocks at a time, so that nobody waits for long. What changes meanwhile may be old or new in it.
  MapSnapshot snapshot(const std::vector<Block>& blocks) const;
  MapSnapshot snapshot() const;

 private:
  mutable std::mutex turn_, mutex_;
  mutable OccupancyMap map_;
};

}  // namespace rtree_occupancy_map
