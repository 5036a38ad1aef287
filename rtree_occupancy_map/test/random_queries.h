// SPDX-License-Identifier: BSD-3-Clause
//
// Questions at random that a map has to answer as a plain grid does, wherever it has its cells at the moment.
#pragma once

#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cstdint>
#include <cstring>
#include <functional>
#include <map>
#include <optional>
#include <random>
#include <vector>

#include "plain_grid.h"
#include "rtree_occupancy_map/occupancy_map.h"

namespace rtree_occupancy_map {

/// Each cell to the bit, in an order of their own.
using CellBits = std::array<std::uint32_t, 6>;
inline std::vector<CellBits> cellsOf(const OccupancyMap& map, const VoxelBox& box = VoxelBox::all()) {
  std::vector<CellBits> cells;
  map.visitBox(box, [&cells](const Cell& c) {
    CellBits bits{};
    std::memcpy(bits.data(), &c.box, sizeof(c.box));
    std::memcpy(&bits[3], &c.log_odds, sizeof(c.log_odds));
    if (c.reflectivity.hits > 0) std::memcpy(&bits[4], &c.reflectivity, sizeof(c.reflectivity));
    cells.push_back(bits);
    return true;
  });
  std::sort(cells.begin(), cells.end());
  return cells;
}

inline void expectEqual(const OccupancyMap& map, const PlainGrid& grid) {
  bool disjoint = false;
  EXPECT_TRUE(voxelsOf(map, &disjoint) == grid.voxels());
  EXPECT_TRUE(disjoint);
  EXPECT_EQ(map.tree().checkInvariants(), "");
}

/// Asks one map something and expects of it what the voxels of the plain grid say, or a map whose tree is
/// always up to date.
class Asker {
 public:
  explicit Asker(unsigned seed) : random_(seed) {}

  void ask(const OccupancyMap& map, const PlainGrid& grid, const OccupancyMap& current) {
    const Eigen::Vector3d p(uniform(6.0), uniform(6.0), uniform(3.0));
    switch (std::uniform_int_distribution<int>(0, 5)(random_)) {
      case 0: {
        const std::optional<Cell> cell = map.cellAt(p);
        const auto expected = grid.voxels().find(grid.voxelOf(p.cast<float>()));
        ASSERT_EQ(cell.has_value(), expected != grid.voxels().end());
        if (cell) {
          EXPECT_EQ(cell->log_odds, expected->second);
        }
        break;
      }
      case 1:
        expectVoxels(grid, map.boxOf(p, p + Eigen::Vector3d(1.0, 2.0, 0.5)),
                     [&](auto&& visit) { map.visitBox(p, p + Eigen::Vector3d(1.0, 2.0, 0.5), visit); });
        break;
      case 2: {
        const Block block = OccupancyMap::blockOf(grid.voxelOf(p.cast<float>()));
        expectVoxels(grid, OccupancyMap::boxOf(block), [&](auto&& visit) { map.visitBlock(block, visit); });
        break;
      }
      case 3: {
        const Eigen::Vector3d origin(0.05, 0.05, 0.05);
        const bool ignore_unknown = p.z() > 0.0;
        const RayHit hit = map.castRay(origin, p, 8.0, ignore_unknown),
                     expected = current.castRay(origin, p, 8.0, ignore_unknown);
        EXPECT_EQ(hit.result, expected.result);
        EXPECT_EQ(hit.point, expected.point);
        EXPECT_TRUE(hit.cell.box == expected.cell.box);
        break;
      }
      case 4: {
        std::size_t occupied = 0, expected = 0;
        map.visitOccupied([&occupied](const Cell& c) {
          occupied += static_cast<std::size_t>(c.box.volume());
          return true;
        });
        for (const auto& voxel : grid.voxels()) expected += voxel.second >= 0.0F;
        EXPECT_EQ(occupied, expected);
        break;
      }
      default: {
        const auto distances = [&p](const OccupancyMap& m) {
          std::vector<double> all;
          for (const Cell& c : m.nearestOccupied(p, 7))
            all.push_back((m.minCorner(c.box) - p).cwiseMax(p - m.maxCorner(c.box)).cwiseMax(0.0).norm());
          return all;
        };
        EXPECT_EQ(distances(map), distances(current));
        const Statistics s = map.statistics(), expected = current.statistics();
        EXPECT_EQ(s.cells, expected.cells);
        EXPECT_EQ(s.occupied_cells, expected.occupied_cells);
        EXPECT_NEAR(s.occupied_volume, expected.occupied_volume, 1e-9);
        EXPECT_NEAR(s.free_volume, expected.free_volume, 1e-9);
        EXPECT_EQ(map.size(), current.size());
        EXPECT_TRUE(map.bounds() == current.bounds());
        EXPECT_EQ(map.blocks(), current.blocks());
      }
    }
  }

 private:
  double uniform(double limit) { return std::uniform_real_distribution<double>(-limit, limit)(random_); }

  // What a query says of the voxels of a box.
  static void expectVoxels(const PlainGrid& grid, const VoxelBox& box,
                           const std::function<void(std::function<bool(const Cell&)>)>& query) {
    std::map<Voxel, float> found, expected;
    query([&](const Cell& c) {
      const VoxelBox b = intersect(c.box, box);
      for (int x = b.min[0]; x < b.max[0]; ++x)
        for (int y = b.min[1]; y < b.max[1]; ++y)
          for (int z = b.min[2]; z < b.max[2]; ++z) found[{x, y, z}] = c.log_odds;
      return true;
    });
    for (const auto& voxel : grid.voxels()) {
      if (box.contains(voxel.first)) expected.insert(voxel);
    }
    EXPECT_TRUE(found == expected);
  }

  std::mt19937 random_;
};

}  // namespace rtree_occupancy_map
