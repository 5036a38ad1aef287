// SPDX-License-Identifier: BSD-3-Clause
#include <geometry_msgs/PoseStamped.h>
#include <geometry_msgs/TransformStamped.h>
#include <gtest/gtest.h>
#include <mapping_common/testing/temp_dir.h>
#include <mapping_simulation/ros/conversions.h>
#include <mapping_simulation/ros/simulation_bag.h>
#include <mapping_simulation/testing/worlds.h>
#include <nav_msgs/Odometry.h>
#include <rosbag_tests/converters/bag_scans.h>
#include <rosbag_tests/converters/conversions.h>
#include <rosbag_tests/converters/scan_bag_writer.h>
#include <rosgraph_msgs/Clock.h>
#include <std_msgs/String.h>
#include <tf2_msgs/TFMessage.h>

#include <cmath>
#include <cstring>
#include <limits>
#include <vector>

namespace rosbag_tests {

using mapping_simulation::PosedScan;
using mapping_simulation::toPointCloud2;
using mapping_simulation::toPose;
using mapping_simulation::toTransform;

namespace {

using mapping_common::errorOf;
using mapping_common::mentions;
using mapping_common::TempDir;

constexpr float kNan = std::numeric_limits<float>::quiet_NaN();
constexpr float kInf = std::numeric_limits<float>::infinity();

pcl::PointXYZI point(float x, float y, float z, float intensity) {
  pcl::PointXYZI p;
  p.getVector3fMap() = Eigen::Vector3f(x, y, z);
  p.intensity = intensity;
  return p;
}

Eigen::Isometry3d pose(double x, double y, double z, double yaw, double pitch = 0.0) {
  Eigen::Isometry3d pose(Eigen::AngleAxisd(yaw, Eigen::Vector3d::UnitZ()) *
                         Eigen::AngleAxisd(pitch, Eigen::Vector3d::UnitY()));
  pose.translation() = Eigen::Vector3d(x, y, z);
  return pose;
}

std::vector<PosedScan> someScans() {
  std::vector<PosedScan> scans(3);
  for (int i = 0; i < 3; ++i) {
    scans[i].name = "scan " + std::to_string(i);
    scans[i].stamp = 0.1 * i;
    scans[i].pose = pose(i, -0.5 * i, 0.1 * i, 0.7 * i, -0.2 * i);
    scans[i].cloud.push_back(point(1.25f + i, 2.5f, 1.0f / 3.0f, 0.1f));
    scans[i].cloud.push_back(point(kNan, kNan, kNan, 0.0f));
    scans[i].cloud.push_back(point(-4.0f, 0.0f, 7.0f, 99.0f));
  }
  return scans;
}

std::string writeScans(const TempDir& dir, const std::vector<PosedScan>& scans,
                       const ScanBagOptions& options = {}) {
  ScanBagWriter writer(dir.path("scans.bag"), options);
  for (const auto& scan : scans) writer.write(scan);
  writer.close();
  return dir.path("scans.bag");
}

void expectSameScans(ScanSource& source, const std::vector<PosedScan>& expected, double offset) {
  PosedScan scan;
  for (const auto& e : expected) {
    ASSERT_TRUE(source.next(scan));
    EXPECT_NEAR(scan.stamp, e.stamp + offset, 1e-6);
    EXPECT_TRUE(scan.pose.isApprox(e.pose, 1e-9)) << scan.name;
    ASSERT_EQ(scan.cloud.size(), e.cloud.size());
    for (std::size_t i = 0; i < e.cloud.size(); ++i) {
      if (std::isnan(e.cloud[i].x)) {
        EXPECT_TRUE(std::isnan(scan.cloud[i].x));
        continue;
      }
      EXPECT_EQ(scan.cloud[i].getVector3fMap(), e.cloud[i].getVector3fMap());
      EXPECT_EQ(scan.cloud[i].intensity, e.cloud[i].intensity);
    }
  }
  EXPECT_FALSE(source.next(scan));
}

std_msgs::Header header(double stamp, const std::string& frame) {
  std_msgs::Header header;
  header.stamp = ros::Time(stamp);
  header.frame_id = frame;
  return header;
}

tf2_msgs::TFMessage tf(double stamp, const std::string& parent, const std::string& child,
                       const Eigen::Isometry3d& pose) {
  tf2_msgs::TFMessage message;
  message.transforms.resize(1);
  message.transforms[0].header = header(stamp, parent);
  message.transforms[0].child_frame_id = child;
  message.transforms[0].transform = toTransform(pose);
  return message;
}

sensor_msgs::PointCloud2 cloudAt(double stamp, const std::string& frame = "lidar") {
  pcl::PointCloud<pcl::PointXYZI> cloud;
  cloud.push_back(point(1, 2, 3, 4));
  return toPointCloud2(cloud, header(stamp, frame));
}

TEST(ScanBag, RoundTripOverTf) {
  TempDir dir;
  const auto scans = someScans();
  ScanBagOptions options;
  options.map_to_odom = pose(3, 4, 5, 1.0);
  options.base_to_sensor = pose(0.1, 0.2, 0.9, -0.5, 0.3);
  BagScans source(writeScans(dir, scans, options));
  EXPECT_EQ(source.topic(), "/cloud");
  EXPECT_EQ(source.size(), 3u);
  expectSameScans(source, scans, 1000.0);
  source.rewind();
  expectSameScans(source, scans, 1000.0);
  EXPECT_EQ(source.withoutPose() + source.malformed() + source.malformedPoses(), 0u);
}

TEST(ScanBag, RoundTripOverThePoseTopic) {
  TempDir dir;
  const auto scans = someScans();
  ScanBagOptions write_options;
  write_options.base_to_sensor = pose(0.1, 0.2, 0.9, -0.5, 0.3);
  write_options.cloud_topic = "points";
  write_options.stamp_offset = 5.0;
  BagScansOptions options;
  options.topic = "points";
  options.pose_topic = "ground_truth";
  options.body_frame = "base_link";
  BagScans source(writeScans(dir, scans, write_options), options);
  expectSameScans(source, scans, 5.0);
}

TEST(ScanBag, TransformIsThereWhenTheCloudComesAndTheClockTicks) {
  TempDir dir;
  rosbag::Bag bag(writeScans(dir, someScans()), rosbag::bagmode::Read);
  tf2::BufferCore buffer;
  std::vector<ros::Time> ticks;
  int clouds = 0;
  bool latched = false;
  for (const auto& message : rosbag::View(bag)) {
    if (const auto transforms = message.instantiate<tf2_msgs::TFMessage>()) {
      const bool is_static = message.getTopic() == "/tf_static";
      for (const auto& transform : transforms->transforms) buffer.setTransform(transform, "bag", is_static);
      if (is_static) latched = message.isLatching();
    } else if (const auto cloud = message.instantiate<sensor_msgs::PointCloud2>()) {
      ++clouds;
      for (const double margin : {-0.001, 0.0, 0.001})
        EXPECT_TRUE(
            buffer.canTransform("map", cloud->header.frame_id, cloud->header.stamp + ros::Duration(margin)));
    } else if (const auto clock = message.instantiate<rosgraph_msgs::Clock>()) {
      ticks.push_back(clock->clock);
    }
  }
  EXPECT_EQ(clouds, 3);
  EXPECT_TRUE(latched);
  ASSERT_EQ(ticks.size(), 221u);
  EXPECT_EQ(ticks.front(), ros::Time(999.0));
  EXPECT_EQ(ticks.back(), ros::Time(1001.2));
  for (std::size_t i = 1; i < ticks.size(); ++i) EXPECT_EQ(ticks[i] - ticks[i - 1], ros::Duration(0.01));
}

TEST(ScanBag, AppearsUnderItsNameWhenComplete) {
  TempDir dir;
  const std::string file = dir.path("scans.bag");
  {
    ScanBagWriter writer(file);
    auto scan = someScans()[1];
    writer.write(scan);
    EXPECT_TRUE(mentions(errorOf([&] { writer.write(scan); }), {"scan 1", "after the scan before"}));
    scan.stamp = -5000.0;
    EXPECT_TRUE(mentions(errorOf([&] { writer.write(scan); }), {"stamp -4000"}));
    EXPECT_TRUE(std::filesystem::exists(file + ".part"));
  }
  EXPECT_TRUE(std::filesystem::is_empty(dir.path()));
  EXPECT_NE(errorOf([&] { ScanBagWriter(dir.path("missing/scans.bag")); }), "");
  ScanBagOptions options;
  options.sensor_frame = options.base_frame;
  EXPECT_TRUE(mentions(errorOf([&] { ScanBagWriter(file, options); }), {"frames need names of their own"}));
}

TEST(BagScans, TransformsMayComeLaterAndScansWithoutOneAreCounted) {
  TempDir dir;
  rosbag::Bag bag(dir.path("a.bag"), rosbag::bagmode::Write);
  const auto write = [&](double time, const auto& message, const std::string& topic) {
    bag.write(topic, ros::Time(time), message);
  };
  write(1, cloudAt(9.0), "/cloud");                // before the first transform
  write(2, cloudAt(10.5, "/lidar"), "/cloud");     // halfway, and with tf1's slash
  write(3, cloudAt(10.5, "elsewhere"), "/cloud");  // frame without a transform
  write(4, cloudAt(0.0), "/cloud");                // unset stamp
  auto malformed = cloudAt(10.5);
  malformed.data.resize(3);
  write(5, malformed, "/cloud");
  write(6, sensor_msgs::PointCloud2(), "/cloud");
  write(7, tf(10.0, "map", "base", pose(1, 0, 0, 0)), "/tf");
  write(8, tf(11.0, "map", "base", pose(2, 0, 0, 0)), "/tf");
  write(9, tf(1.0, "base", "lidar", pose(0, 0, 5, 0)), "/tf_static");
  std_msgs::String garbage;
  garbage.data = "no transforms";
  write(10, garbage, "/tf");
  bag.close();
  BagScans source(dir.path("a.bag"));
  EXPECT_EQ(source.size(), 6u);
  PosedScan scan;
  ASSERT_TRUE(source.next(scan));
  EXPECT_TRUE(scan.pose.isApprox(pose(1.5, 0, 5, 0), 1e-9));
  EXPECT_FALSE(source.next(scan));
  EXPECT_EQ(source.withoutPose(), 3u);
  EXPECT_EQ(source.malformed(), 2u);
  EXPECT_EQ(source.malformedPoses(), 1u);
}

TEST(BagScans, PosesFromOdometryTransformAndPoseTopics) {
  TempDir dir;
  rosbag::Bag bag(dir.path("a.bag"), rosbag::bagmode::Write);
  for (int i = 0; i < 2; ++i) {
    const ros::Time time(10.0 + i);
    nav_msgs::Odometry odometry;
    odometry.header = header(10.0 + i, "odom");
    odometry.child_frame_id = "base";
    odometry.pose.pose = toPose(pose(1.0 + i, 0, 0, 0));
    bag.write("/odom", time, odometry);
    geometry_msgs::TransformStamped transform =
        tf(10.0 + i, "world", "base", pose(11.0 + i, 0, 0, 0)).transforms[0];
    bag.write("/vicon", time, transform);
    geometry_msgs::PoseStamped stamped;
    stamped.header = header(10.0 + i, "world");
    stamped.pose = toPose(pose(21.0 + i, 0, 0, 0));
    bag.write("/pose", time, stamped);
  }
  geometry_msgs::PoseStamped faulty;
  faulty.header = header(10.4, "world");
  bag.write("/pose", ros::Time(10.4), faulty);  // quaternion 0 0 0 0
  bag.write("/tf_static", ros::Time(9.0), tf(9.0, "base", "lidar", pose(0, 0, 5, 0)));
  bag.write("/cloud", ros::Time(10.5), cloudAt(10.5));
  bag.close();
  const auto read = [&](const std::string& topic, std::size_t malformed) {
    BagScansOptions options;
    options.pose_topic = topic;
    BagScans source(dir.path("a.bag"), options);
    EXPECT_EQ(source.malformedPoses(), malformed);
    PosedScan scan;
    EXPECT_TRUE(source.next(scan));
    return Eigen::Vector3d(scan.pose.translation());
  };
  EXPECT_TRUE(read("/odom", 0).isApprox(Eigen::Vector3d(1.5, 0, 5), 1e-9));
  EXPECT_TRUE(read("vicon", 0).isApprox(Eigen::Vector3d(11.5, 0, 5), 1e-9));
  EXPECT_TRUE(read("/pose", 1).isApprox(Eigen::Vector3d(21.5, 0, 0), 1e-9));  // of the sensor itself
}

TEST(BagScans, UnfitFilesAndTopicsAreRefused) {
  TempDir dir;
  EXPECT_TRUE(mentions(errorOf([&] { BagScans(dir.path("none.bag")); }), {"none.bag"}));
  EXPECT_TRUE(mentions(errorOf([&] { BagScans(dir.write("text.bag", "not a bag\n")); }), {"text.bag"}));
  const std::string file = writeScans(dir, someScans());
  BagScansOptions options;
  options.topic = "/points";
  EXPECT_TRUE(
      mentions(errorOf([&] { BagScans(file, options); }), {"/points", "/cloud (sensor_msgs/PointCloud2)"}));
  options.topic = "";
  options.pose_topic = "/cloud";
  EXPECT_TRUE(mentions(errorOf([&] { BagScans(file, options); }), {"nav_msgs/Odometry"}));
  std::filesystem::resize_file(file, std::filesystem::file_size(file) / 2);
  EXPECT_TRUE(mentions(errorOf([&] { BagScans{file}; }), {"scans.bag"}));
}

TEST(Conversions, FieldsOfAnyNumericTypeAndOrganisedClouds) {
  sensor_msgs::PointCloud2 message;
  const auto add = [&](const std::string& name, int type, int offset) {
    sensor_msgs::PointField field;
    field.name = name;
    field.datatype = type;
    field.offset = offset;
    field.count = 1;
    message.fields.push_back(field);
  };
  add("ring", sensor_msgs::PointField::UINT8, 0);
  add("intensity", sensor_msgs::PointField::UINT16, 1);
  add("z", sensor_msgs::PointField::INT32, 3);
  add("x", sensor_msgs::PointField::FLOAT64, 7);
  add("y", sensor_msgs::PointField::FLOAT32, 15);
  add("label", 77, 0);  // unknown, but not asked for
  message.width = 1;
  message.height = 2;
  message.point_step = 19;
  message.row_step = 24;
  message.data.resize(24 + 19);
  for (int row = 0; row < 2; ++row) {
    std::uint8_t* data = message.data.data() + row * 24;
    const std::uint16_t intensity = 40000;
    const std::int32_t z = -3 - row;
    const double x = 0.5;
    const float y = -0.25f;
    std::memcpy(data + 1, &intensity, 2);
    std::memcpy(data + 3, &z, 4);
    std::memcpy(data + 7, &x, 8);
    std::memcpy(data + 15, &y, 4);
  }
  pcl::PointCloud<pcl::PointXYZI> cloud;
  fromPointCloud2(message, cloud);
  ASSERT_EQ(cloud.size(), 2u);
  EXPECT_EQ(cloud[1].getVector3fMap(), Eigen::Vector3f(0.5f, -0.25f, -4.0f));
  EXPECT_EQ(cloud[1].intensity, 40000.0f);

  const auto error = [&](auto change) {
    auto faulty = message;
    change(faulty);
    return errorOf([&] { fromPointCloud2(faulty, cloud); });
  };
  EXPECT_TRUE(mentions(error([](auto& m) { m.data.pop_back(); }), {"42 bytes"}));
  EXPECT_TRUE(mentions(error([](auto& m) { m.row_step = 18; }), {"43 bytes"}));
  EXPECT_TRUE(mentions(error([](auto& m) { m.point_step = 18; }), {"field y"}));
  EXPECT_TRUE(mentions(error([](auto& m) { m.point_step = 0; }), {"field"}));
  EXPECT_TRUE(mentions(error([](auto& m) { m.fields[3].datatype = 9; }), {"field x"}));
  EXPECT_TRUE(mentions(error([](auto& m) { m.fields[3].offset = 0xffffffff; }), {"field x"}));
  EXPECT_TRUE(mentions(error([](auto& m) { m.fields[3].name = "u"; }), {"without the fields"}));
  EXPECT_TRUE(mentions(error([](auto& m) { m.width = 0xffffffff; }), {"43 bytes"}));
  EXPECT_TRUE(mentions(error([](auto& m) { m.is_bigendian = true; }), {"big-endian"}));
  EXPECT_TRUE(mentions(error([](auto& m) { m.height = 0; }), {"without points"}));
  EXPECT_EQ(cloud.size(), 2u);
}

TEST(Conversions, LaserScanWithoutReturns) {
  sensor_msgs::LaserScan scan;
  scan.angle_min = -M_PI / 2;
  scan.angle_increment = M_PI / 2;
  scan.range_min = 0.1f;
  scan.range_max = 10.0f;
  scan.ranges = {2.0f, kInf, 3.0f, 0.05f, 11.0f, kNan};
  scan.intensities = {1, 2, 3, 4, 5, 6};
  pcl::PointCloud<pcl::PointXYZI> cloud;
  fromLaserScan(scan, cloud);
  ASSERT_EQ(cloud.size(), 6u);
  EXPECT_TRUE(cloud[0].getVector3fMap().isApprox(Eigen::Vector3f(0, -2, 0), 1e-6f));
  EXPECT_TRUE(cloud[2].getVector3fMap().isApprox(Eigen::Vector3f(0, 3, 0), 1e-6f));
  EXPECT_EQ(cloud[2].intensity, 3.0f);
  for (const int i : {1, 3, 4, 5}) EXPECT_FALSE(cloud[i].getVector3fMap().allFinite()) << i;
  scan.intensities.pop_back();
  EXPECT_TRUE(mentions(errorOf([&] { fromLaserScan(scan, cloud); }), {"unequal"}));
  scan.intensities.clear();
  fromLaserScan(scan, cloud);
  EXPECT_EQ(cloud[0].intensity, 0.0f);
  scan.angle_increment = kNan;
  EXPECT_THROW(fromLaserScan(scan, cloud), std::invalid_argument);
  scan.ranges.clear();
  EXPECT_TRUE(mentions(errorOf([&] { fromLaserScan(scan, cloud); }), {"without ranges"}));
}

TEST(BagScans, LaserScansKeepBeamsWithoutReturn) {
  TempDir dir;
  rosbag::Bag bag(dir.path("a.bag"), rosbag::bagmode::Write);
  sensor_msgs::LaserScan laser;
  laser.header = header(10.0, "map");
  laser.angle_increment = 0.1f;
  laser.range_max = 10.0f;
  laser.ranges = {1.0f, kInf};
  bag.write("/scan", ros::Time(10.0), laser);
  bag.write("/tf", ros::Time(10.0), tf(10.0, "map", "other", pose(0, 0, 0, 0)));
  bag.close();
  BagScans source(dir.path("a.bag"));
  PosedScan scan;
  ASSERT_TRUE(source.next(scan));
  ASSERT_EQ(scan.cloud.size(), 2u);
  EXPECT_FALSE(std::isfinite(scan.cloud[1].x));
}

TEST(BagScans, HaveThePosesOfASimulation) {
  using namespace mapping_simulation;
  const TempDir dir;
  SensorConfig sensor = loadSensor(configFile("simulator/velodyne_vlp16.yaml"));
  sensor.columns = 90;
  sensor.angle_increment = 2 * M_PI / sensor.columns;
  const std::string world = configFile("worlds/room_8x5.yaml");
  const Simulation simulation{loadWorld(world), loadTrajectory(world), {sensor}, 0.5, 1};
  SimulationBagOptions options;
  options.odometry_noise = {0.05, 0.05};
  writeSimulationBag(dir.path("a.bag"), simulation, options);
  BagScansOptions reader;
  reader.topic = "/velodyne_points";
  BagScans scans(dir.path("a.bag"), reader);
  PosedScan scan;
  int count = 0;
  for (; scans.next(scan); ++count)
    EXPECT_TRUE(scan.pose.isApprox(simulation.trajectory.at(scan.stamp - 1000.0) * sensor.mount, 1e-3));
  EXPECT_EQ(count, 5);
  EXPECT_EQ(scans.withoutPose(), 0u);
}

}  // namespace
}  // namespace rosbag_tests

int main(int argc, char** argv) {
  testing::InitGoogleTest(&argc, argv);
  return RUN_ALL_TESTS();
}
