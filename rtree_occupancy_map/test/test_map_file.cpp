// SPDX-License-Identifier: BSD-3-Clause
#include <gtest/gtest.h>
#include <mapping_common/archive.h>
#include <mapping_common/testing/temp_dir.h>

#include <cstring>
#include <filesystem>
#include <fstream>
#include <iterator>

#include "plain_grid.h"

namespace rtree_occupancy_map {
namespace {

class MapFileTest : public ::testing::Test {
 protected:
  std::vector<std::string> files() const {
    std::vector<std::string> names;
    for (const auto& entry : std::filesystem::directory_iterator(directory_.path())) {
      names.push_back(entry.path().filename().string());
    }
    return names;
  }
  std::string read() const {
    std::ifstream in(path_, std::ios::binary);
    return {std::istreambuf_iterator<char>(in), {}};
  }
  void write(const std::string& bytes) const { std::ofstream(path_, std::ios::binary) << bytes; }
  // Makes the checksum right again after a change: what is left to be found is the content.
  void writeWithChecksum(std::string bytes) const {
    mapping_common::Checksum checksum;
    checksum.add(bytes.data(), bytes.size() - 8);
    const std::uint64_t value = checksum.value();
    std::memcpy(&bytes[bytes.size() - 8], &value, 8);
    write(bytes);
  }
  std::string loadError() const {
    try {
      OccupancyMap::load(path_);
    } catch (const std::runtime_error& e) {
      return e.what();
    }
    return "";
  }

