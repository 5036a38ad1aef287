// SPDX-License-Identifier: BSD-3-Clause
#include <dynamic_reconfigure/Reconfigure.h>
#include <geometry_msgs/PoseWithCovarianceStamped.h>
#include <intensity_hector_slam/ResetMapping.h>
#include <mapping_common/testing/message_fuzz.h>
#include <mapping_common/testing/nodelet_test.h>
#include <mapping_common/testing/temp_dir.h>
#include <mapping_msgs/CorrectedMap.h>
#include <mapping_msgs/EdgeConstraint.h>
#include <mapping_msgs/LoadMap.h>
#include <mapping_msgs/SaveMap.h>
#include <nav_msgs/GetMap.h>
#include <nav_msgs/Odometry.h>
#include <nav_msgs/Path.h>
#include <std_msgs/String.h>
#include <std_srvs/SetBool.h>
#include <std_srvs/Trigger.h>
#include <tf2_ros/buffer.h>
#include <tf2_ros/transform_listener.h>

#include "room_drive.h"

namespace intensity_hector_slam {
namespace {

using mapping_common::Recorder;
using mapping_common::spinFor;
using mapping_common::waitFor;

class SlamNodeletTest : public mapping_common::NodeletTest, protected RoomDrive {
 protected:
  SlamNodeletTest() : NodeletTest("intensity_hector_slam/SlamNodelet", "slam"), RoomDrive(test_) {
    for (const char* frame : {"base_frame", "odom_frame", "map_frame"}) setParam(frame, test_ + "_" + frame);
    setParam("tf_map_scanmatch_transform_frame_name", test_ + "_scanmatcher_frame");
    setParam("map_pub_period", 0.1);
    setParam("reflectivity_scale", 0.001);
    setParam("scan_subscriber_queue_size", 20);
  }
  // A test may have a listener of its own to tf.
  bool load() { return NodeletTest::load() && waitForNode() && mapping_common::waitForLink(tf_); }
  template <class Service>
  bool call(const std::string& name, Service& service) {
    return ros::service::call(name, service);
  }

