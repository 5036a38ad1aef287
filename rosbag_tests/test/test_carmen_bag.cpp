// SPDX-License-Identifier: BSD-3-Clause
#include <gtest/gtest.h>
#include <mapping_common/files.h>
#include <mapping_common/testing/tool_test.h>
#include <mapping_simulation/testing/worlds.h>
#include <nav_msgs/Odometry.h>
#include <rosbag/bag.h>
#include <rosbag/view.h>
#include <rosbag_tests/converters/bag_trajectory.h>
#include <rosbag_tests/converters/carmen_bag.h>
#include <rosbag_tests/evaluations/trajectory_metrics.h>
#include <sensor_msgs/LaserScan.h>

#include <cmath>
#include <filesystem>

namespace rosbag_tests {

using mapping_simulation::loadTrajectory;
using mapping_simulation::Trajectory;

namespace {

using mapping_common::errorOf;
using mapping_common::mentions;
using mapping_common::TempDir;

// The third scan's stamp is ahead; the ODOM lines have poses of their own.
const char kLog[] =
    "PARAM robot_frontlaser_offset 0.1 h 0\n"
    "ODOM 10 0 0 0.5 0.1 0 100.0 h 0.0\n"
    "FLASER 2 1 2 0.1 0 0 0 0 0 100.1 h 0.1\n"
    "FLASER 2 1 2 1.1 0 0 1 0 0 100.2 h 0.2\n"
    "ODOM 11 0 0 0.5 0.1 0 100.25 h 0.25\n"
    "FLASER 2 1 2 2.1 0 0 2 0 0 101.3 h 1.3\n"
    "RLASER 1 3 1.5 0 3.141592653589793 2 0 0 100.3 h 0.3\n"
    "FLASER 2 1 2 3.1 0 0 3 0 0 100.4 h 0.4\n"
    "FLASER 2 1 81.9 4.1 0 0 4 0 0 100.5 h 0.5\n"
    "ODOM 14 0 0 0.5 0.1 0 100.5 h 0.5\n";

template <typename T>
std::vector<T> messages(const std::string& file, const std::string& topic) {
  rosbag::Bag bag(file);
  std::vector<T> all;
  for (const auto& message : rosbag::View(bag, rosbag::TopicQuery(topic)))
    all.push_back(*message.instantiate<T>());
  return all;
}

class CarmenBag : public testing::Test {
 protected:
  CarmenBagSummary write(const CarmenBagOptions& options) {
    return writeCarmenBag(bag(), readCarmenLog(dir_.write("a.clf", kLog)), options, dir_.path("stamps"),
                          dir_.path("reference.tum"));
  }
  std::string bag() const { return dir_.path("a.bag"); }

