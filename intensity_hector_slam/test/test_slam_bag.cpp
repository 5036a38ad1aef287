// SPDX-License-Identifier: BSD-3-Clause
//
// The bag runner, end to end.
#include <gtest/gtest.h>
#include <mapping_common/files.h>
#include <mapping_common/testing/temp_dir.h>
#include <mapping_common/testing/tool_test.h>

#include <memory>
#include <sstream>

#include "intensity_hector_slam/ros/bag_runner.h"
#include "room_bag.h"

namespace intensity_hector_slam {
namespace {

using mapping_common::readFile;
using mapping_common::TempDir;

constexpr int kScans = 60;

class SlamBag : public mapping_common::ToolTest {
 protected:
  SlamBag() : ToolTest(SLAM_BAG) {}
  static void SetUpTestSuite() {
    room_ = std::make_unique<TempDir>();
    writeRoomBag(bag(), kScans);
  }
  static void TearDownTestSuite() { room_.reset(); }
  static std::string bag() { return room_->path("room.bag"); }

  std::string out(const std::string& name) const { return dir_.path(name); }

  // Greatest distance from the truth; the first pose is the origin.
  static double errorOf(const std::string& trajectory) {
    std::istringstream lines(readFile(trajectory));
    double greatest = 0.0, stamp, x, y, z, qx, qy, qz, qw;
    int count = 0;
    while (lines >> stamp >> x >> y >> z >> qx >> qy >> qz >> qw) {
      greatest = std::max(greatest, (Eigen::Vector2d(x, y) - bagPoseAt(stamp - kBagStart).head<2>()).norm());
      ++count;
    }
    EXPECT_EQ(kScans, count);
    return greatest;
  }

  static std::unique_ptr<TempDir> room_;
};
std::unique_ptr<TempDir> SlamBag::room_;

TEST_F(SlamBag, WritesTheSameTwice) {
  const std::string common =
      "--bag " + bag() + " --scan scan --reflectivity-scale 0.001 --cost combined --out ";
  ASSERT_EQ(0, run(common + out("one"))) << output();
  EXPECT_NE(std::string::npos,
            output().find("tf has odometry, odom -> base_link, which isn't used without --odom odom"))
      << output();
  ASSERT_EQ(0, run(common + out("two"))) << output();
  EXPECT_LT(errorOf(out("one") + "/trajectory.tum"), 0.03);
  for (const char* name :
       {"trajectory.tum", "map.pgm", "map.yaml", "reflectivity.png", "edges.g2o", "slam.map"}) {
    const std::string first = readFile(out("one") + "/" + name);
    EXPECT_FALSE(first.empty()) << name;
    EXPECT_EQ(first, readFile(out("two") + "/" + name)) << name;
  }
  EXPECT_EQ("P5\n", readFile(out("one/map.pgm")).substr(0, 3));
  EXPECT_NE(std::string::npos, readFile(out("one/map.yaml")).find("resolution: 0.025\n"));
  EXPECT_EQ("\x89PNG", readFile(out("one/reflectivity.png")).substr(0, 4));
  EXPECT_NE(std::string::npos, readFile(out("one/edges.g2o")).find("EDGE_SE2 0 1 "));
  EXPECT_NE(std::string::npos, readFile(out("one/timing.json")).find("\"scans\": 60"));
}

TEST_F(SlamBag, UsesOdometryOfTfOrOfATopic) {
  const std::string config = dir_.write("slow.yaml", "search: never\nmap_resolution: 0.05\n");
  const std::string common =
      "--bag " + bag() + " --scan /scan --cost occupancy --config " + config + " --out ";
  ASSERT_EQ(0, run(common + out("tf") + " --odom odom")) << output();
  EXPECT_LT(errorOf(out("tf/trajectory.tum")), 0.05);
  EXPECT_EQ(std::string::npos, output().find("tf has odometry")) << output();
  ASSERT_EQ(0, run(common + out("topic") + " --odom-topic odom")) << output();
  EXPECT_LT(errorOf(out("topic/trajectory.tum")), 0.05);
  ASSERT_EQ(1, run(common + out("none") + " --odom nowhere"));
  EXPECT_NE(std::string::npos, output().find("60 no transform")) << output();
  EXPECT_NE(std::string::npos,
            output().find("60 scans are dropped, no transform, the first because \"nowhere\""))
      << output();
}

TEST_F(SlamBag, DoesWithoutTransforms) {
  const std::string bare = dir_.path("bare.bag");
  writeRoomBag(bare, 30, false);
  ASSERT_EQ(0, run("--bag " + bare + " --scan scan --cost occupancy --out " + out("bare"))) << output();
  EXPECT_NE(std::string::npos, output().find("the scanner is the body"));
  EXPECT_EQ(std::string::npos, output().find("tf has odometry")) << output();
}

TEST_F(SlamBag, SaysWhyScansAreDropped) {
  const auto write = [this](const std::function<void(sensor_msgs::LaserScan&)>& damage) {
    const std::string path = dir_.path("damaged.bag");
    rosbag::Bag damaged(path, rosbag::bagmode::Write);
    for (int i = 0; i < 5; ++i) {
      sensor_msgs::LaserScan scan = roomMessage(bagPoseAt(0.1 * i), ros::Time(kBagStart + 0.1 * i), i);
      damage(scan);
      damaged.write("/scan", scan.header.stamp, scan);
    }
    return "--bag " + path + " --scan scan --out " + out("x");
  };
  EXPECT_EQ(1, run(write([](auto& scan) {
              for (float& range : scan.ranges) range *= 1000.0F;
            })));
  EXPECT_NE(std::string::npos,
            output().find("5 scans are dropped, malformed, the first because ranges look like "
                          "millimetres"))
      << output();
  EXPECT_EQ(1, run(write([](auto& scan) { scan.ranges.assign(361, std::nanf("")); })));
  EXPECT_NE(std::string::npos, output().find("all scans are empty")) << output();
  EXPECT_EQ(0, run(write([](auto& scan) { scan.range_max = 0.0F; })));
  EXPECT_NE(std::string::npos, output().find("5 scans: range_max, the first because range_max is 0"))
      << output();
}

TEST_F(SlamBag, SaysWhatIsWrong) {
  EXPECT_EQ(2, run("--bag " + bag()));
  EXPECT_EQ(1, run("--bag /nowhere.bag --scan scan --out " + out("x")));
  EXPECT_EQ(1, run("--bag " + bag() + " --scan laser --out " + out("x")));
  EXPECT_NE(std::string::npos, output().find("has no messages on laser")) << output();
  EXPECT_EQ(1, run("--bag " + bag() + " --scan odom --out " + out("x")));
  EXPECT_NE(std::string::npos, output().find("isn't a sensor_msgs/LaserScan")) << output();
  EXPECT_EQ(1, run("--bag " + bag() + " --scan scan --cost best --out " + out("x")));
  EXPECT_NE(std::string::npos, output().find("~cost is 'best'")) << output();
  EXPECT_EQ(1, run("--bag " + dir_.write("cut.bag", readFile(bag()).substr(0, 5000)) + " --scan scan --out " +
                   out("x")));
  EXPECT_EQ(0, run("--help"));
}

}  // namespace
}  // namespace intensity_hector_slam
