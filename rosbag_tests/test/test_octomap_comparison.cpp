// SPDX-License-Identifier: BSD-3-Clause
//
// The map loses nothing: voxel by voxel it has the log odds of OctoMap, however its cells fuse.
#include <gtest/gtest.h>
#include <mapping_common/testing/recordings.h>
#include <mapping_simulation/posed_scan.h>
#include <mapping_simulation/simulator.h>
#include <mapping_simulation/testing/worlds.h>
#include <rosbag_tests/converters/scan_files.h>
#include <rosbag_tests/evaluations/octomap_comparison.h>

#include <cmath>
#include <functional>
#include <limits>
#include <random>
#include <sstream>

#include "parse_json.h"
#include "voxels.h"

namespace rosbag_tests {

using mapping_common::mentions;
using mapping_simulation::configFile;
using mapping_simulation::loadSensor;
using mapping_simulation::loadTrajectory;
using mapping_simulation::loadWorld;
using mapping_simulation::PosedScan;
using mapping_simulation::SensorConfig;
using mapping_simulation::Simulation;
using mapping_simulation::Sweep;

namespace {

using mapping_common::findRecording;
using mapping_common::withoutRecording;

using rtree_occupancy_map::FusionRule;
using rtree_occupancy_map::Options;
using rtree_occupancy_map::SensorModel;

constexpr double kInfinity = std::numeric_limits<double>::infinity();
enum { kUnknown, kFree, kOccupied };  // as in ComparisonResult::voxels

SensorConfig makeVlp16(int columns = 360) {
  SensorConfig sensor = loadSensor(configFile("simulator/velodyne_vlp16.yaml"));
  sensor.columns = columns;
  sensor.angle_increment = 2 * M_PI / columns;
  return sensor;
}

std::vector<PosedScan> simulatedScans(const std::string& world, double duration = 1.0) {
  const Simulation simulation{
      loadWorld(configFile(world)), loadTrajectory(configFile(world)), {makeVlp16()}, duration, 3};
  std::vector<PosedScan> scans;
  simulate(simulation, [&](const SensorConfig& sensor, const Sweep& sweep) {
    scans.push_back(toPosedScan(sensor, sweep));
  });
  return scans;
}

std::vector<PosedScan> recordedScans(const std::string& folder, std::size_t count) {
  std::vector<PosedScan> scans;
  const auto source = openScans(folder);
  for (PosedScan scan; scans.size() < count && source->next(scan);) scans.push_back(scan);
  return scans;
}

Options makeOptions(SensorModel model, double resolution, double max_range, FusionRule rule,
                    int max_entries) {
  Options options;
  options.sensor_model = model;
  options.resolution = resolution;
  options.max_range = max_range;
  options.fusion_rule = rule;
  options.tree.max_entries = max_entries;
  options.tree.min_entries = std::max(1, 2 * max_entries / 5);
  return options;
}

/// Both rules and several M.
std::vector<Options> allFusions(SensorModel model, double resolution, double max_range) {
  std::vector<Options> options;
  for (const int max_entries : {16, 4, 64})
    for (const FusionRule rule : {FusionRule::kEqualValue, FusionRule::kThesis})
      options.push_back(makeOptions(model, resolution, max_range, rule, max_entries));
  return options;
}

ComparisonResult compare(const std::vector<PosedScan>& scans, const std::vector<Options>& options) {
  OctomapComparison comparison(options);
  for (const PosedScan& scan : scans) comparison.insert(scan);
  return comparison.finish();
}

void expectEqualToOctomap(const ComparisonResult& result) {
  EXPECT_EQ(result.voxels_differing, 0u);
  EXPECT_EQ(result.log_odds_differing, 0u);
  EXPECT_EQ(result.voxels[kUnknown][kUnknown], 0u);
  EXPECT_EQ(result.voxels[kFree][kFree] + result.voxels[kOccupied][kOccupied], result.voxels_compared);
}

void expectPlausible(const ComparisonResult& result, const std::vector<PosedScan>& scans,
                     const std::vector<Options>& options) {
  std::size_t points = 0;
  for (const PosedScan& scan : scans)
    for (const auto& p : scan.cloud) points += p.getVector3fMap().allFinite();
  EXPECT_EQ(result.scans, scans.size());
  EXPECT_EQ(result.points, points);

  // Without pruning a leaf of OctoMap is a voxel. A few end points hardly ever fill the octant that pruning
  // takes.
  const bool beams = options[0].sensor_model == SensorModel::kBeam;
  EXPECT_GT(result.voxels_compared, beams ? 1000u : 100u);
  EXPECT_EQ(result.octomap_unpruned.cells, result.voxels_compared);
  EXPECT_LT(result.octomap.cells, result.octomap_unpruned.cells + !beams);
  EXPECT_LT(result.octomap.inner_nodes, result.octomap_unpruned.inner_nodes + !beams);
  EXPECT_GE(result.full_grid_voxels, result.voxels_compared);
  EXPECT_GT(result.voxels[kOccupied][kOccupied], 0u);
  EXPECT_EQ(result.voxels[kFree][kFree] > 0, beams);

  ASSERT_EQ(result.rtree.size(), options.size());
  const auto expectFigures = [&](const MapFigures& f) {
    EXPECT_GT(f.cells, 0u);
    EXPECT_GT(f.inner_nodes, 0u);
    EXPECT_GT(f.occupied_cells, 0u);
    EXPECT_LE(f.occupied_cells, f.cells);
    EXPECT_LE(f.occupied_cells, result.voxels[kOccupied][kOccupied]);
    EXPECT_GT(f.insertion_ns_per_point, 1.0);
    EXPECT_LT(f.insertion_ns_per_point, 1e7);
    EXPECT_GT(f.occupied_access_s, 0.0);
    EXPECT_LT(f.occupied_access_s, 60.0);
    EXPECT_GT(f.memory_bytes, f.cells * sizeof(float));
  };
  expectFigures(result.octomap);
  for (std::size_t i = 0; i < options.size(); ++i) {
    SCOPED_TRACE("R-tree map " + std::to_string(i));
    const MapFigures& f = result.rtree[i];
    expectFigures(f);
    EXPECT_LT(f.inner_nodes, f.cells);
    EXPECT_GE(f.inner_nodes * options[i].tree.max_entries, f.cells);
    if (options[i].fusion_rule == FusionRule::kEqualValue) {
      EXPECT_LT(f.cells, result.octomap.cells);
      EXPECT_LT(f.occupied_cells, result.octomap.occupied_cells);
    } else {
      // Only what has settled fuses.
      EXPECT_GE(f.cells, result.rtree[0].cells);
      EXPECT_LE(f.cells, result.octomap_unpruned.cells);
    }
  }
}

// Each of the maps against OctoMap.
void expectLossless(const std::vector<PosedScan>& scans) {
  ASSERT_EQ(scans.size(), 10u);
  for (const SensorModel model : {SensorModel::kBeam, SensorModel::kEndPoint}) {
    for (const double max_range : {kInfinity, 20.0, 7.3, 3.7}) {
      for (std::vector<Options> options = allFusions(model, 0.2, max_range); !options.empty();
           options.erase(options.begin(), options.begin() + 2)) {
        for (int rule = 0; rule < 2; ++rule) {
          SCOPED_TRACE((model == SensorModel::kBeam ? "beam, " : "end-point, ") + std::to_string(max_range) +
                       " m, M " + std::to_string(options[0].tree.max_entries) + ", rule " +
                       std::to_string(static_cast<int>(options[rule].fusion_rule)));
          const std::vector<Options> both = {options[rule], options[1 - rule]};
          const ComparisonResult result = compare(scans, both);
          expectEqualToOctomap(result);
          if (rule == 0) expectPlausible(result, scans, both);
        }
      }
    }
  }
}

TEST(SimulatedScans, OfARoomGiveTheLogOddsOfOctomap) {
  expectLossless(simulatedScans("worlds/room_8x5.yaml"));
}

TEST(SimulatedScans, OfAStreetGiveTheLogOddsOfOctomap) {
  expectLossless(simulatedScans("worlds/street.yaml"));
}

// Beams that meet edges and corners of voxels all along: 0.5 m has no rounding.
TEST(SimulatedScans, OnTheGridsEdgesGiveTheLogOddsOfOctomap) {
  for (const double max_range : {kInfinity, 4.0}) {
    for (const double start : {0.0, 0.25, 0.5, -0.125}) {
      SCOPED_TRACE(std::to_string(start) + " m, " + std::to_string(max_range) + " m");
      PosedScan scan;
      scan.pose.translation().setConstant(start);
      for (int x = -10; x <= 10; ++x)
        for (int y = -10; y <= 10; ++y)
          for (const int z : {-10, -5, 0, 5, 10})
            for (const int axis : {0, 1, 2}) {
              pcl::PointXYZI p;
              p.data[axis] = 0.5f * x;
              p.data[(axis + 1) % 3] = 0.5f * y;
              p.data[(axis + 2) % 3] = 0.5f * z;
              scan.cloud.push_back(p);
            }
      const std::vector<Options> options = allFusions(SensorModel::kBeam, 0.5, max_range);
      const ComparisonResult result = compare({scan}, options);
      expectEqualToOctomap(result);
      EXPECT_GT(result.voxels_compared, 1000u);
    }
  }
}

// A beam that is cut ends anywhere in a voxel, so that the last bit of its direction may decide where it
// passes. Far from the map's origin that bit is large.
TEST(SimulatedScans, InAllDirectionsGiveTheLogOddsOfOctomap) {
  std::mt19937 random(7);
  std::uniform_real_distribution<float> coordinate(-1.0f, 1.0f), range(5.0f, 30.0f);
  std::vector<PosedScan> scans(10);
  for (PosedScan& scan : scans) {
    scan.pose.translation() = Eigen::Vector3d(900.0, -700.0, 50.0);
    for (int i = 0; i < 3; ++i) scan.pose.translation()[i] += 5.0 * coordinate(random);
    for (int i = 0; i < 2000; ++i) {
      const Eigen::Vector3f direction(coordinate(random), coordinate(random), coordinate(random));
      pcl::PointXYZI p;
      p.getVector3fMap() = direction.normalized() * range(random);
      scan.cloud.push_back(p);
    }
  }
  for (const double max_range : {12.0, 7.3, 4.3, 2.9}) {
    SCOPED_TRACE(std::to_string(max_range) + " m");
    expectEqualToOctomap(
        compare(scans, {makeOptions(SensorModel::kBeam, 0.2, max_range, FusionRule::kEqualValue, 16)}));
  }
}

TEST(OctomapComparison, LeavesOutNonFinitePoints) {
  std::vector<PosedScan> scans = simulatedScans("worlds/room_8x5.yaml", 0.15);
  ASSERT_EQ(scans.size(), 1u);
  const std::vector<Options> options = {Options()};
  const ComparisonResult result = compare(scans, options);
  pcl::PointXYZI p;
  for (int axis = 0; axis < 3; ++axis) {
    for (const float value :
         {std::numeric_limits<float>::quiet_NaN(), std::numeric_limits<float>::infinity()}) {
      p.x = p.y = p.z = 1.0f;
      p.data[axis] = value;
      scans[0].cloud.push_back(p);
    }
  }
  const ComparisonResult again = compare(scans, options);
  EXPECT_EQ(again.points, result.points);
  EXPECT_EQ(again.voxels, result.voxels);
  expectEqualToOctomap(again);
}

// A wall is seen until it has settled, and then it is gone. A map whose settled cells stay as they are must
// show up as different from OctoMap, one whose cells follow must not.
TEST(OctomapComparison, NoticesMapsThatDiffer) {
  PosedScan wall, behind;
  wall.pose.translation() = behind.pose.translation() = Eigen::Vector3d(0.1, 0.1, 0.1);
  for (int y = -8; y <= 8; ++y) {
    for (int z = -8; z <= 8; ++z) {
      pcl::PointXYZI p;
      p.x = 4.0f, p.y = 0.2f * y, p.z = 0.2f * z;
      wall.cloud.push_back(p);
      p.getVector3fMap() *= 2.0f;
      behind.cloud.push_back(p);
    }
  }
  std::vector<PosedScan> scans(10, wall);
  scans.insert(scans.end(), 30, behind);
  Options options;
  expectEqualToOctomap(compare(scans, {options}));
  options.fusion_rule = FusionRule::kThesis;
  expectEqualToOctomap(compare(scans, {options}));
  options.dynamic = false;
  const ComparisonResult result = compare(scans, {options});
  EXPECT_GE(result.voxels[kFree][kOccupied], 17u * 17u);
  EXPECT_EQ(result.voxels_differing, result.voxels[kFree][kOccupied]);
  EXPECT_GE(result.log_odds_differing, result.voxels_differing);

  OctomapComparison comparison({options});
  comparison.probeEvery(1);
  for (const PosedScan& scan : scans) comparison.insert(scan);
  std::ostringstream probes, table;
  comparison.writeProbes(probes);
  EXPECT_TRUE(mentions(probes.str(), {"free,-1.99243021,occupied,"}));
  printTable(table, result, {options});
  EXPECT_TRUE(mentions(table.str(), {"free in OctoMap, occupied in the R-tree map: "}));
}

TEST(OctomapComparison, RefusesOptionsThatDisagree) {
  const auto refuses = [](const std::function<void(Options&)>& change) {
    Options first, second;
    first.fusion_rule = FusionRule::kThesis;
    first.tree.max_entries = 32;
    EXPECT_NO_THROW(OctomapComparison({first, second}));
    change(second);
    EXPECT_NO_THROW(mapping_common::validate(second));
    EXPECT_THROW(OctomapComparison({first, second}), std::invalid_argument);
  };
  refuses([](Options& o) { o.resolution = 0.1; });
  refuses([](Options& o) { o.sensor_model = SensorModel::kEndPoint; });
  refuses([](Options& o) { o.prob_hit = 0.8; });
  refuses([](Options& o) { o.prob_miss = 0.3; });
  refuses([](Options& o) { o.clamping_min = 0.2; });
  refuses([](Options& o) { o.clamping_max = 0.9; });
  refuses([](Options& o) { o.max_range = 10.0; });
  refuses([](Options& o) { o.min_range = 1.0; });
  refuses([](Options& o) { o.prior = 0.4; });

  // OctoMap has neither of these.
  Options alone;
  alone.prior = 0.4;
  EXPECT_THROW(OctomapComparison({alone}), std::invalid_argument);
  alone = Options();
  alone.min_range = 1.0;
  EXPECT_THROW(OctomapComparison({alone}), std::invalid_argument);
  alone = Options();
  alone.resolution = -1.0;
  EXPECT_THROW(OctomapComparison({alone}), std::invalid_argument);
}

// ---------------------------------------------------------------------------------------------------------
// real scans

class RecordedScans : public testing::TestWithParam<double> {
 protected:
  // The first map against OctoMap, the others against the first.
  void expectLossless(const std::vector<PosedScan>& scans) {
    for (const SensorModel model : {SensorModel::kBeam, SensorModel::kEndPoint}) {
      for (const double max_range : {kInfinity, 20.0, 7.3}) {
        SCOPED_TRACE((model == SensorModel::kBeam ? "beam, " : "end-point, ") + std::to_string(max_range) +
                     " m");
        const std::vector<Options> options = allFusions(model, GetParam(), max_range);
        OctomapComparison comparison(options);
        for (const PosedScan& scan : scans) comparison.insert(scan);
        const ComparisonResult result = comparison.finish();
        expectEqualToOctomap(result);
        expectPlausible(result, scans, options);
        const auto voxels = knownVoxels(comparison.map(0));
        for (std::size_t i = 1; i < options.size(); ++i)
          EXPECT_TRUE(sameVoxels(voxels, knownVoxels(comparison.map(i)))) << "map " << i;
      }
    }
  }
};

TEST_P(RecordedScans, OfAStreetGiveTheLogOddsOfOctomap) {
  const std::string folder = findRecording("scans3d_street154");
  if (folder.empty()) GTEST_SKIP() << withoutRecording("scans3d_street154");
  const auto scans = recordedScans(folder, 6);
  ASSERT_EQ(scans.size(), 6u);
  expectLossless(scans);
}

TEST_P(RecordedScans, OfASimulatedRoomGiveTheLogOddsOfOctomap) {
  const std::string folder = findRecording("scans3d_la3dm_sim");
  if (folder.empty()) GTEST_SKIP() << withoutRecording("scans3d_la3dm_sim");
  const auto scans = recordedScans(folder, 100);
  ASSERT_EQ(scans.size(), 12u);
  expectLossless(scans);
}

INSTANTIATE_TEST_SUITE_P(Resolutions, RecordedScans, testing::Values(0.2, 0.5),
                         [](const testing::TestParamInfo<double>& info) {
                           return std::to_string(std::lround(100 * info.param)) + "cm";
                         });

// ---------------------------------------------------------------------------------------------------------
// output

void expectMap(const boost::property_tree::ptree& json, const MapFigures& f) {
  EXPECT_EQ(json.size(), 6u);
  EXPECT_EQ(json.get<std::size_t>("cells"), f.cells);
  EXPECT_EQ(json.get<std::size_t>("inner_nodes"), f.inner_nodes);
  EXPECT_EQ(json.get<std::size_t>("occupied_cells"), f.occupied_cells);
  EXPECT_EQ(json.get<std::size_t>("memory_bytes"), f.memory_bytes);
  EXPECT_NEAR(json.get<double>("insertion_ns_per_point") / f.insertion_ns_per_point, 1.0, 1e-6);
  EXPECT_NEAR(json.get<double>("occupied_access_s") / f.occupied_access_s, 1.0, 1e-6);
}

TEST(Json, HasAllFigures) {
  const std::vector<Options> options = allFusions(SensorModel::kBeam, 0.2, kInfinity);
  const ComparisonResult result = compare(simulatedScans("worlds/room_8x5.yaml", 0.25), options);
  std::ostringstream text;
  printJson(text, result, options);
  const auto json = parseJson(text.str());
  EXPECT_EQ(json.get<std::size_t>("scans"), 2u);
  EXPECT_EQ(json.get<std::size_t>("points"), result.points);
  EXPECT_DOUBLE_EQ(json.get<double>("resolution"), 0.2);
  EXPECT_EQ(json.get<std::string>("model"), "beam");
  expectMap(json.get_child("octomap"), result.octomap);
  expectMap(json.get_child("rtree_occupancy_map"), result.rtree[0]);
  EXPECT_EQ(json.get<std::size_t>("octomap_unpruned.cells"), result.octomap_unpruned.cells);
  EXPECT_EQ(json.get<std::size_t>("octomap_unpruned.inner_nodes"), result.octomap_unpruned.inner_nodes);
  EXPECT_EQ(json.get<std::size_t>("full_grid_voxels"), result.full_grid_voxels);
  EXPECT_EQ(json.get<std::size_t>("voxels_compared"), result.voxels_compared);
  EXPECT_EQ(json.get<std::size_t>("voxels_differing"), 0u);
  EXPECT_EQ(json.get<std::size_t>("log_odds_differing"), 0u);
  const auto& maps = json.get_child("rtree_occupancy_maps");
  ASSERT_EQ(maps.size(), options.size());
  std::size_t i = 0;
  for (const auto& map : maps) {
    EXPECT_EQ(map.second.get<std::string>("fusion"),
              options[i].fusion_rule == FusionRule::kThesis ? "thesis" : "equal");
    EXPECT_EQ(map.second.get<int>("max_entries"), options[i].tree.max_entries);
    expectMap(map.second.get_child("figures"), result.rtree[i]);
    ++i;
  }
}

}  // namespace
}  // namespace rosbag_tests

int main(int argc, char** argv) {
  testing::InitGoogleTest(&argc, argv);
  return RUN_ALL_TESTS();
}
