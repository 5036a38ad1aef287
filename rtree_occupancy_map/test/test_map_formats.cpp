// SPDX-License-Identifier: BSD-3-Clause
#include <gtest/gtest.h>
#include <mapping_common/files.h>
#include <mapping_common/testing/tool_test.h>
#include <rtree_occupancy_map/ros/map_formats.h>

#include <filesystem>
#include <set>
#include <string>

#include "plain_grid.h"

namespace rtree_occupancy_map {
namespace {

using mapping_common::errorOf;
using mapping_common::mentions;
using mapping_common::readFile;
using mapping_common::TempDir;

OccupancyMap smallMap() {
  Options options;
  options.resolution = 0.25;
  OccupancyMap map(options);
  RandomScans random(2);
  for (int i = 0; i < 4; ++i) map.insertScan(random.next(100));
  return map;
}

TEST(MapFormats, TheEndingDecides) {
  EXPECT_EQ(MapFormat::kRTree, formatOf("/a.b/map"));
  EXPECT_EQ(MapFormat::kRTree, formatOf("room.map"));
  EXPECT_EQ(MapFormat::kOctomapBinary, formatOf("room.bt"));
  EXPECT_EQ(MapFormat::kMapServer, formatOf("room.yaml"));
  try {
    formatOf("room.bz");
    FAIL();
  } catch (const std::invalid_argument& e) {
    EXPECT_TRUE(mentions(e.what(), {"'room.bz'", ".map", ".bt", ".ot", ".pcd", ".pgm", ".yaml"}));
  }
}

TEST(MapFormats, AreWrittenAndRead) {
  const TempDir dir;
  const OccupancyMap map = smallMap();
  for (const char* name : {"a.map", "a", "a.db", "a.ot"}) {
    EXPECT_TRUE(mentions(writeMap(map, dir.path(name)), {"Wrote ", "cells to", name}));
    EXPECT_EQ(known(map), known(readMap(dir.path(name)))) << name;
  }
  writeMap(map, dir.path("a.bt"));
  EXPECT_EQ(known(map).size(), known(readMap(dir.path("a.bt"))).size());
  EXPECT_TRUE(mentions(errorOf([&] { readMap(dir.path("a.pgm")); }), {"a.pgm", ".ot"}));
  EXPECT_TRUE(mentions(errorOf([&] { writeMap(map, "/nowhere/a.ot"); }), {"/nowhere/a.ot"}));
}

TEST(MapFormats, FilesOfAnotherResolution) {
  const TempDir dir;
  const OccupancyMap map = smallMap();
  Options options;
  options.resolution = 0.5;
  for (const char* name : {"a.map", "a.db", "a.ot"}) {
    const std::string path = dir.path(name);
    writeMap(map, path);
    EXPECT_EQ(0.25, readMap(path, options, OtherResolution::kAdopt).options().resolution);
    EXPECT_TRUE(mentions(errorOf([&] { readMap(path, options, OtherResolution::kRefuse); }),
                         {name, "0.25 m", "0.5 m", "other_resolution"}));
    const OccupancyMap converted = readMap(path, options, OtherResolution::kConvert);
    EXPECT_EQ(0.5, converted.options().resolution);
    EXPECT_EQ(map.options().prob_hit, converted.options().prob_hit);
    // Nothing occupied is lost, and nothing else is occupied.
    std::set<Voxel> expected, occupied;
    for (const auto& [voxel, log_odds] : known(map))
      if (log_odds >= 0.0F) expected.insert({voxel[0] >> 1, voxel[1] >> 1, voxel[2] >> 1});
    for (const auto& [voxel, log_odds] : known(converted))
      if (log_odds >= 0.0F) occupied.insert(voxel);
    EXPECT_EQ(expected, occupied);
    options.resolution = 0.25;
    EXPECT_EQ(known(map), known(readMap(path, options, OtherResolution::kRefuse)));
    options.resolution = 0.5;
  }
}

TEST(MapFormats, SeenFromAbove) {
  const TempDir dir;
  Options options;
  options.resolution = 0.5;
  std::vector<Cell> cells(2);
  cells[0].box = {{{-2, 33, 0}}, {{0, 34, 1}}};
  cells[0].log_odds = 1.0F;
  cells[1].box = {{{-32, 63, 10}}, {{-31, 64, 11}}};
  cells[1].log_odds = -1.0F;
  const OccupancyMap map = OccupancyMap::fromCells(options, cells);
  EXPECT_TRUE(mentions(writeMap(map, dir.path("a.pgm")), {"32 x 32 pixels"}));
  std::string expected(32 * 32, '\xcd');  // unknown; the topmost row is that of y = 63
  expected[0] = '\xfe';
  expected[30 * 32 + 30] = expected[30 * 32 + 31] = '\0';
  EXPECT_EQ("P5\n32 32\n255\n" + expected, readFile(dir.path("a.pgm")));
  EXPECT_TRUE(mentions(readFile(dir.path("a.yaml")),
                       {"image: a.pgm\n", "resolution: 0.5\n", "origin: [-16, 16, 0]\n"}));
  DisplayOptions high;
  high.occupancy_min_z = 3.0;
  writeMap(map, dir.path("b.yaml"), high);
  EXPECT_EQ(std::string::npos, readFile(dir.path("b.pgm")).find('\0'));
}

class Tool : public mapping_common::ToolTest {
 protected:
  Tool() : ToolTest(RTREE_MAP) {}
};

TEST_F(Tool, Converts) {
  const OccupancyMap map = smallMap();
  map.save(dir_.path("a.map"));
  ASSERT_EQ(0, run("convert " + dir_.path("a.map") + ' ' + dir_.path("a.ot"))) << ran_.err;
  EXPECT_TRUE(mentions(ran_.out, {"Wrote ", "a.ot"}));
  ASSERT_EQ(0, run("convert " + dir_.path("a.ot") + ' ' + dir_.path("b.map"))) << ran_.err;
  EXPECT_EQ(known(map), known(OccupancyMap::load(dir_.path("b.map"))));
  ASSERT_EQ(0, run("convert " + dir_.path("a.ot") + ' ' + dir_.path("b.pgm --min-z 1.0 --max-size 32")))
      << ran_.err;
  EXPECT_TRUE(std::filesystem::exists(dir_.path("b.yaml")));
  EXPECT_TRUE(mentions(ran_.out, {"32 x 32 pixels", " m of "}));
}

TEST_F(Tool, ReadsAndWritesStores) {
  const OccupancyMap map = smallMap();
  map.save(dir_.path("a.map"));
  ASSERT_EQ(0, run("convert " + dir_.path("a.map") + ' ' + dir_.path("a.db"))) << ran_.err;
  ASSERT_EQ(0, run("convert " + dir_.path("a.db") + ' ' + dir_.path("b.ot"))) << ran_.err;
  ASSERT_EQ(0, run("convert " + dir_.path("a.map") + ' ' + dir_.path("a.ot"))) << ran_.err;
  EXPECT_EQ(readFile(dir_.path("a.ot")), readFile(dir_.path("b.ot")));
  for (const char* file : {"a.map", "a.db"}) {
    ASSERT_EQ(0, run("info " + dir_.path(file))) << ran_.err;
    EXPECT_TRUE(mentions(ran_.out, {"cells: ", "from: ", "resolution: ", "dynamic: true"}));
    EXPECT_NE(std::string::npos, ran_.out.find("cells: " + std::to_string(map.size()) + ",")) << ran_.out;
  }
  EXPECT_EQ(2, run("info"));
  EXPECT_EQ(2, run("info --transform 0 0 0 0 0 0 " + dir_.path("a.map")));
  EXPECT_EQ(1, run("info /nowhere/a.db"));
  EXPECT_TRUE(mentions(ran_.err, {"/nowhere/a.db"}));
}

TEST_F(Tool, ChangesTheResolution) {
  smallMap().save(dir_.path("a.map"));
  ASSERT_EQ(0, run("convert --resolution 0.5 " + dir_.path("a.map") + ' ' + dir_.path("b.map"))) << ran_.err;
  const OccupancyMap coarse = OccupancyMap::load(dir_.path("b.map"));
  EXPECT_EQ(0.5, coarse.options().resolution);
  const OccupancyMap fine = smallMap();
  fine.visitOccupied([&](const Cell& cell) {
    EXPECT_EQ(VoxelState::kOccupied, coarse.stateAt(fine.center(cell.box)));
    return true;
  });
}

TEST_F(Tool, MergesTwoMaps) {
  Options options;
  options.resolution = 0.25;
  std::vector<Cell> cells(1);
  cells[0].box = VoxelBox::unit({4, 0, 0});
  cells[0].log_odds = 1.0F;
  OccupancyMap::fromCells(options, cells).save(dir_.path("a.map"));
  cells[0].box = VoxelBox::unit({0, 8, 0});
  OccupancyMap::fromCells(options, cells).save(dir_.path("b.map"));
  // B's frame is at (0, 0.5, -0.25), turned a quarter to the right: its (0, 8, 0) is at (8, 1, -1).
  ASSERT_EQ(0, run("merge " + dir_.path("a.map") + ' ' + dir_.path("b.map") +
                   " --transform 0 0.5 -0.25 0 0 -1.5707963267948966 " + dir_.path("c.ot")))
      << ran_.err;
  const auto merged = known(readMap(dir_.path("c.ot")));
  EXPECT_EQ((std::map<Voxel, float>{{{4, 0, 0}, 1.0F}, {{8, 1, -1}, 1.0F}}), merged);
  const std::string maps = "merge " + dir_.path("a.map") + ' ' + dir_.path("b.map") + ' ';
  EXPECT_EQ(0, run(maps + dir_.path("c") + " --resolution 1.0")) << ran_.err;
  EXPECT_EQ(2u, known(readMap(dir_.path("c"))).size());
  for (const char* wrong : {"--transform 1 2 3", "c --transform 1 2 3 4 5", "c --transform 1 2 3 4 5 six"}) {
    EXPECT_EQ(2, run(maps + wrong)) << wrong;
    EXPECT_TRUE(mentions(ran_.err, {"--transform has"}));
  }
}

TEST_F(Tool, SaysWhatIsWrong) {
  const auto expect = [this](int code, const std::string& arguments,
                             std::initializer_list<const char*> parts) {
    EXPECT_EQ(code, run(arguments)) << arguments;
    EXPECT_TRUE(mentions(ran_.err, parts));
    EXPECT_EQ("", ran_.out);
  };
  smallMap().save(dir_.path("a.map"));
  const std::string in = "convert " + dir_.path("a.map") + ' ';
  expect(2, "", {"convert IN OUT"});
  expect(2, "confuse a b", {"convert IN OUT"});
  expect(2, in, {"convert IN OUT"});
  expect(2, in + "out.jpeg", {"out.jpeg", ".pcd"});
  expect(2, in + "out.map --resolution 0", {"--resolution is 0"});
  expect(2, in + "out.map --transform 1 2 3 4 5 6", {"merge A B OUT"});
  expect(2, in + "out.pgm --max-size 0", {"max-size is 0"});
  expect(1, "convert /nowhere/a.bt b.map", {"rtree_map: /nowhere/a.bt can't be opened"});
  expect(1, in + "/nowhere/b.bt", {"/nowhere/b.bt"});
}

}  // namespace
}  // namespace rtree_occupancy_map

int main(int argc, char** argv) {
  testing::InitGoogleTest(&argc, argv);
  return RUN_ALL_TESTS();
}
