// SPDX-License-Identifier: BSD-3-Clause
//
// The program that compares the map with OctoMap's.
#include <gtest/gtest.h>
#include <mapping_common/testing/tool_test.h>
#include <mapping_simulation/ros/simulation_bag.h>
#include <mapping_simulation/simulator.h>
#include <mapping_simulation/testing/worlds.h>
#include <rtree_occupancy_map/occupancy_map.h>

#include <array>
#include <cmath>
#include <filesystem>
#include <initializer_list>
#include <map>
#include <set>
#include <sstream>
#include <string>
#include <vector>

#include "parse_json.h"

namespace rosbag_tests {

using mapping_common::mentions;
using mapping_common::TempDir;
using mapping_simulation::configFile;
using mapping_simulation::loadSensor;
using mapping_simulation::loadTrajectory;
using mapping_simulation::loadWorld;
using mapping_simulation::SensorConfig;
using mapping_simulation::writeSimulationBag;

namespace {

/// Runs compare_octomap.
class Tool : public mapping_common::ToolTest {
 protected:
  Tool() : ToolTest(COMPARE_OCTOMAP) {
    // Scans 0 to 4 from the same place in a tube of 2 m radius.
    std::vector<float> values;
    for (int i = 0; i < 3000; ++i) {
      const float a = 0.01f * static_cast<float>(i);
      for (const float v : {2.0f * std::cos(a), 2.0f * std::sin(a), 0.1f * a, 0.5f}) values.push_back(v);
    }
    std::filesystem::create_directory(scans_);
    std::string poses;
    for (int i = 0; i < 5; ++i) {
      dir_.write("scans/" + std::to_string(i) + ".bin",
                 {reinterpret_cast<const char*>(values.data()), values.size() * sizeof(float)});
      poses += std::to_string(i) + " 1 0 0 0.05 0 1 0 0.06 0 0 1 0.07\n";
    }
    dir_.write("scans/poses.txt", poses);
  }

  std::string read(const std::string& name) const { return mapping_common::readFile(dir_.path(name)); }

