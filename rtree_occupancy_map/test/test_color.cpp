// SPDX-License-Identifier: BSD-3-Clause
//
// Colours beside the map: against sums that are kept voxel by voxel, and a map without colours.
#include <gtest/gtest.h>
#include <mapping_common/archive.h>
#include <mapping_common/files.h>
#include <mapping_common/testing/temp_dir.h>

#include <algorithm>
#include <array>
#include <cstring>
#include <map>
#include <random>
#include <string>
#include <vector>

#include "plain_grid.h"
#include "rtree_occupancy_map/map_snapshot.h"
#include "rtree_occupancy_map/map_transform.h"
#include "rtree_occupancy_map/octomap_file.h"
#include "rtree_occupancy_map/pcd_file.h"
#include "rtree_occupancy_map/window.h"

namespace rtree_occupancy_map {
namespace {

using mapping_common::mentions;
using mapping_common::TempDir;

/// The message of what `call` throws, "" if it throws nothing.
template <class Call>
std::string errorOf(const Call& call) {
  try {
    call();
  } catch (const std::exception& e) {
    return e.what();
  }
  return "";
}

Options withColor(Options options = {}) {
  options.color = true;
  return options;
}

void paint(Scan& scan, std::mt19937& random) {
  for (std::size_t i = 0; i < scan.hits.size(); ++i) {
    const auto byte = [&random] { return static_cast<std::uint8_t>(random()); };
    scan.colors.push_back({byte(), byte(), byte()});
  }
}

OccupancyMap mapOf(int scans, unsigned seed = 1, Options options = {}) {
  OccupancyMap map(withColor(std::move(options)));
  RandomScans scenes(seed);
  std::mt19937 random(seed);
  for (int i = 0; i < scans; ++i) {
    Scan scan = scenes.next(300);
    paint(scan, random);
    map.insertScan(scan);
  }
  return map;
}

std::map<Voxel, ColorSum> colorsOf(const OccupancyMap& map) {
  std::map<Voxel, ColorSum> colors;
  for (const ColoredVoxel& c : map.coloredVoxels()) EXPECT_TRUE(colors.emplace(c.voxel, c.color).second);
  return colors;
}

Eigen::Vector3d centerOf(const OccupancyMap& map, const Voxel& voxel) {
  return map.center(VoxelBox::unit(voxel));
}

bool isOccupied(const OccupancyMap& map, const Voxel& voxel) {
  const auto cell = map.cellAt(voxel);
  return cell && map.isOccupied(*cell);
}

/// A wall of 40 x 1 x 40 voxels seen from afar, each of its voxels in a colour of its own.
Scan wall(const Color& base = {0, 0, 100}) {
  Scan scan;
  scan.origin = {0.1F, 0.1F, 0.1F};
  for (int x = 0; x < 40; ++x) {
    for (int z = 0; z < 40; ++z) {
      scan.hits.emplace_back(0.2F * static_cast<float>(x) + 0.1F, 6.1F, 0.2F * static_cast<float>(z) + 0.1F);
      scan.colors.push_back(
          {static_cast<std::uint8_t>(base[0] + x), static_cast<std::uint8_t>(base[1] + z), base[2]});
    }
  }
  return scan;
}

struct Kind {
  const char* name;
  Options options;
};
std::vector<Kind> kinds() {
  std::vector<Kind> all(6);
  all[0].name = "by default";
  all[1].name = "two threads";
  all[1].options.threads = 2;
  all[2].name = "end points";
  all[2].options.sensor_model = SensorModel::kEndPoint;
  all[3].name = "reflectivity";
  all[3].options.reflectivity = true;
  all[4].name = "expansion";
  all[4].options.fusion_strategy = FusionStrategy::kExpansion;
  all[5].name = "settles, and what is occupied is so from two returns on";
  all[5].options.dynamic = false;
  all[5].options.occupancy_threshold = 0.8;
  return all;
}

TEST(Color, IsTheMeanOfTheReturnsOfOccupiedVoxelsAndTheMapStaysAsItIs) {
  for (Kind& kind : kinds()) {
    SCOPED_TRACE(kind.name);
    kind.options.max_range = 6.0;
    OccupancyMap plain(kind.options), map(withColor(kind.options));
    std::map<Voxel, ColorSum> expected;
    RandomScans scenes(4);
    std::mt19937 random(5 + testSeed());
    std::size_t forgotten = 0;
    for (int i = 0; i < 25; ++i) {
      Scan scan = scenes.next(400);
      if (kind.options.reflectivity) scan.reflectivity.assign(scan.hits.size(), 0.5F);
      plain.insertScan(scan);
      paint(scan, random);
      if (i % 6 == 5) scan.colors.clear();  // of another sensor
      map.insertScan(scan);
      for (std::size_t k = 0; k < scan.colors.size(); ++k) {
        const Voxel v = PlainGrid(kind.options).voxelOf(scan.hits[k]);
        if ((centerOf(map, v).cast<float>() - scan.origin).norm() <= 6.0F) expected[v].add(scan.colors[k]);
      }
      for (auto e = expected.begin(); e != expected.end();) {
        const bool occupied = isOccupied(plain, e->first);
        EXPECT_EQ(occupied, isOccupied(map, e->first));
        forgotten += !occupied;
        e = occupied ? std::next(e) : expected.erase(e);
      }
      ASSERT_TRUE(expected == colorsOf(map)) << i;
    }
    EXPECT_GT(expected.size(), 500u);
    EXPECT_EQ(forgotten > 20, kind.options.sensor_model == SensorModel::kBeam) << forgotten;
    EXPECT_EQ("", map.tree().checkInvariants());
    map.setColor(false);
    EXPECT_TRUE(plain.toBytes() == map.toBytes());  // cells, their order and all else
    EXPECT_TRUE(map.coloredVoxels().empty());
  }
}

TEST(Color, OfAFusedCellIsTheMeanOverItsVoxels) {
  OccupancyMap map(withColor());
  for (int i = 0; i < 10; ++i) map.insertScan(wall());
  int cells = 0, largest = 0;
  map.visitOccupied([&](const Cell& cell) {
    std::array<int, 3> sum{};
    int voxels = 0;
    for (int x = cell.box.min[0]; x < cell.box.max[0]; ++x) {
      for (int z = cell.box.min[2]; z < cell.box.max[2]; ++z, ++voxels) {
        const auto here = map.colorAt(centerOf(map, {x, cell.box.min[1], z}));
        EXPECT_EQ((Color{static_cast<std::uint8_t>(x), static_cast<std::uint8_t>(z), 100}), here);
        for (int k = 0; k < 3; ++k) sum[k] += (*here)[k];
      }
    }
    const auto mean = map.colorOf(cell);
    EXPECT_TRUE(mean);
    for (int k = 0; k < 3 && mean; ++k)
      EXPECT_EQ(std::lround(static_cast<double>(sum[k]) / voxels), (*mean)[k]);
    ++cells;
    largest = std::max(largest, voxels);
    return true;
  });
  EXPECT_GT(largest, 100);
  EXPECT_LT(cells, 40);
  EXPECT_FALSE(map.colorAt({3.0, 3.0, 3.0}));  // free
  EXPECT_FALSE(map.colorAt({-3.0, 3.0, 3.0}));
  EXPECT_FALSE(map.colorAt({1e30, 0.0, std::nan("")}));
}

TEST(Color, ChangesAreReported) {
  OccupancyMap map(withColor());
  const auto sawAll = [&map](const Scan& scan) { return map.insertScan(scan).changed_blocks; };
  while (!sawAll(wall()).empty()) {
  }
  EXPECT_TRUE(sawAll(wall()).empty());
  EXPECT_EQ(4u, sawAll(wall({10, 10, 200})).size());
  Scan none = wall();
  none.colors.clear();
  EXPECT_TRUE(sawAll(none).empty());
  none.colors.resize(3);
  EXPECT_TRUE(mentions(errorOf([&] { sawAll(none); }), {"3 colours", "1600 hits"}));
}

TEST(Color, GoesWithWhatItBelongsTo) {
  Options options;
  options.decay_time = 10.0;
  OccupancyMap map(withColor(options));
  Scan scan = wall();
  for (scan.time = 0.0; scan.time < 3.0; scan.time += 1.0) map.insertScan(scan);
  const std::size_t all = map.coloredVoxels().size();
  ASSERT_EQ(1600u, all);
  map.clearBox({0, 6, 0}, {2, 7, 2});
  EXPECT_EQ(all - 100, map.coloredVoxels().size());
  EXPECT_FALSE(map.colorAt({1.1, 6.1, 1.1}));
  Scan elsewhere;
  elsewhere.origin = {0.1F, 0.1F, -3.1F};
  elsewhere.hits = {{0.1F, 3.1F, -3.1F}};
  elsewhere.time = 60.0;
  map.insertScan(elsewhere);
  EXPECT_TRUE(map.coloredVoxels().empty());

  OccupancyMap other = mapOf(3);
  EXPECT_FALSE(other.coloredVoxels().empty());
  const OccupancyMap moved = std::move(other);
  EXPECT_FALSE(moved.coloredVoxels().empty());
  OccupancyMap cleared = mapOf(3);
  cleared.clear();
  EXPECT_TRUE(cleared.coloredVoxels().empty());
}

TEST(Color, MemoryIsCounted) {
  OccupancyMap with = mapOf(10), without = mapOf(10);
  without.setColor(false);
  const std::size_t voxels = with.coloredVoxels().size(), bytes = with.memoryUsage() - without.memoryUsage();
  EXPECT_GE(bytes, 18 * voxels);
  EXPECT_LT(bytes, 40 * voxels + 10000);
}

TEST(Color, SumsOfVeryManyReturnsKeepTheirMean) {
  ColorSum sum, more;
  sum.returns = (1u << 24) - 1;
  sum.sum = {255 * sum.returns, 100 * sum.returns, 0};
  EXPECT_TRUE(sum.isSound());
  EXPECT_EQ((Color{255, 100, 0}), sum.mean());
  for (int i = 0; i < 3; ++i) sum.add(sum);
  EXPECT_TRUE(sum.isSound());
  EXPECT_EQ((Color{255, 100, 0}), sum.mean());
  more.add(Color{1, 2, 3});
  sum.add(more);
  EXPECT_EQ((Color{255, 100, 0}), sum.mean());
}

TEST(Color, HitsAreRemovedWithTheirs) {
  Scan scan = wall();
  const Scan all = scan;
  removeHits([](const Eigen::Vector3f& hit) { return hit.x() < 4.0F; }, scan);
  ASSERT_EQ(scan.hits.size(), scan.colors.size());
  EXPECT_TRUE(std::equal(scan.colors.begin(), scan.colors.end(), all.colors.end() - 800));
}

// ---- files ----------------------------------------------------------------------------------------------

TEST(ColorFile, ComesBackAndGoesOn) {
  const TempDir dir;
  for (const bool reflectivity : {false, true}) {
    Options options;
    options.reflectivity = reflectivity;
    OccupancyMap map = mapOf(8, 2, options);
    map.save(dir.path("a.map"));
    OccupancyMap loaded = OccupancyMap::load(dir.path("a.map"));
    EXPECT_TRUE(loaded.options().color);
    EXPECT_TRUE(colorsOf(map) == colorsOf(loaded));
    EXPECT_EQ(known(map), known(loaded));
    std::mt19937 random(1);
    Scan scan = RandomScans(9).next(200);
    paint(scan, random);
    map.insertScan(scan);
    loaded.insertScan(scan);
    EXPECT_TRUE(colorsOf(map) == colorsOf(loaded));
  }
  OccupancyMap(withColor()).save(dir.path("empty.map"));
  EXPECT_TRUE(OccupancyMap::load(dir.path("empty.map")).options().color);
}

TEST(ColorFile, WithoutColoursThereIsNoTraceOfThem) {
  OccupancyMap map = mapOf(2);
  map.setColor(false);
  EXPECT_EQ(std::string::npos, map.toBytes().find("color"));
  map.setColor(true);
  EXPECT_NE(std::string::npos, map.toBytes().find("color"));
}

TEST(ColorFile, ChecksTheContent) {
  const std::string bytes = mapOf(3).toBytes();
  const auto errorOfBytes = [](std::string patched) {
    mapping_common::Checksum checksum;
    checksum.add(patched.data(), patched.size() - 8);
    const std::uint64_t value = checksum.value();
    std::memcpy(&patched[patched.size() - 8], &value, 8);
    return errorOf([&] { OccupancyMap::fromBytes(patched.data(), patched.data() + patched.size(), "it"); });
  };
  EXPECT_EQ("", errorOfBytes(bytes));
  const auto patched = [&](std::size_t from_end, auto value) {
    std::string b = bytes;
    std::memcpy(&b[b.size() - 8 - from_end], &value, sizeof(value));
    return errorOfBytes(b);
  };
  EXPECT_TRUE(mentions(patched(4, std::uint32_t{0}), {"out of order or range"}));         // returns
  EXPECT_TRUE(mentions(patched(16, std::uint32_t{1} << 30), {"out of order or range"}));  // red
  EXPECT_TRUE(mentions(patched(18, std::uint16_t{0xffff}), {"out of order or range"}));   // voxel
  EXPECT_TRUE(mentions(patched(18, std::uint16_t{0}), {"colours"}));  // another voxel, free or out of order
  const std::string shorter = bytes.substr(0, bytes.size() - 8 - 18) + bytes.substr(bytes.size() - 8);
  EXPECT_TRUE(mentions(errorOfBytes(shorter), {"truncated"}));
  std::mt19937 random(1);
  for (int i = 0; i < 500; ++i) {  // whatever it holds, it is an error or a map
    std::string b = bytes;
    b[b.size() - 9 - random() % 2000] = static_cast<char>(random());
    errorOfBytes(b);
  }
}

TEST(ColorFile, StoresRefuseIt) {
  const TempDir dir;
  OccupancyMap map = mapOf(2);
  WindowOptions window;
  window.file = dir.path("window.db");
  EXPECT_TRUE(mentions(errorOf([&] { map.keepIn(window); }), {"color is true", "rolling window"}));
  EXPECT_TRUE(mentions(errorOf([&] { map.save(dir.path("a.db")); }), {"a.db", "color is true"}));
  EXPECT_FALSE(map.coloredVoxels().empty());
  map.setColor(false);
  map.keepIn(window);
  EXPECT_TRUE(mentions(errorOf([&] { map.setColor(true); }), {"color is true"}));
}

TEST(ColorFile, ColorOcTreesComeBack) {
  const TempDir dir;
  OccupancyMap map = mapOf(8);
  Scan white;
  white.hits = {{9.1F, 0.1F, 0.1F}};
  white.colors = {kNoColor};
  map.insertScan(white);
  writeOctomap(map, dir.path("a.ot"), OctomapFormat::kFull);
  const std::string head = mapping_common::readFile(dir.path("a.ot")).substr(0, 200);
  EXPECT_NE(std::string::npos, head.find("id ColorOcTree"));
  const OccupancyMap read = readOctomap(dir.path("a.ot"));
  EXPECT_TRUE(read.options().color);
  EXPECT_EQ(known(map), known(read));
  const auto expected = colorsOf(map), actual = colorsOf(read);
  ASSERT_EQ(expected.size(), actual.size());
  int pruned = 0;
  for (const auto& [voxel, color] : expected) {
    const Color mean = color.mean(), here = actual.at(voxel).mean();
    EXPECT_EQ(1u, actual.at(voxel).returns);
    if (voxel[0] == 45) {
      EXPECT_EQ((Color{255, 255, 254}), here);
    } else {
      pruned += mean != here;
    }
  }
  EXPECT_LT(pruned, static_cast<int>(expected.size()) / 20);
  EXPECT_TRUE(readOctomap(dir.path("a.ot"), {}).coloredVoxels().empty());  // as options say
  writeOctomap(map, dir.path("a.bt"), OctomapFormat::kBinary);
  EXPECT_FALSE(readOctomap(dir.path("a.bt")).options().color);
  writeOctomap(OccupancyMap(withColor()), dir.path("empty.ot"), OctomapFormat::kFull);
  EXPECT_TRUE(readOctomap(dir.path("empty.ot")).options().color);
}

// A few bytes may claim more voxels than there is memory for.
TEST(ColorFile, LargeColouredLeavesAreRefused) {
  const TempDir dir;
  std::string data;
  const float log_odds = 2.0F;
  for (int i = 0; i < 6; ++i) {  // from the root to a cube of 1024 voxels
    data.append(reinterpret_cast<const char*>(&log_odds), 4);
    data += "abc";
    data.push_back(static_cast<char>(i == 5 ? 0 : i == 0 ? 128 : 1));
  }
  mapping_common::writeFile(dir.path("large.ot"), [&](std::ostream& out) {
    out << "# Octomap OcTree file\nid ColorOcTree\nsize 6\nres 0.1\ndata\n" << data;
  });
  EXPECT_TRUE(mentions(errorOf([&] { readOctomap(dir.path("large.ot")); }), {"large.ot", "too many voxels"}));
  EXPECT_EQ("", errorOf([&] { readOctomap(dir.path("large.ot"), {}); }));
}

TEST(ColorFile, PointsHaveTheColoursOfTheirVoxels) {
  const TempDir dir;
  OccupancyMap map(withColor());
  for (int i = 0; i < 10; ++i) map.insertScan(wall());
  map.insertScan([] {
    Scan scan = wall();
    scan.hits.resize(1);
    scan.hits[0] = {-1.1F, -1.1F, 0.1F};
    scan.colors.clear();
    return scan;
  }());
  ASSERT_EQ(1601u, writePcd(map, dir.path("a.pcd")));
  const std::string bytes = mapping_common::readFile(dir.path("a.pcd"));
  EXPECT_NE(std::string::npos, bytes.find("FIELDS x y z rgb\nSIZE 4 4 4 4\nTYPE F F F F\nCOUNT 1 1 1 1\n"));
  const std::size_t begin = bytes.find("DATA binary\n") + 12;
  ASSERT_EQ(begin + 1601 * 16, bytes.size());
  for (std::size_t i = 0; i < 1601; ++i) {
    float point[3];
    std::uint32_t packed;
    std::memcpy(point, &bytes[begin + 16 * i], 12);
    std::memcpy(&packed, &bytes[begin + 16 * i + 12], 4);
    const Color expected =
        map.colorAt(Eigen::Map<Eigen::Vector3f>(point).cast<double>()).value_or(Color{255, 255, 255});
    EXPECT_EQ(expected, unpackedColor(packed));
    EXPECT_EQ(point[0] < 0.0F, expected == kNoColor);
  }
}

// ---- other maps -----------------------------------------------------------------------------------------

TEST(ColorTransform, FollowsTheVoxels) {
  const OccupancyMap map = mapOf(6);
  EXPECT_TRUE(colorsOf(map) == colorsOf(transformed(map, Eigen::Isometry3d::Identity(), map.options())));
  Eigen::Isometry3d quarter(Eigen::AngleAxisd(M_PI_2, Eigen::Vector3d::UnitZ()));
  quarter.translation() = Eigen::Vector3d(4.0, -2.0, 1.0);
  std::map<Voxel, ColorSum> turned;
  for (const auto& [v, color] : colorsOf(map)) turned[{19 - v[1], v[0] - 10, v[2] + 5}] = color;
  EXPECT_TRUE(turned == colorsOf(transformed(map, quarter, map.options())));

  Options coarse = map.options();
  coarse.resolution = 0.6;
  std::map<Voxel, ColorSum> sums;
  for (const auto& [v, color] : colorsOf(map)) {
    const auto third = [](int c) { return c >= 0 ? c / 3 : (c - 2) / 3; };
    sums[{third(v[0]), third(v[1]), third(v[2])}].add(color);
  }
  EXPECT_TRUE(sums == colorsOf(transformed(map, Eigen::Isometry3d::Identity(), coarse)));

  Options fine = map.options();
  fine.resolution = 0.05;
  const OccupancyMap finer = transformed(map, Eigen::Isometry3d::Identity(), fine);
  EXPECT_EQ(64 * map.coloredVoxels().size(), finer.coloredVoxels().size());
  for (const ColoredVoxel& c : finer.coloredVoxels())
    EXPECT_EQ(map.colorAt(centerOf(finer, c.voxel)), c.color.mean());

  Options plain = map.options();
  plain.color = false;
  EXPECT_TRUE(transformed(map, quarter, plain).coloredVoxels().empty());
}

TEST(ColorTransform, MergedMapsHaveTheColoursOfBoth) {
  const OccupancyMap a = mapOf(5, 1), b = mapOf(5, 2), both = merged(a, b);
  std::map<Voxel, ColorSum> expected = colorsOf(a);
  for (const auto& [voxel, color] : colorsOf(b)) expected[voxel].add(color);
  for (auto e = expected.begin(); e != expected.end();)
    e = isOccupied(both, e->first) ? std::next(e) : expected.erase(e);
  EXPECT_TRUE(expected == colorsOf(both));
  EXPECT_GT(expected.size(), colorsOf(a).size());
}

TEST(ColorTransform, SnapshotsHaveThem) {
  const OccupancyMap map = mapOf(5);
  const MapSnapshot snapshot(map);
  EXPECT_TRUE(snapshot.colored);
  std::size_t colored = 0;
  for (const MapSnapshot::BlockCells& block : snapshot.blocks) {
    for (const Cell& cell : block.cells) {
      EXPECT_EQ(map.colorOf(cell), block.colorOf(cell.box));
      colored += block.colorOf(cell.box).has_value();
    }
  }
  EXPECT_GT(colored, 100u);
  EXPECT_FALSE(MapSnapshot(OccupancyMap()).colored);
}

}  // namespace
}  // namespace rtree_occupancy_map

int main(int argc, char** argv) {
  testing::InitGoogleTest(&argc, argv);
  return RUN_ALL_TESTS();
}
