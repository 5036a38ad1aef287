// SPDX-License-Identifier: BSD-3-Clause
#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <stdexcept>
#include <string>
#include <vector>

#include "mapping_common/laser_scans.h"

namespace mapping_common {
namespace {

constexpr float kInfinity = std::numeric_limits<float>::infinity();

// 270 degrees in a corridor 4 m wide, whose ends the scanner doesn't reach.
sensor_msgs::LaserScan corridor(float reach, float none, int beams = 541) {
  sensor_msgs::LaserScan scan;
  scan.header.stamp = ros::Time(100.0);
  scan.angle_min = static_cast<float>(-0.75 * M_PI);
  scan.angle_increment = static_cast<float>(1.5 * M_PI / (beams - 1));
  scan.range_min = 0.05F;
  scan.range_max = 30.0F;
  for (int i = 0; i < beams; ++i) {
    const auto range =
        static_cast<float>(2.0 / std::abs(std::sin(scan.angle_min + i * scan.angle_increment)));
    scan.ranges.push_back(range > reach ? none : range);
  }
  return scan;
}

std::size_t returns(const LaserReading& reading, const sensor_msgs::LaserScan& scan) {
  std::size_t count = 0;
  for (const float range : scan.ranges) count += reading.isReturn(range);
  return count;
}

std::string errorOf(const sensor_msgs::LaserScan& scan) {
  try {
    LaserScans().read(scan);
  } catch (const std::invalid_argument& e) {
    return e.what();
  }
  return "";
}

TEST(LaserScans, KnowBeamsWithoutAReturnInEachForm) {
  const auto expected = corridor(4.0F, kInfinity);
  const std::size_t count = returns(LaserScans().read(expected), expected);
  ASSERT_GT(count, 300u);
  ASSERT_LT(count, 500u);
  for (const float none : {30.0F, 31.0F, 65.533F, 0.0F, -kInfinity, std::nanf("")}) {
    auto scan = corridor(4.0F, none);
    scan.range_min = 0.0F;
    const LaserReading reading = LaserScans().read(scan);
    EXPECT_EQ(count, returns(reading, scan)) << none;
    EXPECT_TRUE(reading.warnings.empty()) << none;
    EXPECT_EQ(none >= 0.0F, reading.isNoReturn(none)) << none;
  }
}

TEST(LaserScans, SayThatEqualGreatestRangesAreNone) {
  LaserScans scans;
  auto scan = corridor(4.0F, 29.99F);
  LaserReading reading = scans.read(scan);
  EXPECT_FALSE(reading.isReturn(29.99F));
  EXPECT_TRUE(reading.isNoReturn(29.99F));
  EXPECT_TRUE(reading.isReturn(3.99F));
  ASSERT_EQ(1u, reading.warnings.count("ranges"));
  EXPECT_NE(std::string::npos, reading.warnings["ranges"].find("29.99 m")) << reading.warnings["ranges"];
  // It stays known where only few come, ...
  auto few = corridor(100.0F, kInfinity);
  for (float& range : few.ranges) range = std::min(range, 20.0F);
  few.ranges[3] = few.ranges[4] = 29.99F;
  for (float& range : few.ranges) range = range == 20.0F ? kInfinity : range;
  EXPECT_FALSE(scans.read(few).isReturn(29.99F));
  // ... until something returns from farther away.
  few.ranges[5] = 29.995F;
  EXPECT_TRUE(scans.read(few).isReturn(29.99F));
}

TEST(LaserScans, TakeSurfacesForReturns) {
  // A wall across, in centimetres: many ranges are equal, and as many a little less.
  auto scan = corridor(4.0F, kInfinity);
  for (std::size_t i = 250; i < 290; ++i) scan.ranges[i] = 10.0F + 0.01F * static_cast<float>(i % 3);
  EXPECT_TRUE(LaserScans().read(scan).warnings.empty());
  // Two corners at the same distance.
  auto corners = corridor(4.0F, kInfinity);
  for (std::size_t i : {200, 201, 300, 301}) corners.ranges[i] = 15.0F;
  EXPECT_TRUE(LaserScans().read(corners).warnings.empty());
}

TEST(LaserScans, UseARangeMaxOf0) {
  for (const float none : {0.0F, -1.0F, std::nanf("")}) {
    auto scan = corridor(20.0F, kInfinity);
    const std::size_t count = returns(LaserScans().read(scan), scan);
    scan.range_max = none;
    const LaserReading reading = LaserScans().read(scan);
    EXPECT_EQ(count, returns(reading, scan));
    EXPECT_EQ(1u, reading.warnings.count("range_max"));
  }
}

TEST(LaserScans, RefuseMillimetres) {
  auto scan = corridor(20.0F, kInfinity);
  for (float& range : scan.ranges) range *= 1000.0F;
  EXPECT_NE(std::string::npos, errorOf(scan).find("millimetres")) << errorOf(scan);
  scan.range_max = 0.0F;
  EXPECT_NE(std::string::npos, errorOf(scan).find("millimetres")) << errorOf(scan);
  scan.range_max = 30.0F;
  scan.ranges.assign(541, 65533.0F);  // a scanner that sees nothing
  EXPECT_EQ("", errorOf(scan));
  EXPECT_EQ(0u, returns(LaserScans().read(scan), scan));
}

TEST(LaserScans, RefuseAnglesThatAreNone) {
  auto scan = corridor(4.0F, kInfinity);
  scan.angle_increment = 0.0F;
  EXPECT_NE(std::string::npos, errorOf(scan).find("angle_increment is 0")) << errorOf(scan);
  scan.ranges.resize(1);
  EXPECT_EQ("", errorOf(scan));
  scan = corridor(4.0F, kInfinity);
  scan.angle_increment = 0.5F;
  EXPECT_NE(std::string::npos, errorOf(scan).find("degrees")) << errorOf(scan);
  scan.angle_increment = kInfinity;
  EXPECT_NE("", errorOf(scan));
}

TEST(LaserScans, IgnoreASweepLongerThanTheTimeBetweenScans) {
  LaserScans scans;
  auto scan = corridor(20.0F, kInfinity, 720);
  const auto readAt = [&](double stamp, float time_increment, float scan_time = 0.0F) {
    scan.header.stamp = ros::Time(stamp);
    scan.time_increment = time_increment;
    scan.scan_time = scan_time;
    return scans.read(scan);
  };
  const LaserReading first = readAt(100.0, 0.1F);
  EXPECT_EQ(0.0, first.time_increment);
  EXPECT_EQ(1u, first.warnings.count("time_increment"));
  EXPECT_EQ(0.0, readAt(100.1, 0.0003F).time_increment);
  EXPECT_FLOAT_EQ(0.1F / 720, readAt(100.2, 0.1F / 720).time_increment);
  EXPECT_FLOAT_EQ(-0.1F / 720, readAt(100.29, -0.1F / 720).time_increment);  // its stamp came early
  EXPECT_EQ(0.0, readAt(100.4, 0.1F).time_increment);
  EXPECT_FLOAT_EQ(0.1F / 720, readAt(100.4, 0.1F / 720).time_increment);  // the same stamp again

  scans = {};
  EXPECT_EQ(0.0, readAt(100.0, 0.1F / 720, 0.05F).time_increment);
  scans = {};
  EXPECT_FLOAT_EQ(0.1F / 720, readAt(100.0, 0.1F / 720, 0.1F).time_increment);
}

TEST(LaserScans, UseRangesWithoutIntensitiesThatDontFit) {
  auto scan = corridor(20.0F, kInfinity);
  scan.intensities.assign(534, 0.5F);
  const LaserReading reading = LaserScans().read(scan);
  EXPECT_FALSE(reading.has_intensities);
  EXPECT_EQ(1u, reading.warnings.count("intensities"));
  scan.intensities.assign(541, 0.5F);
  EXPECT_TRUE(LaserScans().read(scan).has_intensities);
  EXPECT_TRUE(LaserScans().read(scan).warnings.empty());
}

TEST(LaserScans, RefuseRangesThatAreNoInterval) {
  auto scan = corridor(4.0F, kInfinity);
  scan.range_min = 40.0F;
  EXPECT_NE("", errorOf(scan));
  scan.range_min = std::nanf("");
  EXPECT_NE("", errorOf(scan));
}

}  // namespace
}  // namespace mapping_common
