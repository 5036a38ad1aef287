// SPDX-License-Identifier: BSD-3-Clause
#include <gtest/gtest.h>

#include <cmath>
#include <cstring>
#include <limits>
#include <stdexcept>

#include "rtree_occupancy_map/ros/scan_conversion.h"
#include "test_messages.h"

namespace rtree_occupancy_map {
namespace {

using sensor_msgs::PointField;

constexpr float kNan = std::numeric_limits<float>::quiet_NaN();
constexpr float kInf = std::numeric_limits<float>::infinity();
constexpr std::uint8_t F32 = PointField::FLOAT32, F64 = PointField::FLOAT64;

Eigen::Isometry3d pose(double x, double y, double z, double yaw) {
  Eigen::Isometry3d p(Eigen::AngleAxisd(yaw, Eigen::Vector3d::UnitZ()));
  p.translation() = Eigen::Vector3d(x, y, z);
  return p;
}

void expectNear(const Eigen::Vector3f& actual, double x, double y, double z) {
  EXPECT_LT((actual - Eigen::Vector3d(x, y, z).cast<float>()).norm(), 1e-4F) << actual.transpose();
}

TEST(CloudConversion, TransformsPointsToTheMap) {
  const auto c = toScan(makeCloud({{1, 2, 3}, {4, 5, 6}}), pose(10, 20, 30, M_PI_2), {});
  expectNear(c.scan.origin, 10, 20, 30);
  ASSERT_EQ(2u, c.scan.hits.size());
  expectNear(c.scan.hits[0], 8, 21, 33);
  expectNear(c.scan.hits[1], 5, 24, 36);
  EXPECT_TRUE(c.scan.reflectivity.empty());
  EXPECT_TRUE(c.scan.misses.empty());
}

TEST(CloudConversion, ReadsDoublesInAnyOrderAmongUnknownFields) {
  const auto c =
      toScan(makeCloud({{"ring", PointField::UINT16}, {"z", F64}, {"t", F64}, {"y", F32}, {"x", F64}},
                       {{7, 3, 0.5, 2, 1}, {8, 6, 0.6, 5, 4}}),
             Eigen::Isometry3d::Identity(), {});
  ASSERT_EQ(2u, c.scan.hits.size());
  expectNear(c.scan.hits[0], 1, 2, 3);
  expectNear(c.scan.hits[1], 4, 5, 6);
}

TEST(CloudConversion, ReadsReflectivityOfAnyNumericType) {
  for (std::uint8_t type = PointField::INT8; type <= PointField::FLOAT64; ++type) {
    const auto c =
        toScan(makeCloud({{"x", F32}, {"y", F32}, {"z", F32}, {"intensity", type}}, {{1, 2, 3, 100}}),
               Eigen::Isometry3d::Identity(), {});
    ASSERT_EQ(1u, c.scan.reflectivity.size()) << int(type);
    EXPECT_EQ(100.0F, c.scan.reflectivity[0]) << int(type);
  }
}

TEST(CloudConversion, PrefersReflectivityToIntensity) {
  const auto c =
      toScan(makeCloud({{"x", F32}, {"y", F32}, {"z", F32}, {"intensity", F32}, {"reflectivity", F32}},
                       {{1, 2, 3, 100, 0.5}}),
             Eigen::Isometry3d::Identity(), {});
  EXPECT_EQ(std::vector<float>{0.5F}, c.scan.reflectivity);
}

float asFloat(std::uint32_t bits) {
  float value;
  std::memcpy(&value, &bits, sizeof(value));
  return value;
}

TEST(CloudConversion, ReadsColoursWhereTheyAreWanted) {
  ScanLimits limits;
  limits.color = true;
  const std::vector<Color> expected = {{200, 10, 3}, {0, 255, 128}};
  const auto colorsOf = [](const sensor_msgs::PointCloud2& cloud, const ScanLimits& how) {
    return toScan(cloud, Eigen::Isometry3d::Identity(), how).scan.colors;
  };
  // float32 with the bits of a colour, which are no number that survives arithmetics
  auto packed = makeCloud({{"x", F32}, {"y", F32}, {"z", F32}, {"rgb", F32}}, {{1, 2, 3, 0}, {4, 5, 6, 0}});
  for (std::size_t i = 0; i < 2; ++i) {
    const float value = asFloat(packedColor(expected[i]));
    std::memcpy(&packed.data[i * packed.point_step + 12], &value, 4);
  }
  EXPECT_EQ(expected, colorsOf(packed, limits));
  EXPECT_TRUE(colorsOf(packed, {}).empty());
  packed.fields[3].name = "rgba";
  packed.fields[3].datatype = PointField::UINT32;
  EXPECT_EQ(expected, colorsOf(packed, limits));
  packed.fields[3].datatype = PointField::INT16;
  EXPECT_THROW(colorsOf(packed, limits), std::invalid_argument);
  packed.fields[3].name = "other";
  EXPECT_TRUE(colorsOf(packed, limits).empty());
  const std::uint8_t U8 = PointField::UINT8;
  EXPECT_EQ(expected,
            colorsOf(makeCloud({{"x", F32}, {"y", F32}, {"z", F32}, {"r", U8}, {"g", U8}, {"b", U8}},
                               {{1, 2, 3, 200, 10, 3}, {4, 5, 6, 0, 255, 128}}),
                     limits));
  // Returns that are left out are left out with their colours.
  limits.max_z = 4.0;
  packed.fields[3].name = "rgb";
  packed.fields[3].datatype = F32;
  EXPECT_EQ(std::vector<Color>{expected[0]}, colorsOf(packed, limits));
}

TEST(CloudConversion, ReadsOrganisedCloudsWithPaddedRows) {
  auto cloud = makeCloud({{1, 0, 0}, {2, 0, 0}, {3, 0, 0}, {4, 0, 0}});
  cloud.width = cloud.height = 2;
  cloud.row_step = 2 * cloud.point_step + 5;
  cloud.data.insert(cloud.data.begin() + 2 * cloud.point_step, 5, 0xff);
  const auto c = toScan(cloud, Eigen::Isometry3d::Identity(), {});
  ASSERT_EQ(4u, c.scan.hits.size());
  for (int i = 0; i < 4; ++i) expectNear(c.scan.hits[i], i + 1, 0, 0);
}

TEST(CloudConversion, KeepsNonFinitePointsForTheMapToCount) {
  const auto c = toScan(makeCloud({{kNan, 0, 0}, {1, kInf, 0}, {1, 2, kNan}, {1, 2, 3}}), pose(0, 0, 0, 1),
                        {-5, 5, true});
  EXPECT_EQ(4u, c.scan.hits.size());
  EXPECT_EQ(0u, c.outside_z);
  EXPECT_EQ(1u, c.at_infinity);
  EXPECT_TRUE(c.scan.misses.empty());  // it doesn't tell its direction
}

TEST(CloudConversion, LeavesOutWhatIsTooLowOrTooHighInTheMap) {
  const auto c = toScan(makeCloud({{"x", F32}, {"y", F32}, {"z", F32}, {"intensity", F32}},
                                  {{0, 0, -2, 1}, {0, 0, 0, 2}, {0, 0, 2, 3}}),
                        pose(0, 0, 10, 0), {9, 11, true});
  ASSERT_EQ(1u, c.scan.hits.size());
  expectNear(c.scan.hits[0], 0, 0, 10);
  EXPECT_EQ(std::vector<float>{2.0F}, c.scan.reflectivity);
  EXPECT_EQ(2u, c.outside_z);
}

TEST(CloudConversion, RejectsWhatIsMalformed) {
  const auto identity = Eigen::Isometry3d::Identity();
  const auto good = makeCloud({{1, 2, 3}, {4, 5, 6}});
  const auto rejected = [&](auto change, const std::string& text) {
    auto cloud = good;
    change(cloud);
    try {
      toScan(cloud, identity, {});
      ADD_FAILURE() << "accepted, expected: " << text;
    } catch (const std::invalid_argument& e) {
      EXPECT_NE(std::string::npos, std::string(e.what()).find(text)) << e.what();
    }
  };
  using Cloud = sensor_msgs::PointCloud2;
  rejected([](Cloud& c) { c.fields.erase(c.fields.begin()); }, "no field x");
  rejected([](Cloud& c) { c.fields.clear(); }, "no field x");
  rejected([](Cloud& c) { c.fields[1].datatype = PointField::INT32; }, "no field y");
  rejected([](Cloud& c) { c.fields[2].offset = 9; }, "field z ends beyond");
  rejected([](Cloud& c) { c.fields[2].offset = 0xffffffff; }, "field z ends beyond");
  rejected(
      [](Cloud& c) {
        c.fields.push_back(c.fields[0]), c.fields[3].name = "intensity", c.fields[3].datatype = 9;
      },
      "field intensity of unknown type 9");
  rejected([](Cloud& c) { c.data.pop_back(); }, "23 bytes");
  rejected([](Cloud& c) { c.width = 0xffffffff; }, "too few");
  rejected([](Cloud& c) { c.width = 1, c.height = 0xffffffff, c.row_step = 0xffffffff; }, "too few");
  rejected([](Cloud& c) { c.width = 1, c.height = 2, c.row_step = 0; }, "too few");
  rejected([](Cloud& c) { c.point_step = 0; }, "ends beyond");
  rejected([](Cloud& c) { c.is_bigendian = true; }, "big-endian");
}

sensor_msgs::LaserScan makeScan(const std::vector<float>& ranges) {
  sensor_msgs::LaserScan scan;
  scan.angle_min = 0.0F;
  scan.angle_increment = static_cast<float>(M_PI_2);
  scan.range_min = 0.5F;
  scan.range_max = 10.0F;
  scan.ranges = ranges;
  return scan;
}

TEST(ScanConversion, FollowsRep117) {
  auto message = makeScan({2, kInf, 10, kNan, -kInf, 0.1F, 9, 0.5F});
  message.intensities = {1, 2, 3, 4, 5, 6, 7, 8};
  const auto c = toScan(message, pose(1, 1, 1, 0), {});
  ASSERT_EQ(2u, c.scan.misses.size());
  expectNear(c.scan.misses[0], 1, 11, 1);
  expectNear(c.scan.misses[1], -9, 1, 1);
  // NaN and -inf stay in, non-finite, for the map to count.
  ASSERT_EQ(5u, c.scan.hits.size());
  expectNear(c.scan.hits[0], 3, 1, 1);
  EXPECT_FALSE(c.scan.hits[1].allFinite());
  EXPECT_FALSE(c.scan.hits[2].allFinite());
  expectNear(c.scan.hits[3], -8, 1, 1);
  expectNear(c.scan.hits[4], 1, 0.5, 1);
  EXPECT_EQ((std::vector<float>{1, 4, 5, 7, 8}), c.scan.reflectivity);
  EXPECT_EQ(1u, c.below_minimum);
  // 0 is an error or no return: it doesn't say which, and clears nothing.
  const auto zero = toScan(makeScan({0, 2}), pose(0, 0, 0, 0), {});
  EXPECT_EQ(1u, zero.below_minimum);
  EXPECT_TRUE(zero.scan.misses.empty());
}

// As drivers send them that don't know REP 117.
TEST(ScanConversion, BeamsWithoutAReturnAreFoundByTheirEqualRanges) {
  auto message = makeScan({2, 3, 4, 9.9F, 9.9F, 9.9F, 9.9F, 9.9F, 9.9F, 9.9F, 9.9F});
  message.angle_increment = 0.1F;
  const auto c = toScan(message, pose(0, 0, 0, 0), {});
  EXPECT_EQ(3u, c.scan.hits.size());
  ASSERT_EQ(8u, c.scan.misses.size());
  EXPECT_NEAR(9.9, c.scan.misses[0].norm(), 1e-5);
}

TEST(ScanConversion, ScansThatDontFitTogetherAreUsedAsFarAsTheyGo) {
  auto message = makeScan({1, 2, 3});
  message.intensities = {1};
  EXPECT_TRUE(toScan(message, pose(0, 0, 0, 0), {}).scan.reflectivity.empty());
  message.range_max = 0;
  EXPECT_EQ(3u, toScan(message, pose(0, 0, 0, 0), {}).scan.hits.size());
  message.time_increment = 100.0F;
  EXPECT_EQ(0.0, sweepTimesOf(message).last);
}

TEST(ScanConversion, NoReturnClearsOnlyIfAskedToAndKnownHowFar) {
  ScanLimits limits;
  limits.no_return_clears = false;
  EXPECT_TRUE(toScan(makeScan({kInf}), Eigen::Isometry3d::Identity(), limits).scan.misses.empty());
  auto unlimited = makeScan({kInf});
  unlimited.range_max = kInf;
  EXPECT_TRUE(toScan(unlimited, Eigen::Isometry3d::Identity(), {}).scan.misses.empty());
}

TEST(ScanConversion, RejectsWhatIsMalformed) {
  const auto rejected = [](auto change, const std::string& text) {
    auto scan = makeScan({1, 2, 3});
    change(scan);
    try {
      toScan(scan, Eigen::Isometry3d::Identity(), {});
      ADD_FAILURE() << "accepted, expected: " << text;
    } catch (const std::invalid_argument& e) {
      EXPECT_NE(std::string::npos, std::string(e.what()).find(text)) << e.what();
    }
  };
  using LaserScan = sensor_msgs::LaserScan;
  rejected([](LaserScan& s) { s.angle_min = kNan; }, "angles");
  rejected([](LaserScan& s) { s.angle_increment = kInf; }, "angles");
  rejected([](LaserScan& s) { s.ranges = {1000, 2000, 3000}; }, "millimetres");
  rejected([](LaserScan& s) { s.range_min = 20; }, "range_min");
}

}  // namespace
}  // namespace rtree_occupancy_map
