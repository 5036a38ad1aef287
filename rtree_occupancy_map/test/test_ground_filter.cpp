// SPDX-License-Identifier: BSD-3-Clause
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <random>

#include "rtree_occupancy_map/ground_filter.h"

namespace rtree_occupancy_map {
namespace {

// In the frame of the base, which is somewhere in the map.
class GroundFilter : public ::testing::Test {
 protected:
  GroundFilter() {
    base_ = Eigen::Translation3d(30.0, -7.0, 2.0) * Eigen::AngleAxisd(1.0, Eigen::Vector3d::UnitZ());
    scan_.origin = (base_ * Eigen::Vector3d(0, 0, 1.5)).cast<float>();
  }
  void add(double x, double y, double z, float reflectivity = 0.0F) {
    scan_.hits.push_back((base_ * Eigen::Vector3d(x, y, z)).cast<float>());
    scan_.reflectivity.push_back(reflectivity);
  }
  double uniform(double min, double max) { return std::uniform_real_distribution<>(min, max)(random_); }
  double noise(double sigma) { return std::normal_distribution<>(0.0, sigma)(random_); }
  // Ground that rises along x by a slope, with noise.
  void addGround(int count, double slope) {
    for (int i = 0; i < count; ++i) {
      const double x = uniform(-10, 10);
      add(x, uniform(-10, 10), slope * x + std::clamp(noise(0.01), -0.03, 0.03), 1.0F);
    }
  }
  void addWall(int count) {
    for (int i = 0; i < count; ++i) add(8.0, uniform(-10, 10), uniform(0.9, 3.0), 2.0F);
  }

  std::mt19937 random_{1};
  Eigen::Isometry3d base_;
  Scan scan_;
};

TEST_F(GroundFilter, GroundOnASlopeOnlyClears) {
  addGround(2000, 0.08);
  addWall(1500);
  EXPECT_EQ(2000u, clearGround({}, base_, scan_));
  EXPECT_EQ(1500u, scan_.hits.size());
  EXPECT_EQ(2000u, scan_.misses.size());
  EXPECT_EQ(std::vector<float>(1500, 2.0F), scan_.reflectivity);
  EXPECT_TRUE(scan_.miss_origins.empty());
}

TEST_F(GroundFilter, AKerbIsNotGround) {
  addGround(3000, 0.0);
  for (int i = 0; i < 300; ++i) add(uniform(3, 4), uniform(-10, 10), 0.12);
  EXPECT_EQ(3000u, clearGround({}, base_, scan_));
  EXPECT_EQ(300u, scan_.hits.size());
}

TEST_F(GroundFilter, ALargerPlaneElsewhereIsNotTheGround) {
  addGround(1000, 0.0);
  for (int i = 0; i < 3000; ++i) add(uniform(-5, 5), uniform(-5, 5), 2.5);  // a ceiling
  addWall(2000);
  EXPECT_EQ(1000u, clearGround({}, base_, scan_));
  EXPECT_EQ(5000u, scan_.hits.size());
}

TEST_F(GroundFilter, WithoutAPlaneWhatIsNearZeroIsTheGround) {
  addWall(500);
  for (int i = 0; i < 5; ++i) add(1.0 + i, 0.0, 0.06);
  EXPECT_EQ(5u, clearGround({}, base_, scan_));
  EXPECT_EQ(500u, scan_.hits.size());
}

TEST_F(GroundFilter, IsTheSameInLargeCloudsAndWithPointsThatAreNone) {
  addGround(60000, 0.03);
  addWall(20000);
  for (int i = 0; i < 100; ++i) add(std::nan(""), 0, 0);
  EXPECT_EQ(60000u, clearGround({}, base_, scan_));
  EXPECT_EQ(20100u, scan_.hits.size());
}

TEST_F(GroundFilter, BeamsStillStartWhereTheyDid) {
  addGround(100, 0.0);
  add(8.0, 0.0, 1.0);
  scan_.misses = {{1.0F, 2.0F, 3.0F}};
  for (std::size_t i = 0; i < scan_.hits.size(); ++i)
    scan_.hit_origins.emplace_back(static_cast<float>(i), 0.0F, 0.0F);
  EXPECT_EQ(100u, clearGround({}, base_, scan_));
  ASSERT_EQ(101u, scan_.misses.size());
  ASSERT_EQ(101u, scan_.miss_origins.size());
  EXPECT_EQ(scan_.origin, scan_.miss_origins[0]);
  for (int i = 0; i < 100; ++i) EXPECT_EQ(static_cast<float>(i), scan_.miss_origins[i + 1].x());
  ASSERT_EQ(1u, scan_.hit_origins.size());
  EXPECT_EQ(100.0F, scan_.hit_origins[0].x());
}

TEST_F(GroundFilter, AnEmptyScanHasNone) {
  EXPECT_EQ(0u, clearGround({}, base_, scan_));
}

}  // namespace
}  // namespace rtree_occupancy_map
