// SPDX-License-Identifier: BSD-3-Clause
#include <gtest/gtest.h>
#include <mapping_common/testing/recordings.h>
#include <mapping_common/testing/temp_dir.h>
#include <rosbag_tests/converters/carmen_log.h>

#include <boost/iostreams/filter/gzip.hpp>
#include <boost/iostreams/filtering_stream.hpp>
#include <cmath>
#include <fstream>

namespace rosbag_tests {

using mapping_simulation::PlanarScan;

namespace {

using mapping_common::errorOf;
using mapping_common::mentions;
using mapping_common::TempDir;
using Kind = CarmenRecord::Kind;

const char kOdometry[] = "ODOM 1 2 0.5 0.3 -0.1 0 100.5 host 0.5\n";
// Laser 0.2 m in front of a robot that looks along y.
const char kFront[] = "FLASER 3 1.5 81.83 0 4 5.2 1.570796326794897 4 5 1.570796326794897 101.25 host 1.25\n";
const char kRemissions[] =
    "ROBOTLASER1 0 -0.7 1.4 0.7 25.0 0.01 2 3 1 26 2 3 0.5 0.6 0.7 1 2 0 1 2 0 0.25 0.125 0.1 0.1 1e6 "
    "102.5 host 2.5\n";

std::string gzip(const std::string& bytes) {
  std::string packed;
  boost::iostreams::filtering_ostream stream;
  stream.push(boost::iostreams::gzip_compressor());
  stream.push(boost::iostreams::back_inserter(packed));
  stream << bytes;
  stream.reset();
  return packed;
}

CarmenLog readText(const std::string& text, const CarmenOptions& options = CarmenOptions()) {
  TempDir dir;
  return readCarmenLog(dir.write("a.clf", text), options);
}

TEST(CarmenLog, OdometryLine) {
  const CarmenLog log = readText(std::string(kOdometry) + kFront);
  ASSERT_EQ(2u, log.records.size());
  const CarmenRecord& record = log.records[0];
  EXPECT_EQ(Kind::kOdometry, record.kind);
  EXPECT_DOUBLE_EQ(100.5, record.ipc_stamp);
  EXPECT_DOUBLE_EQ(0.5, record.logger_stamp);
  EXPECT_TRUE(record.robot.translation().isApprox(Eigen::Vector3d(1, 2, 0)));
  EXPECT_NEAR(0.5, Eigen::AngleAxisd(record.robot.linear()).angle(), 1e-12);
  EXPECT_DOUBLE_EQ(0.3, record.linear_velocity);
  EXPECT_DOUBLE_EQ(-0.1, record.angular_velocity);
}

TEST(CarmenLog, FrontLaser) {
  const CarmenLog log = readText(kFront);
  const CarmenRecord& record = log.records.at(0);
  EXPECT_EQ(Kind::kFrontScan, record.kind);
  ASSERT_EQ(3u, record.scan.ranges.size());
  EXPECT_FLOAT_EQ(1.5f, record.scan.ranges[0]);
  EXPECT_EQ(INFINITY, record.scan.ranges[1]) << "81.83 m is no return";
  EXPECT_TRUE(std::isnan(record.scan.ranges[2]));
  EXPECT_TRUE(record.scan.intensities.empty());
  EXPECT_DOUBLE_EQ(101.25, record.scan.stamp);
  EXPECT_TRUE(log.mount(Kind::kFrontScan).translation().isApprox(Eigen::Vector3d(0.2, 0, 0), 1e-9));
}

TEST(CarmenLog, FieldOfViewAsCarmenTakesIt) {
  const struct {
    int readings;
    double min, max;
  } cases[] = {{180, -90, 89}, {181, -90, 90}, {360, -90, 89.5}, {361, -90, 90}, {541, -135, 135}};
  for (const auto& c : cases) {
    std::string line = "FLASER " + std::to_string(c.readings);
    for (int i = 0; i < c.readings; ++i) line += " 1";
    const CarmenLog log = readText(line + " 0 0 0 0 0 0 1 h 1");
    const PlanarScan& scan = log.records.at(0).scan;
    EXPECT_NEAR(c.min, scan.angle_min * 180 / M_PI, 1e-9) << c.readings;
    EXPECT_NEAR(c.max, scan.angle_max * 180 / M_PI, 1e-9) << c.readings;
  }
}

TEST(CarmenLog, FieldOfViewAsTold) {
  CarmenOptions options;
  options.angle_min = -1.0;
  options.angle_increment = 0.5;
  options.range_max = 1.2;
  for (const char* line : {kFront, kRemissions}) {
    const CarmenLog log = readText(line, options);
    const PlanarScan& scan = log.records.at(0).scan;
    EXPECT_DOUBLE_EQ(-1.0, scan.angle_min);
    EXPECT_DOUBLE_EQ(0.0, scan.angle_max);
    EXPECT_DOUBLE_EQ(1.2, scan.range_max);
  }
}

TEST(CarmenLog, RobotLaserWithConfigurationAndRemissions) {
  const CarmenLog log = readText(kRemissions);
  const CarmenRecord& record = log.records.at(0);
  EXPECT_DOUBLE_EQ(-0.7, record.scan.angle_min);
  EXPECT_DOUBLE_EQ(0.7, record.scan.angle_max);
  EXPECT_DOUBLE_EQ(25.0, record.scan.range_max);
  EXPECT_EQ((std::vector<float>{1, INFINITY, 2}), record.scan.ranges);
  EXPECT_EQ((std::vector<float>{0.5, 0.6, 0.7}), record.scan.intensities);
  EXPECT_DOUBLE_EQ(0.25, record.linear_velocity);
  EXPECT_DOUBLE_EQ(0.125, record.angular_velocity);
  EXPECT_DOUBLE_EQ(102.5, record.ipc_stamp);
}

TEST(CarmenLog, OldRobotLaserIsLikeFlaser) {
  const CarmenLog log = readText("ROBOTLASER1" + std::string(kFront).substr(6));
  EXPECT_EQ(3u, log.records.at(0).scan.ranges.size());
  EXPECT_NEAR(5.0, log.records[0].robot.translation().y(), 1e-12);
}

TEST(CarmenLog, RearLaserAndParameters) {
  const CarmenLog log = readText(
      "PARAM robot_frontlaser_offset 0.1 host 1\nPARAM robot_rearlaser_offset -0.3 host 1\n"
      "RLASER 1 2 -0.3 0 3.141592653589793 0 0 0 1 h 1\n"
      "FLASER 1 2 9 9 0 0 0 0 2 h 2\nFLASER 1 2 8 9 0 0 0 0 3 h 3\n");
  EXPECT_EQ(Kind::kRearScan, log.records.at(0).kind);
  const Eigen::Isometry3d rear = log.mount(Kind::kRearScan), front = log.mount(Kind::kFrontScan);
  EXPECT_TRUE(rear.translation().isApprox(Eigen::Vector3d(-0.3, 0, 0), 1e-9));
  EXPECT_NEAR(-1.0, rear.linear()(0, 0), 1e-9);
  EXPECT_TRUE(front.translation().isApprox(Eigen::Vector3d(0.1, 0, 0)))
      << "poses that move apart are no mount: the parameter counts";
}

TEST(CarmenLog, MalformedLinesAreNamedAndLeftOut) {
  const CarmenLog log = readText(
      "# a comment\n\nODOM 1 2\nFLASER 3 1 2\nFLASER -1 2\nFLASER 1e9 2\nFLASER 1 x 0 0 0 0 0 0 1 h 1\n"
      "ODOM 1 2 0 0 0 nan 1 h 1\nFLASER 0 0 0 0 0 0 0 1 h 1\nFLASER 1 2 0 0 0 0 0 0 1 h 1 7\nROBOTLASER1 "
      "0\n" +
      std::string(kRemissions).replace(45, 1, "2") + "NEFF 30\nSYNC x\n" + kFront);
  EXPECT_EQ(1u, log.records.size());
  ASSERT_EQ(10u, log.malformed.size());
  EXPECT_TRUE(mentions(log.malformed[0], {"a.clf:3", "ODOM", "ends too early"}));
  EXPECT_TRUE(mentions(log.malformed[1], {"a.clf:4", "3 readings"}));
  EXPECT_TRUE(mentions(log.malformed[4], {"a.clf:7", "'x' is no number"}));
  EXPECT_TRUE(mentions(log.malformed[7], {"a.clf:10", "too many"}));
}

TEST(CarmenLog, Gzip) {
  TempDir dir;
  const std::string packed = gzip(std::string(kOdometry) + kFront);
  EXPECT_EQ(2u, readCarmenLog(dir.write("a.clf.gz", packed)).records.size());
  EXPECT_TRUE(
      mentions(errorOf([&] { readCarmenLog(dir.write("b.gz", packed.substr(0, packed.size() / 2))); }),
               {"b.gz", "truncated"}));
  EXPECT_TRUE(
      mentions(errorOf([&] { readCarmenLog(dir.write("c.gz", kFront)); }), {"c.gz", "not a gzip file"}));
}

TEST(CarmenLog, WithoutScan) {
  TempDir dir;
  EXPECT_TRUE(mentions(errorOf([&] { readCarmenLog(dir.path("none.clf")); }), {"none.clf", "can't be read"}));
  EXPECT_TRUE(mentions(errorOf([&] { readCarmenLog(dir.write("a.clf", kOdometry)); }), {"a.clf", "no scan"}));
  EXPECT_TRUE(mentions(errorOf([&] { readCarmenLog(dir.write("b.clf", "FLASER 1\n")); }), {"b.clf:1"}));
}

TEST(RisingStamps, OnlyOffendersChange) {
  std::size_t repaired = 0;
  const std::vector<double> rising{1, 2, 3.5};
  EXPECT_EQ(rising, risingStamps(rising, repaired));
  EXPECT_EQ(0u, repaired);
  // As in a well-known log: one stamp is a second ahead.
  const std::vector<double> stamps = risingStamps({10.0, 10.2, 11.3, 10.6, 10.8}, repaired);
  EXPECT_EQ(1u, repaired);
  const std::vector<double> expected{10.0, 10.2, 10.4, 10.6, 10.8};
  for (std::size_t i = 0; i < expected.size(); ++i) EXPECT_NEAR(expected[i], stamps[i], 1e-9);
}

TEST(RisingStamps, EqualsEndsAndUnknown) {
  std::size_t repaired = 0;
  for (const std::vector<double>& given : std::vector<std::vector<double>>{
           {5, 5, 5, 6, 7, 8}, {9, 1, 2, 3}, {1, 2, 3, 0}, {NAN, 1, NAN, NAN, 2, NAN}, {1}, {}}) {
    const std::vector<double> stamps = risingStamps(given, repaired);
    ASSERT_EQ(given.size(), stamps.size());
    for (std::size_t i = 1; i < stamps.size(); ++i) EXPECT_GT(stamps[i], stamps[i - 1] + 5e-7);
  }
  EXPECT_TRUE(mentions(errorOf([&] {
                         risingStamps({4, 3, 2, 1}, repaired);
                       }),
                       {"3 of 4", "--clock none --rate"}));
}

TEST(CarmenLog, RecordedLogs) {
  const struct {
    const char* file;
    std::size_t scans, readings;
    double offset;
  } logs[] = {{"intel.clf.gz", 13631, 180, 0.0},
              {"fr079.clf.gz", 4934, 360, -0.04},
              {"orebro-corrected.log.gz", 237, 181, 0.0}};
  for (const auto& expected : logs) {
    const std::string name = std::string("laser2d_carmen/") + expected.file;
    const std::string path = mapping_common::findRecording(name);
    if (path.empty()) GTEST_SKIP() << mapping_common::withoutRecording(name);
    const CarmenLog log = readCarmenLog(path);
    EXPECT_TRUE(log.malformed.empty()) << log.malformed.front();
    std::size_t scans = 0;
    for (const CarmenRecord& record : log.records) {
      if (!record.isScan()) continue;
      ++scans;
      EXPECT_EQ(expected.readings, record.scan.ranges.size());
    }
    EXPECT_EQ(expected.scans, scans);
    EXPECT_NEAR(expected.offset, log.mount(Kind::kFrontScan).translation().x(), 1e-4) << expected.file;
  }
}

}  // namespace
}  // namespace rosbag_tests

int main(int argc, char** argv) {
  testing::InitGoogleTest(&argc, argv);
  return RUN_ALL_TESTS();
}
