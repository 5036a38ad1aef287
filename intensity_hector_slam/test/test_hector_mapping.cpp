// SPDX-License-Identifier: BSD-3-Clause
//
// The node in place of hector_mapping, started with what its launch file passes.
#include <geometry_msgs/PoseWithCovarianceStamped.h>
#include <intensity_hector_slam/ResetMapping.h>
#include <mapping_common/testing/tool_test.h>
#include <nav_msgs/GetMap.h>
#include <nav_msgs/Odometry.h>
#include <sensor_msgs/PointCloud.h>
#include <std_srvs/SetBool.h>
#include <std_srvs/Trigger.h>
#include <tf2_ros/buffer.h>
#include <tf2_ros/transform_listener.h>

#include <string>

#include "room_drive.h"

namespace intensity_hector_slam {
namespace {

using mapping_common::Recorder;
using mapping_common::waitFor;

class HectorMapping : public ::testing::TestWithParam<const char*>, protected RoomDrive {
 protected:
  HectorMapping() : RoomDrive(GetParam()) { odometry_ = GetParam() == std::string("with_odometry"); }
};

TEST_P(HectorMapping, IsReplacedWithItsLaunchFile) {
  Recorder<nav_msgs::OccupancyGrid> maps(node_, "map");
  Recorder<nav_msgs::MapMetaData> metadata(node_, "map_metadata");
  Recorder<geometry_msgs::PoseWithCovarianceStamped> updates(node_, "poseupdate");
  Recorder<nav_msgs::Odometry> odometry(node_, "scanmatch_odom");
  Recorder<sensor_msgs::PointCloud> clouds(node_, "slam_cloud");
  tf2_ros::Buffer buffer;
  tf2_ros::TransformListener listener(buffer);
  ASSERT_TRUE(waitForNode());

  int last = driveUntil(0, 1);
  const auto complete = [&] {
    return !updates.messages.empty() && !odometry.messages.empty() && !clouds.messages.empty() &&
           buffer.canTransform("map", frame("scanmatcher_frame"), ros::Time(0));
  };
  for (; last < 40 || (last < 150 && !complete()); ++last) ASSERT_TRUE(drive(last, last + 1)) << last;
  --last;
  ASSERT_TRUE(waitFor(complete));
  EXPECT_LT(errorAt(last), 0.05);
  EXPECT_EQ("map", poses_.back().header.frame_id);
  EXPECT_EQ(ros::Time(timeOf(last)), poses_.back().header.stamp);

  EXPECT_EQ("map", updates.messages.back().header.frame_id);
  EXPECT_GT(updates.messages.back().pose.covariance[0], 0.0);
  EXPECT_GT(updates.messages.back().pose.covariance[35], 0.0);
  EXPECT_EQ(frame("base_frame"), odometry.messages.back().child_frame_id);
  const auto& cloud = clouds.messages.back();
  EXPECT_EQ(frame("laser"), cloud.header.frame_id);
  EXPECT_EQ(361u, cloud.points.size());
  ASSERT_EQ(2u, cloud.channels.size());
  EXPECT_EQ(361u, cloud.channels[1].values.size());

  // A map of the whole room, every second and for those who come late.
  const auto known = [](const nav_msgs::OccupancyGrid& map, int value) {
    return std::count(map.data.begin(), map.data.end(), value);
  };
  ASSERT_TRUE(waitFor([&] { return !maps.messages.empty() && known(maps.messages.back(), 100) > 250; }));
  const auto& map = maps.messages.back();
  EXPECT_EQ("map", map.header.frame_id);
  EXPECT_FLOAT_EQ(0.05F, map.info.resolution);
  EXPECT_EQ(2048u, map.info.width);
  EXPECT_EQ(2048u, map.info.height);
  EXPECT_NEAR(-51.2, map.info.origin.position.x, 0.05);
  EXPECT_NEAR(-51.2, map.info.origin.position.y, 0.05);
  EXPECT_GT(known(map, 0), 5000);
  EXPECT_EQ(map.data.size(), static_cast<std::size_t>(known(map, 0) + known(map, 100) + known(map, -1)));
  EXPECT_EQ(2048u, metadata.messages.back().width);
  Recorder<nav_msgs::OccupancyGrid> late(node_, "map");
  EXPECT_TRUE(waitFor([&] { return !late.messages.empty(); }));

  const ros::Time stamp = poses_.back().header.stamp;
  const auto expectAt = [&](const Pose& expected, const std::string& child) {
    ASSERT_TRUE(waitFor([&] { return buffer.canTransform("map", frame(child), stamp); })) << child;
    const auto transform = buffer.lookupTransform("map", frame(child), stamp);
    Pose difference = toPose(tf2::transformToEigen(transform)) - expected;
    difference.z() = wrapAngle(difference.z());
    EXPECT_LT(difference.norm(), 1e-6) << child;
  };
  const Pose pose = toPose(poses_.back().pose);
  expectAt(pose, "scanmatcher_frame");
  if (odometry_) {
    expectAt(pose, "base_frame");
  } else {
    expectAt(pose, "odom_frame");
  }
}

TEST_P(HectorMapping, HasItsServices) {
  const std::string ns = "/" + name_space_ + "/";
  ASSERT_TRUE(waitForNode());
  const int next = driveUntil(500, 5);
  ASSERT_TRUE(waitFor([&] { return isAt(next - 1); }));

  nav_msgs::GetMap map;
  const auto occupied = [&] {
    EXPECT_TRUE(ros::service::call(ns + "dynamic_map", map));
    return std::count(map.response.map.data.begin(), map.response.map.data.end(), 100);
  };
  EXPECT_GT(occupied(), 100);
  std_srvs::SetBool pause;
  pause.request.data = true;
  EXPECT_TRUE(ros::service::call(ns + "pause_mapping", pause));
  std_srvs::Trigger reset;
  EXPECT_TRUE(ros::service::call(ns + "reset_map", reset));
  EXPECT_EQ(0, occupied());
  step(next);  // while it is paused
  mapping_common::spinFor(0.2);
  EXPECT_EQ(0, occupied());
  ResetMapping restart;  // ends the pause
  restart.request.initial_pose = toMessage(Pose(3.0, 1.0, 0.5));
  EXPECT_TRUE(ros::service::call(ns + "restart_mapping_with_new_pose", restart));
  ASSERT_TRUE(drive(next + 1, next + 2));
  EXPECT_LT((toPose(poses_.back().pose) - Pose(3.0, 1.0, 0.5)).norm(), 1e-6);
  EXPECT_GT(occupied(), 100);
}

INSTANTIATE_TEST_SUITE_P(Tf, HectorMapping, ::testing::Values("with_odometry", "without_odometry"),
                         [](const auto& info) { return info.param; });

// Its clients call ours: that is what rossrv md5 hector_mapping/ResetMapping tells.
TEST(ResetMapping, HasTheTypeOfHectorMapping) {
  EXPECT_STREQ("3423647d14c6c84592eef8b1184a5974", ros::service_traits::md5sum<ResetMapping>());
}

TEST(Node, PrintsItsUsageAndEnds) {
  for (const char* argument : {"-h", "--help", "scan:=front/scan --help"}) {
    const mapping_common::Ran ran = mapping_common::run("ROS_MASTER_URI=http://localhost:1 timeout 60 " +
                                                        std::string(SLAM) + ' ' + argument);
    EXPECT_EQ(0, ran.code) << argument;
    EXPECT_EQ(0u, ran.out.find("Usage: slam")) << ran.out;
  }
}

TEST(Node, SaysWhichParameterIsWrongAndEnds) {
  const auto expectEnd = [&](const std::string& argument, const std::string& expected) {
    const mapping_common::Ran ran = mapping_common::run(std::string(SLAM) + " __name:=wrong " + argument);
    EXPECT_NE(0, ran.code) << argument;
    EXPECT_NE(std::string::npos, ran.said().find(expected)) << ran.said();
    ros::param::del("/wrong");
  };
  expectEnd("_map_sizes:=2048", "~map_sizes");
  expectEnd("_map_resolution:=fine", "~map_resolution is 'fine', expected is a number");
  expectEnd("_update_factor_free:=0.7", "~update_factor_free is 0.7, allowed is");
}

}  // namespace
}  // namespace intensity_hector_slam

int main(int argc, char** argv) {
  ::testing::InitGoogleTest(&argc, argv);
  ros::init(argc, argv, "test_slam_hector_mapping");
  ros::NodeHandle keep_alive;
  return RUN_ALL_TESTS();
}
