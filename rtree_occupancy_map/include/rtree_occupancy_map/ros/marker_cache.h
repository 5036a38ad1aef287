// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <mapping_common/options.h>
#include <rtree_occupancy_map/map_snapshot.h>
#include <visualization_msgs/MarkerArray.h>

#include <array>
#include <cstddef>
#include <cstdint>
#include <map>
#include <string>
#include <utility>
#include <vector>

namespace rtree_occupancy_map {

enum class ColorMode { kHeight, kOccupancy, kReflectivity, kColor };
constexpr auto choicesOf(ColorMode) {
  return mapping_common::choices<ColorMode>({{"height", ColorMode::kHeight, "of the cell's centre"},
                                             {"occupancy", ColorMode::kOccupancy, "the probability"},
                                             {"reflectivity", ColorMode::kReflectivity, "the mean"},
                                             {"color", ColorMode::kColor,
                                              "the mean, of a map with color: true; occupied cells are shown "
                                              "voxel by voxel, those without a colour white"}});
}

/// What the colours of cells stand for. Height and occupancy run from blue to red, reflectivity from black to
/// white.
struct ColorScale {
  ColorMode mode = ColorMode::kHeight;
  double min = 0.0;  ///< height (m) or reflectivity at the lower end
  double max = 3.0;  ///< and at the upper end; a probability always runs from 0 to 1
};

/// The map's occupied, or its free, cells as markers: one CUBE_LIST for each block and cell size that it has.
/// What was shown of each is remembered, so that later only what changed is sent: ADD for new content, DELETE
/// for what vanished. The ids are stable for as long as a marker is shown.
class MarkerCache {
 public:
  enum class Show { kOccupied, kFree };

  MarkerCache(const std::string& frame_id, Show show);

  /// What changed in these blocks since they were last shown.
  visualization_msgs::MarkerArray changes(const MapSnapshot& blocks, const ColorScale& scale);
  /// Everything, for one who has seen nothing yet. Ask for the changes first, or others will miss them.
  visualization_msgs::MarkerArray all(const MapSnapshot& map, const ColorScale& scale);
  /// Everything, for all, in the place of whatever was shown.
  visualization_msgs::MarkerArray restart(const MapSnapshot& map, const ColorScale& scale);
  void clear();

 private:
  using Size = std::array<int, 3>;  // voxels
  using Key = std::pair<Block, Size>;
  struct Shown {
    std::int32_t id;
    std::size_t content;  // hash
  };

  visualization_msgs::MarkerArray show(const MapSnapshot& map, const ColorScale& scale, bool unchanged_too);
  void fill(const MapSnapshot& map, const MapSnapshot::BlockCells& block, const std::vector<Cell>& cells,
            const ColorScale& scale);

  Show show_;
  visualization_msgs::Marker marker_;  // filled anew for each
  std::map<Key, Shown> shown_;
  std::vector<std::int32_t> free_ids_;
  std::int32_t next_id_ = 0;
};

}  // namespace rtree_occupancy_map
