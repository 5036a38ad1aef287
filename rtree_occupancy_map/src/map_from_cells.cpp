// SPDX-License-Identifier: BSD-3-Clause
#include <algorithm>
#include <cmath>
#include <stdexcept>
#include <utility>

#include "block_grid.h"
#include "insertion.h"
#include "rtree_occupancy_map/occupancy_map.h"

namespace rtree_occupancy_map {
namespace {

// A cell, as far as it is in a block.
struct Part {
  Block block;
  const Cell* cell;
};

void check(const Cell& cell) {
  for (int i = 0; i < 3; ++i) {
    if (cell.box.width(i) <= 0 || cell.box.min[i] < kMinVoxel || cell.box.max[i] > kMaxVoxel)
      throw std::invalid_argument("a cell is empty or outside of the map's coordinates");
  }
  if (!std::isfinite(cell.log_odds)) throw std::invalid_argument("a cell's log odds aren't finite");
}

std::vector<Part> partsOf(const std::vector<Cell>& cells) {
  const auto first = [](const VoxelBox& b) { return OccupancyMap::blockOf({b.min[0], b.min[1], b.min[2]}); };
  const auto last = [](const VoxelBox& b) {
    return OccupancyMap::blockOf({b.max[0] - 1, b.max[1] - 1, b.max[2] - 1});
  };
  std::vector<Part> parts;
  std::size_t beyond_first = 0;  // parts of cells beside their first ones
  for (const Cell& cell : cells) {
    check(cell);
    const Block min = first(cell.box), max = last(cell.box);
    std::size_t blocks = 1;
    for (int i = 0; i < 3; ++i) blocks *= static_cast<std::size_t>(max[i] - min[i] + 1);
    beyond_first += blocks - 1;
    if (beyond_first > kMostBlocks) throw std::invalid_argument("the cells are in too many blocks");
    for (int x = min[0]; x <= max[0]; ++x)
      for (int y = min[1]; y <= max[1]; ++y)
        for (int z = min[2]; z <= max[2]; ++z) parts.push_back({{x, y, z}, &cell});
  }
  std::stable_sort(parts.begin(), parts.end(),
                   [](const Part& a, const Part& b) { return a.block < b.block; });
  return parts;
}

}  // namespace

OccupancyMap OccupancyMap::fromCells(const Options& options, const std::vector<Cell>& cells) {
  OccupancyMap map(options);
  const LogOddsModel& model = map.insertion_->model;
  DenseBlock& dense = map.insertion_->buffers[0]->dense;
  // Whether a cell that fills a block stays one.
  const bool whole_blocks =
      options.fusion_rule == FusionRule::kEqualValue && options.fusion_strategy == FusionStrategy::kBlock;
  BlockGrid grid(options);
  BlockVoxels voxels;
  std::vector<VoxelBox> boxes;
  std::vector<Cell> fused, all;
  const std::vector<Part> parts = partsOf(cells);
  for (auto part = parts.begin(); part != parts.end();) {
    const Block block = part->block;
    const VoxelBox block_box = boxOf(block);
    if (whole_blocks && part->cell->box.contains(block_box) &&
        (part + 1 == parts.end() || part[1].block != block)) {
      all.push_back(
          {block_box, std::clamp(part->cell->log_odds, model.min, model.max), part->cell->reflectivity});
      ++part;
      continue;
    }
    voxels.start();
    boxes.clear();
    std::int64_t volume = 0;
    for (; part != parts.end() && part->block == block; ++part) {
      const Cell& cell = *part->cell;
      const VoxelBox box = intersect(cell.box, block_box);
      voxels.add(localBox(box, block_box), cell.log_odds, cell.reflectivity, model, dense);
      volume += box.volume();
      boxes.push_back(box);
    }
    if (voxels.knownVoxels() != volume) throw std::invalid_argument("cells overlap");
    voxels.pack(dense);
    grid.fuse(block, voxels, boxes, {}, fused);
    all.insert(all.end(), fused.begin(), fused.end());
  }
  map.tree_.bulkLoad(std::move(all));
  map.startDecay();
  return map;
}

}  // namespace rtree_occupancy_map
