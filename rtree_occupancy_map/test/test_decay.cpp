// SPDX-License-Identifier: BSD-3-Clause
//
// Obstacles that go: those that beams cross from then on, and those that nobody has seen for a while.
#include <gtest/gtest.h>
#include <mapping_common/testing/temp_dir.h>

#include <cmath>
#include <map>
#include <vector>

#include "decay.h"
#include "log_odds.h"
#include "plain_grid.h"

namespace rtree_occupancy_map {
namespace {

Options decaying(double seconds) {
  Options options;
  options.decay_time = seconds;
  return options;
}

Scan scanOf(const Eigen::Vector3f& hit, double time) {
  Scan scan;
  scan.time = time;
  scan.origin = {0.1F, 0.1F, 0.1F};
  scan.hits = {hit};
  return scan;
}

// The log odds of a voxel after misses.
std::vector<float> afterMisses(const Options& options) {
  const LogOddsModel model(options);
  std::vector<float> values = {model.max};
  while (values.back() >= model.occupied) values.push_back(values.back() + model.miss);
  return values;
}

const Eigen::Vector3f kObstacle(5.1F, 0.1F, 0.1F), kBehind(9.1F, 0.1F, 0.1F), kElsewhere(0.1F, 5.1F, 0.1F);

TEST(ObstaclesThatMovedAway, AreGoneAfterAsFewScansAsTheSensorModelAllows) {
  for (const double miss : {0.45, 0.4, 0.2}) {
    for (const double max : {0.7, 0.9, 0.97}) {
      Options options;
      options.prob_miss = miss;
      options.clamping_max = max;
      OccupancyMap map(options);
      for (int i = 0; i < 100; ++i) map.insertScan(scanOf(kObstacle, 0.1 * i));  // however long it was there
      int scans = 0;
      for (; map.stateAt(kObstacle.cast<double>()) == VoxelState::kOccupied; ++scans)
        map.insertScan(scanOf(kBehind, 0));
      // ln(0.97 / 0.03) / ln(0.6 / 0.4) = 8.6 with the defaults.
      const double allowed = std::log(max / (1.0 - max)) / std::log((1.0 - miss) / miss);
      EXPECT_EQ(static_cast<int>(std::floor(allowed)) + 1, scans) << miss << ' ' << max;
      EXPECT_EQ(VoxelState::kFree, map.stateAt(kObstacle.cast<double>()));
    }
  }
}

TEST(Decay, IsAMissForEachStepWithoutBeingSeen) {
  const Options options = decaying(18.0);
  const std::vector<float> values = afterMisses(options);
  const double step = Decay(options).step();
  ASSERT_EQ(10u, values.size());
  ASSERT_NEAR(2.0, step, 1e-9);
  OccupancyMap map(options);
  double time = 1.7e9;
  for (int i = 0; i < 200; ++i) map.insertScan(scanOf(kObstacle, time += 0.1));
  const double seen = time;
  std::size_t misses = 0, last = 0;
  while (time < seen + 25.0) {
    map.insertScan(scanOf(kElsewhere, time += 0.1));
    const auto cell = map.cellAt(Eigen::Vector3d(kObstacle.cast<double>()));
    // The step in which it was seen ends, then each costs a miss.
    const double steps = (time - seen) / step;
    if (!cell) {
      EXPECT_GT(time, seen + 18.0 - 0.01);
      EXPECT_TRUE(misses == 9 || time < seen + 20.0 + 0.11) << time - seen;
      misses = 9;
      continue;
    }
    for (misses = last; misses < 9 && values[misses] != cell->log_odds;) ++misses;
    ASSERT_LT(misses, 9u) << cell->log_odds;
    ASSERT_LE(misses, last + 1);
    EXPECT_LE(static_cast<double>(misses), steps + 0.01);
    EXPECT_GE(static_cast<double>(misses), std::floor(steps) - 1.1);
    last = misses;
  }
  EXPECT_EQ(9u, misses);
  EXPECT_EQ(VoxelState::kUnknown, map.stateAt(kObstacle.cast<double>()));
  // Free space stays, and what is seen.
  EXPECT_EQ(VoxelState::kFree, map.stateAt({3.1, 0.1, 0.1}));
  EXPECT_EQ(VoxelState::kOccupied, map.stateAt(kElsewhere.cast<double>()));
}

TEST(Decay, WhatWasSeenOnceGoesSooner) {
  OccupancyMap map(decaying(18.0));
  map.insertScan(scanOf(kObstacle, 100.0));  // 0.85, that is three misses of 0.41
  double time = 100.0;
  while (map.stateAt(kObstacle.cast<double>()) == VoxelState::kOccupied && time < 130.0)
    map.insertScan(scanOf(kElsewhere, time += 0.1));
  EXPECT_GT(time, 106.0 - 0.01);
  EXPECT_LT(time, 108.2);
}

TEST(Decay, IsOffByDefaultAndNeedsAMiss) {
  OccupancyMap map;
  map.insertScan(scanOf(kObstacle, 100.0));
  map.insertScan(scanOf(kElsewhere, 1e6));
  EXPECT_EQ(VoxelState::kOccupied, map.stateAt(kObstacle.cast<double>()));
  Options options = decaying(1.0);
  options.prob_miss = 0.5;
  EXPECT_THROW(OccupancyMap{options}, std::invalid_argument);
  options.prob_miss = 0.4;
  options.dynamic = false;
  EXPECT_THROW(OccupancyMap{options}, std::invalid_argument);
}

TEST(Decay, LongPausesAndJumpsBackAreOneStepAfterTheOther) {
  OccupancyMap map(decaying(9.0));
  for (int i = 0; i < 20; ++i) map.insertScan(scanOf(kObstacle, 1000.0));
  map.insertScan(scanOf(kElsewhere, 1004.5));  // 4 or 5 steps, the first of which it was seen in
  const auto cell = map.cellAt(Eigen::Vector3d(kObstacle.cast<double>()));
  const std::vector<float> values = afterMisses(map.options());
  ASSERT_TRUE(cell);
  EXPECT_TRUE(cell->log_odds == values[3] || cell->log_odds == values[4]) << cell->log_odds;
  map.insertScan(scanOf(kElsewhere, 10.0));  // a recording begins anew
  EXPECT_EQ(cell->log_odds, map.cellAt(Eigen::Vector3d(kObstacle.cast<double>()))->log_odds);
  map.insertScan(scanOf(kElsewhere, 100.0));
  EXPECT_EQ(VoxelState::kUnknown, map.stateAt(kObstacle.cast<double>()));
}

TEST(Decay, GoesOnInMapsThatWereLoaded) {
  const mapping_common::TempDir dir;
  {
    OccupancyMap map;
    for (int i = 0; i < 20; ++i) map.insertScan(scanOf(kObstacle, 0.0));
    map.save(dir.path("a.map"));
  }
  OccupancyMap map = OccupancyMap::load(dir.path("a.map"), decaying(9.0));
  EXPECT_EQ(9.0, map.options().decay_time);
  map.insertScan(scanOf(kElsewhere, 50.0));
  EXPECT_EQ(VoxelState::kOccupied, map.stateAt(kObstacle.cast<double>()));
  map.insertScan(scanOf(kElsewhere, 61.0));
  EXPECT_EQ(VoxelState::kUnknown, map.stateAt(kObstacle.cast<double>()));
}

// Whether somebody looks between the scans, how many threads there are and how much stays unpacked make no
// difference; and what changed is said.
TEST(Decay, IsTheSameHoweverTheMapIsKept) {
  Options options = decaying(3.0);
  options.reflectivity = false;
  options.threads = 1;
  OccupancyMap watched(options);
  options.threads = 3;
  OccupancyMap left_alone(options);
  options.working_set_memory = 0.0;
  OccupancyMap small(options);
  RandomScans random(3);
  std::map<Voxel, float> known;
  bool disjoint = true;
  for (int i = 0; i < 60; ++i) {
    Scan scan = random.next(60);
    scan.time = 0.1 * i;
    const std::map<Voxel, float> before = known;
    const InsertReport report = watched.insertScan(scan);
    left_alone.insertScan(scan);
    small.insertScan(scan);
    known = voxelsOf(watched, &disjoint);
    ASSERT_TRUE(disjoint);
    const auto changed = [&](const Voxel& voxel) {
      return std::binary_search(report.changed_blocks.begin(), report.changed_blocks.end(),
                                OccupancyMap::blockOf(voxel));
    };
    for (const auto& [voxel, log_odds] : before) {
      const auto now = known.find(voxel);
      const bool same = now != known.end() && now->second == log_odds;
      ASSERT_TRUE(same || changed(voxel));
    }
  }
  EXPECT_EQ(known, voxelsOf(left_alone, &disjoint));
  EXPECT_EQ(known, voxelsOf(small, &disjoint));
}

// All strategies keep their cells apart and what they say where voxels become unknown in them.
TEST(Decay, WorksWithAllStrategiesAndReflectivity) {
  for (const char* strategy : {"block", "expansion", "none"}) {
    Options options = decaying(2.0);
    options.reflectivity = true;
    options.fusion_strategy = mapping_common::valueOf<FusionStrategy>(strategy);
    OccupancyMap map(options);
    options.reflectivity = false;
    options.fusion_strategy = FusionStrategy::kBlock;
    OccupancyMap reference(options);
    RandomScans random(4);
    for (int i = 0; i < 40; ++i) {
      Scan scan = random.next(60);
      scan.time = 0.1 * i;
      scan.reflectivity.assign(scan.hits.size(), 0.5F);
      map.insertScan(scan);
      reference.insertScan(scan);
    }
    bool disjoint = false, reference_disjoint = false;
    EXPECT_EQ(voxelsOf(reference, &reference_disjoint), voxelsOf(map, &disjoint)) << strategy;
    EXPECT_TRUE(disjoint) << strategy;
  }
}

}  // namespace
}  // namespace rtree_occupancy_map
