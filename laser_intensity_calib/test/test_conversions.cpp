// SPDX-License-Identifier: BSD-3-Clause
//
// Messages to arrays and back, parameters, and the files that ship.
#include <gtest/gtest.h>
#include <mapping_common/testing/temp_dir.h>

#include <filesystem>

#include "laser_intensity_calib/calibration_file.h"
#include "laser_intensity_calib/ros/conversions.h"
#include "laser_intensity_calib/ros/parameters.h"
#include "scans_of_a_wall.h"

namespace laser_intensity_calib {
namespace {

constexpr float kNan = std::numeric_limits<float>::quiet_NaN();
constexpr float kInf = std::numeric_limits<float>::infinity();

template <class Call>
std::string invalidArgument(const Call& call) {
  try {
    call();
  } catch (const std::invalid_argument& e) {
    return e.what();
  }
  return "";
}

TEST(ReadScan, LeavesOutWhatIsNoReturn) {
  sensor_msgs::LaserScan scan;
  scan.angle_increment = 0.01F;
  scan.range_min = 0.1F;
  scan.range_max = 10.0F;
  scan.ranges = {1.0F, kInf, -kInf, kNan, 0.05F, 10.0F, 9.0F};
  scan.intensities = {1, 2, 3, 4, 5, 6, 7};
  const ScanArrays arrays = readScan(scan);
  EXPECT_EQ(5, arrays.ranges.isNaN().count());
  EXPECT_FLOAT_EQ(1.0F, arrays.ranges[0]);
  EXPECT_FLOAT_EQ(9.0F, arrays.ranges[6]);
  EXPECT_FLOAT_EQ(7.0F, arrays.intensities[6]);
}

TEST(ReadScan, RejectsWhatIsMalformed) {
  sensor_msgs::LaserScan scan;
  scan.angle_increment = 0.01F;
  scan.ranges = {1.0F, 2.0F};
  EXPECT_EQ(0u, invalidArgument([&] { readScan(scan); }).find("no intensities"));
  scan.intensities = {1.0F};
  EXPECT_EQ("1 intensities for 2 ranges", invalidArgument([&] { readScan(scan); }));
  scan.intensities = {1.0F, 2.0F};
  scan.angle_increment = 0.0F;
  EXPECT_NE("", invalidArgument([&] { readScan(scan); }));
  scan.angle_increment = kNan;
  EXPECT_NE("", invalidArgument([&] { readScan(scan); }));
}

TEST(ReadCloud, TakesIntensitiesOfAnyTypeAndViewpoints) {
  const CloudArrays plain = readCloud(makeCloud({{1, 2, 3}, {4, 5, 6}}, {7, 8}));
  EXPECT_EQ(Eigen::Vector3f(4, 5, 6), plain.points.col(1));
  EXPECT_FLOAT_EQ(8.0F, plain.intensities[1]);
  ASSERT_EQ(1, plain.viewpoints.cols());
  EXPECT_TRUE(plain.viewpoints.isZero());
  const CloudArrays moved = readCloud(makeCloud({{1, 2, 3}, {4, 5, 6}}, {7, 8}, {{0, 0, 1}, {0, 0, 2}}));
  ASSERT_EQ(2, moved.viewpoints.cols());
  EXPECT_EQ(Eigen::Vector3f(0, 0, 2), moved.viewpoints.col(1));
}

TEST(ReadCloud, LasersAreTheRings) {
  const sensor_msgs::PointCloud2 cloud = makeCloud({{1, 2, 3}, {4, 5, 6}}, {7, 8});
  EXPECT_EQ(0, readCloud(cloud).lasers.size());
  const CloudArrays arrays = readCloud(withRings(cloud, {63, 2}));
  ASSERT_EQ(2, arrays.lasers.size());
  EXPECT_EQ(63, arrays.lasers[0]);
  EXPECT_EQ(2, arrays.lasers[1]);
  EXPECT_FLOAT_EQ(8.0F, arrays.intensities[1]);
}

TEST(ReadCloud, RejectsWhatIsMalformed) {
  const sensor_msgs::PointCloud2 good = makeCloud({{1, 2, 3}, {4, 5, 6}}, {7, 8});
  auto bad = good;
  bad.fields.pop_back();
  EXPECT_EQ("no field intensity", invalidArgument([&] { readCloud(bad); }));
  bad = good;
  bad.data.resize(10);
  EXPECT_NE("", invalidArgument([&] { readCloud(bad); }));
  bad = good;
  bad.fields[0].offset = 1000;
  EXPECT_NE("", invalidArgument([&] { readCloud(bad); }));
  bad = good;
  bad.fields[3].datatype = 77;
  EXPECT_NE("", invalidArgument([&] { readCloud(bad); }));
  bad = good;
  bad.is_bigendian = true;
  EXPECT_NE("", invalidArgument([&] { readCloud(bad); }));
}

TEST(WithReflectivity, AddsAFieldAndKeepsTheRest) {
  sensor_msgs::PointCloud2 cloud = makeCloud({{1, 2, 3}, {4, 5, 6}}, {7, 8});
  Eigen::ArrayXf reflectivity(2);
  reflectivity << 0.25F, kNan;
  const sensor_msgs::PointCloud2 once = withReflectivity(cloud, reflectivity);
  EXPECT_EQ(Eigen::Vector3f(4, 5, 6), readCloud(once).points.col(1));
  EXPECT_FLOAT_EQ(8.0F, readCloud(once).intensities[1]);
  sensor_msgs::PointCloud2ConstIterator<float> value(once, "reflectivity");
  EXPECT_FLOAT_EQ(0.25F, *value);
  ++value;
  EXPECT_TRUE(std::isnan(*value));
  const sensor_msgs::PointCloud2 twice = withReflectivity(once, 2.0F * reflectivity);
  EXPECT_FLOAT_EQ(0.5F, *sensor_msgs::PointCloud2ConstIterator<float>(twice, "reflectivity"));
  EXPECT_FLOAT_EQ(0.25F, *sensor_msgs::PointCloud2ConstIterator<float>(twice, "reflectivity_device"));
  EXPECT_THROW(withReflectivity(cloud, Eigen::ArrayXf::Zero(3)), std::invalid_argument);
}

TEST(Calibrations, ThoseThatShipCanBeRead) {
  int count = 0;
  for (const auto& entry : std::filesystem::directory_iterator(PACKAGE_DIR "/config")) {
    const std::string name = entry.path().filename().string();
    if (name.rfind("reflectivity_", 0) != 0 || entry.path().extension() != ".yaml") continue;
    const Calibration c = loadCalibration(entry.path().string());
    for (const ModelType type : kModelTypes) EXPECT_TRUE(c.has(type)) << name;
    EXPECT_LT(c.residuals[2].rms, c.residuals[1].rms) << name;
    ++count;
  }
  EXPECT_GE(count, 2);
}

TEST(LoadFor, SaysWhatIsMissing) {
  EXPECT_NO_THROW(loadFor(ModelType::kRaw, ""));
  EXPECT_EQ(0u, invalidArgument([] { loadFor(ModelType::kLut, ""); }).find("~calibration_file is empty"));
  EXPECT_EQ(
      0u, invalidArgument([] { loadFor(ModelType::kRaw, "/nowhere"); }).find("~calibration_file: /nowhere"));
  const mapping_common::TempDir dir;
  saveCalibration(Calibration(), dir.path("raw.yaml"));
  EXPECT_EQ(0u,
            invalidArgument([&] { loadFor(ModelType::kLut, dir.path("raw.yaml")); }).find("~model is lut"));
}

}  // namespace
}  // namespace laser_intensity_calib
