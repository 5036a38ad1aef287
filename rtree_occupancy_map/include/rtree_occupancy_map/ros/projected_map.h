// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <map_msgs/OccupancyGridUpdate.h>
#include <nav_msgs/OccupancyGrid.h>
#include <rtree_occupancy_map/occupancy_map.h>

#include <array>
#include <cstdint>
#include <vector>

namespace rtree_occupancy_map {

/// The map seen from above, between two heights: a pixel is 100 (occupied) if any voxel of its column is
/// occupied, else 0 (free) if any is free, else -1 (unknown). Only the columns of changed blocks are
/// projected anew.
class ProjectedMap {
 public:
  ProjectedMap() { clear(); }

  /// Empty: a single unknown pixel, as an OccupancyGrid must have one.
  void clear();
  /// From scratch, between the heights min_z and max_z (m).
  void rebuild(const OccupancyMap& map, double min_z, double max_z, const std_msgs::Header& header);
  /// @param patch the rectangle of pixels that changed, of zero width where none did
  /// @return whether the extent grew: the patch alone doesn't say enough then
  bool update(const OccupancyMap& map, const std::vector<Block>& blocks, const std_msgs::Header& header,
              map_msgs::OccupancyGridUpdate& patch);

  const nav_msgs::OccupancyGrid& grid() const { return grid_; }

 private:
  using Column = std::array<int, 2>;  // of blocks
  using Pixels = std::array<std::int8_t, kBlockSize * kBlockSize>;

  bool grow(const std::vector<Column>& columns, double resolution);
  Pixels project(const OccupancyMap& map, const Column& column) const;

  nav_msgs::OccupancyGrid grid_;
  Column min_, max_;  // extent in blocks, half-open
  VoxelBox heights_;  // of which z alone counts
};

}  // namespace rtree_occupancy_map
