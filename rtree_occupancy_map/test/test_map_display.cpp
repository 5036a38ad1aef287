// SPDX-License-Identifier: BSD-3-Clause
//
// Markers and projection, kept up to date by changed blocks, against what the map holds.
#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <map>
#include <set>

#include "rtree_occupancy_map/octomap_file.h"
#include "rtree_occupancy_map/ros/cell_conversion.h"
#include "rtree_occupancy_map/ros/marker_cache.h"
#include "rtree_occupancy_map/ros/projected_map.h"
#include "test_messages.h"

namespace rtree_occupancy_map {
namespace {

Scan roomScan(const Eigen::Vector3f& origin, const Eigen::Vector3f& half_size, unsigned seed) {
  Scan scan;
  scan.origin = origin;
  for (const auto& p : roomPoints(half_size, 2000, seed)) scan.hits.push_back(origin + p);
  return scan;
}

// A sequence of changes that adds, fuses, splits, frees and grows.
template <class Step>
void drive(OccupancyMap& map, Step step) {
  for (unsigned i = 0; i < 12; ++i) {
    const float x = 0.7F * static_cast<float>(i) - 5.0F;
    step(map.insertScan(roomScan({x, 0.1F, 0.3F}, {3.0F + static_cast<float>(i % 3), 2.0F, 1.5F}, i))
             .changed_blocks);
  }
  step(map.clearBox({-2, -3, -2}, {1, 3, 2}));
  step(map.insertScan(roomScan({20, 20, 0}, {2, 2, 2}, 99)).changed_blocks);
}

constexpr double kResolution = 0.2;  // Options' default

class MarkerCacheTest : public ::testing::TestWithParam<MarkerCache::Show> {};

TEST_P(MarkerCacheTest, ChangesAddUpToTheMap) {
  OccupancyMap map;
  MarkerCache cache("map", GetParam());
  MarkerDisplay display;
  drive(map, [&](const std::vector<Block>& changed) {
    display.show(cache.changes({map, changed}, {}));
    const auto expected = boxesOf(map, GetParam() == MarkerCache::Show::kOccupied);
    ASSERT_FALSE(expected.empty());
    ASSERT_TRUE(expected == display.boxes(kResolution));
  });
}

TEST_P(MarkerCacheTest, OneWhoComesLateSeesTheSameUnderTheSameIds) {
  OccupancyMap map;
  MarkerCache cache("map", GetParam());
  MarkerDisplay early, late;
  bool joined = false;
  int steps = 0;
  drive(map, [&](const std::vector<Block>& changed) {
    const auto changes = cache.changes({map, changed}, {});
    early.show(changes);
    if (joined) late.show(changes);
    if (++steps == 5) {
      late.show(cache.all(map, {}));
      joined = true;
    }
    if (joined) {
      ASSERT_EQ(early.markers().size(), late.markers().size());
    }
  });
  for (const auto& [id, marker] : early.markers()) {
    ASSERT_EQ(1u, late.markers().count(id));
    EXPECT_EQ(marker.points.size(), late.markers().at(id).points.size());
  }
  EXPECT_TRUE(early.boxes(kResolution) == late.boxes(kResolution));
}

TEST_P(MarkerCacheTest, SendsNothingOfBlocksThatLookTheSame) {
  OccupancyMap map;
  map.insertScan(roomScan({0, 0, 0}, {3, 2, 1}, 1));
  MarkerCache cache("map", GetParam());
  EXPECT_FALSE(cache.changes(map, {}).markers.empty());
  EXPECT_TRUE(cache.changes(map, {}).markers.empty());
  // Another colour is another look.
  EXPECT_FALSE(cache.changes(map, {ColorMode::kOccupancy, 0.0, 1.0}).markers.empty());
}

TEST_P(MarkerCacheTest, RestartTakesThePlaceOfWhatWasShown) {
  OccupancyMap map;
  map.insertScan(roomScan({0, 0, 0}, {3, 2, 1}, 1));
  MarkerCache cache("map", GetParam());
  MarkerDisplay display;
  display.show(cache.all(map, {}));
  map.clear();
  map.insertScan(roomScan({40, 0, 0}, {2, 2, 1}, 1));
  display.show(cache.restart(map, {}));
  EXPECT_TRUE(boxesOf(map, GetParam() == MarkerCache::Show::kOccupied) == display.boxes(kResolution));
}

INSTANTIATE_TEST_SUITE_P(Both, MarkerCacheTest,
                         ::testing::Values(MarkerCache::Show::kOccupied, MarkerCache::Show::kFree));

TEST(MarkerCache, OneMarkerForEachBlockAndSizeThatRvizCanShow) {
  OccupancyMap map;
  map.insertScan(roomScan({0, 0, 0}, {3, 2, 1}, 1));
  std::set<std::pair<Block, std::array<int, 3>>> expected;
  map.visitOccupied([&](const Cell& c) {
    expected.insert({OccupancyMap::blockOf({c.box.min[0], c.box.min[1], c.box.min[2]}),
                     {c.box.width(0), c.box.width(1), c.box.width(2)}});
    return true;
  });
  MarkerCache cache("odom", MarkerCache::Show::kOccupied);
  const auto message = cache.all(map, {});
  EXPECT_EQ(expected.size(), message.markers.size());
  std::set<int> ids;
  for (const auto& m : message.markers) {
    EXPECT_TRUE(ids.insert(m.id).second);
    EXPECT_EQ("odom", m.header.frame_id);
    EXPECT_EQ("occupied", m.ns);
    EXPECT_EQ(visualization_msgs::Marker::CUBE_LIST, m.type);
    EXPECT_EQ(m.points.size(), m.colors.size());
    EXPECT_GT(std::min({m.scale.x, m.scale.y, m.scale.z}), 0.0);
    EXPECT_EQ(1.0, m.pose.orientation.w);
    for (const auto& c : m.colors) EXPECT_EQ(1.0F, c.a);
  }
}

// The colour of the only occupied cell of a map: one return at z = 1.1 m.
std_msgs::ColorRGBA colorOfOneCell(const ColorScale& scale, float reflectivity) {
  Options options;
  options.reflectivity = true;
  OccupancyMap map(options);
  Scan scan;
  scan.origin = {0, 0, 1.1F};
  scan.hits = {{3, 0, 1.1F}};
  scan.reflectivity = {reflectivity};
  map.insertScan(scan);
  MarkerCache cache("map", MarkerCache::Show::kOccupied);
  return cache.all(map, scale).markers.at(0).colors.at(0);
}

TEST(MarkerCache, Colours) {
  const auto low = colorOfOneCell({ColorMode::kHeight, 2.0, 3.0}, 0.5F);
  EXPECT_GT(low.b, low.r);
  const auto high = colorOfOneCell({ColorMode::kHeight, -1.0, 1.0}, 0.5F);
  EXPECT_GT(high.r, high.b);
  const auto likely =
      colorOfOneCell({ColorMode::kOccupancy, 5.0, 6.0}, 0.5F);  // 0.7, whatever the scale says
  EXPECT_GT(likely.r, likely.b);
  const auto grey = colorOfOneCell({ColorMode::kReflectivity, 0.0, 2.0}, 0.5F);
  EXPECT_FLOAT_EQ(0.25F, grey.r);
  EXPECT_FLOAT_EQ(0.25F, grey.g);
  EXPECT_FLOAT_EQ(0.25F, grey.b);
  const auto none =
      colorOfOneCell({ColorMode::kReflectivity, 0.0, 2.0}, std::numeric_limits<float>::quiet_NaN());
  EXPECT_NE(none.r, none.b);
}

// A map with colours, which change without the cells.
template <class Step>
void driveColored(OccupancyMap& map, Step step) {
  for (unsigned i = 0; i < 12; ++i) {
    Scan scan = roomScan({0.1F, 0.1F, 0.1F}, {3.0F, 2.0F, 1.5F + static_cast<float>(i / 6)}, i % 2);
    for (std::size_t k = 0; k < scan.hits.size(); ++k)
      scan.colors.push_back({static_cast<std::uint8_t>(20 * i), static_cast<std::uint8_t>(k), 200});
    if (i == 10) scan.colors.clear();
    step(map.insertScan(scan).changed_blocks);
  }
  step(map.clearBox({-2, -3, -2}, {1, 3, 2}));
}

Options withColor() {
  Options options;
  options.color = true;
  return options;
}

TEST(MarkerCache, ShowsTheColoursOfVoxels) {
  OccupancyMap map(withColor());
  MarkerCache cache("map", MarkerCache::Show::kOccupied);
  std::map<std::int32_t, visualization_msgs::Marker> shown;
  driveColored(map, [&](const std::vector<Block>& changed) {
    for (const auto& marker : cache.changes({map, changed}, {ColorMode::kColor, 0.0, 1.0}).markers) {
      if (marker.action == visualization_msgs::Marker::ADD) {
        shown[marker.id] = marker;
      } else {
        shown.erase(marker.id);
      }
    }
    std::size_t voxels = 0, colored = 0, expected = 0;
    for (const auto& [id, marker] : shown) {
      ASSERT_EQ(marker.points.size(), marker.colors.size());
      for (std::size_t i = 0; i < marker.points.size(); ++i) {
        voxels += static_cast<std::size_t>(
            std::lround(marker.scale.x * marker.scale.y * marker.scale.z / std::pow(kResolution, 3)));
        const auto color = map.colorAt(toEigen(marker.points[i]));
        const auto& c = marker.colors[i];
        const Color mean = color.value_or(kNoColor);
        ASSERT_NEAR(mean[0], 255 * c.r, 0.1);
        ASSERT_NEAR(mean[1], 255 * c.g, 0.1);
        ASSERT_NEAR(mean[2], 255 * c.b, 0.1);
        ASSERT_EQ(1.0F, c.a);
        colored += color.has_value();
      }
    }
    ASSERT_EQ(map.coloredVoxels().size(), colored);
    map.visitOccupied([&expected](const Cell& cell) {
      expected += static_cast<std::size_t>(cell.box.volume());
      return true;
    });
    ASSERT_EQ(expected, voxels);
  });
  EXPECT_FALSE(shown.empty());
}

// The projection of every voxel, one by one.
std::map<std::array<int, 2>, int> projectByVoxel(const OccupancyMap& map, int min_z, int max_z) {
  std::map<std::array<int, 2>, int> pixels;
  map.tree().visitAll([&](const Cell& c) {
    for (int x = c.box.min[0]; x < c.box.max[0]; ++x) {
      for (int y = c.box.min[1]; y < c.box.max[1]; ++y) {
        for (int z = std::max<int>(min_z, c.box.min[2]); z < std::min<int>(max_z, c.box.max[2]); ++z) {
          const int value = map.isOccupied(c) ? 100 : 0;
          const auto found = pixels.insert({{x, y}, value}).first;
          found->second = std::max(found->second, value);
        }
      }
    }
    return true;
  });
  return pixels;
}

std::map<std::array<int, 2>, int> knownPixels(const nav_msgs::OccupancyGrid& grid) {
  std::map<std::array<int, 2>, int> pixels;
  const int x0 = static_cast<int>(std::lround(grid.info.origin.position.x / grid.info.resolution));
  const int y0 = static_cast<int>(std::lround(grid.info.origin.position.y / grid.info.resolution));
  EXPECT_EQ(std::size_t{grid.info.width} * grid.info.height, grid.data.size());
  for (std::size_t i = 0; i < grid.data.size(); ++i) {
    if (grid.data[i] == -1) continue;
    pixels[{x0 + static_cast<int>(i % grid.info.width), y0 + static_cast<int>(i / grid.info.width)}] =
        grid.data[i];
  }
  return pixels;
}

void applyPatch(const map_msgs::OccupancyGridUpdate& patch, nav_msgs::OccupancyGrid& grid) {
  ASSERT_EQ(std::size_t{patch.width} * patch.height, patch.data.size());
  for (std::uint32_t y = 0; y < patch.height; ++y) {
    for (std::uint32_t x = 0; x < patch.width; ++x) {
      grid.data.at((patch.y + y) * grid.info.width + patch.x + x) = patch.data[y * patch.width + x];
    }
  }
}

class ProjectedMapTest : public ::testing::TestWithParam<std::pair<double, double>> {};

TEST_P(ProjectedMapTest, PatchesAddUpToTheProjectionOfEveryVoxel) {
  const double min_z = GetParam().first, max_z = GetParam().second;
  OccupancyMap map;
  ProjectedMap projected;
  projected.rebuild(map, min_z, max_z, 5000, {});
  nav_msgs::OccupancyGrid received = projected.grid();
  EXPECT_TRUE(knownPixels(received).empty());
  int patched = 0, grown = 0;
  drive(map, [&](const std::vector<Block>& changed) {
    map_msgs::OccupancyGridUpdate patch;
    if (projected.update({map, changed}, {}, patch)) {
      received = projected.grid();
      ++grown;
    } else if (patch.width > 0) {
      applyPatch(patch, received);
      ++patched;
    }
    const VoxelBox z = map.boxOf({0, 0, min_z}, {0, 0, max_z});
    ASSERT_EQ(projectByVoxel(map, z.min[2], z.max[2]), knownPixels(received));
    ASSERT_EQ(received.data, projected.grid().data);
  });
  EXPECT_GT(patched, 3);
  EXPECT_GE(grown, 2);

  ProjectedMap anew;
  anew.rebuild(map, min_z, max_z, 5000, {});
  EXPECT_EQ(knownPixels(received), knownPixels(anew.grid()));
}

INSTANTIATE_TEST_SUITE_P(Heights, ProjectedMapTest,
                         ::testing::Values(std::make_pair(-1e9, 1e9), std::make_pair(-0.5, 0.7),
                                           std::make_pair(-std::numeric_limits<double>::infinity(),
                                                          std::numeric_limits<double>::infinity())));

TEST(ProjectedMap, NothingChangedNothingSent) {
  OccupancyMap map;
  map.insertScan(roomScan({0, 0, 0}, {3, 2, 1}, 1));
  ProjectedMap projected;
  projected.rebuild(map, -1.0, 1.0, 5000, {});
  map_msgs::OccupancyGridUpdate patch;
  EXPECT_FALSE(projected.update(map, {}, patch));
  EXPECT_EQ(0u, patch.width);
  EXPECT_TRUE(patch.data.empty());
}

// As of a mirror, or of the sun.
TEST(ProjectedMap, FarReturnsDoNotMakeItLarge) {
  OccupancyMap map;
  ProjectedMap projected;
  for (const bool far_first : {true, false}) {
    map.clear();
    Scan far;
    far.hits = {{1000, 3, 0}, {-1000, 3, 0}, {3, 6000, 0}};
    if (far_first) map.insertScan(far);
    map.insertScan(roomScan({0, 0, 0}, {3, 2, 1}, 1));
    projected.rebuild(map, -1.0, 1.0, 320, {});
    map_msgs::OccupancyGridUpdate patch;
    if (!far_first) {
      EXPECT_FALSE(projected.leavesOut());
      projected.update({map, map.insertScan(far).changed_blocks}, {}, patch);
    }
    EXPECT_TRUE(projected.leavesOut());
    EXPECT_LE(projected.grid().info.width, 320u);
    EXPECT_LE(projected.grid().info.height, 320u);
    EXPECT_EQ(projected.grid().data.size(),
              static_cast<std::size_t>(projected.grid().info.width) * projected.grid().info.height);
    EXPECT_NEAR(2000.0, projected.wholeSize().x(), 15.0);
    EXPECT_NEAR(6000.0, projected.wholeSize().y(), 15.0);
    // The room is all there.
    auto expected = projectByVoxel(map, -5, 5);
    const auto shown = knownPixels(projected.grid());
    int in_room = 0;
    for (const auto& [pixel, value] : expected) {
      if (std::abs(pixel[0]) > 16 || std::abs(pixel[1]) > 11) continue;
      ++in_room;
      EXPECT_EQ(value, shown.at(pixel)) << pixel[0] << ' ' << pixel[1];
    }
    EXPECT_GT(in_room, 400);
  }
}

TEST(CellConversion, CloudHoldsTheCells) {
  OccupancyMap map;
  map.insertScan(roomScan({0, 0, 0}, {3, 2, 1}, 1));
  const auto cloud = occupiedCloud(map);
  ASSERT_EQ(std::size_t{cloud.width} * cloud.point_step, cloud.data.size());
  std::vector<std::array<int, 6>> received;
  for (std::size_t i = 0; i < cloud.width; ++i) {
    float v[8];
    std::memcpy(v, &cloud.data[i * cloud.point_step], sizeof(v));
    EXPECT_GE(v[6], 0.5F);
    received.push_back(boxOf({v[0], v[1], v[2]}, {v[3], v[4], v[5]}, kResolution));
  }
  std::sort(received.begin(), received.end());
  EXPECT_TRUE(boxesOf(map, true) == received);
}

TEST(CellConversion, CloudHoldsTheColours) {
  OccupancyMap map(withColor());
  OccupiedCloud changing;
  driveColored(map, [&](const std::vector<Block>& changed) {
    changing.update({map, changed});
    const auto cloud = occupiedCloud(map);
    ASSERT_EQ(cloud.data, changing.cloud().data);
    ASSERT_EQ("rgb", cloud.fields.back().name);
    ASSERT_EQ(cloud.fields.back().offset + 4, cloud.point_step);
    std::size_t colored = 0;
    for (std::size_t i = 0; i < cloud.width; ++i) {
      float v[8];
      std::uint32_t packed;
      std::memcpy(v, &cloud.data[i * cloud.point_step], sizeof(v));
      std::memcpy(&packed, &cloud.data[i * cloud.point_step + sizeof(v)], sizeof(packed));
      const auto cell = map.cellAt(Eigen::Vector3d(v[0], v[1], v[2]));
      ASSERT_TRUE(cell);
      const auto color = map.colorOf(*cell);
      ASSERT_EQ(color.value_or(kNoColor), unpackedColor(packed));
      colored += color.has_value();
    }
    ASSERT_GT(colored, 50u);
  });
  EXPECT_EQ("reflectivity", occupiedCloud(OccupancyMap()).fields.back().name);
}

// Block by block as they change, it comes to the same as all at once.
TEST(CellConversion, CloudsOfAMapThatChanges) {
  OccupancyMap map;
  OccupiedCloud changing;
  drive(map, [&](const std::vector<Block>& changed) {
    changing.update({map, changed});
    ASSERT_EQ(occupiedCloud(map).data, changing.cloud().data);
  });
  map.clearBox({-50, -50, -50}, {50, 50, 50});
  changing.update(map);
  EXPECT_TRUE(changing.cloud().data.empty());
}

TEST(CellConversion, OctreesOfAMapThatChanges) {
  for (const OctomapFormat format : {OctomapFormat::kBinary, OctomapFormat::kFull}) {
    OccupancyMap map, colored(withColor());
    for (OccupancyMap* of : {&map, &colored}) {
      Octree octree(format);
      const auto compare = [&](const std::vector<Block>& changed) {
        octree.update({*of, changed});
        const OctomapData expected = toOctomap(*of, format), actual = octree.data();
        ASSERT_EQ(expected.nodes, actual.nodes);
        ASSERT_EQ(expected.bytes, actual.bytes);
        ASSERT_STREQ(of == &colored && format == OctomapFormat::kFull ? "ColorOcTree" : "OcTree",
                     actual.id());
      };
      of == &map ? drive(*of, compare) : driveColored(*of, compare);
    }
  }
}

TEST(CellConversion, KnownBlocksAreThoseWithCells) {
  OccupancyMap map;
  EXPECT_TRUE(knownBlocks(map).empty());
  std::set<Block> changed;
  drive(map, [&](const std::vector<Block>& blocks) { changed.insert(blocks.begin(), blocks.end()); });
  EXPECT_EQ(std::vector<Block>(changed.begin(), changed.end()), knownBlocks(map));
}

}  // namespace
}  // namespace rtree_occupancy_map