  const mapping_common::TempDir directory_;
  std::string path_ = directory_.path("test.map");
};

OccupancyMap makeMap(bool reflectivity, int scans) {
  Options o;
  o.resolution = 0.25;
  o.reflectivity = reflectivity;
  o.tree.max_entries = 8;
  o.tree.min_entries = 3;
  o.tree.split = "rstar";
  o.search_order = "yxz";
  OccupancyMap map(o);
  RandomScans random(2);
  for (int i = 0; i < scans; ++i) {
    Scan scan = random.next(200);
    if (reflectivity) scan.reflectivity.assign(scan.hits.size(), 0.1F * static_cast<float>(i));
    map.insertScan(scan);
  }
  return map;
}

TEST_F(MapFileTest, ComesBackAndGoesOn) {
  for (const bool reflectivity : {false, true}) {
    OccupancyMap map = makeMap(reflectivity, 12);
    map.save(path_);
    OccupancyMap loaded = OccupancyMap::load(path_);
    EXPECT_EQ(files(), std::vector<std::string>{"test.map"});  // nothing temporary is left
    EXPECT_EQ(loaded.options().resolution, 0.25);
    EXPECT_EQ(loaded.options().tree.max_entries, 8);
    EXPECT_EQ(loaded.options().tree.split, "rstar");
    EXPECT_EQ(loaded.options().search_order, "yxz");
    EXPECT_EQ(loaded.tree().checkInvariants(), "");

    RandomScans more(77);
    for (int i = 0; i < 5; ++i) {
      bool disjoint;
      EXPECT_TRUE(voxelsOf(map, &disjoint) == voxelsOf(loaded, &disjoint));
      EXPECT_EQ(map.tree().size(), loaded.tree().size());
      loaded.tree().visitAll([&map](const Cell& c) {
        const Reflectivity expected =
            map.cellAt(Voxel{c.box.min[0], c.box.min[1], c.box.min[2]})->reflectivity;
        EXPECT_EQ(c.reflectivity.hits, expected.hits);
        EXPECT_TRUE(c.reflectivity.mean == expected.mean || expected.hits == 0);
        return true;
      });
      const Scan scan = more.next(150);
      map.insertScan(scan);
      loaded.insertScan(scan);
    }
  }
}

TEST_F(MapFileTest, EachSplitComesBack) {
  for (const auto& split : splits()) {
    Options o;
    o.tree.split = split.name;
    OccupancyMap map(o);
    map.insertScan(RandomScans(3).next(100));
    map.save(path_);
    OccupancyMap loaded = OccupancyMap::load(path_);
    EXPECT_EQ(split.name, loaded.options().tree.split);
    const Scan scan = RandomScans(4).next(100);
    map.insertScan(scan);
    loaded.insertScan(scan);
    EXPECT_EQ(map.tree().size(), loaded.tree().size());
    EXPECT_EQ("", loaded.tree().checkInvariants());
  }
}

// The bytes of version 1 were written by the program that wrote that version.
TEST_F(MapFileTest, OlderVersionsAreRead) {
  const OccupancyMap map = OccupancyMap::load(PACKAGE_DIR "/test/files/version1.map");
  const Options& o = map.options();
  EXPECT_EQ(0.25, o.resolution);
  EXPECT_EQ(0.8, o.prob_hit);
  EXPECT_EQ(20.0, o.max_range);
  EXPECT_EQ(SensorModel::kEndPoint, o.sensor_model);
  EXPECT_EQ(FusionRule::kThesis, o.fusion_rule);
  EXPECT_EQ(FusionStrategy::kNone, o.fusion_strategy);
  EXPECT_EQ("yxz", o.search_order);
  EXPECT_EQ(7u, o.seed);
  EXPECT_FALSE(o.dynamic);
  EXPECT_EQ(3, o.tree.min_entries);
  EXPECT_EQ("rstar", o.tree.split);
  ASSERT_EQ(3u, map.tree().size());
  for (int i = 0; i < 3; ++i) {
    const std::optional<Cell> cell = map.cellAt(Voxel{4 + 4 * i, 0, 0});
    ASSERT_TRUE(cell);
    EXPECT_EQ(0.5F + 0.25F * static_cast<float>(i), cell->reflectivity.mean);
    EXPECT_FLOAT_EQ(std::log(4.0F), cell->log_odds);
  }
  map.save(path_);
  EXPECT_TRUE(mapping_common::same(o, OccupancyMap::load(path_).options()));
}

TEST_F(MapFileTest, AnEmptyMapIsAMap) {
  makeMap(false, 0).save(path_);
  EXPECT_EQ(OccupancyMap::load(path_).tree().size(), 0U);
}

TEST_F(MapFileTest, RefusesTruncatedFiles) {
  makeMap(true, 1).save(path_);
  const std::string bytes = read();
  for (std::size_t size = 0; size < bytes.size(); size += size < 200 ? 1 : 997) {
    write(bytes.substr(0, size));
    EXPECT_NE(loadError(), "") << size;
  }
  write(bytes + "x");
  EXPECT_NE(loadError(), "");
}

TEST_F(MapFileTest, RefusesEveryFlippedBit) {
  makeMap(false, 1).save(path_);
  const std::string bytes = read();
  std::mt19937 random(1);
  for (int i = 0; i < 300; ++i) {
    std::string broken = bytes;
    const std::size_t at = i < 150 ? static_cast<std::size_t>(i) : random() % bytes.size();
    broken[at] = static_cast<char>(broken[at] ^ (1 << random() % 8));
    write(broken);
    EXPECT_NE(loadError(), "") << at;
  }
}

TEST_F(MapFileTest, SaysWhatIsWrong) {
  EXPECT_NE(loadError().find("can't be opened"), std::string::npos);
  write("# OctoMap OcTree binary file\nid OcTree\n");
  EXPECT_NE(loadError().find("isn't an R-tree occupancy map"), std::string::npos);
  makeMap(false, 1).save(path_);
  std::string bytes = read();
  bytes[8] = 9;
  write(bytes);
  EXPECT_NE(loadError().find("format version 9"), std::string::npos);
  path_ = directory_.path();
  EXPECT_NE(loadError(), "");
}

// A right checksum over wrong content: files that somebody else's program wrote.
TEST_F(MapFileTest, ChecksTheContent) {
  makeMap(false, 1).save(path_);
  const std::string bytes = read();
  const std::size_t cell = 16, last = bytes.size() - 8 - cell;
  const auto patched = [&](std::size_t at, const void* data, std::size_t size) {
    std::string b = bytes;
    std::memcpy(&b[at], data, size);
    writeWithChecksum(b);
    return loadError();
  };
  writeWithChecksum(bytes);
  EXPECT_EQ(loadError(), "");
  EXPECT_NE(patched(bytes.find("0.25"), "-1.0", 4).find("resolution is -1"), std::string::npos);
  EXPECT_NE(patched(bytes.find("rstar"), "roman", 5).find("tree/split is 'roman'"), std::string::npos);
  EXPECT_NE(patched(bytes.find("seed"), "sees", 4).find("an option sees"), std::string::npos);
  const std::int16_t inverted[6] = {5, 5, 5, 4, 6, 6}, wide[6] = {0, 0, 0, 40, 1, 1};
  EXPECT_NE(patched(last, inverted, 12).find("cuboid within a block"), std::string::npos);
  EXPECT_NE(patched(last, wide, 12).find("cuboid within a block"), std::string::npos);
  EXPECT_NE(patched(last, &bytes[last - cell], 12).find("overlap"), std::string::npos);
  const float nan = std::nanf(""), high = 100.0F;
  EXPECT_NE(patched(last + 12, &nan, 4).find("log odds"), std::string::npos);
  EXPECT_NE(patched(last + 12, &high, 4).find("log odds"), std::string::npos);
  // A number of cells that would need more memory than there is.
  std::string b = bytes;
  const std::size_t count_at = bytes.size() - 8 -
                               cell * OccupancyMap::load([this, &bytes] {
                                        write(bytes);
                                        return path_;
                                      }())
                                          .tree()
                                          .size() -
                               8;
  const std::uint64_t huge = std::numeric_limits<std::uint64_t>::max() / 16;
  EXPECT_NE(patched(count_at, &huge, 8).find("number of cells"), std::string::npos);
}

TEST_F(MapFileTest, AFailedSaveLeavesTheOldFile) {
  makeMap(false, 1).save(path_);
  const std::string before = read();
  EXPECT_THROW(makeMap(false, 2).save(directory_.path("no/such/folder.map")), std::runtime_error);
  std::filesystem::create_directory(directory_.path("occupied"));
  EXPECT_THROW(makeMap(false, 2).save(directory_.path("occupied")), std::runtime_error);
  std::filesystem::remove(directory_.path("occupied"));
  EXPECT_EQ(read(), before);
  EXPECT_EQ(files().size(), 1U);
}

}  // namespace
}  // namespace rtree_occupancy_map

int main(int argc, char** argv) {
  testing::InitGoogleTest(&argc, argv);
  return RUN_ALL_TESTS();
}
