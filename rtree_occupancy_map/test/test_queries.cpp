// SPDX-License-Identifier: BSD-3-Clause
#include <gtest/gtest.h>

#include <cmath>
#include <map>
#include <random>

#include "plain_grid.h"

namespace rtree_occupancy_map {
namespace {

Options smallVoxels() {
  Options o;
  o.resolution = 0.1;
  return o;
}

class QueryTest : public ::testing::Test {
 protected:
  QueryTest() : map_(smallVoxels()), random_(11) {
    RandomScans scans(9);
    for (int i = 0; i < 15; ++i) map_.insertScan(scans.next(300));
    bool disjoint;
    voxels_ = voxelsOf(map_, &disjoint);
  }
  double uniform(double low, double high) {
    return std::uniform_real_distribution<double>(low, high)(random_);
  }
  Eigen::Vector3d randomPoint() { return {uniform(-6, 6), uniform(-6, 6), uniform(-3, 3)}; }

  OccupancyMap map_;
  std::map<Voxel, float> voxels_;
  std::mt19937 random_;
};

TEST_F(QueryTest, FindsTheCellAtAPoint) {
  for (int i = 0; i < 2000; ++i) {
    const Eigen::Vector3d p = randomPoint();
    const Voxel v{static_cast<int>(std::floor(p.x() / 0.1)), static_cast<int>(std::floor(p.y() / 0.1)),
                  static_cast<int>(std::floor(p.z() / 0.1))};
    const auto expected = voxels_.find(v);
    const std::optional<Cell> cell = map_.cellAt(p);
    ASSERT_EQ(cell.has_value(), expected != voxels_.end());
    if (!cell) {
      EXPECT_EQ(map_.stateAt(p), VoxelState::kUnknown);
      continue;
    }
    EXPECT_EQ(cell->log_odds, expected->second);
    EXPECT_TRUE(cell->box.contains(v));
    EXPECT_EQ(map_.stateAt(p), expected->second >= 0.0F ? VoxelState::kOccupied : VoxelState::kFree);
  }
  EXPECT_FALSE(map_.cellAt(Eigen::Vector3d(1e12, 0, 0)).has_value());
  EXPECT_FALSE(map_.cellAt(Eigen::Vector3d(std::nan(""), 0, 0)).has_value());
}

TEST_F(QueryTest, CountsVolumes) {
  const Statistics s = map_.statistics();
  std::size_t occupied = 0;
  for (const auto& [voxel, log_odds] : voxels_) occupied += log_odds >= 0.0F;
  EXPECT_NEAR(s.occupied_volume, static_cast<double>(occupied) * 1e-3, 1e-9);
  EXPECT_NEAR(s.free_volume, static_cast<double>(voxels_.size() - occupied) * 1e-3, 1e-9);
  EXPECT_EQ(s.cells, s.occupied_cells + s.free_cells);
  EXPECT_EQ(s.nodes, map_.tree().numNodes());
  std::size_t visited = 0;
  map_.visitOccupied([&](const Cell& c) {
    EXPECT_TRUE(map_.isOccupied(c));
    return ++visited > 0;
  });
  EXPECT_EQ(visited, s.occupied_cells);
}

TEST_F(QueryTest, FindsTheNearestOccupiedCells) {
  for (int i = 0; i < 30; ++i) {
    const Eigen::Vector3d p = randomPoint();
    const auto distance = [&](const Cell& c) {
      return (map_.minCorner(c.box) - p).cwiseMax(p - map_.maxCorner(c.box)).cwiseMax(0.0).norm();
    };
    std::vector<double> expected;
    map_.visitOccupied([&](const Cell& c) {
      expected.push_back(distance(c));
      return true;
    });
    std::sort(expected.begin(), expected.end());
    const std::vector<Cell> nearest = map_.nearestOccupied(p, 10);
    ASSERT_EQ(nearest.size(), 10U);
    for (std::size_t k = 0; k < 10; ++k) EXPECT_NEAR(distance(nearest[k]), expected[k], 1e-9);
  }
  EXPECT_TRUE(map_.nearestOccupied(Eigen::Vector3d::Zero(), 0).empty());
  EXPECT_EQ(map_.nearestOccupied(Eigen::Vector3d::Zero(), 1000000).size(), map_.statistics().occupied_cells);
  EXPECT_TRUE(OccupancyMap(smallVoxels()).nearestOccupied(Eigen::Vector3d::Zero(), 3).empty());
}

// Against small steps along the ray.
TEST_F(QueryTest, CastsRays) {
  int occupied = 0, unknown = 0;
  for (int i = 0; i < 400; ++i) {
    const Eigen::Vector3d origin(uniform(-0.5, 0.5), uniform(-0.5, 0.5), uniform(-0.3, 0.3));
    const Eigen::Vector3d direction = randomPoint();
    const double range = uniform(1.0, 9.0);
    for (const bool ignore_unknown : {true, false}) {
      const RayHit hit = map_.castRay(origin, direction, range, ignore_unknown);
      const double length = (hit.point - origin).norm();
      EXPECT_NEAR((hit.point - origin).cross(direction.normalized()).norm(), 0.0, 1e-9);
      EXPECT_LE(length, range + 1e-9);
      // Nothing that ends the ray lies before its end, up to slivers that the steps or rounding can't tell.
      int before = 0;
      for (double t = 0.0; t < length - 0.003; t += 0.001) {
        const VoxelState s = map_.stateAt(origin + t * direction.normalized());
        before += s == VoxelState::kOccupied || (!ignore_unknown && s == VoxelState::kUnknown);
      }
      EXPECT_LE(before, 1);
      const VoxelState at_end = map_.stateAt(hit.point + 1e-7 * direction.normalized());
      switch (hit.result) {
        case RayHit::Result::kOccupied:
          ++occupied;
          EXPECT_EQ(at_end, VoxelState::kOccupied);
          EXPECT_TRUE(map_.isOccupied(hit.cell));
          break;
        case RayHit::Result::kUnknown:
          ++unknown;
          EXPECT_FALSE(ignore_unknown);
          EXPECT_EQ(at_end, VoxelState::kUnknown);
          break;
        case RayHit::Result::kNothing:
          EXPECT_NEAR(length, range, 1e-9);
      }
    }
  }
  EXPECT_GT(occupied, 50);
  EXPECT_GT(unknown, 50);
}

TEST_F(QueryTest, RefusesRaysToNowhere) {
  const Eigen::Vector3d o = Eigen::Vector3d::Zero(), x = Eigen::Vector3d::UnitX();
  EXPECT_THROW(map_.castRay(o, o, 1.0), std::invalid_argument);
  EXPECT_THROW(map_.castRay(o, x, 0.0), std::invalid_argument);
  EXPECT_THROW(map_.castRay(o, Eigen::Vector3d(std::nan(""), 0, 0), 1.0), std::invalid_argument);
  const RayHit far = map_.castRay(Eigen::Vector3d(0, 0, 1000), x, std::numeric_limits<double>::infinity());
  EXPECT_EQ(far.result, RayHit::Result::kNothing);
  EXPECT_TRUE(far.point.allFinite());
}

TEST_F(QueryTest, FindsTheBoxOfACellByItsCorners) {
  map_.tree().visitAll([&](const Cell& c) {
    EXPECT_TRUE(map_.boxOf(map_.minCorner(c.box), map_.maxCorner(c.box)) == c.box);
    return true;
  });
  EXPECT_TRUE(OccupancyMap::boxOf(Block{2048, 0, 0}).isEmpty());
  EXPECT_TRUE(OccupancyMap::boxOf(Block{0, -2000, 0}).isEmpty());
  EXPECT_EQ(OccupancyMap::boxOf(Block{-1, 0, 1}).volume(), 32768);
}

TEST_F(QueryTest, VisitsABox) {
  const Eigen::Vector3d min(-1.0, -2.0, -0.5), max(2.0, 1.0, 0.5);
  std::size_t found = 0, expected = 0;
  map_.visitBox(min, max, [&](const Cell&) { return ++found > 0; });
  map_.tree().visitAll([&](const Cell& c) {
    expected += (map_.minCorner(c.box).array() < max.array() - 1e-9).all() &&
                (map_.maxCorner(c.box).array() > min.array() + 1e-9).all();
    return true;
  });
  EXPECT_EQ(found, expected);
  EXPECT_GT(found, 100U);
  map_.visitBox({std::nan(""), -2.0, -0.5}, max, [&](const Cell&) { return ++found > 0; });
  map_.visitBox(min, {2.0, std::nan(""), 0.5}, [&](const Cell&) { return ++found > 0; });
  EXPECT_EQ(found, expected);
}

}  // namespace
}  // namespace rtree_occupancy_map

int main(int argc, char** argv) {
  testing::InitGoogleTest(&argc, argv);
  return RUN_ALL_TESTS();
}
