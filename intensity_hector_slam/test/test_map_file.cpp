// SPDX-License-Identifier: BSD-3-Clause
#include <gtest/gtest.h>
#include <mapping_common/archive.h>
#include <mapping_common/files.h>
#include <mapping_common/testing/temp_dir.h>

#include <limits>

#include "flat_world.h"
#include "intensity_hector_slam/multi_map.h"

namespace intensity_hector_slam {
namespace {

using mapping_common::errorOf;
using mapping_common::mentions;

class MapFile : public ::testing::Test {
 protected:
  MapFile() {
    MapOptions options;
    options.resolution = 0.05;
    map_ = MultiMap(options);
    map_.update(look(furnishedRoom(), Pose::Zero(), {}), Pose::Zero());
    map_.save(path_);
    bytes_ = mapping_common::readFile(path_);
  }
  void expectRefused(const std::string& bytes, const char* why) {
    const std::string path = dir_.write("bad.map", bytes);
    EXPECT_TRUE(mentions(errorOf([&] { MultiMap::load(path); }), {"bad.map", why}));
  }
  static std::string withChecksum(std::string bytes) {
    mapping_common::Checksum checksum;
    checksum.add(bytes.data(), bytes.size() - 8);
    const std::uint64_t sum = checksum.value();
    std::memcpy(&bytes[bytes.size() - 8], &sum, 8);
    return bytes;
  }

  mapping_common::TempDir dir_;
  const std::string path_ = dir_.path("room.map");
  MultiMap map_;
  std::string bytes_;
};

TEST_F(MapFile, HoldsAllOfAMap) {
  const MultiMap loaded = MultiMap::load(path_);
  ASSERT_EQ(map_.levels(), loaded.levels());
  EXPECT_TRUE(map_ == loaded);
  for (int i = 0; i < map_.levels(); ++i) {
    EXPECT_EQ(map_.level(i).box().min(), loaded.level(i).box().min());
    EXPECT_EQ(map_.level(i).box().max(), loaded.level(i).box().max());
  }
  EXPECT_LT(bytes_.size(), map_.bytes() / 20);
  EXPECT_EQ(0.05, loaded.options().resolution);
  loaded.save(dir_.path("again.map"));
  EXPECT_EQ(bytes_, mapping_common::readFile(dir_.path("again.map")));
}

// Their bytes were written by the programs that wrote those versions.
TEST_F(MapFile, OlderVersionsAreRead) {
  for (const std::string version : {"1", "2"}) {
    const MultiMap map = MultiMap::load(PACKAGE_DIR "/test/files/version" + version + ".map");
    ASSERT_EQ(2, map.levels());
    EXPECT_EQ(0.5, map.options().resolution);
    EXPECT_EQ(32, map.level(0).width());
    EXPECT_EQ(16, map.level(1).height());
    EXPECT_EQ(Eigen::Vector2d(-8.0, -8.0), map.level(1).origin());
    EXPECT_FLOAT_EQ(0.7f, map.level(0).cell(3, 1).occupancy);
    EXPECT_EQ(0.75f, map.level(0).cell(3, 1).reflectivity);
    EXPECT_EQ(1, map.level(0).count(3, 1));
    EXPECT_EQ(0.625f, map.level(1).cell(1, 0).reflectivity);
    EXPECT_EQ(2, map.level(1).count(1, 0));
    map.save(path_);
    EXPECT_TRUE(map == MultiMap::load(path_));
  }
}

TEST_F(MapFile, AnEmptyMapIsOne) {
  MultiMap().save(path_);
  EXPECT_TRUE(MultiMap::load(path_).level(0).knownCells().isEmpty());
}

TEST_F(MapFile, DamageIsRefused) {
  expectRefused("", "isn't a reflectivity SLAM map");
  expectRefused("P5\n100 100\n", "isn't a reflectivity SLAM map");
  for (const std::size_t size :
       {std::size_t(8), std::size_t(15), std::size_t(60), bytes_.size() / 2, bytes_.size() - 1}) {
    const std::string path = dir_.write("short.map", bytes_.substr(0, size));
    EXPECT_TRUE(mentions(errorOf([&] { MultiMap::load(path); }), {"short.map", "truncated"})) << size;
  }
  for (std::size_t at = 8; at < bytes_.size(); at += 97) {
    std::string damaged = bytes_;
    damaged[at] ^= 0x10;
    EXPECT_NE("", errorOf([&] { MultiMap::load(dir_.write("bad.map", damaged)); })) << at;
  }
  EXPECT_TRUE(mentions(errorOf([] { MultiMap::load("/nowhere/a.map"); }), {"/nowhere/a.map"}));
}

TEST_F(MapFile, NonsenseWithAValidChecksumIsRefused) {
  const auto patched = [this](std::size_t at, auto value) {
    std::string bytes = bytes_;
    std::memcpy(&bytes[at], &value, sizeof(value));
    return withChecksum(bytes);
  };
  expectRefused(patched(8, std::uint32_t(7)), "format version 7");
  expectRefused(patched(12, std::uint32_t(0)), "levels");
  expectRefused(patched(12, std::uint32_t(1u << 31)), "levels");
  expectRefused(patched(12, std::uint32_t(2)), "more than it says");
  expectRefused(patched(16, -1.0), "impossible bounds");
  expectRefused(patched(24, std::numeric_limits<std::int32_t>::min()), "impossible bounds");
  expectRefused(patched(32, std::int32_t(999999999)), "larger than max_size");
  expectRefused(patched(32, map_.level(0).box().max().x() + 1), "don't agree");
  expectRefused(patched(40, ~std::uint64_t(0)), "truncated");
  expectRefused(patched(48, std::int32_t(1 << 30)), "isn't in its grid");
  expectRefused(patched(56, std::uint32_t(0)), "size of data");
}

TEST_F(MapFile, WhatCannotBeWrittenIsSaid) {
  EXPECT_TRUE(mentions(errorOf([this] { map_.save("/nowhere/a.map"); }), {"/nowhere/a.map"}));
}

}  // namespace
}  // namespace intensity_hector_slam
