// SPDX-License-Identifier: BSD-3-Clause
#include <gtest/gtest.h>

#include <cmath>
#include <memory>
#include <random>

#include "plain_grid.h"

namespace rtree_occupancy_map {
namespace {

constexpr double kFar = 100.0;

Options small(int max_entries = 16) {
  Options o;
  o.resolution = 0.1;
  o.tree.max_entries = max_entries;
  o.tree.min_entries = std::max(1, max_entries * 2 / 5);
  return o;
}

// Equal to the plain grid, voxel by voxel; the tree is sound; no cell crosses a block's border.
void expectLossless(const OccupancyMap& map, const PlainGrid& grid) {
  bool disjoint = false;
  const std::map<Voxel, float> voxels = voxelsOf(map, &disjoint);
  EXPECT_TRUE(disjoint);
  EXPECT_EQ(voxels.size(), grid.voxels().size());
  std::size_t differing = 0;
  for (const auto& [voxel, log_odds] : grid.voxels()) {
    const auto found = voxels.find(voxel);
    differing += found == voxels.end() || found->second != log_odds;
  }
  EXPECT_EQ(differing, 0U);
  EXPECT_EQ(map.tree().checkInvariants(), "");
  map.tree().visitAll([](const Cell& c) {
    for (int i = 0; i < 3; ++i) EXPECT_EQ(c.box.min[i] >> kBlockBits, (c.box.max[i] - 1) >> kBlockBits);
    return true;
  });
}

struct Variant {
  const char* name;
  FusionRule rule;
  FusionStrategy strategy;
  SensorModel model;
  const char* order;
  int max_entries;
};

class LosslessTest : public ::testing::TestWithParam<Variant> {};

TEST_P(LosslessTest, EqualsAPlainGrid) {
  Options o = small(GetParam().max_entries);
  o.fusion_rule = GetParam().rule;
  o.fusion_strategy = GetParam().strategy;
  o.sensor_model = GetParam().model;
  o.search_order = GetParam().order;
  o.samples_per_metre = 3.0;
  o.min_range = 0.5;
  o.max_range = 6.0;
  OccupancyMap map(o);
  PlainGrid grid(o);
  RandomScans scans(GetParam().max_entries);
  for (int i = 0; i < 40; ++i) {
    const Scan scan = scans.next(i < 30 ? 300 : 40);
    map.insertScan(scan);
    grid.insert(scan);
    if (i % 13 == 12) expectLossless(map, grid);
  }
  expectLossless(map, grid);
  if (o.fusion_strategy == FusionStrategy::kNone) {
    EXPECT_EQ(map.tree().size(), grid.voxels().size());
  } else {
    EXPECT_LE(map.tree().size(), grid.voxels().size());  // FusesByItsRule makes sure that cells fuse
  }
}

TEST_P(LosslessTest, FusesByItsRule) {
  Options o = small(GetParam().max_entries);
  o.fusion_rule = GetParam().rule;
  o.fusion_strategy = GetParam().strategy;
  o.sensor_model = GetParam().model;
  o.search_order = GetParam().order;
  OccupancyMap map(o);
  RandomScans scans(3);
  for (int i = 0; i < 25; ++i) map.insertScan(scans.next(300));
  Scan bar;  // something that settles for sure
  for (int k = 0; k < 10; ++k) bar.hits.emplace_back(2.05F, 0.1F * static_cast<float>(k) + 0.05F, 0.05F);
  for (int i = 0; i < 20; ++i) map.insertScan(bar);
  const auto clamped = [&o](float l) {
    const double p = OccupancyMap::probability(l);
    return p > o.clamping_max - 1e-6 || (o.sensor_model == SensorModel::kBeam && p < o.clamping_min + 1e-6);
  };
  std::size_t fused = 0;
  map.tree().visitAll([&](const Cell& c) {
    fused += c.box.volume() > 1;
    EXPECT_TRUE(o.fusion_rule != FusionRule::kThesis || c.box.volume() == 1 || clamped(c.log_odds));
    return true;
  });
  EXPECT_EQ(fused > 0, o.fusion_strategy != FusionStrategy::kNone);
}

constexpr auto kThesis = FusionRule::kThesis;
constexpr auto kEqual = FusionRule::kEqualValue;
constexpr auto kBeam = SensorModel::kBeam;
constexpr auto kEnd = SensorModel::kEndPoint;
INSTANTIATE_TEST_SUITE_P(
    Variants, LosslessTest,
    ::testing::Values(Variant{"block_equal", kEqual, FusionStrategy::kBlock, kBeam, "zxy", 16},
                      Variant{"block_equal_xyz", kEqual, FusionStrategy::kBlock, kBeam, "xyz", 4},
                      Variant{"block_equal_yxz", kEqual, FusionStrategy::kBlock, kBeam, "yxz", 64},
                      Variant{"block_thesis", kThesis, FusionStrategy::kBlock, kBeam, "zxy", 16},
                      Variant{"block_thesis_yzx", kThesis, FusionStrategy::kBlock, kBeam, "yzx", 8},
                      Variant{"expansion_thesis", kThesis, FusionStrategy::kExpansion, kBeam, "xyz", 16},
                      Variant{"expansion_equal", kEqual, FusionStrategy::kExpansion, kBeam, "zyx", 8},
                      Variant{"endpoint_thesis", kThesis, FusionStrategy::kBlock, kEnd, "zxy", 16},
                      Variant{"endpoint_equal", kEqual, FusionStrategy::kBlock, kEnd, "xzy", 16},
                      Variant{"endpoint_expansion", kThesis, FusionStrategy::kExpansion, kEnd, "xyz", 16},
                      Variant{"none", kEqual, FusionStrategy::kNone, kBeam, "zxy", 16}),
    [](const auto& info) { return info.param.name; });

// a small world

Eigen::Vector3f vec(double x, double y, double z) {
  return Eigen::Vector3d(x, y, z).cast<float>();
}

// Beams from the origin to a wall at this x.
Scan wallAt(double x) {
  Scan scan;
  scan.origin = vec(0.05, 0.05, 0.05);
  for (int y = -10; y <= 10; ++y) {
    for (int z = -5; z <= 5; ++z) scan.hits.push_back(vec(x, 0.1 * y + 0.05, 0.1 * z + 0.05));
  }
  return scan;
}

TEST(OccupancyMap, AnObstacleThatMovesAwayDisappears) {
  OccupancyMap map(small());
  for (int i = 0; i < 10; ++i) map.insertScan(wallAt(1.05));
  EXPECT_EQ(map.stateAt({1.05, 0.05, 0.05}), VoxelState::kOccupied);
  EXPECT_GT(map.cellAt(Eigen::Vector3d(1.05, 0.05, 0.05))->box.volume(), 1);
  for (int i = 0; i < 12; ++i) map.insertScan(wallAt(2.05));
  EXPECT_EQ(map.stateAt({1.05, 0.05, 0.05}), VoxelState::kFree);
  EXPECT_EQ(map.stateAt({2.05, 0.05, 0.05}), VoxelState::kOccupied);
}

// A fused cell that is divided anew, so that one of its voxels is alone: it stays what it was.
TEST(OccupancyMap, AStaticMapKeepsWhatHasSettled) {
  Options o = small();
  o.dynamic = false;
  OccupancyMap map(o);
  const auto repeat = [&map](const Eigen::Vector3f& hit, int times) {
    Scan scan;
    scan.origin = vec(0.05, 0.05, 0.05);
    scan.hits = {hit};
    for (int i = 0; i < times; ++i) map.insertScan(scan);
  };
  repeat(vec(0.55, 0.55, 0.55), 10);
  repeat(vec(0.55, 0.65, 0.55), 10);
  repeat(vec(0.65, 0.55, 0.55), 10);
  repeat(vec(1.1, 1.3, 1.1), 30);  // through the second
  EXPECT_EQ(map.stateAt({0.55, 0.55, 0.55}), VoxelState::kOccupied);
  EXPECT_EQ(map.stateAt({0.55, 0.65, 0.55}), VoxelState::kOccupied);
  EXPECT_EQ(map.stateAt({0.65, 0.55, 0.55}), VoxelState::kOccupied);
}

TEST(OccupancyMap, AStaticMapKeepsWhatIsFused) {
  Options o = small();
  o.dynamic = false;
  o.fusion_rule = FusionRule::kThesis;
  OccupancyMap map(o);
  for (int i = 0; i < 10; ++i) map.insertScan(wallAt(1.05));
  for (int i = 0; i < 30; ++i) map.insertScan(wallAt(2.05));
  EXPECT_EQ(map.stateAt({1.05, 0.05, 0.05}), VoxelState::kOccupied);
  EXPECT_EQ(map.stateAt({2.05, 0.05, 0.05}), VoxelState::kOccupied);
}

// One beam that crosses a large free cell and ends in it: only what contradicts is taken out.
TEST(OccupancyMap, SplitsJustWhereNeeded) {
  for (const FusionStrategy strategy : {FusionStrategy::kBlock, FusionStrategy::kExpansion}) {
    Options o = small();
    o.fusion_rule = FusionRule::kThesis;
    o.fusion_strategy = strategy;
    o.samples_per_metre = 20.0;
    OccupancyMap map(o);
    for (int i = 0; i < 10; ++i) map.insertScan(wallAt(2.95));
    const std::size_t before = map.tree().size();
    Scan scan;
    scan.origin = vec(0.05, 0.05, 0.05);
    scan.hits = {vec(1.55, 0.05, 0.05)};
    map.insertScan(scan);
    EXPECT_EQ(map.cellAt(Eigen::Vector3d(1.55, 0.05, 0.05))->box.volume(), 1);
    EXPECT_LE(map.tree().size(), before + 10);
  }
}

TEST(OccupancyMap, ClearsAlongBeamsWithoutReturn) {
  Options o = small();
  o.max_range = 5.0;
  OccupancyMap map(o);
  Scan scan;
  scan.origin = vec(0.05, 0.05, 0.05);
  scan.misses = {vec(kFar, 0.05, 0.05)};
  scan.hits = {vec(0.05, kFar, 0.05)};
  const InsertReport report = map.insertScan(scan);
  EXPECT_EQ(report.hits, 0U);
  EXPECT_EQ(report.beyond_range, 1U);
  EXPECT_EQ(map.statistics().occupied_cells, 0U);
  for (const Eigen::Vector3d& axis : {Eigen::Vector3d(1, 0, 0), Eigen::Vector3d(0, 1, 0)}) {
    EXPECT_EQ(map.stateAt(Eigen::Vector3d(0.05, 0.05, 0.05) + 4.8 * axis), VoxelState::kFree);
    EXPECT_EQ(map.stateAt(Eigen::Vector3d(0.05, 0.05, 0.05) + 5.2 * axis), VoxelState::kUnknown);
  }
  map.setRange(0.0, 2.0);
  EXPECT_THROW(map.setRange(3.0, 2.0), std::invalid_argument);
  scan.hits = {vec(0.05, 0.05, 3.05)};
  EXPECT_EQ(map.insertScan(scan).beyond_range, 1U);
}

TEST(OccupancyMap, CutsBeamsHoweverLong) {
  Options o = small();
  o.max_range = 5.0;
  OccupancyMap map(o);
  Scan scan;
  scan.origin = vec(0.05, 0.05, 0.05);
  scan.misses = {vec(3e38, 0.05, 0.05)};
  scan.hits = {vec(0.05, 1e20, 0.05)};
  EXPECT_EQ(map.insertScan(scan).beyond_range, 1U);
  EXPECT_EQ(map.stateAt({4.85, 0.05, 0.05}), VoxelState::kFree);
  EXPECT_EQ(map.stateAt({0.05, 4.85, 0.05}), VoxelState::kFree);
}

TEST(OccupancyMap, BeamsThatOnlyClearAreSelectedFromToo) {
  Options o = small();
  o.fusion_strategy = FusionStrategy::kExpansion;
  o.samples_per_metre = 5.0;
  OccupancyMap map(o);
  Scan scan;
  scan.origin = vec(0.05, 0.05, 0.05);
  scan.misses = {vec(3.05, 0.05, 0.05)};
  for (int i = 0; i < 20; ++i) map.insertScan(scan);
  EXPECT_LT(map.tree().size(), 15U);
}

TEST(OccupancyMap, CountsWhatItLeavesOut) {
  Options o = small();
  o.min_range = 1.0;
  OccupancyMap map(o);
  const float nan = std::numeric_limits<float>::quiet_NaN(), inf = std::numeric_limits<float>::infinity();
  Scan scan;
  scan.hits = {vec(nan, 0, 0), vec(0, inf, 0), vec(0.5, 0.5, 0), vec(1e9, 0, 0), vec(1, 1, 1), vec(1, 1, 1)};
  scan.misses = {vec(0, 0, nan), vec(0, 0, 1e9)};
  const InsertReport report = map.insertScan(scan);
  EXPECT_EQ(report.non_finite, 3U);
  EXPECT_EQ(report.too_near, 1U);
  EXPECT_EQ(report.outside, 2U);
  EXPECT_EQ(report.hits, 2U);
  EXPECT_EQ(map.statistics().occupied_cells, 1U);
}

TEST(OccupancyMap, RefusesBadScansAsAWhole) {
  OccupancyMap map(small());
  map.insertScan(wallAt(1.05));
  const std::size_t cells = map.tree().size();
  Scan scan = wallAt(2.05);
  scan.reflectivity = {1.0F};
  EXPECT_THROW(map.insertScan(scan), std::invalid_argument);
  scan.reflectivity.clear();
  scan.origin.x() = std::numeric_limits<float>::quiet_NaN();
  EXPECT_THROW(map.insertScan(scan), std::invalid_argument);
  scan.origin.x() = 1e7F;
  EXPECT_THROW(map.insertScan(scan), std::invalid_argument);
  EXPECT_EQ(map.tree().size(), cells);
}

TEST(OccupancyMap, SaysWhereAnOriginMayBe) {
  OccupancyMap map;
  Scan scan;
  scan.origin = {448262.0F, 5411932.0F, 120.0F};  // UTM
  try {
    map.insertScan(scan);
    ADD_FAILURE();
  } catch (const std::invalid_argument& e) {
    for (const char* part : {"448262", "+-6547.2 m", "UTM"})
      EXPECT_NE(std::string::npos, std::string(e.what()).find(part)) << e.what();
  }
}

TEST(OccupancyMap, WorksUpToTheEdgeOfItsCoordinates) {
  Options o = small();
  OccupancyMap map(o);
  const double edge = kMaxVoxel * o.resolution;
  Scan scan;
  scan.origin = vec(edge - 3.0, -edge + 3.0, 0.0);
  for (int i = 0; i < 60; ++i) scan.hits.push_back(vec(edge - 0.06 * i, -edge + 0.05 * i + 0.02, 0.01 * i));
  for (int i = 0; i < 60; ++i) scan.misses.push_back(vec(edge + 0.5, -edge + 0.1 * i, 0.0));
  const InsertReport report = map.insertScan(scan);
  // Its end is so near to a border that rounding takes it past, out of the coordinates.
  Scan grazing;
  grazing.origin = vec(1111.54724, 719.944641, 214.416901);
  grazing.misses = {vec(3273.59985, 1821.90002, 752.700012)};
  map.insertScan(grazing);
  const VoxelBox bounds = map.tree().bounds();
  for (int i = 0; i < 3; ++i) {
    EXPECT_GE(bounds.min[i], kMinVoxel);
    EXPECT_LE(bounds.max[i], kMaxVoxel);
  }
  EXPECT_GT(report.hits, 50U);
  EXPECT_GT(report.outside, 50U);
  EXPECT_EQ(map.tree().checkInvariants(), "");
}

TEST(OccupancyMap, ReportsChangedBlocksOnly) {
  OccupancyMap map(small());
  EXPECT_FALSE(map.insertScan(wallAt(1.05)).changed_blocks.empty());
  std::size_t last = 1;
  for (int i = 0; i < 10; ++i) last = map.insertScan(wallAt(1.05)).changed_blocks.size();
  EXPECT_EQ(last, 0U);  // all voxels are at a threshold
  Scan one;
  one.origin = vec(0.05, 0.05, 0.05);
  one.hits = {vec(0.45, 0.05, 0.05)};
  EXPECT_EQ(map.insertScan(one).changed_blocks, (std::vector<Block>{{0, 0, 0}}));
}

TEST(OccupancyMap, AveragesReflectivity) {
  Options o = small();
  o.reflectivity = true;
  OccupancyMap map(o);
  Scan scan;
  scan.hits = {vec(1.05, 0.05, 0.05), vec(1.06, 0.05, 0.05), vec(1.05, 0.15, 0.05)};
  scan.reflectivity = {0.2F, 0.4F, 0.9F};
  map.insertScan(scan);
  scan.reflectivity = {0.6F, std::numeric_limits<float>::quiet_NaN(), 0.9F};
  for (int i = 0; i < 2; ++i) map.insertScan(scan);
  const Cell cell = *map.cellAt(Eigen::Vector3d(1.05, 0.05, 0.05));
  // Both voxels have had the same updates and are one cell: the mean over its volume.
  EXPECT_EQ(cell.box.volume(), 2);
  EXPECT_NEAR(cell.reflectivity.mean, (0.45 + 0.9) / 2, 0.1);
  EXPECT_GT(cell.reflectivity.hits, 1U);
  map.tree().visitAll([&map](const Cell& c) {
    EXPECT_EQ(map.isOccupied(c), c.reflectivity.hits > 0);
    return true;
  });
  // A scan without reflectivities leaves them alone.
  scan.reflectivity.clear();
  map.insertScan(scan);
  EXPECT_NEAR(map.cellAt(Eigen::Vector3d(1.05, 0.05, 0.05))->reflectivity.mean, cell.reflectivity.mean, 1e-6);
}

TEST(OccupancyMap, AveragesReflectivityExactlyInOneVoxel) {
  Options o = small();
  o.reflectivity = true;
  o.fusion_strategy = FusionStrategy::kNone;
  OccupancyMap map(o);
  Scan scan;
  for (int i = 0; i < 10; ++i) {
    scan.hits = {vec(1.05, 0.05, 0.05), vec(1.06, 0.05, 0.05)};
    scan.reflectivity = {0.1F * static_cast<float>(i), 0.5F};
    map.insertScan(scan);
  }
  const Reflectivity r = map.cellAt(Eigen::Vector3d(1.05, 0.05, 0.05))->reflectivity;
  EXPECT_EQ(r.hits, 20U);
  EXPECT_NEAR(r.mean, 0.475, 1e-5);
}

TEST(OccupancyMap, ClearsABox) {
  OccupancyMap map(small());
  for (int i = 0; i < 10; ++i) map.insertScan(wallAt(1.05));
  const std::size_t blocks = map.clearBox({1.0, -0.5, -2.0}, {1.1, 0.5, 2.0}).size();
  EXPECT_GT(blocks, 0U);
  EXPECT_EQ(map.stateAt({1.05, 0.05, 0.05}), VoxelState::kFree);
  EXPECT_EQ(map.stateAt({1.05, 0.75, 0.05}), VoxelState::kOccupied);
  EXPECT_EQ(map.stateAt({1.15, 0.05, 0.05}), VoxelState::kUnknown);
  EXPECT_EQ(map.tree().checkInvariants(), "");
  EXPECT_TRUE(map.clearBox({1.0, -0.5, -2.0}, {1.1, 0.5, 2.0}).empty());
}

TEST(OccupancyMap, GoesOnAfterAMove) {
  Options o = small();
  auto first = std::make_unique<OccupancyMap>(o);
  PlainGrid grid(o);
  RandomScans scans(8);
  const auto insert = [&](OccupancyMap& map) {
    const Scan scan = scans.next(200);
    map.insertScan(scan);
    grid.insert(scan);
  };
  insert(*first);
  OccupancyMap second(std::move(*first));
  first.reset();
  for (int i = 0; i < 10; ++i) insert(second);
  OccupancyMap third{Options()};
  third = std::move(second);
  for (int i = 0; i < 10; ++i) insert(third);
  expectLossless(third, grid);
}

TEST(OccupancyMap, SameSeedSameMap) {
  const auto cells = [](std::uint64_t seed) {
    Options o = small();
    o.fusion_strategy = FusionStrategy::kExpansion;
    o.seed = seed;
    OccupancyMap map(o);
    RandomScans scans(5);
    for (int i = 0; i < 12; ++i) map.insertScan(scans.next(200));
    std::vector<VoxelBox> boxes;
    map.tree().visitAll([&boxes](const Cell& c) {
      boxes.push_back(c.box);
      return true;
    });
    return boxes;
  };
  EXPECT_TRUE(cells(1) == cells(1));
  EXPECT_FALSE(cells(1) == cells(2));
}

TEST(Options, NamesWhatIsWrong) {
  const auto message = [](auto&& change) -> std::string {
    Options o;
    change(o);
    try {
      OccupancyMap map(o);
    } catch (const std::invalid_argument& e) {
      return e.what();
    }
    return "accepted";
  };
  EXPECT_EQ(message([](Options& o) { o.resolution = 0.0; }),
            "resolution is 0, allowed is above 0 to below 1000000 m");
  EXPECT_EQ(message([](Options& o) { o.prob_hit = 0.4; }),
            "sensor_model/hit is 0.4, allowed is 0.5 to below 1");
  EXPECT_EQ(message([](Options& o) { o.max_range = -1; }),
            "sensor_model/max_range is -1, allowed is more than 0 m, or -1: no limit");
  EXPECT_EQ(message([](Options& o) { o.max_range = std::nan(""); }).substr(0, 29),
            "sensor_model/max_range is nan");
  EXPECT_EQ(message([](Options& o) { o.search_order = "xxy"; }).substr(0, 28),
            "fusion/search_order is 'xxy'");
  EXPECT_EQ(message([](Options& o) { o.tree.max_entries = 1; }),
            "tree/max_entries is 1, allowed is 2 to 256");
  EXPECT_EQ(message([](Options& o) { o.prior = 0.3; }).substr(0, 25), "sensor_model/prior is 0.3");
  EXPECT_EQ(message([](Options&) {}), "accepted");
}

}  // namespace
}  // namespace rtree_occupancy_map

int main(int argc, char** argv) {
  testing::InitGoogleTest(&argc, argv);
  return RUN_ALL_TESTS();
}
