// SPDX-License-Identifier: BSD-3-Clause
#include <gtest/gtest.h>

#include <limits>

#include "flat_world.h"
#include "intensity_hector_slam/ros/map_conversion.h"
#include "intensity_hector_slam/ros/scan_conversion.h"

namespace intensity_hector_slam {
namespace {

sensor_msgs::LaserScan message(const std::vector<float>& ranges) {
  sensor_msgs::LaserScan scan;
  scan.header.stamp = ros::Time(100.5);
  scan.angle_min = -0.5F;
  scan.angle_increment = 0.25F;
  scan.range_min = 0.1F;
  scan.range_max = 20.0F;
  scan.time_increment = 0.001F;
  scan.ranges = ranges;
  return scan;
}

TEST(ToScan, LeavesOutWhatWasNotMeasured) {
  constexpr float kInfinity = std::numeric_limits<float>::infinity();
  auto scan = message({5.0F, kInfinity, -kInfinity, std::nanf(""), 0.3F, 25.0F, 2.0F});
  scan.intensities = {100, 200, 300, 400, 500, 600, 700};
  ScanLimits limits;
  limits.reflectivity_scale = 0.001;
  const Scan converted = toScan(scan, Eigen::Isometry3d::Identity(), limits);
  ASSERT_EQ(2u, converted.points.size());
  EXPECT_EQ(100.5, converted.stamp);
  EXPECT_NEAR(5.0 * std::cos(-0.5), converted.points[0].x(), 1e-5);
  EXPECT_NEAR(2.0 * std::sin(1.0), converted.points[1].y(), 1e-5);
  EXPECT_FLOAT_EQ(0.1F, converted.reflectivities[0]);
  EXPECT_FLOAT_EQ(0.7F, converted.reflectivities[1]);
  EXPECT_FLOAT_EQ(0.006F, converted.times[1]);
}

TEST(ToScan, LeavesOutRawIntensities) {
  auto scan = message({1.0F, 2.0F, 3.0F});
  scan.intensities = {0.5F, 1000.0F, 0.7F};  // one of a reflector
  const auto convert = [&](const ScanLimits& limits, bool raw) {
    auto reading = mapping_common::LaserScans().read(scan);
    const Scan converted = toScan(scan, reading, Eigen::Isometry3d::Identity(), limits);
    EXPECT_EQ(raw, reading.warnings.count("raw intensities"));
    return converted;
  };
  EXPECT_EQ(3u, convert({}, false).reflectivities.size());
  scan.intensities = {800.0F, 1000.0F, std::nanf("")};
  const Scan converted = convert({}, true);
  EXPECT_EQ(3u, converted.points.size());
  EXPECT_TRUE(converted.reflectivities.empty());
  ScanLimits limits;
  limits.reflectivity_scale = 0.001;
  EXPECT_EQ(3u, convert(limits, false).reflectivities.size());
}

TEST(ToScan, IsInTheFrameOfTheBody) {
  Eigen::Isometry3d mount(Eigen::AngleAxisd(M_PI / 2.0, Eigen::Vector3d::UnitZ()));
  mount.translation() << 1.0, 2.0, 0.3;
  const Scan converted = toScan(message({0, 0, 3.0F}), mount, {});
  EXPECT_LT((converted.points[0] - Eigen::Vector2f(1.0F, 5.0F)).norm(), 1e-5F);
  EXPECT_EQ(Eigen::Vector2f(1.0F, 2.0F), converted.origin);
  EXPECT_TRUE(converted.reflectivities.empty());
}

TEST(ToScan, CutsTheFloorThatATiltedScannerSees) {
  const Eigen::Isometry3d mount(Eigen::AngleAxisd(0.2, Eigen::Vector3d::UnitY()));
  EXPECT_EQ(1u, toScan(message({0, 0, 4.0F}), mount, {}).points.size());
  EXPECT_EQ(0u, toScan(message({0, 0, 6.0F}), mount, {}).points.size());
}

TEST(ToScan, UsesRangesWithoutIntensitiesThatDontFit) {
  auto scan = message({1, 2, 3});
  scan.intensities = {1};
  const Scan converted = toScan(scan, Eigen::Isometry3d::Identity(), {});
  EXPECT_EQ(3u, converted.points.size());
  EXPECT_TRUE(converted.reflectivities.empty());
}

TEST(ToScan, HasFreeSpaceOfBeamsWithoutAReturnOnDemand) {
  constexpr float kInfinity = std::numeric_limits<float>::infinity();
  const auto scan = message({kInfinity, 0.0F, 20.0F, std::nanf(""), -kInfinity, 0.3F, 15.0F, 2.0F});
  EXPECT_TRUE(toScan(scan, Eigen::Isometry3d::Identity(), {}).free.empty());
  ScanLimits limits;
  limits.max_range = 10.0;
  limits.no_return_free_range = 8.0;
  const Scan converted = toScan(scan, Eigen::Isometry3d::Identity(), limits);
  EXPECT_EQ(1u, converted.points.size());
  ASSERT_EQ(4u, converted.free.size());  // inf, 0, range_max, and beyond laser_max_dist
  ASSERT_EQ(4u, converted.free_times.size());
  EXPECT_NEAR(8.0 * std::cos(-0.5), converted.free[0].x(), 1e-5);
  EXPECT_NEAR(8.0 * std::sin(1.0), converted.free[3].y(), 1e-5);
  EXPECT_FLOAT_EQ(0.006F, converted.free_times[3]);
}

TEST(ToPointCloud, HasTheEndsInTheFrameOfTheScanner) {
  auto scan = message({5.0F, std::nanf(""), 0.3F, 25.0F, 2.0F});
  scan.header.frame_id = "laser";
  scan.intensities = {100, 200, 300, 400, 500};
  const auto read = [](const auto& message) { return mapping_common::LaserScans().read(message); };
  const sensor_msgs::PointCloud cloud = toPointCloud(scan, read(scan), {});
  EXPECT_EQ("laser", cloud.header.frame_id);
  EXPECT_EQ(ros::Time(100.5), cloud.header.stamp);
  ASSERT_EQ(2u, cloud.points.size());
  EXPECT_NEAR(5.0 * std::sin(-0.5), cloud.points[0].y, 1e-5);
  EXPECT_NEAR(2.0 * std::cos(0.5), cloud.points[1].x, 1e-5);
  ASSERT_EQ(2u, cloud.channels.size());
  EXPECT_EQ(std::vector<float>({0, 4}), cloud.channels[0].values);
  EXPECT_EQ(std::vector<float>({100, 500}), cloud.channels[1].values);
  EXPECT_EQ(1u, toPointCloud(message({5.0F}), read(message({5.0F})), {}).channels.size());
}

TEST(ToScan, RefusesMalformedMessages) {
  const auto expectRefused = [](const std::function<void(sensor_msgs::LaserScan&)>& damage) {
    auto scan = message({1, 2, 3});
    damage(scan);
    EXPECT_THROW(toScan(scan, Eigen::Isometry3d::Identity(), {}), std::invalid_argument);
  };
  expectRefused([](auto& scan) { scan.angle_min = std::nanf(""); });
  expectRefused([](auto& scan) { scan.angle_increment = std::numeric_limits<float>::infinity(); });
  expectRefused([](auto& scan) { scan.time_increment = std::nanf(""); });
  expectRefused([](auto& scan) { scan.angle_increment = 0.0F; });
  expectRefused([](auto& scan) { scan.ranges = {1000, 2000, 3000}; });  // mm
  expectRefused([](auto& scan) { scan.range_min = std::nanf(""); });
}

TEST(MapConversion, ShowsWhatCellsAre) {
  GridMap map(0.5, {Eigen::Vector2i(-2, 4), Eigen::Vector2i(1, 6)});
  map.set(-1, 4, {0.9F, 0.4F}, 3);
  map.set(0, 5, {0.1F, 0.0F}, 0);
  map.set(1, 6, {0.8F, 1.7F}, 1);
  const auto occupancy = toOccupancyGrid(map), reflectivity = toReflectivityGrid(map);
  EXPECT_EQ(4u, occupancy.info.width);
  EXPECT_EQ(3u, occupancy.info.height);
  EXPECT_EQ(-1.0, occupancy.info.origin.position.x);
  EXPECT_EQ(2.0, occupancy.info.origin.position.y);
  EXPECT_EQ(100, occupancy.data[1]);
  EXPECT_EQ(0, occupancy.data[6]);
  EXPECT_EQ(-1, occupancy.data[0]);
  EXPECT_EQ(40, reflectivity.data[1]);
  EXPECT_EQ(-1, reflectivity.data[6]);
  EXPECT_EQ(100, reflectivity.data[11]);
}

TEST(MapConversion, PosesGoThereAndBack) {
  const Pose pose(1.0, -2.0, 3.0);
  EXPECT_LT((toPose(toMessage(pose)) - pose).norm(), 1e-12);
  EXPECT_LT((toPose(toIsometry(pose)) - pose).norm(), 1e-12);
  geometry_msgs::Pose no_orientation;
  EXPECT_THROW(toPose(no_orientation), std::invalid_argument);
  geometry_msgs::Pose nan = toMessage(pose);
  nan.position.x = std::nan("");
  EXPECT_THROW(toPose(nan), std::invalid_argument);
}

TEST(MapConversion, EdgesKeepTheirInformation) {
  Edge edge;
  edge.from = {3, 10.0, {1, 2, 3}};
  edge.to = {4, 12.5, {2, 2, 3}};
  edge.transform = {1.0, 0.5, M_PI / 2};
  edge.information << 1, 2, 3, 2, 5, 6, 3, 6, 9;  // in the axes of the first pose; the second's x is its y
  const auto message = toMessage(edge, "map", "base_link");
  EXPECT_EQ(ros::Time(10.0), message.from_stamp);
  EXPECT_EQ(ros::Time(12.5), message.header.stamp);
  EXPECT_EQ(3u, message.from_id);
  EXPECT_EQ(4u, message.to_id);
  EXPECT_TRUE(message.has_transform);
  EXPECT_EQ(mapping_msgs::EdgeConstraint::CONSECUTIVE, message.type);
  EXPECT_NEAR(5.0, message.information[0], 1e-12);
  EXPECT_NEAR(1.0, message.information[7], 1e-12);
  EXPECT_NEAR(-2.0, message.information[1], 1e-12);
  EXPECT_NEAR(6.0, message.information[5], 1e-12);
  EXPECT_NEAR(-3.0, message.information[11], 1e-12);
  EXPECT_NEAR(9.0, message.information[35], 1e-12);
  EXPECT_EQ(0.0, message.information[14]);
  EXPECT_EQ("base_link", message.frame_id);
}

}  // namespace
}  // namespace intensity_hector_slam
