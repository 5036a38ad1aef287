// SPDX-License-Identifier: BSD-3-Clause
//
// robot.launch for two robots on one master: each has its own scans, maps and frames.
#include <mapping_common/testing/nodelet_test.h>
#include <nav_msgs/OccupancyGrid.h>
#include <ros/master.h>
#include <sensor_msgs/LaserScan.h>
#include <tf2_ros/buffer.h>
#include <tf2_ros/transform_listener.h>

#include <algorithm>
#include <set>
#include <string>

using mapping_common::Recorder;
using mapping_common::waitFor;

namespace {

bool startsWith(const std::string& text, const std::string& start) {
  return text.rfind(start, 0) == 0;
}

bool belongsToARobot(const std::string& name) {
  return startsWith(name, "/alice/") || startsWith(name, "/bob/");
}

/// What nodes publish, subscribe to or offer as services, of all nodes that aren't this test, emulators or
/// ROS itself.
std::set<std::string> namesOfRobots() {
  std::set<std::string> names;
  XmlRpc::XmlRpcValue request(ros::this_node::getName()), response, state;
  ros::master::execute("getSystemState", request, response, state, false);
  for (int kind = 0; kind < state.size(); ++kind) {
    for (int i = 0; i < state[kind].size(); ++i) {
      XmlRpc::XmlRpcValue& nodes = state[kind][i][1];
      for (int n = 0; n < nodes.size(); ++n) {
        if (belongsToARobot(nodes[n])) names.insert(static_cast<std::string>(state[kind][i][0]));
      }
    }
  }
  return names;
}

TEST(Robots, HaveMapsOfTheirOwn) {
  ros::NodeHandle node;
  tf2_ros::Buffer buffer;
  tf2_ros::TransformListener listener(buffer);
  for (const std::string robot : {"alice", "bob"}) {
    Recorder<sensor_msgs::LaserScan> scans(node, "/" + robot + "/scan");
    Recorder<nav_msgs::OccupancyGrid> maps(node, "/" + robot + "/map");
    const auto mapped = [&] {
      return !scans.messages.empty() && !maps.messages.empty() &&
             std::count(maps.messages.back().data.begin(), maps.messages.back().data.end(), 100) > 100;
    };
    ASSERT_TRUE(waitFor(mapped, 60.0)) << robot;
    EXPECT_EQ(robot + "/laser", scans.messages.back().header.frame_id);
    EXPECT_EQ(robot + "/map", maps.messages.back().header.frame_id);
    EXPECT_TRUE(buffer.canTransform(robot + "/map", robot + "/laser", ros::Time(0), ros::Duration(10.0)))
        << robot;
    EXPECT_TRUE(buffer.canTransform(robot + "/map", robot + "/scanmatcher_frame", ros::Time(0))) << robot;
  }
  EXPECT_NEAR(0.2,
              buffer.lookupTransform("alice/base_link", "alice/laser", ros::Time(0)).transform.translation.x,
              1e-9);
  EXPECT_FALSE(buffer._frameExists("map"));
  EXPECT_FALSE(buffer._frameExists("scanmatcher_frame"));
  EXPECT_FALSE(buffer.canTransform("alice/map", "bob/map", ros::Time(0)));
}

TEST(Robots, ShareNothingButTransformsAndDiagnostics) {
  const std::set<std::string> shared = {"/clock", "/diagnostics", "/rosout", "/tf", "/tf_static"};
  std::set<std::string> names;
  for (const std::string expected : {"/alice/map", "/bob/map", "/alice/places", "/alice/graph_path"})
    EXPECT_TRUE(waitFor([&] { return (names = namesOfRobots()).count(expected) > 0; }, 30.0)) << expected;
  EXPECT_FALSE(names.count("/bob/graph_path")) << "as it was told";
  for (const std::string& name : names) EXPECT_TRUE(belongsToARobot(name) || shared.count(name)) << name;
}

}  // namespace

int main(int argc, char** argv) {
  testing::InitGoogleTest(&argc, argv);
  ros::init(argc, argv, "test_robots");
  const ros::NodeHandle node;  // ROS goes on from test to test
  return RUN_ALL_TESTS();
}
