// SPDX-License-Identifier: BSD-3-Clause
#include "rtree_occupancy_map/ros/projected_map.h"

#include <algorithm>
#include <cstdlib>
#include <limits>

#include "rtree_occupancy_map/ros/cell_conversion.h"

namespace rtree_occupancy_map {
namespace {

constexpr std::int8_t kUnknown = -1, kFree = 0, kOccupied = 100;

}  // namespace

void ProjectedMap::clear() {
  constexpr int lo = std::numeric_limits<int>::min(), hi = std::numeric_limits<int>::max();
  min_ = whole_min_ = {hi, hi};
  max_ = whole_max_ = {lo, lo};
  grid_ = {};
  grid_.info.width = grid_.info.height = 1;
  grid_.info.origin.orientation.w = 1.0;
  grid_.data = {kUnknown};
  layers_.clear();
}

void ProjectedMap::rebuild(const MapSnapshot& map, double min_z, double max_z, int max_size,
                           const std_msgs::Header& header) {
  clear();
  max_blocks_ = std::max(1, max_size / kBlockSize);
  heights_ = voxelsWithin({0.0, 0.0, min_z}, {0.0, 0.0, max_z}, map.resolution);
  grid_.info.resolution = static_cast<float>(map.resolution);
  map_msgs::OccupancyGridUpdate ignored;
  update(map, header, ignored);
}

bool ProjectedMap::update(const MapSnapshot& blocks, const std_msgs::Header& header,
                          map_msgs::OccupancyGridUpdate& patch) {
  std::vector<Column> columns;
  for (const MapSnapshot::BlockCells& block : blocks.blocks)
    if (setLayer(blocks, block)) columns.push_back({block.block[0], block.block[1]});
  std::sort(columns.begin(), columns.end());
  columns.erase(std::unique(columns.begin(), columns.end()), columns.end());
  leaveOutFar(blocks, columns);
  const bool grown = grow(columns, blocks.resolution);

  const int width = static_cast<int>(grid_.info.width);
  int min_x = width, max_x = 0, min_y = static_cast<int>(grid_.info.height),
      max_y = 0;  // what changed, half-open
  for (const Column& column : columns) {
    const Pixels pixels = project(column);
    const int x0 = (column[0] - min_[0]) * kBlockSize, y0 = (column[1] - min_[1]) * kBlockSize;
    for (int y = 0; y < kBlockSize; ++y) {
      for (int x = 0; x < kBlockSize; ++x) {
        std::int8_t& pixel = grid_.data[static_cast<std::size_t>(y0 + y) * width + x0 + x];
        if (pixel == pixels[y * kBlockSize + x]) continue;
        pixel = pixels[y * kBlockSize + x];
        min_x = std::min(min_x, x0 + x);
        max_x = std::max(max_x, x0 + x + 1);
        min_y = std::min(min_y, y0 + y);
        max_y = std::max(max_y, y0 + y + 1);
      }
    }
  }

  grid_.header = patch.header = header;
  grid_.info.map_load_time = header.stamp;
  patch.data.clear();
  patch.x = min_x;
  patch.y = min_y;
  patch.width = std::max(0, max_x - min_x);
  patch.height = std::max(0, max_y - min_y);
  for (int y = min_y; y < max_y; ++y) {
    const auto row = grid_.data.begin() + static_cast<std::ptrdiff_t>(y) * width;
    patch.data.insert(patch.data.end(), row + min_x, row + max_x);
  }
  return grown;
}

Eigen::Vector2d ProjectedMap::wholeSize() const {
  const double edge = kBlockSize * static_cast<double>(grid_.info.resolution);
  return {edge * std::max(0, whole_max_[0] - whole_min_[0]),
          edge * std::max(0, whole_max_[1] - whole_min_[1])};
}

// The nearest to what is shown go first, and at the start the nearest to where most is occupied.
void ProjectedMap::leaveOutFar(const MapSnapshot& blocks, std::vector<Column>& columns) {
  for (const Column& column : columns) {
    for (int i = 0; i < 2; ++i) {
      whole_min_[i] = std::min(whole_min_[i], column[i]);
      whole_max_[i] = std::max(whole_max_[i], column[i] + 1);
    }
  }
  if (!leavesOut() ||
      (whole_max_[0] - whole_min_[0] <= max_blocks_ && whole_max_[1] - whole_min_[1] <= max_blocks_)) {
    return;
  }
  const Column middle =
      min_[0] < max_[0] ? Column{(min_[0] + max_[0]) / 2, (min_[1] + max_[1]) / 2} : middleOf(blocks);
  const auto distance = [&](const Column& column) {
    return std::max(std::abs(column[0] - middle[0]), std::abs(column[1] - middle[1]));
  };
  std::stable_sort(columns.begin(), columns.end(),
                   [&](const Column& a, const Column& b) { return distance(a) < distance(b); });
  Column min = min_, max = max_;
  const auto isFar = [&](const Column& column) {
    Column new_min, new_max;
    for (int i = 0; i < 2; ++i) {
      new_min[i] = std::min(min[i], column[i]);
      new_max[i] = std::max(max[i], column[i] + 1);
      if (new_max[i] - new_min[i] > max_blocks_) return true;
    }
    min = new_min;
    max = new_max;
    return false;
  };
  columns.erase(std::remove_if(columns.begin(), columns.end(), isFar), columns.end());
}

// The median of the occupied cells. (Beams without a near end cross many blocks.)
ProjectedMap::Column ProjectedMap::middleOf(const MapSnapshot& blocks) {
  std::array<std::vector<int>, 2> values;
  for (const auto& [block, cells, colors] : blocks.blocks) {
    for (const Cell& cell : cells)
      for (int i = 0; i < 2 && blocks.isOccupied(cell); ++i) values[i].push_back(block[i]);
  }
  if (values[0].empty()) return {blocks.blocks.front().block[0], blocks.blocks.front().block[1]};
  Column middle;
  for (int i = 0; i < 2; ++i) {
    const auto at = values[i].begin() + static_cast<std::ptrdiff_t>(values[i].size() / 2);
    std::nth_element(values[i].begin(), at, values[i].end());
    middle[i] = *at;
  }
  return middle;
}

// Makes room for these columns.
bool ProjectedMap::grow(const std::vector<Column>& columns, double resolution) {
  Column min = min_, max = max_;
  for (const Column& column : columns) {
    for (int i = 0; i < 2; ++i) {
      min[i] = std::min(min[i], column[i]);
      max[i] = std::max(max[i], column[i] + 1);
    }
  }
  if (min == min_ && max == max_) return false;

  const int width = (max[0] - min[0]) * kBlockSize, height = (max[1] - min[1]) * kBlockSize;
  std::vector<std::int8_t> data(static_cast<std::size_t>(width) * height, kUnknown);
  for (int y = min_[1]; y < max_[1]; ++y) {  // rows of blocks
    for (int i = 0; i < kBlockSize; ++i) {
      const auto from =
          grid_.data.begin() + static_cast<std::ptrdiff_t>((y - min_[1]) * kBlockSize + i) * grid_.info.width;
      const auto to = data.begin() + static_cast<std::ptrdiff_t>((y - min[1]) * kBlockSize + i) * width;
      std::copy(from, from + grid_.info.width, to + (min_[0] - min[0]) * kBlockSize);
    }
  }
  grid_.data = std::move(data);
  min_ = min;
  max_ = max;
  grid_.info.width = width;
  grid_.info.height = height;
  grid_.info.origin.position.x = min[0] * kBlockSize * resolution;
  grid_.info.origin.position.y = min[1] * kBlockSize * resolution;
  return true;
}

// @return whether the block is within the heights
bool ProjectedMap::setLayer(const MapSnapshot& map, const MapSnapshot::BlockCells& block) {
  const VoxelBox box = OccupancyMap::boxOf(block.block);
  if (!(box.min[2] < heights_.max[2] && heights_.min[2] < box.max[2])) return false;
  Layer layer;
  bool any = false;
  for (const Cell& cell : block.cells) {
    const VoxelBox& b = cell.box;
    if (!(b.min[2] < heights_.max[2] && heights_.min[2] < b.max[2])) continue;
    any = true;
    const int x0 = b.min[0] - box.min[0], width = b.width(0);
    const std::uint32_t bits = (width == kBlockSize ? ~0u : (1u << width) - 1) << x0;
    for (int y = b.min[1] - box.min[1]; y < b.max[1] - box.min[1]; ++y) {
      layer.known[y] |= bits;
      if (map.isOccupied(cell)) layer.occupied[y] |= bits;
    }
  }
  std::map<int, Layer>& column = layers_[{block.block[0], block.block[1]}];
  if (any) {
    column[block.block[2]] = layer;
  } else {
    column.erase(block.block[2]);
  }
  return true;
}

ProjectedMap::Pixels ProjectedMap::project(const Column& column) const {
  Layer all;
  for (const auto& [z, layer] : layers_.at(column)) {
    for (int y = 0; y < kBlockSize; ++y) {
      all.known[y] |= layer.known[y];
      all.occupied[y] |= layer.occupied[y];
    }
  }
  Pixels pixels;
  for (int y = 0; y < kBlockSize; ++y) {
    for (int x = 0; x < kBlockSize; ++x) {
      const auto in = [&](const Rows& rows) { return (rows[y] >> x & 1) != 0; };
      pixels[y * kBlockSize + x] = in(all.occupied) ? kOccupied : in(all.known) ? kFree : kUnknown;
    }
  }
  return pixels;
}

}  // namespace rtree_occupancy_map
