// SPDX-License-Identifier: BSD-3-Clause
#include <gtest/gtest.h>
#include <mapping_common/files.h>
#include <mapping_common/testing/temp_dir.h>

#include <cmath>
#include <cstring>
#include <random>
#include <vector>

#include "plain_grid.h"
#include "rtree_occupancy_map/octomap_file.h"
#include "rtree_occupancy_map/pcd_file.h"

namespace rtree_occupancy_map {
namespace {

using mapping_common::errorOf;
using mapping_common::mentions;
using mapping_common::readFile;
using mapping_common::TempDir;

OccupancyMap mapOf(int scans, const Options& options = {}) {
  OccupancyMap map(options);
  RandomScans random(5 + testSeed());
  for (int i = 0; i < scans; ++i) map.insertScan(random.next(200));
  return map;
}

/// A file of one path from the root to the octant of -16384 to -1 along each axis, cut where `level` is
/// reached.
std::string withHeader(const std::string& first_line, const std::string& id, std::size_t nodes,
                       const std::string& data) {
  return first_line + "\n# comment\nid " + id + "\nsize " + std::to_string(nodes) + "\nres 0.1\ndata\n" +
         data;
}
const char kBinaryLine[] = "# Octomap OcTree binary file", kFullLine[] = "# Octomap OcTree file";

/// Inner nodes with one child, number 7 and then 0s: the first voxel from the origin on.
std::string binaryPath(int levels) {
  std::string data;
  for (int i = 0; i < levels; ++i) {
    const unsigned as = i + 1 < levels ? 3 : 2, bits = as << (i == 0 ? 14 : 0);
    data.push_back(static_cast<char>(bits & 255));
    data.push_back(static_cast<char>(bits >> 8));
  }
  return data;
}

class OctomapFile : public testing::Test {
 protected:
  std::string loadError(const std::string& bytes) {
    dir_.write("m", bytes);
    return errorOf([this] { readOctomap(dir_.path("m")); });
  }
  TempDir dir_;
};

TEST_F(OctomapFile, FullComesBack) {
  for (const double occupancy_threshold : {0.5, 0.8}) {
    Options o;
    o.resolution = 0.1 + 0.2;  // of many digits
    o.occupancy_threshold = occupancy_threshold;
    for (const int scans : {0, 1, 15}) {
      const OccupancyMap map = mapOf(scans, o);
      writeOctomap(map, dir_.path("m"), OctomapFormat::kFull);
      const OccupancyMap read = readOctomap(dir_.path("m"), o);
      EXPECT_EQ(known(map), known(read));
      EXPECT_TRUE(mapping_common::same(map.options(), read.options()));
      EXPECT_EQ(map.tree().size(), read.tree().size());  // fused again, not the octree's leaves
      EXPECT_EQ("", read.tree().checkInvariants());
    }
  }
}

TEST_F(OctomapFile, BinaryKeepsFreeAndOccupied) {
  const OccupancyMap map = mapOf(15);
  writeOctomap(map, dir_.path("m"), OctomapFormat::kBinary);
  const std::string bytes = readFile(dir_.path("m"));
  const OccupancyMap read = readOctomap(dir_.path("m"));
  std::map<Voxel, float> expected = known(map);
  for (auto& [voxel, log_odds] : expected)
    log_odds = static_cast<float>(log_odds >= 0.0F ? std::log(0.971 / 0.029) : std::log(0.1192 / 0.8808));
  EXPECT_EQ(expected, known(read));
  EXPECT_EQ(0.1192, read.options().clamping_min);
  EXPECT_EQ(0.971, read.options().clamping_max);
  writeOctomap(read, dir_.path("again"), OctomapFormat::kBinary);
  EXPECT_EQ(bytes, readFile(dir_.path("again")));
}

TEST_F(OctomapFile, GoesOnToBeBuilt) {
  OccupancyMap map = mapOf(5);
  writeOctomap(map, dir_.path("m"), OctomapFormat::kFull);
  OccupancyMap read = readOctomap(dir_.path("m"));
  RandomScans random(3);
  for (int i = 0; i < 5; ++i) {
    const Scan scan = random.next(100);
    map.insertScan(scan);
    read.insertScan(scan);
  }
  EXPECT_EQ(known(map), known(read));
}

// What OctoMap prunes becomes one node, and no larger cuboid than the octree has is missed.
TEST_F(OctomapFile, EqualChildrenAreOneNode) {
  const VoxelBox cube = {{{-64, 0, 64}}, {{0, 64, 128}}};
  const OccupancyMap map = OccupancyMap::fromCells({}, {cellOf(cube, 1.0F)});
  EXPECT_EQ(8u, map.tree().size());
  // From the root, 16 levels above the voxels, to the node of 2^6 voxels: 10 inner nodes and a leaf.
  EXPECT_EQ(11u, toOctomap(map, OctomapFormat::kFull).nodes);
  EXPECT_EQ(11u * 5, toOctomap(map, OctomapFormat::kFull).bytes.size());
  EXPECT_EQ(11u, toOctomap(map, OctomapFormat::kBinary).nodes);
  EXPECT_EQ(10u * 2, toOctomap(map, OctomapFormat::kBinary).bytes.size());
  // Free and occupied of any log odds: each one's half is a node of its own in .bt alone.
  const OccupancyMap two = OccupancyMap::fromCells(
      {}, {cellOf({{{0, 0, 0}}, {{4, 4, 2}}}, 1.0F), cellOf({{{0, 0, 2}}, {{4, 4, 4}}}, 2.0F)});
  EXPECT_EQ(15u, toOctomap(two, OctomapFormat::kBinary).nodes);
  EXPECT_EQ(15u + 8, toOctomap(two, OctomapFormat::kFull).nodes);
}

TEST_F(OctomapFile, PrunedNodesBecomeCuboids) {
  // The child 7 of the root's child 7's ... : a path of 9 inner nodes to a leaf of 2^7 voxels.
  dir_.write("m", withHeader(kBinaryLine, "OcTree", 10, binaryPath(9)));
  const OccupancyMap map = readOctomap(dir_.path("m"));
  EXPECT_EQ(0.1, map.options().resolution);
  EXPECT_EQ(64u, map.tree().size());  // blocks
  EXPECT_EQ(VoxelBox({{{0, 0, 0}}, {{128, 128, 128}}}), map.tree().bounds());
  EXPECT_EQ(VoxelState::kOccupied, map.stateAt({12.75, 0.05, 6.0}));
}

TEST_F(OctomapFile, OlderIdsAndColoursAreRead) {
  const auto voxel = [](std::size_t colour) {
    std::string data;
    for (int level = 0; level <= 16; ++level) {
      const float log_odds = 1.5F;
      data.append(reinterpret_cast<const char*>(&log_odds), 4);
      data.append(colour, '\x55');
      data.push_back(level == 16 ? '\0' : level == 0 ? '\x80' : '\1');
    }
    return data;
  };
  dir_.write("m", withHeader(kFullLine, "ColorOcTree", 17, voxel(3)));
  EXPECT_EQ((std::map<Voxel, float>{{{0, 0, 0}, 1.5F}}), known(readOctomap(dir_.path("m"))));
  dir_.write("m", withHeader(kFullLine, "OcTreeStamped", 17, voxel(0)));
  EXPECT_EQ((std::map<Voxel, float>{{{0, 0, 0}, 1.5F}}), known(readOctomap(dir_.path("m"))));
  dir_.write("m", withHeader(kBinaryLine, "1", 17, binaryPath(16)));
  EXPECT_EQ(1u, known(readOctomap(dir_.path("m"))).size());
}

TEST_F(OctomapFile, ThresholdsAreThoseOfTheFile) {
  for (const double p : {0.971, 0.9987654321, 0.97, 0.9}) {
    Options o;
    o.clamping_max = std::max(p, 0.97);
    o.clamping_min = 1.0 - o.clamping_max;
    const auto high = static_cast<float>(std::log(p / (1.0 - p)));
    writeOctomap(OccupancyMap::fromCells(o, {cellOf(VoxelBox::unit({1, 2, 3}), high)}), dir_.path("m"),
                 OctomapFormat::kFull);
    const OccupancyMap read = readOctomap(dir_.path("m"));
    EXPECT_EQ(high, read.cellAt(Voxel{1, 2, 3})->log_odds) << p;
    EXPECT_NEAR(std::max(p, 0.97), read.options().clamping_max, 1e-9);
    EXPECT_EQ(0.12, read.options().clamping_min);
    read.save(dir_.path("own"));
    EXPECT_EQ(high, OccupancyMap::load(dir_.path("own")).cellAt(Voxel{1, 2, 3})->log_odds);
  }
  // Any float between +-20.
  std::mt19937 random(testSeed());
  for (int i = 0; i < 300; ++i) {
    const float value = std::uniform_real_distribution<float>(-20.0F, 20.0F)(random);
    std::string data = toOctomap(OccupancyMap::fromCells({}, {cellOf(VoxelBox::unit({0, 0, 0}), 1.0F)}),
                                 OctomapFormat::kFull)
                           .bytes;
    std::memcpy(&data[data.size() - 5], &value, 4);
    dir_.write("m", withHeader(kFullLine, "OcTree", 17, data));
    EXPECT_EQ(value, readOctomap(dir_.path("m")).cellAt(Voxel{0, 0, 0})->log_odds);
  }
}

TEST_F(OctomapFile, SaysWhatIsWrong) {
  EXPECT_TRUE(mentions(errorOf([] { readOctomap("/nowhere/m.bt"); }), {"/nowhere/m.bt", "No such file"}));
  EXPECT_TRUE(mentions(loadError(""), {"isn't a map of OctoMap"}));
  EXPECT_TRUE(mentions(loadError("RTREEMAP"), {dir_.path("m").c_str(), "isn't a map of OctoMap"}));
  const std::string full(kFullLine), data = binaryPath(16);
  EXPECT_EQ("", loadError(withHeader(kBinaryLine, "OcTree", 17, data)));
  EXPECT_TRUE(mentions(loadError(full + "\nid OcTree\n"), {"no end"}));
  EXPECT_TRUE(mentions(loadError(full + "\nid OcTree\nsize 1\ndata\n"), {"no resolution"}));
  EXPECT_TRUE(mentions(loadError(full + "\nid OcTree\nres -1\ndata\n"), {"no resolution"}));
  EXPECT_TRUE(mentions(loadError(full + "\nid OcTree\nres 1e300\ndata\n"), {"resolution is 1e+300"}));
  EXPECT_TRUE(mentions(loadError(full + "\nid OcTree\nsize many\n"), {"the line 'size many'"}));
  EXPECT_TRUE(mentions(loadError(full + "\nres 0.1\ndata\n"), {"(id)"}));
  EXPECT_TRUE(
      mentions(loadError(withHeader(kFullLine, "CountingOcTree", 1, "")), {"CountingOcTree", "allowed"}));
  EXPECT_TRUE(mentions(loadError(withHeader(kBinaryLine, "OcTree", 17, data.substr(0, 31))), {"truncated"}));
  EXPECT_TRUE(
      mentions(loadError(withHeader(kBinaryLine, "OcTree", 17, data + "x")), {"after its last node"}));
  EXPECT_TRUE(mentions(loadError(withHeader(kBinaryLine, "OcTree", 18, data)), {"17 nodes", "18"}));
  EXPECT_TRUE(mentions(loadError(withHeader(kBinaryLine, "OcTree", 16, data)), {"more nodes"}));
  EXPECT_TRUE(
      mentions(loadError(withHeader(kBinaryLine, "OcTree", 9, std::string(2, '\0'))), {"no children"}));
  EXPECT_TRUE(
      mentions(loadError(withHeader(kBinaryLine, "OcTree", 99, binaryPath(17))), {"below the smallest"}));
  // Space beyond what any map is: a leaf at the root's child 0 reaches voxel -32768, one at its child 7 8e9
  // m^3.
  EXPECT_TRUE(mentions(loadError(withHeader(kBinaryLine, "OcTree", 2, std::string("\2\0", 2))),
                       {"farther than 3273.6"}));
  EXPECT_TRUE(mentions(loadError(withHeader(kBinaryLine, "OcTree", 4, binaryPath(3))), {"too many blocks"}));
  const float nan = std::nanf("");
  std::string broken = toOctomap(mapOf(1), OctomapFormat::kFull).bytes;
  const std::size_t nodes = broken.size() / 5;
  std::memcpy(&broken[broken.size() - 5], &nan, 4);
  EXPECT_TRUE(mentions(loadError(withHeader(kFullLine, "OcTree", nodes, broken)), {"aren't finite"}));
}

// Whatever the bytes are, they are read or refused, in little memory.
TEST_F(OctomapFile, TakesAnyBytes) {
  std::mt19937 random(1 + testSeed());
  for (const OctomapFormat format : {OctomapFormat::kBinary, OctomapFormat::kFull}) {
    writeOctomap(mapOf(2), dir_.path("whole"), format);
    const std::string whole = readFile(dir_.path("whole"));
    int refused = 0;
    for (int i = 0; i < 300; ++i) {
      std::string bytes = whole;
      for (int k = random() % 3; k >= 0; --k) {
        const std::size_t at = random() % (k % 2 == 0 ? 120 : bytes.size());
        bytes[at] = static_cast<char>(random());
      }
      if (i % 5 == 0) bytes.resize(random() % bytes.size());
      refused += !loadError(bytes).empty();
    }
    EXPECT_GT(refused, 100);
  }
}

TEST_F(OctomapFile, CellsOfAnySizeMakeAMap) {
  const OccupancyMap map = mapOf(10);
  std::vector<Cell> cells;
  map.tree().visitAll([&cells](const Cell& cell) { return cells.push_back(cell), true; });
  std::reverse(cells.begin(), cells.end());
  EXPECT_EQ(known(map), known(OccupancyMap::fromCells({}, cells)));

  const VoxelBox wall = {{{-100, 3, -20}}, {{100, 5, 20}}};
  EXPECT_EQ(200u * 2 * 40, known(OccupancyMap::fromCells({}, {cellOf(wall, 100.0F)})).size());
  EXPECT_FLOAT_EQ(std::log(0.97F / 0.03F),
                  OccupancyMap::fromCells({}, {cellOf(wall, 100.0F)}).cellAt(Voxel{0, 3, 0})->log_odds);
  const auto refused = [](const std::vector<Cell>& given) {
    EXPECT_THROW(OccupancyMap::fromCells({}, given), std::invalid_argument);
  };
  refused({cellOf(wall, 1.0F), cellOf(VoxelBox::unit({99, 4, 19}), 1.0F)});
  refused({cellOf({{{0, 0, 0}}, {{1, 0, 1}}}, 1.0F)});
  refused({cellOf(VoxelBox::unit({kMinVoxel - 1, 0, 0}), 1.0F)});
  refused({cellOf(wall, std::nanf(""))});
  refused({cellOf({{{-30000, -30000, -30000}}, {{30000, 30000, 30000}}}, 1.0F)});
}

TEST(PcdFile, HasAPointForEachOccupiedVoxel) {
  const TempDir dir;
  Options o;
  o.resolution = 0.5;
  Cell occupied = cellOf({{{-2, 0, 4}}, {{0, 1, 5}}}, 1.0F);
  occupied.reflectivity = {0.25F, 3};
  const std::vector<Cell> cells = {occupied, cellOf(VoxelBox::unit({7, 7, 7}), -1.0F)};
  EXPECT_EQ(2u, writePcd(OccupancyMap::fromCells(o, cells), dir.path("a.pcd")));
  std::string bytes = readFile(dir.path("a.pcd"));
  EXPECT_TRUE(mentions(bytes, {"\nFIELDS x y z\n", "\nWIDTH 2\n", "\nPOINTS 2\n", "\nDATA binary\n"}));
  const float points[] = {-0.75F, 0.25F, 2.25F, -0.25F, 0.25F, 2.25F};
  ASSERT_GT(bytes.size(), sizeof(points));
  EXPECT_EQ(0, std::memcmp(points, &bytes[bytes.size() - sizeof(points)], sizeof(points)));
  o.reflectivity = true;
  writePcd(OccupancyMap::fromCells(o, cells), dir.path("a.pcd"));
  bytes = readFile(dir.path("a.pcd"));
  EXPECT_TRUE(mentions(bytes, {"\nFIELDS x y z intensity\n"}));
  float last = 0.0F;
  std::memcpy(&last, &bytes[bytes.size() - 4], 4);
  EXPECT_EQ(0.25F, last);
}

}  // namespace
}  // namespace rtree_occupancy_map

int main(int argc, char** argv) {
  testing::InitGoogleTest(&argc, argv);
  return RUN_ALL_TESTS();
}