  TempDir dir_;
};

TEST_F(CarmenBag, ScansOdometryAndTransforms) {
  const CarmenBagSummary summary = write(CarmenBagOptions());
  EXPECT_EQ(5u, summary.scans);
  EXPECT_EQ(1u, summary.rear_scans);
  EXPECT_EQ(5u, summary.odometry);
  EXPECT_EQ(1u, summary.repaired_scans);
  const auto scans = messages<sensor_msgs::LaserScan>(bag(), "/scan");
  ASSERT_EQ(5u, scans.size());
  EXPECT_EQ("laser", scans[0].header.frame_id);
  EXPECT_NEAR(100.3, scans[2].header.stamp.toSec(), 1e-6) << "between its neighbours";
  EXPECT_NEAR(-M_PI / 2, scans[0].angle_min, 1e-6);
  EXPECT_EQ(INFINITY, scans[4].ranges[1]);
  EXPECT_EQ("laser_rear", messages<sensor_msgs::LaserScan>(bag(), "/scan_rear").at(0).header.frame_id);
  EXPECT_EQ(5u, messages<nav_msgs::Odometry>(bag(), "/odom").size());
  for (std::size_t i = 0; i < scans.size(); ++i) {
    const auto base = poseAt(readTransforms(bag(), "odom", "base_link"), scans[i].header.stamp.toSec(), 0.0);
    const auto laser = poseAt(readTransforms(bag(), "odom", "laser"), scans[i].header.stamp.toSec(), 0.0);
    ASSERT_TRUE(base && laser);
    EXPECT_NEAR(i, base->translation().x(), 1e-9);
    EXPECT_NEAR(i + 0.1, laser->translation().x(), 1e-9);
  }
}

TEST_F(CarmenBag, ChangedStampsAndReference) {
  write(CarmenBagOptions());
  const StampMap stamps(dir_.path("stamps"));
  EXPECT_NEAR(100.3, stamps(101.3), 1e-6);
  EXPECT_NEAR(100.4, stamps(100.4), 1e-9);
  const Trajectory reference = loadTrajectory(dir_.path("reference.tum"));
  ASSERT_EQ(5u, reference.poses().size());
  EXPECT_NEAR(2.0, reference.at(100.3).translation().x(), 1e-6);
}

TEST_F(CarmenBag, OdometryOfTheLines) {
  CarmenBagOptions options;
  options.odometry = CarmenBagOptions::Odometry::kLines;
  EXPECT_EQ(3u, write(options).odometry);
  const auto odometry = messages<nav_msgs::Odometry>(bag(), "/odom");
  ASSERT_EQ(3u, odometry.size());
  EXPECT_DOUBLE_EQ(0.5, odometry[0].twist.twist.linear.x);
  EXPECT_DOUBLE_EQ(0.1, odometry[0].twist.twist.angular.z);
  const Trajectory read = readPoseTopic(bag(), "/odom");
  EXPECT_NEAR(10.4, poseAt(read, 100.1, 0.5)->translation().x(), 1e-6);
}

TEST_F(CarmenBag, LoggerAndMadeUpStamps) {
  CarmenBagOptions options;
  options.stamps = CarmenBagOptions::Stamps::kLogger;
  options.offset = 5.0;
  write(options);
  EXPECT_NEAR(5.1, messages<sensor_msgs::LaserScan>(bag(), "/scan")[0].header.stamp.toSec(), 1e-6);
  options = CarmenBagOptions();
  options.stamps = CarmenBagOptions::Stamps::kRate;
  options.rate = 4.0;
  write(options);
  const auto scans = messages<sensor_msgs::LaserScan>(bag(), "/scan");
  ASSERT_EQ(5u, scans.size());
  for (std::size_t i = 0; i < scans.size(); ++i)
    EXPECT_NEAR(1.0 + 0.25 * i, scans[i].header.stamp.toSec(), 1e-6);
  options.rate = 0.0;
  EXPECT_TRUE(mentions(errorOf([&] { write(options); }), {"rate"}));
}

TEST_F(CarmenBag, StampsThatRosCanNotHave) {
  CarmenBagOptions options;
  options.offset = -200.0;
  EXPECT_TRUE(mentions(errorOf([&] { write(options); }), {"from -", "--offset", "--clock none --rate"}));
  EXPECT_FALSE(std::filesystem::exists(bag()));
  EXPECT_FALSE(std::filesystem::exists(bag() + ".part"));
}

TEST_F(CarmenBag, ReadersSayWhatIsMissing) {
  write(CarmenBagOptions());
  EXPECT_TRUE(mentions(errorOf([&] { readPoseTopic(bag(), "/nowhere"); }), {"a.bag", "/nowhere"}));
  EXPECT_TRUE(mentions(errorOf([&] { readPoseTopic(bag(), "/scan"); }), {"no pose"}));
  EXPECT_TRUE(mentions(errorOf([&] { readTransforms(bag(), "map", "base_link"); }), {"map", "base_link"}));
  EXPECT_TRUE(mentions(errorOf([&] { readTransforms(dir_.write("x.bag", "no bag"), "map", "base_link"); }),
                       {"x.bag"}));
}

// The tools themselves, end to end.
TEST_F(CarmenBag, Tools) {
  std::string out;
  const auto run = [&out](const std::string& command) {
    const mapping_common::Ran ran = mapping_common::run(command);
    out = ran.out;
    return ran.code;
  };
  const std::string log = dir_.write("a.clf", kLog);
  ASSERT_EQ(0, run(CARMEN_TO_BAG " " + log + " " + bag() + " --stamps " + dir_.path("stamps") +
                   " --reference " + dir_.path("t.tum")));
  const std::string relations =
      dir_.write("a.relations", "100.1 101.3 2.5 0 0 0 0 0\n100.1 99 1 0 0 0 0 0\n");
  ASSERT_EQ(0, run(RELATIONS_METRIC " --trajectory " + dir_.path("t.tum") + " --relations " + relations +
                   " --stamps " + dir_.path("stamps") + " --json " + dir_.path("r.json")));
  EXPECT_TRUE(mentions(out, {"relations: 1 used, 1 without a pose", "0.5000"}));
  EXPECT_TRUE(mentions(mapping_common::readFile(dir_.path("r.json")), {"\"unmatched\": 1"}));
  ASSERT_EQ(
      0, run(TRAJECTORY_ERROR " --reference " + bag() + " --parent odom --estimate " + dir_.path("t.tum")));
  EXPECT_TRUE(mentions(out, {"delta pose error: 4 used", "absolute"}));
  EXPECT_EQ(
      1, run(TRAJECTORY_ERROR " --reference " + bag() + " --topic /none --estimate " + dir_.path("t.tum")));
  EXPECT_EQ(2, run(TRAJECTORY_ERROR));
  EXPECT_EQ(2, run(CARMEN_TO_BAG " " + log + " " + bag() + " --clock none"));
  EXPECT_EQ(1, run(CARMEN_TO_BAG " " + dir_.path("missing.clf") + " " + bag()));
  EXPECT_EQ(2, run(RELATIONS_METRIC " --trajectory x"));
}

}  // namespace
}  // namespace rosbag_tests

int main(int argc, char** argv) {
  testing::InitGoogleTest(&argc, argv);
  return RUN_ALL_TESTS();
}
