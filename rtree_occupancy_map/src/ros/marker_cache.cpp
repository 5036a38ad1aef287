// SPDX-License-Identifier: BSD-3-Clause
#include "rtree_occupancy_map/ros/marker_cache.h"

#include <algorithm>
#include <cmath>
#include <functional>
#include <stdexcept>
#include <string_view>

#include "rtree_occupancy_map/ros/cell_conversion.h"

namespace rtree_occupancy_map {
namespace {

constexpr float kFreeAlpha = 0.1F;

std_msgs::ColorRGBA colorOf(const MapSnapshot& map, const MapSnapshot::BlockCells& block, const Cell& cell,
                            const ColorScale& scale) {
  std_msgs::ColorRGBA color;
  const auto fraction = [&scale](double value) {
    return static_cast<float>(std::clamp((value - scale.min) / (scale.max - scale.min), 0.0, 1.0));
  };
  if (scale.mode == ColorMode::kColor) {
    const Color mean = block.colorOf(cell.box).value_or(kNoColor);
    color.r = static_cast<float>(mean[0]) / 255.0F;
    color.g = static_cast<float>(mean[1]) / 255.0F;
    color.b = static_cast<float>(mean[2]) / 255.0F;
  } else if (scale.mode == ColorMode::kReflectivity) {
    if (cell.reflectivity.hits > 0) {
      color.r = color.g = color.b = fraction(cell.reflectivity.mean);
    } else {
      color.b = 0.5F;  // none measured: a colour that is no grey
    }
  } else {
    const float f = scale.mode == ColorMode::kHeight
                        ? fraction(map.center(cell.box).z())
                        : static_cast<float>(OccupancyMap::probability(cell.log_odds));
    const auto ramp = [f](float peak) { return std::clamp(1.5F - std::abs(4.0F * f - peak), 0.0F, 1.0F); };
    color.r = ramp(3.0F);
    color.g = ramp(2.0F);
    color.b = ramp(1.0F);
  }
  color.a = map.isOccupied(cell) ? 1.0F : kFreeAlpha;
  return color;
}

// A cell taken apart.
void addVoxels(const Cell& cell, std::vector<Cell>& voxels) {
  Cell voxel = cell;
  for (int x = cell.box.min[0]; x < cell.box.max[0]; ++x) {
    for (int y = cell.box.min[1]; y < cell.box.max[1]; ++y) {
      for (int z = cell.box.min[2]; z < cell.box.max[2]; ++z) {
        voxel.box = VoxelBox::unit({x, y, z});
        voxels.push_back(voxel);
      }
    }
  }
}

template <class T>
std::size_t hashOf(const std::vector<T>& values) {
  return std::hash<std::string_view>()(
      {reinterpret_cast<const char*>(values.data()), values.size() * sizeof(T)});
}

}  // namespace

MarkerCache::MarkerCache(const std::string& frame_id, Show show) : show_(show) {
  marker_.header.frame_id = frame_id;  // stamp 0, the latest transform: a map isn't of one moment
  marker_.ns = show == Show::kOccupied ? "occupied" : "free";
  marker_.type = visualization_msgs::Marker::CUBE_LIST;
  marker_.pose.orientation.w = 1.0;
  marker_.color.a = 1.0F;
}

visualization_msgs::MarkerArray MarkerCache::changes(const MapSnapshot& blocks, const ColorScale& scale) {
  return show(blocks, scale, false);
}

visualization_msgs::MarkerArray MarkerCache::all(const MapSnapshot& map, const ColorScale& scale) {
  return show(map, scale, true);
}

visualization_msgs::MarkerArray MarkerCache::restart(const MapSnapshot& map, const ColorScale& scale) {
  clear();
  visualization_msgs::MarkerArray out = all(map, scale);
  marker_.points.clear();
  marker_.colors.clear();
  marker_.action = visualization_msgs::Marker::DELETEALL;
  out.markers.insert(out.markers.begin(), marker_);
  return out;
}

void MarkerCache::clear() {
  shown_.clear();
  free_ids_.clear();
  next_id_ = 0;
}

visualization_msgs::MarkerArray MarkerCache::show(const MapSnapshot& map, const ColorScale& scale,
                                                  bool unchanged_too) {
  visualization_msgs::MarkerArray out;
  std::vector<std::int32_t> freed;  // for later messages: RViz warns of an id that is twice in one
  std::map<Size, std::vector<Cell>> by_size;
  for (const MapSnapshot::BlockCells& block_cells : map.blocks) {
    const Block& block = block_cells.block;
    by_size.clear();
    for (const Cell& cell : block_cells.cells) {
      if (map.isOccupied(cell) != (show_ == Show::kOccupied)) continue;
      if (scale.mode == ColorMode::kColor && block_cells.colorOf(cell.box)) {
        addVoxels(cell, by_size[{1, 1, 1}]);
      } else {
        by_size[{cell.box.width(0), cell.box.width(1), cell.box.width(2)}].push_back(cell);
      }
    }

    // What vanished.
    for (auto shown = shown_.lower_bound({block, Size{}});
         shown != shown_.end() && shown->first.first == block;) {
      if (by_size.count(shown->first.second) > 0) {
        ++shown;
        continue;
      }
      marker_.points.clear();
      marker_.colors.clear();
      marker_.id = shown->second.id;
      marker_.action = visualization_msgs::Marker::DELETE;
      out.markers.push_back(marker_);
      freed.push_back(shown->second.id);
      shown = shown_.erase(shown);
    }
    // What there is.
    for (const auto& [size, cells] : by_size) {
      fill(map, block_cells, cells, scale);
      const std::size_t content = hashOf(marker_.points) ^ (3 * hashOf(marker_.colors));
      auto [shown, fresh] = shown_.insert({{block, size}, {0, content}});
      if (fresh) {
        if (free_ids_.empty()) free_ids_.push_back(next_id_++);
        shown->second.id = free_ids_.back();
        free_ids_.pop_back();
      }
      if (!fresh && !unchanged_too && shown->second.content == content) continue;
      shown->second.content = content;
      marker_.id = shown->second.id;
      marker_.action = visualization_msgs::Marker::ADD;
      out.markers.push_back(marker_);
    }
  }
  free_ids_.insert(free_ids_.end(), freed.begin(), freed.end());
  return out;
}

void MarkerCache::fill(const MapSnapshot& map, const MapSnapshot::BlockCells& block,
                       const std::vector<Cell>& cells, const ColorScale& scale) {
  const VoxelBox& box = cells.front().box;  // all are of this size
  marker_.scale.x = box.width(0) * map.resolution;
  marker_.scale.y = box.width(1) * map.resolution;
  marker_.scale.z = box.width(2) * map.resolution;
  marker_.points.clear();
  marker_.colors.clear();
  for (const Cell& cell : cells) {
    marker_.points.push_back(toPoint(map.center(cell.box)));
    marker_.colors.push_back(colorOf(map, block, cell, scale));
  }
}

}  // namespace rtree_occupancy_map
