// SPDX-License-Identifier: BSD-3-Clause
#include <gtest/gtest.h>

#include <atomic>
#include <map>
#include <mutex>
#include <set>
#include <thread>
#include <vector>

#include "plain_grid.h"
#include "rtree_occupancy_map/map_snapshot.h"

namespace rtree_occupancy_map {
namespace {

using CellsOfBlocks = std::map<Block, std::vector<Cell>>;

std::map<Voxel, float> voxelsOf(const MapSnapshot& snapshot) {
  std::map<Voxel, float> voxels;
  for (const auto& [block, cells, colors] : snapshot.blocks) {
    for (const Cell& cell : cells) {
      for (int x = cell.box.min[0]; x < cell.box.max[0]; ++x)
        for (int y = cell.box.min[1]; y < cell.box.max[1]; ++y)
          for (int z = cell.box.min[2]; z < cell.box.max[2]; ++z) voxels[{x, y, z}] = cell.log_odds;
    }
  }
  return voxels;
}

TEST(MapSnapshot, HasTheCellsOfItsBlocks) {
  OccupancyMap map;
  RandomScans random(1);
  for (int i = 0; i < 5; ++i) map.insertScan(random.next(50));
  bool disjoint = false;
  const MapSnapshot all(map);
  EXPECT_EQ(voxelsOf(map, &disjoint), voxelsOf(all));
  EXPECT_EQ(map.options().resolution, all.resolution);
  const std::vector<Block> some = {all.blocks.front().block, {1000, 1000, 1000}};  // the second is unknown
  const MapSnapshot part(map, some);
  ASSERT_EQ(2u, part.blocks.size());
  EXPECT_EQ(all.blocks.front().cells.size(), part.blocks[0].cells.size());
  EXPECT_TRUE(part.blocks[1].cells.empty());
  map.visitBlock(some[0], [&](const Cell& cell) {
    EXPECT_EQ(map.isOccupied(cell), part.isOccupied(cell));
    EXPECT_EQ(map.center(cell.box), part.center(cell.box));
    EXPECT_EQ(map.maxCorner(cell.box), part.maxCorner(cell.box));
    return true;
  });
}

// One thread inserts while another takes along what changed: in the end it has the map.
TEST(SharedMap, CanBeTakenAlongWhileItChanges) {
  SharedMap map;
  map([](OccupancyMap& m) {
    Options options;
    options.threads = 2;
    options.working_set_memory = 1.0;
    m = OccupancyMap(options);
  });
  std::mutex mutex;
  std::set<Block> changed;
  std::atomic<bool> done{false};
  std::thread inserting([&] {
    RandomScans random(2);
    for (int i = 0; i < 100; ++i) {
      const Scan scan = random.next(100);
      const std::vector<Block> blocks =
          map([&scan](OccupancyMap& m) { return m.insertScan(scan).changed_blocks; });
      const std::lock_guard<std::mutex> lock(mutex);
      changed.insert(blocks.begin(), blocks.end());
    }
    done = true;
  });
  CellsOfBlocks taken;
  int snapshots = 0;
  for (bool last = false; !last; ++snapshots) {
    last = done;
    std::vector<Block> blocks;
    {
      const std::lock_guard<std::mutex> lock(mutex);
      blocks.assign(changed.begin(), changed.end());
      changed.clear();
    }
    for (auto& [block, cells, colors] : map.snapshot(blocks).blocks) taken[block] = cells;
  }
  inserting.join();
  EXPECT_GT(snapshots, 3);
  MapSnapshot all = map.snapshot();
  const std::map<Voxel, float> expected = voxelsOf(all);
  all.blocks.clear();
  for (const auto& [block, cells] : taken) all.blocks.push_back({block, cells});
  EXPECT_EQ(expected, voxelsOf(all));
}

}  // namespace
}  // namespace rtree_occupancy_map
