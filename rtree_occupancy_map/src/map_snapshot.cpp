// SPDX-License-Identifier: BSD-3-Clause
#include "rtree_occupancy_map/map_snapshot.h"

#include <algorithm>
#include <iterator>
#include <utility>

#include "block_rows.h"

namespace rtree_occupancy_map {
namespace {

// Blocks of a snapshot that are read at a time: some ms.
constexpr std::ptrdiff_t kBlocksAtOnce = 64;

}  // namespace

std::vector<Block> knownBlocks(const OccupancyMap& map) {
  return map.blocks();
}

MapSnapshot::MapSnapshot(const OccupancyMap& map, const std::vector<Block>& some)
    : colored(map.options().color),
      resolution(map.options().resolution),
      occupied_log_odds(map.options().tree.occupied_log_odds) {
  blocks.reserve(some.size());
  for (const Block& block : some) {
    blocks.push_back({block, {}});
    if (const BlockColors* colors = map.colorsIn(block)) blocks.back().colors = *colors;
  }
  map.visitBlocks(some, [this](std::size_t i, const Cell& cell) {
    blocks[i].cells.push_back(cell);
    return true;
  });
}

std::optional<Color> MapSnapshot::BlockCells::colorOf(const VoxelBox& box) const {
  if (colors.empty()) return std::nullopt;
  return colors.meanIn(localBox(box, OccupancyMap::boxOf(block)));
}

MapSnapshot SharedMap::snapshot(const std::vector<Block>& blocks) const {
  MapSnapshot all = (*this)([](const OccupancyMap& map) { return MapSnapshot(map, {}); });
  for (auto first = blocks.begin(); first != blocks.end();) {
    const auto last = first + std::min(kBlocksAtOnce, blocks.end() - first);
    const std::vector<Block> some(first, last);
    MapSnapshot part = (*this)([&some](const OccupancyMap& map) { return MapSnapshot(map, some); });
    std::move(part.blocks.begin(), part.blocks.end(), std::back_inserter(all.blocks));
    first = last;
  }
  return all;
}

MapSnapshot SharedMap::snapshot() const {
  return snapshot((*this)([](const OccupancyMap& map) { return knownBlocks(map); }));
}

}  // namespace rtree_occupancy_map
