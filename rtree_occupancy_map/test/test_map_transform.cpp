// SPDX-License-Identifier: BSD-3-Clause
#include <gtest/gtest.h>

#include <cmath>
#include <vector>

#include "plain_grid.h"
#include "rtree_occupancy_map/map_transform.h"

namespace rtree_occupancy_map {
namespace {

OccupancyMap mapOf(unsigned seed, int scans, const Options& options = {}) {
  OccupancyMap map(options);
  RandomScans random(seed + testSeed());
  for (int i = 0; i < scans; ++i) map.insertScan(random.next(150));
  return map;
}

Options withResolution(double resolution) {
  Options options;
  options.resolution = resolution;
  return options;
}

Eigen::Isometry3d moved(double x, double y, double z, double yaw) {
  Eigen::Isometry3d pose(Eigen::AngleAxisd(yaw, Eigen::Vector3d::UnitZ()));
  pose.translation() = Eigen::Vector3d(x, y, z);
  return pose;
}

int floorOf(int a, int b) {
  return a >= 0 ? a / b : -((b - 1 - a) / b);
}

TEST(MapTransform, WithoutOneAllStays) {
  const OccupancyMap map = mapOf(1, 6);
  const OccupancyMap same = transformed(map, Eigen::Isometry3d::Identity(), map.options());
  EXPECT_EQ(known(map), known(same));
  EXPECT_EQ(map.tree().size(), same.tree().size());
  EXPECT_TRUE(known(transformed(OccupancyMap(), moved(1, 2, 3, 1), {})).empty());
}

TEST(MapTransform, ALargerVoxelIsTheMostOfItsParts) {
  const OccupancyMap map = mapOf(2, 6);
  for (const int factor : {2, 3, 7, 40}) {
    std::map<Voxel, float> expected;
    for (const auto& [v, log_odds] : known(map)) {
      const Voxel large = {floorOf(v[0], factor), floorOf(v[1], factor), floorOf(v[2], factor)};
      float& value = expected.emplace(large, log_odds).first->second;
      value = std::max(value, log_odds);
    }
    EXPECT_EQ(expected, known(transformed(map, Eigen::Isometry3d::Identity(), withResolution(0.2 * factor))))
        << factor;
  }
}

TEST(MapTransform, ASmallerVoxelIsAsTheOneThatItIsIn) {
  const OccupancyMap map = mapOf(3, 2);
  const OccupancyMap fine = transformed(map, Eigen::Isometry3d::Identity(), withResolution(0.1));
  EXPECT_EQ(8 * known(map).size(), known(fine).size());
  for (const auto& [v, log_odds] : known(fine))
    ASSERT_EQ(log_odds, map.cellAt(Voxel{floorOf(v[0], 2), floorOf(v[1], 2), floorOf(v[2], 2)})->log_odds);
}

// Whatever the ratio, every place that was known is, and nothing occupied becomes free. No centre comes to
// lie on a border, where rounding decides.
TEST(MapTransform, NothingGetsLostBetweenTheVoxels) {
  const OccupancyMap map = mapOf(4, 4);
  for (const double resolution : {0.13, 0.2, 0.27, 0.51}) {
    for (const double yaw : {0.0, 0.3, M_PI / 4}) {
      const Eigen::Isometry3d transform = moved(0.7312345, -11.1098765, 0.0314159, yaw);
      const OccupancyMap there = transformed(map, transform, withResolution(resolution));
      for (const auto& [v, log_odds] : known(map)) {
        const Eigen::Vector3d center = transform * map.center(VoxelBox::unit(v));
        const auto cell = there.cellAt(center);
        ASSERT_TRUE(cell);
        EXPECT_GE(cell->log_odds, log_odds);
      }
    }
  }
}

TEST(MapTransform, TurnsAndMoves) {
  const OccupancyMap map = mapOf(5, 4);
  std::map<Voxel, float> expected;  // a quarter turn to the left, and 1 m = 5 voxels along x
  for (const auto& [v, log_odds] : known(map)) expected[{-v[1] - 1 + 5, v[0], v[2]}] = log_odds;
  EXPECT_EQ(expected, known(transformed(map, moved(1.0, 0.0, 0.0, M_PI / 2), map.options())));
}

TEST(MapTransform, TellsWhatDoesNotFit) {
  const OccupancyMap map = mapOf(6, 1);
  EXPECT_THROW(transformed(map, moved(7000, 0, 0, 0), map.options()), std::invalid_argument);
  EXPECT_THROW(transformed(map, Eigen::Isometry3d::Identity(), withResolution(0.0)), std::invalid_argument);
}

TEST(MapTransform, MergedMapsAddUpWhatBothKnow) {
  Options options;
  options.prob_miss = 0.45;
  const OccupancyMap a = mapOf(7, 5, options), b = mapOf(8, 4);
  const auto in_a = known(a), in_b = known(b);
  std::map<Voxel, float> expected = in_a;
  const float high = std::log(0.97 / 0.03), low = std::log(0.12 / 0.88);
  std::size_t both = 0;
  for (const auto& [v, log_odds] : in_b) {
    const auto [at, fresh] = expected.emplace(v, log_odds);
    if (!fresh) at->second = std::clamp(at->second + log_odds, low, high);
    both += !fresh;
  }
  ASSERT_GT(both, 100u);
  const OccupancyMap merged = rtree_occupancy_map::merged(a, b);
  EXPECT_EQ(expected, known(merged));
  EXPECT_TRUE(mapping_common::same(options, merged.options()));
  EXPECT_EQ(in_a, known(rtree_occupancy_map::merged(a, OccupancyMap())));
  EXPECT_EQ(in_b, known(rtree_occupancy_map::merged(OccupancyMap(), b)));
  EXPECT_THROW(rtree_occupancy_map::merged(a, OccupancyMap(withResolution(0.1))), std::invalid_argument);
}

TEST(MapTransform, MergedReflectivitiesAreMeansOfAllReturns) {
  Options options;
  options.reflectivity = true;
  std::vector<Cell> a = {cellOf(VoxelBox::unit({0, 0, 0}), 1.0F), cellOf(VoxelBox::unit({5, 0, 0}), 1.0F)},
                    b = a;
  a[0].reflectivity = {0.2F, 3};
  b[0].reflectivity = {0.6F, 1};
  b[1].reflectivity = {0.5F, 7};
  const OccupancyMap map = merged(OccupancyMap::fromCells(options, a), OccupancyMap::fromCells(options, b));
  EXPECT_FLOAT_EQ(0.3F, map.cellAt(Voxel{0, 0, 0})->reflectivity.mean);
  EXPECT_EQ(4u, map.cellAt(Voxel{0, 0, 0})->reflectivity.hits);
  EXPECT_FLOAT_EQ(0.5F, map.cellAt(Voxel{5, 0, 0})->reflectivity.mean);
}

}  // namespace
}  // namespace rtree_occupancy_map

int main(int argc, char** argv) {
  testing::InitGoogleTest(&argc, argv);
  return RUN_ALL_TESTS();
}