  using NodeletTest::node_;
};

TEST_F(SlamNodeletTest, TopicsAndFramesAreThoseOfHectorMapping) {
  setParam("pub_odometry", true);
  Recorder<nav_msgs::OccupancyGrid> maps(node_, "map"), reflectivity(node_, "reflectivity_map");
  Recorder<nav_msgs::MapMetaData> metadata(node_, "map_metadata");
  Recorder<geometry_msgs::PoseWithCovarianceStamped> updates(node_, "poseupdate");
  Recorder<nav_msgs::Odometry> odometry(node_, "scanmatch_odom");
  Recorder<nav_msgs::Path> paths(node_, "path");
  Recorder<mapping_msgs::EdgeConstraint> edges(node_, "edges");
  tf2_ros::Buffer buffer;
  tf2_ros::TransformListener listener(buffer);
  ASSERT_TRUE(load());
  // Those who listen may have found the nodelet late.
  int last = 0;
  const auto complete = [&] {
    return !updates.messages.empty() && !odometry.messages.empty() && maps.messages.size() > 1 &&
           reflectivity.messages.size() > 1 && !metadata.messages.empty() && paths.messages.size() > 1 &&
           edges.messages.size() > 1;
  };
  for (; last < 40 || (last < 150 && !complete()); ++last) ASSERT_TRUE(drive(last, last + 1)) << last;
  --last;
  EXPECT_TRUE(waitFor(complete));
  EXPECT_LT(errorAt(last), 0.03);
  const ros::Time stamp = poses_.back().header.stamp;
  EXPECT_EQ(frame("map_frame"), poses_.back().header.frame_id);
  EXPECT_EQ(ros::Time(kBagStart + 0.1 * last), stamp);

  EXPECT_GT(updates.messages.back().pose.covariance[0], 0.0);
  EXPECT_GT(updates.messages.back().pose.covariance[35], 0.0);
  const auto& map = maps.messages.back();
  EXPECT_FLOAT_EQ(0.025F, map.info.resolution);
  EXPECT_GT(std::count(map.data.begin(), map.data.end(), 100), 500);
  EXPECT_GT(std::count(map.data.begin(), map.data.end(), 0), 10000);
  EXPECT_GT(
      *std::max_element(reflectivity.messages.back().data.begin(), reflectivity.messages.back().data.end()),
      70);

  ASSERT_GT(edges.messages.size(), 1u);
  const auto& edge = edges.messages.back();
  EXPECT_EQ(frame("base_frame"), edge.frame_id);
  EXPECT_EQ(edge.from_id + 1, edge.to_id);
  const Pose moved = between(bagPoseAt((edge.from_stamp - ros::Time(kBagStart)).toSec()),
                             bagPoseAt((edge.to_stamp - ros::Time(kBagStart)).toSec()));
  EXPECT_LT((toPose(edge.transform) - moved).norm(), 0.04);
  EXPECT_GT(edge.information[0], 100.0);

  ASSERT_TRUE(waitFor([&] {
    return buffer.canTransform(frame("map_frame"), frame("base_frame"), stamp) &&
           buffer.canTransform(frame("map_frame"), frame("scanmatcher_frame"), stamp);
  }));
  for (const char* child : {"base_frame", "scanmatcher_frame"}) {
    const auto transform = buffer.lookupTransform(frame("map_frame"), frame(child), stamp);
    EXPECT_LT((toPose(tf2::transformToEigen(transform)) - toPose(poses_.back().pose)).norm(), 1e-6) << child;
  }
}

TEST_F(SlamNodeletTest, PublishesLoops) {
  using mapping_msgs::EdgeConstraint;
  setParam("loop_min_travel", 6.0);
  setParam("loop_submap_length", 5.0);
  Recorder<EdgeConstraint> edges(node_, "edges");
  ASSERT_TRUE(load());
  const auto loop = [&] {
    return std::find_if(edges.messages.begin(), edges.messages.end(),
                        [](const auto& edge) { return edge.type == EdgeConstraint::LOOP_CLOSURE; });
  };
  for (int i = 0; i < 300 && loop() == edges.messages.end(); ++i) ASSERT_TRUE(drive(i, i + 1)) << i;
  ASSERT_TRUE(waitFor([&] { return loop() != edges.messages.end(); }));
  EXPECT_TRUE(loop()->has_transform);
  EXPECT_EQ(frame("base_frame"), loop()->frame_id);
  EXPECT_EQ(loop()->to_stamp, loop()->header.stamp);
  EXPECT_LT(loop()->from_id + 5, loop()->to_id);
  EXPECT_GT(loop()->similarity, 0.5F);
  EXPECT_LE(loop()->similarity, 1.0F);
  const Pose moved = between(bagPoseAt((loop()->from_stamp - ros::Time(kBagStart)).toSec()),
                             bagPoseAt((loop()->to_stamp - ros::Time(kBagStart)).toSec()));
  const Pose error = between(moved, toPose(loop()->transform));
  EXPECT_LT(error.norm(), 0.05) << error.transpose();
  // Both its key poses have edges of the chain, with the same stamps.
  const auto stampOf = [&](std::uint32_t id) {
    for (const auto& edge : edges.messages) {
      if (edge.type != EdgeConstraint::CONSECUTIVE) continue;
      if (edge.to_id == id) return edge.to_stamp;
      if (edge.from_id == id) return edge.from_stamp;
    }
    return ros::Time();
  };
  EXPECT_EQ(stampOf(loop()->from_id), loop()->from_stamp);
  EXPECT_EQ(stampOf(loop()->to_id), loop()->to_stamp);
}

TEST_F(SlamNodeletTest, WithoutOdometryTheBodyHangsOnTheMap) {
  setParam("odom_frame", frame("base_frame"));
  odometry_ = false;
  tf2_ros::Buffer buffer;
  tf2_ros::TransformListener listener(buffer);
  ASSERT_TRUE(load());
  ASSERT_TRUE(drive(0, 10));
  EXPECT_LT(errorAt(9), 0.03);
  // The listener may have found the nodelet late.
  for (int i = 10; i < 40 && !buffer.canTransform(frame("map_frame"), frame("base_frame"), ros::Time(0));
       ++i) {
    ASSERT_TRUE(drive(i, i + 1));
    spinFor(0.05);
  }
  const auto transform = buffer.lookupTransform(frame("map_frame"), frame("base_frame"), ros::Time(0));
  const double time = (transform.header.stamp - ros::Time(kBagStart)).toSec();
  EXPECT_LT((toPose(tf2::transformToEigen(transform)) - bagPoseAt(time)).norm(), 0.05);
}

TEST_F(SlamNodeletTest, ServicesAreThoseOfHectorMapping) {
  ASSERT_TRUE(load());
  ASSERT_TRUE(drive(0, 10));
  const std::string ns = "/" + test_ + "/";
  nav_msgs::GetMap map;
  ASSERT_TRUE(call(ns + "dynamic_map", map));
  EXPECT_EQ(frame("map_frame"), map.response.map.header.frame_id);
  EXPECT_GT(std::count(map.response.map.data.begin(), map.response.map.data.end(), 100), 500);

  std_srvs::SetBool pause;
  pause.request.data = true;
  ASSERT_TRUE(call(ns + "pause_mapping", pause));
  EXPECT_TRUE(pause.response.success);
  step(10);
  expectDiagnostic("Scans", "Without a pose: paused", "1");
  EXPECT_EQ(10u, poses_.size());

  // Starts elsewhere, and goes on.
  ResetMapping restart;
  restart.request.initial_pose = toMessage(Pose(3.0, 1.0, 0.5));
  ASSERT_TRUE(call(ns + "restart_mapping_with_new_pose", restart));
  ASSERT_TRUE(drive(11, 12));
  EXPECT_LT((toPose(poses_.back().pose) - Pose(3.0, 1.0, 0.5)).norm(), 1e-6);

  std_srvs::Trigger reset;
  ASSERT_TRUE(call(ns + "reset_map", reset));
  EXPECT_TRUE(reset.response.success);
  ASSERT_TRUE(call(ns + "dynamic_map", map));
  EXPECT_EQ(0, std::count(map.response.map.data.begin(), map.response.map.data.end(), 100));
  ASSERT_TRUE(drive(12, 14));

  auto commands = node_.advertise<std_msgs::String>("syscommand", 1);
  ASSERT_TRUE(waitFor([&] { return commands.getNumSubscribers() > 0; }));
  std_msgs::String command;
  command.data = "reset";
  commands.publish(command);
  EXPECT_TRUE(waitFor([&] {
    return call(ns + "dynamic_map", map) &&
           std::count(map.response.map.data.begin(), map.response.map.data.end(), 100) == 0;
  }));

  ResetMapping nonsense;  // no orientation
  EXPECT_FALSE(call(ns + "restart_mapping_with_new_pose", nonsense));
}

// Only what changed is sent to the thread that publishes.
TEST_F(SlamNodeletTest, PublishesTheMapAsItIs) {
  setParam("map_size", 128);  // so that it grows
  Recorder<nav_msgs::OccupancyGrid> maps(node_, "map"), reflectivity(node_, "reflectivity_map");
  ASSERT_TRUE(load());
  const auto expectTheMap = [&] {
    const std::string ns = "/" + test_ + "/";
    nav_msgs::GetMap is;
    ASSERT_TRUE(call(ns + "dynamic_map", is));
    const nav_msgs::OccupancyGrid& map = is.response.map;
    // Scans that came since may have changed nothing, so that the stamps may be earlier ones.
    ASSERT_TRUE(waitFor([&] {
      return !maps.messages.empty() && !reflectivity.messages.empty() &&
             maps.messages.back().data == map.data &&
             reflectivity.messages.back().info == maps.messages.back().info;
    }));
    EXPECT_EQ(map.info.origin, maps.messages.back().info.origin);
    EXPECT_EQ(map.info.width, maps.messages.back().info.width);
    // What is hit is occupied.
    for (std::size_t i = 0; i < map.data.size(); ++i)
      ASSERT_TRUE(reflectivity.messages.back().data[i] < 0 || map.data[i] == 100) << i;
  };
  for (int i = 0; i < 40; i += 8) {
    ASSERT_TRUE(drive(i, i + 8));
    expectTheMap();
  }
  const auto shown = [&] {
    const auto& data = reflectivity.messages.back().data;
    return std::count_if(data.begin(), data.end(), [](int value) { return value > 0; });
  };
  EXPECT_GT(shown(), 500);
  std_srvs::Trigger reset;
  ASSERT_TRUE(call("/" + test_ + "/reset_map", reset));
  expectTheMap();
  EXPECT_TRUE(waitFor([&] { return shown() == 0; })) << shown();
  ASSERT_TRUE(drive(40, 42));
  expectTheMap();
}

TEST_F(SlamNodeletTest, MapsAreSavedAndLocalizedIn) {
  const mapping_common::TempDir dir;
  ASSERT_TRUE(load());
  ASSERT_TRUE(drive(0, 30));
  mapping_msgs::SaveMap save;
  save.request.path = dir.path("room.map");
  ASSERT_TRUE(call(name_ + "/save_map", save));
  EXPECT_TRUE(save.response.success) << save.response.message;
  save.request.path = "relative.map";
  ASSERT_TRUE(call(name_ + "/save_map", save));
  EXPECT_FALSE(save.response.success);
  mapping_msgs::LoadMap bad;
  bad.request.path = dir.write("bad.map", "nothing");
  ASSERT_TRUE(call(name_ + "/load_map", bad));
  EXPECT_FALSE(bad.response.success);
  ASSERT_TRUE(drive(30, 31));  // as if nothing had happened
  EXPECT_LT(errorAt(30), 0.03);
  unload();

  setParam("map_file", dir.path("room.map"));
  setParam("localization", true);
  ASSERT_TRUE(load());
  auto initial = node_.advertise<geometry_msgs::PoseWithCovarianceStamped>("initialpose", 1);
  ASSERT_TRUE(waitFor([&] { return initial.getNumSubscribers() > 0; }));
  geometry_msgs::PoseWithCovarianceStamped pose;
  pose.header.frame_id = frame("map_frame");
  pose.pose.pose = toMessage(bagPoseAt(2.0) + Pose(0.1, -0.1, 0.1));
  mapping_common::LogRecorder log(node_);
  ASSERT_TRUE(log.waitForLink());
  initial.publish(pose);
  ASSERT_TRUE(log.waitFor("The pose is set to"));
  ASSERT_TRUE(drive(20, 30));
  EXPECT_LT(errorAt(29), 0.03);
  expectDiagnostic("Map", "Updates", "1");
}

TEST_F(SlamNodeletTest, BadScansAreCountedAndChangeNothing) {
  ASSERT_TRUE(load());
  ASSERT_TRUE(drive(0, 5));
  double time = kBagStart + 0.5;
  const auto damaged = [&](const std::function<void(sensor_msgs::LaserScan&)>& damage) {
    sensor_msgs::LaserScan scan = roomMessage(bagPoseAt(0.5), ros::Time(time), 5);
    damage(scan);
    sendTransforms(time);
    send(scan, time);
    time += 0.02;
  };
  damaged([](auto& scan) { scan.ranges.clear(), scan.intensities.clear(); });
  damaged([](auto& scan) { scan.ranges.assign(361, std::numeric_limits<float>::infinity()); });
  damaged([](auto& scan) { scan.ranges.assign(361, std::nanf("")); });
  damaged([](auto& scan) { scan.angle_increment = 0.0F; });
  damaged([](auto& scan) {
    for (float& range : scan.ranges) range *= 1000.0F;
  });
  damaged([](auto& scan) {  // the inside of a barrel
    for (std::size_t i = 0; i < scan.ranges.size(); ++i) scan.ranges[i] = 0.6F + 1e-4F * (i % 7);
  });
  for (const double never : {4294967290.0, 4294967295.0})
    send(roomMessage(bagPoseAt(0.0), ros::Time(1.0), 5), never);
  expectDiagnostic("Scans", "Without a pose: empty", "3");
  expectDiagnostic("Scans", "Without a pose: malformed", "4");
  expectDiagnostic("Scans", "Without a pose: rejected", "1");
  ASSERT_TRUE(drive(7, 10));
  EXPECT_LT(errorAt(9), 0.03);
}

TEST_F(SlamNodeletTest, FindsItsPlaceInAMap) {
  const mapping_common::TempDir dir;
  ASSERT_TRUE(load());
  ASSERT_TRUE(drive(0, 40));
  const Pose room = roomInMap();
  mapping_msgs::SaveMap save;
  save.request.path = dir.path("room.map");
  ASSERT_TRUE(call(name_ + "/save_map", save));
  ASSERT_TRUE(save.response.success) << save.response.message;
  unload();
  setParam("map_file", dir.path("room.map"));
  setParam("localization", true);
  setParam("relocalize_at_start", true);
  poses_.clear();
  ASSERT_TRUE(load());
  const int next = driveUntil(60, 3);
  ASSERT_GE(poses_.size(), 3u);
  const auto errorOf = [&](const geometry_msgs::PoseStamped& pose) {
    const double time = (pose.header.stamp - ros::Time(kBagStart)).toSec();
    return (toPose(pose.pose) - compose(room, bagPoseAt(time))).head<2>().norm();
  };
  for (const auto& pose : poses_) EXPECT_LT(errorOf(pose), 0.05);

  std_srvs::Trigger relocalize;
  ASSERT_TRUE(call(name_ + "/relocalize", relocalize));
  EXPECT_TRUE(relocalize.response.success) << relocalize.response.message;
  EXPECT_NE(std::string::npos, relocalize.response.message.find("the pose is"))
      << relocalize.response.message;
  ASSERT_TRUE(drive(next, next + 5));
  EXPECT_LT(errorOf(poses_.back()), 0.05);
}

TEST_F(SlamNodeletTest, ScansThatArentAsTheySayAreUsedAndReported) {
  ASSERT_TRUE(load());
  ASSERT_TRUE(drive(0, 5));
  const auto damaged = [&](int i, const std::function<void(sensor_msgs::LaserScan&)>& damage) {
    sensor_msgs::LaserScan scan = roomMessage(bagPoseAt(0.1 * i), ros::Time(timeOf(i)), i);
    damage(scan);
    sendTransforms(timeOf(i));
    send(scan, timeOf(i));
    EXPECT_TRUE(waitFor([&] { return isAt(i); }));
    EXPECT_LT(errorAt(i), 0.03);
  };
  damaged(5, [](auto& scan) { scan.intensities.resize(3); });
  damaged(6, [](auto& scan) { scan.range_max = -1.0F; });
  damaged(7, [](auto& scan) { scan.time_increment = 0.1F; });
  damaged(8, [](auto& scan) {
    for (std::size_t i = 0; i < 60; ++i) scan.ranges[i] = 29.9F;
  });
  for (const char* field : {"intensities", "range_max", "time_increment", "ranges"})
    expectDiagnostic("Scans", std::string("Not as it says: ") + field, "1");
}

TEST_F(SlamNodeletTest, SurvivesWhateverArrives) {
  ASSERT_TRUE(load());
  ASSERT_TRUE(drive(0, 5));
  auto initial = node_.advertise<geometry_msgs::PoseWithCovarianceStamped>("initialpose", 10);
  auto commands = node_.advertise<std_msgs::String>("syscommand", 10);
  auto corrected = node_.advertise<mapping_msgs::CorrectedMap>("corrected_map", 10);
  const auto listen = [&] {
    return initial.getNumSubscribers() > 0 && commands.getNumSubscribers() > 0 &&
           corrected.getNumSubscribers() > 0;
  };
  ASSERT_TRUE(waitFor(listen));
  mapping_msgs::CorrectedMap empty;
  empty.header.frame_id = frame("map_frame");
  empty.correction.orientation.w = 1.0;
  MapOptions small;
  small.size = 64;
  const std::string bytes = MultiMap(small).toBytes();
  empty.data.assign(bytes.begin(), bytes.end());
  double time = kBagStart + 0.5;
  mapping_common::fuzz({frame("laser"), frame("other")}, [&](mapping_common::MessageFuzz& fuzz) {
    time += 0.01;
    switch (fuzz.pick<int>({0, 0, 0, 0, 1, 2, 3, 4})) {
      case 0: {
        sendTransforms(time);
        sensor_msgs::LaserScan scan = roomMessage(bagPoseAt(0.5), ros::Time(time), 5);
        scan.header.frame_id = frame("laser");
        fuzz.spoil(scan);
        return scans_.publish(scan);
      }
      case 1: {
        tf2_msgs::TFMessage message;
        message.transforms = {
            transformMessage(Pose::Zero(), frame("base_frame"), frame("other"), ros::Time(time))};
        fuzz.spoil(message);
        return tf_.publish(message);
      }
      case 2: {
        geometry_msgs::PoseWithCovarianceStamped pose;
        pose.header.frame_id = frame("map_frame");
        pose.pose.pose.orientation.w = 1.0;
        fuzz.spoil(pose);
        return initial.publish(pose);
      }
      case 3: {
        mapping_msgs::CorrectedMap map = empty;
        map.header.stamp = ros::Time(time);
        fuzz.spoil(map);
        return corrected.publish(map);
      }
      default: {
        std_msgs::String command;
        fuzz.spoil(command);
        return commands.publish(command);
      }
    }
  });
  expectQuiet("Scans", "Scans (Hz)");
  std_srvs::Trigger reset;
  ASSERT_TRUE(call("/" + test_ + "/reset_map", reset));
  // Time jumps back to where it was, and with it all transforms of the future are forgotten.
  send(roomMessage(bagPoseAt(0.0), ros::Time(2e9), 0), 2e9);
  for (int i = 10; i < 13; ++i) step(i);
  ASSERT_TRUE(call("/" + test_ + "/reset_map", reset));
  ASSERT_TRUE(drive(13, 14));
  poses_.erase(poses_.begin(), poses_.end() - 1);  // of another map
  ASSERT_TRUE(drive(14, 20));
  EXPECT_LT(errorAt(19), 0.03);
}

TEST_F(SlamNodeletTest, SaysThatTransformsAreMissing) {
  ASSERT_TRUE(load());
  for (int i = 0; i < 40; ++i) {
    send(roomMessage(bagPoseAt(0.0), ros::Time(1.0), i), kBagStart + 0.1 * i);
    spinFor(0.02);
  }
  EXPECT_TRUE(
      waitFor([&] { return std::stoi("0" + diagnostic("Scans", "Without a pose: no transform")) >= 5; }));
  expectDiagnostic("Scans", "Processed", "0");
}

TEST_F(SlamNodeletTest, ScansWhoseStampsStandDoNotPileUp) {
  setParam("scan_subscriber_queue_size", 2000);
  ASSERT_TRUE(load());
  sensor_msgs::LaserScan scan = roomMessage(bagPoseAt(0.0), ros::Time(1.0), 0);
  scan.ranges.resize(1);
  scan.intensities.resize(1);
  for (int i = 0; i < 1200; ++i) {  // there is no tf
    send(scan, kBagStart);
    if (i % 50 == 0) spinFor(0.02);
  }
  expectDiagnostic("Scans", "Without a pose: no transform", "200");
  expectDiagnostic("Scans", "Waiting for transforms", "1000");
}

TEST_F(SlamNodeletTest, GoesOnWhenTimeJumpsBack) {
  mapping_common::LogRecorder log(node_);
  ASSERT_TRUE(load());
  ASSERT_TRUE(log.waitForLink());
  ASSERT_TRUE(drive(0, 20));
  // From the start again: odometry knows where that is. One scan may just be late, the second tells, and may
  // be lost with the old transforms.
  step(0);
  step(1);
  ASSERT_TRUE(log.waitFor("Time jumped back"));
  ASSERT_TRUE(drive(2, 20));
  EXPECT_LT(errorAt(19), 0.03);
}

TEST_F(SlamNodeletTest, LateTransformsAreWaitedFor) {
  setParam("scan_subscriber_queue_size", 5);
  ASSERT_TRUE(load());
  sendTransforms(timeOf(0));
  for (int i = 0; i < 40; ++i) {  // four scans late, and all at once
    sendScan(i);
    spinFor(0.01);
    if (i % 4 != 3) continue;
    sendTransforms(timeOf(i));
    ASSERT_TRUE(waitFor([&] { return poses_.size() == i + 1u; })) << i << ": " << poses_.size();
  }
  for (std::size_t i = 1; i < 40; ++i) EXPECT_LT(poses_[i - 1].header.stamp, poses_[i].header.stamp);
  EXPECT_LT(errorAt(39), 0.03);
}

TEST_F(SlamNodeletTest, ScansBeforeAllTransformsDoNotHoldUpOthers) {
  ASSERT_TRUE(load());
  sendScan(0);
  spinFor(0.2);
  sendScan(1);
  spinFor(0.2);
  sendTransforms(timeOf(1));
  EXPECT_TRUE(waitFor([&] { return isAt(1); }));
}

TEST_F(SlamNodeletTest, OdometryMayComeLater) {
  odometry_ = false;
  tf2_ros::Buffer buffer;
  tf2_ros::TransformListener listener(buffer);
  ASSERT_TRUE(load());
  // The first scan waits for odometry, the others don't wait any more.
  int next = driveUntil(0, 1);
  EXPECT_GE(next, 6);
  ASSERT_TRUE(drive(next, next + 5));
  next += 5;
  // The listener may have found the nodelet late.
  while (next < 40 && !buffer.canTransform(frame("map_frame"), frame("odom_frame"), ros::Time(0))) {
    ASSERT_TRUE(drive(next, next + 1));
    ++next;
    spinFor(0.05);
  }
  expectDiagnostic("Scans", "Odometry", "none");
  ASSERT_TRUE(waitFor([&] {
    return buffer.canTransform(frame("map_frame"), frame("odom_frame"), ros::Time(timeOf(next - 1)));
  }));
  const auto odometry_frame = [&](double time) {
    return toPose(tf2::transformToEigen(
        buffer.lookupTransform(frame("map_frame"), frame("odom_frame"), ros::Time(time))));
  };
  EXPECT_LT((odometry_frame(timeOf(next - 1)) - compose(roomInMap(), bagPoseAt(0.1 * (next - 1)))).norm(),
            0.05);

  // Now it comes: the pose goes on as it was, and its frame is nowhere in between.
  odometry_ = true;
  sendOdometry(timeOf(next));
  spinFor(0.1);
  ASSERT_TRUE(drive(next, next + 5));
  EXPECT_LT(errorAt(next + 4), 0.03);
  expectDiagnostic("Scans", "Odometry", "used");
  ASSERT_TRUE(waitFor([&] {
    return buffer.canTransform(frame("map_frame"), frame("odom_frame"), ros::Time(timeOf(next + 4)));
  }));
  const Pose true_frame = compose(roomInMap(), between(kOdometryFrame, Pose::Zero()));
  EXPECT_LT((odometry_frame(timeOf(next) - 0.05) - true_frame).norm(), 0.1);
  EXPECT_LT((odometry_frame(timeOf(next + 4)) - true_frame).norm(), 0.1);

  // It ends: the body is followed, the frame of the odometry stays where it was.
  odometry_ = false;
  for (int i = next + 5; i < next + 15; ++i) {
    step(i);
    spinFor(0.02);
  }
  ASSERT_TRUE(waitFor([&] { return isAt(next + 14); }));
  ASSERT_TRUE(drive(next + 15, next + 20));
  EXPECT_LT(errorAt(next + 19), 0.03);
  EXPECT_FALSE(buffer.canTransform(frame("map_frame"), frame("odom_frame"), ros::Time(timeOf(next + 19))));
  // And comes again, from zero.
  odometry_ = true;
  odometry_frame_ = Pose(-1.0, -7.0, 2.0);
  ASSERT_TRUE(drive(next + 20, next + 25));
  EXPECT_LT(errorAt(next + 24), 0.03);
}

TEST_F(SlamNodeletTest, OdometryThatJumpsLeadsNowhere) {
  ASSERT_TRUE(load());
  ASSERT_TRUE(drive(0, 10));
  odometry_frame_ = Pose::Zero();
  ASSERT_TRUE(drive(10, 15));
  EXPECT_LT(errorAt(14), 0.03);
}

TEST_F(SlamNodeletTest, MapsWithPosesThatAreKnown) {
  setParam("map_with_known_poses", true);
  setParam("map_frame", frame("odom_frame"));
  setParam("start/x", 100.0);  // of no meaning
  Recorder<nav_msgs::OccupancyGrid> maps(node_, "map");
  ASSERT_TRUE(load());
  for (int i = 0; i < 20; ++i) {
    step(i);
    spinFor(0.02);
  }
  expectDiagnostic("Scans", "Processed", "20");
  expectDiagnostic("Scans", "Last scan", "given");
  EXPECT_TRUE(poses_.empty());
  // The column in the room is where the poses put it, and so much of it is seen.
  nav_msgs::GetMap map;
  ASSERT_TRUE(call("/" + test_ + "/dynamic_map", map));
  const auto& info = map.response.map.info;
  const auto value = [&](const Pose& in_room) {
    const Pose at = compose(kOdometryFrame, in_room);
    const auto column = static_cast<std::size_t>((at.x() - info.origin.position.x) / info.resolution);
    const auto row = static_cast<std::size_t>((at.y() - info.origin.position.y) / info.resolution);
    int greatest = -1;
    for (const std::size_t r : {row - 1, row, row + 1}) {
      for (const std::size_t c : {column - 1, column, column + 1}) {
        greatest = std::max<int>(greatest, map.response.map.data.at(r * info.width + c));
      }
    }
    return greatest;
  };
  EXPECT_EQ(100, value({2.0, -0.8, 0.0}));
  EXPECT_EQ(100, value({4.25, 0.0, 0.0}));
  EXPECT_EQ(0, value({1.0, 0.5, 0.0}));
  EXPECT_EQ(-1, value({4.5, 0.0, 0.0}));
}

TEST_F(SlamNodeletTest, FramesMayBeginWithASlash) {
  setParam("base_frame", "/" + frame("base_frame"));
  setParam("map_frame", "/" + frame("map_frame"));
  setParam("odom_frame", "/" + frame("odom_frame"));
  ASSERT_TRUE(load());
  for (int i = 0; i < 5; ++i) {
    sendTransforms(timeOf(i));
    sensor_msgs::LaserScan scan = roomMessage(bagPoseAt(0.1 * i), ros::Time(timeOf(i)), i);
    scan.header.frame_id = "/" + frame("laser");
    scans_.publish(scan);
  }
  ASSERT_TRUE(waitFor([&] { return poses_.size() == 5; }));
  EXPECT_EQ(frame("map_frame"), poses_.back().header.frame_id);
}

TEST_F(SlamNodeletTest, ReconfiguresWhileItRuns) {
  ASSERT_TRUE(load());
  ASSERT_TRUE(drive(0, 3));
  const auto reconfigure = [this](const std::string& cost) {
    dynamic_reconfigure::Reconfigure service;
    dynamic_reconfigure::StrParameter parameter;
    parameter.name = "cost";
    parameter.value = cost;
    service.request.config.strs.push_back(parameter);
    EXPECT_TRUE(ros::service::call(name_ + "/set_parameters", service));
    for (const auto& value : service.response.config.strs) {
      if (value.name == "cost") return value.value;
    }
    return std::string();
  };
  EXPECT_EQ("reflectivity", reconfigure("reflectivity"));
  ASSERT_TRUE(drive(3, 8));
  expectDiagnostic("Scans", "Last cost", "reflectivity");
  EXPECT_EQ("reflectivity", reconfigure("nonsense"));
  ASSERT_TRUE(drive(8, 10));
  EXPECT_LT(errorAt(9), 0.03);
}

TEST_F(SlamNodeletTest, BadParametersStopIt) {
  setParam("map_resolution", -1.0);
  EXPECT_FALSE(load());
  setParam("map_resolution", 0.05);
  setParam("map_resolutoin", 0.05);
  EXPECT_FALSE(load());
  ros::param::del(name_ + "/map_resolutoin");
  setParam("map_file", std::string("/nowhere/a.map"));
  EXPECT_FALSE(load());
  ros::param::del(name_ + "/map_file");
  EXPECT_TRUE(load());
}

}  // namespace
}  // namespace intensity_hector_slam

int main(int argc, char** argv) {
  ::testing::InitGoogleTest(&argc, argv);
  ros::init(argc, argv, "test_slam_nodelet");
  ros::NodeHandle keep_alive;
  return RUN_ALL_TESTS();
}
