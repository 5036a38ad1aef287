// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <map_msgs/OccupancyGridUpdate.h>
#include <nav_msgs/OccupancyGrid.h>
#include <rtree_occupancy_map/map_snapshot.h>

#include <Eigen/Core>
#include <array>
#include <cstdint>
#include <map>
#include <vector>

namespace rtree_occupancy_map {

/// The map seen from above, between two heights: a pixel is 100 (occupied) if any voxel of its column is
/// occupied, else 0 (free) if any is free, else -1 (unknown). Only changed blocks are projected anew. Its
/// edges have a greatest length, as a single far return would make it too large for any subscriber: what is
/// farther out is left out.
class ProjectedMap {
 public:
  ProjectedMap() { clear(); }

  /// Empty: a single unknown pixel, as an OccupancyGrid must have one.
  void clear();
  /// From scratch, between the heights min_z and max_z (m). @param max_size pixels, longest edge
  void rebuild(const MapSnapshot& map, double min_z, double max_z, int max_size,
               const std_msgs::Header& header);
  /// @param patch the rectangle of pixels that changed, of zero width where none did
  /// @return whether the extent grew: the patch alone doesn't say enough then
  bool update(const MapSnapshot& blocks, const std_msgs::Header& header,
              map_msgs::OccupancyGridUpdate& patch);

  const nav_msgs::OccupancyGrid& grid() const { return grid_; }
  /// Edges of what there is to show (m), larger than the grid where something is left out.
  Eigen::Vector2d wholeSize() const;
  bool leavesOut() const { return whole_min_ != min_ || whole_max_ != max_; }

 private:
  using Column = std::array<int, 2>;  // of blocks
  using Pixels = std::array<std::int8_t, kBlockSize * kBlockSize>;

  // Seen from above: row y, bit x.
  using Rows = std::array<std::uint32_t, kBlockSize>;
  struct Layer {
    Rows known{}, occupied{};
  };

  void leaveOutFar(const MapSnapshot& blocks, std::vector<Column>& columns);
  static Column middleOf(const MapSnapshot& blocks);
  bool grow(const std::vector<Column>& columns, double resolution);
  bool setLayer(const MapSnapshot& map, const MapSnapshot::BlockCells& block);
  Pixels project(const Column& column) const;

  nav_msgs::OccupancyGrid grid_;
  Column min_, max_;                               // extent in blocks, half-open
  Column whole_min_, whole_max_;                   // the same of what there is to show
  int max_blocks_ = 1;                             // longest edge
  VoxelBox heights_;                               // of which z alone counts
  std::map<Column, std::map<int, Layer>> layers_;  // of blocks by their z
};

}  // namespace rtree_occupancy_map