  const std::string scans_ = dir_.path("scans");
};

TEST_F(Tool, ExplainsItself) {
  EXPECT_EQ(run("--help"), 0);
  EXPECT_TRUE(mentions(ran_.out, {"Usage: compare_octomap", "--scans", "--bag", "--json", "--max-range"}));
  EXPECT_EQ(ran_.err, "");
}

TEST_F(Tool, RefusesWrongUsage) {
  const auto expect = [&](const std::string& arguments, const char* message) {
    EXPECT_EQ(run(arguments), 2) << arguments;
    EXPECT_TRUE(mentions(ran_.err, {"compare_octomap: ", message})) << arguments;
    EXPECT_EQ(ran_.out, "") << arguments;
  };
  const std::string scans = "--scans " + scans_;
  expect("", "either --scans or --bag is needed");
  expect(scans + " --bag a.bag", "either --scans or --bag is needed");
  expect(scans + " --colour red", "colour");
  expect(scans + " --step 0", "--step must be at least 1");
  expect(scans + " --step one", "step");
  expect(scans + " --write-back-every 0", "--write-back-every must be at least 1");
  expect(scans + " --dump a.csv --dump-every 0", "--dump-every must be at least 1");
  expect(scans + " --threads -1", "threads is -1");
  expect(scans + " --first 3 --last 2", "--last at least --first");
  expect(scans + " --first -1", "--first must be at least 0");
  expect(scans + " --model laser", "laser");
  expect(scans + " --fusion some", "some");
  expect(scans + " --split even", "even");
  expect(scans + " --resolution 0", "resolution");
  expect(scans + " --max-entries 1", "max_entries");
  expect(scans + " --max-entries 16 --min-entries 9", "min_entries");
  expect(scans + " --max-range -3", "--max-range is -3");
}

TEST_F(Tool, SaysWhichFileIsMissing) {
  const auto expect = [&](const std::string& arguments, std::initializer_list<const char*> messages) {
    EXPECT_EQ(run(arguments), 1) << arguments;
    EXPECT_TRUE(mentions(ran_.err, {"compare_octomap: "}));
    EXPECT_TRUE(mentions(ran_.err, messages)) << arguments;
  };
  const std::string scans = "--scans " + scans_;
  expect("--scans /nowhere/scans", {"/nowhere/scans", "no such file"});
  expect("--bag /nowhere/a.bag", {"/nowhere/a.bag"});
  expect(scans + " --poses /nowhere/poses.txt", {"/nowhere/poses.txt: can't be read"});
  expect(scans + " --first 5", {"there was no scan to insert"});
  expect(scans + " --json /nowhere/a.json", {"/nowhere/a.json can't be written"});
  expect(scans + " --dump /nowhere/a.csv", {"/nowhere/a.csv can't be written"});
  expect(scans + " --save /nowhere/map", {"/nowhere/map"});
}

TEST_F(Tool, WritesFiguresAndMap) {
  ASSERT_EQ(run("--scans " + scans_ + " --fusion equal thesis --max-entries 8 32 --json " +
                dir_.path("a.json") + " --save " + dir_.path("map")),
            0)
      << ran_.err;
  const auto json = parseJson(read("a.json"));
  EXPECT_FALSE(std::filesystem::exists(dir_.path("a.json.part")));
  EXPECT_EQ(json.get<int>("scans"), 5);
  EXPECT_EQ(json.get<int>("points"), 5 * 3000);
  EXPECT_EQ(json.get_child("rtree_occupancy_maps").size(), 4u);
  for (const char* map : {"octomap", "rtree_occupancy_map"}) {
    const auto& figures = json.get_child(map);
    for (const char* key : {"cells", "inner_nodes", "occupied_cells", "memory_bytes"})
      EXPECT_GT(figures.get<long>(key), 0) << map << ' ' << key;
    for (const char* key : {"insertion_ns_per_point", "occupied_access_s"})
      EXPECT_GT(figures.get<double>(key), 0.0) << map << ' ' << key;
  }
  EXPECT_GT(json.get<long>("voxels_compared"), 1000);
  EXPECT_EQ(json.get<long>("voxels_differing"), 0);
  EXPECT_TRUE(mentions(ran_.out, {"5 scans, 15,000 points, 0.2 m, beam model", "R-tree (equal, M 8)",
                                  "R-tree (thesis, M 32)", "of another class 0, of other log odds 0"}));
  const auto map = rtree_occupancy_map::OccupancyMap::load(dir_.path("map"));
  EXPECT_EQ(map.tree().size(), json.get<std::size_t>("rtree_occupancy_map.cells"));
  EXPECT_EQ(map.options().tree.max_entries, 8);
}

// Each line as its fields, without the header.
std::vector<std::vector<std::string>> parseProbes(const std::string& text) {
  std::istringstream lines(text);
  std::string line, field;
  std::getline(lines, line);
  EXPECT_EQ(line, "x,y,z,octomap_state,octomap_log_odds,rtree_state,rtree_log_odds");
  std::vector<std::vector<std::string>> rows;
  while (std::getline(lines, line)) {
    rows.emplace_back();
    std::istringstream fields(line + ',');
    while (std::getline(fields, field, ',')) rows.back().push_back(field);
    EXPECT_EQ(rows.back().size(), 7u) << line;
  }
  return rows;
}

TEST_F(Tool, DumpsWhatBothMapsSay) {
  ASSERT_EQ(run("--scans " + scans_ + " --dump " + dir_.path("a.csv") +
                " --dump-every 10 --max-range 5 --save " + dir_.path("map")),
            0)
      << ran_.err;
  const auto map = rtree_occupancy_map::OccupancyMap::load(dir_.path("map"));
  std::map<std::string, int> states;
  std::set<std::array<std::string, 3>> places;
  for (const auto& row : parseProbes(read("a.csv"))) {
    const Eigen::Vector3d p(std::stod(row[0]), std::stod(row[1]), std::stod(row[2]));
    EXPECT_TRUE(places.insert({row[0], row[1], row[2]}).second);
    for (int i = 0; i < 3; ++i) {
      const double voxels = p[i] / 0.2 - 0.5;
      EXPECT_NEAR(voxels, std::round(voxels), 1e-5);
    }
    EXPECT_EQ(row[3], row[5]);
    EXPECT_EQ(row[4], row[6]);
    ++states[row[5]];
    const auto cell = map.cellAt(p);
    EXPECT_EQ(row[5], !cell ? "unknown" : map.isOccupied(*cell) ? "occupied" : "free");
    EXPECT_EQ(row[6].empty(), !cell);
    if (cell) {
      EXPECT_NEAR(std::stod(row[6]), cell->log_odds, 1e-6);
    }
  }
  for (const char* state : {"unknown", "free", "occupied"}) EXPECT_GT(states[state], 10) << state;
}

// However often the cells go back into the tree and with as many threads as there are, the map is the same.
TEST_F(Tool, WritesBackAndSharesOut) {
  std::string first;
  for (const char* how :
       {"", " --write-back-every 1", " --write-back-every 100 --threads 2", " --threads 0"}) {
    ASSERT_EQ(run("--scans " + scans_ + how + " --json " + dir_.path("a.json")), 0) << ran_.err;
    const auto json = parseJson(read("a.json"));
    EXPECT_EQ(json.get<int>("voxels_differing"), 0);
    EXPECT_EQ(json.get<int>("log_odds_differing"), 0);
    const auto cells = json.get<std::string>("rtree_occupancy_map.cells");
    if (first.empty()) first = cells;
    EXPECT_EQ(cells, first) << how;
  }
}

TEST_F(Tool, TakesTheScansAskedFor) {
  const auto scans = [&](const std::string& arguments) {
    EXPECT_EQ(run("--scans " + scans_ + " --json " + dir_.path("a.json") + " " + arguments), 0) << ran_.err;
    return parseJson(read("a.json")).get<int>("scans");
  };
  EXPECT_EQ(scans("--first 1"), 4);
  EXPECT_EQ(scans("--last 1"), 2);
  EXPECT_EQ(scans("--first 1 --last 1"), 1);
  EXPECT_EQ(scans("--step 2"), 3);
  EXPECT_EQ(scans("--first 1 --last 4 --step 3"), 2);
}

TEST_F(Tool, ReadsBags) {
  const std::string world = configFile("worlds/room_8x5.yaml"), bag = dir_.path("a.bag");
  SensorConfig lidar = loadSensor(configFile("simulator/velodyne_vlp16.yaml"));
  lidar.columns = 90;
  lidar.angle_increment = 2 * M_PI / 90;
  writeSimulationBag(bag, {loadWorld(world),
                           loadTrajectory(world),
                           {lidar, loadSensor(configFile("simulator/hokuyo_utm30lx.yaml"))},
                           0.35,
                           1});
  EXPECT_EQ(run("--bag " + bag), 1);
  EXPECT_TRUE(mentions(ran_.err, {"expected one topic", "/velodyne_points", "/scan"}));
  ASSERT_EQ(run("--bag " + bag + " --cloud /velodyne_points --model endpoint --json " + dir_.path("a.json")),
            0)
      << ran_.err;
  const auto json = parseJson(read("a.json"));
  EXPECT_EQ(json.get<int>("scans"), 3);
  EXPECT_EQ(json.get<std::string>("model"), "endpoint");
  EXPECT_EQ(json.get<int>("voxels_differing"), 0);
  EXPECT_EQ(run("--bag " + bag + " --cloud /velodyne_points --fixed-frame moon"), 1);
  EXPECT_TRUE(mentions(ran_.err, {"left out: 3 scans without a pose", "there was no scan to insert"}));
}

}  // namespace
}  // namespace rosbag_tests

int main(int argc, char** argv) {
  testing::InitGoogleTest(&argc, argv);
  return RUN_ALL_TESTS();
}
