// SPDX-License-Identifier: BSD-3-Clause
//
// The nodelet goes on in a map that was made anew, and nothing that came meanwhile is missing.
#include <mapping_common/testing/corrected_map_faults.h>
#include <mapping_common/testing/nodelet_test.h>
#include <mapping_common/testing/temp_dir.h>
#include <mapping_msgs/CorrectedMap.h>
#include <mapping_msgs/EdgeConstraint.h>
#include <mapping_msgs/SaveMap.h>
#include <std_srvs/Trigger.h>
#include <tf2_ros/buffer.h>
#include <tf2_ros/transform_listener.h>

#include <cmath>
#include <map>

#include "room_drive.h"

namespace intensity_hector_slam {
namespace {

using mapping_common::Recorder;
using mapping_common::spinFor;
using mapping_common::waitFor;

constexpr int kLast = 19;  // scan in the corrected map
const Pose kCorrection(0.6, -0.4, 0.3);

class MapCorrection : public mapping_common::NodeletTest, protected RoomDrive {
 protected:
  MapCorrection() : NodeletTest("intensity_hector_slam/SlamNodelet", "slam"), RoomDrive(test_) {
    for (const char* frame : {"base_frame", "odom_frame", "map_frame"}) setParam(frame, test_ + "_" + frame);
    setParam("tf_map_scanmatch_transform_frame_name", test_ + "_scanmatcher_frame");
    setParam("reflectivity_scale", 0.001);
    setParam("scan_subscriber_queue_size", 20);
    // Each scan goes into the map at the pose that is published.
    setParam("deskew", false);
    setParam("map_update_distance_thresh", 0.0);
    setParam("map_update_period", 0.0);
  }
  void start() {
    ASSERT_TRUE(NodeletTest::load() && waitForNode() && mapping_common::waitForLink(tf_));
    ASSERT_TRUE(waitFor([this] { return corrected_.getNumSubscribers() > 0; }));
    ASSERT_TRUE(mapping_common::waitForLink(corrected_));
  }

  // Of the scans up to one, at the corrected poses that they had.
  MultiMap mapOf(int last) const {
    MapOptions options;
    MultiMap map(options);
    ScanLimits limits;
    limits.reflectivity_scale = 0.001;
    std::map<double, Pose> poses;
    for (const auto& pose : poses_) poses[pose.header.stamp.toSec()] = toPose(pose.pose);
    for (const auto& [time, pose] : poses) {
      const int i = static_cast<int>(std::lround(10.0 * (time - kBagStart)));
      if (i > last) break;
      const auto message = roomMessage(bagPoseAt(0.1 * i), ros::Time(time), i);
      map.update(toScan(message, toIsometry(kMount), limits), compose(kCorrection, pose));
    }
    return map;
  }
  mapping_msgs::CorrectedMap messageOf(const MultiMap& map) const {
    mapping_msgs::CorrectedMap message;
    message.header.stamp = ros::Time(timeOf(kLast));
    message.header.frame_id = frame("map_frame");
    message.correction = toMessage(kCorrection);
    const std::string bytes = map.toBytes();
    message.data.assign(bytes.begin(), bytes.end());
    return message;
  }
  MultiMap map() {
    mapping_msgs::SaveMap save;
    save.request.path = dir_.path("slam.map");
    EXPECT_TRUE(ros::service::call(name_ + "/save_map", save) && save.response.success);
    return MultiMap::load(save.request.path);
  }
  // Share of the known cells of either that aren't alike.
  static double difference(const MultiMap& a, const MultiMap& b) {
    const GridMap &x = a.level(0), &y = b.level(0);
    std::size_t known = 0, differ = 0;
    const Eigen::AlignedBox2i box = x.knownCells().merged(y.knownCells());
    for (int row = box.min().y(); row <= box.max().y(); ++row) {
      for (int column = box.min().x(); column <= box.max().x(); ++column) {
        const GridMap::Cell &cell = x.cell(column, row), &other = y.cell(column, row);
        known += GridMap::isKnown(cell) || GridMap::isKnown(other);
        differ += std::abs(other.occupancy - cell.occupancy) > 1e-3F ||
                  std::abs(other.reflectivity - cell.reflectivity) > 1e-3F;
      }
    }
    return static_cast<double>(differ) / static_cast<double>(known);
  }

  using NodeletTest::node_;
  const mapping_common::TempDir dir_;
  ros::Publisher corrected_ = node_.advertise<mapping_msgs::CorrectedMap>("corrected_map", 10);
};

TEST_F(MapCorrection, MappingGoesOnInACorrectedMap) {
  Recorder<mapping_msgs::EdgeConstraint> edges(node_, "edges");
  tf2_ros::Buffer buffer;
  tf2_ros::TransformListener listener(buffer);
  start();
  ASSERT_TRUE(drive(0, 30));
  const Pose to_map = compose(kCorrection, roomInMap());
  const MultiMap without = mapOf(kLast), all = mapOf(29);
  corrected_.publish(messageOf(without));
  expectDiagnostic("Map", "Corrected maps taken", "1");
  EXPECT_LT(difference(all, map()), 1e-3);
  EXPECT_GT(difference(all, without), 0.2);

  edges.messages.clear();
  for (int i = 30; i < 50; ++i) {
    ASSERT_TRUE(drive(i, i + 1));
    const Pose error = between(compose(to_map, bagPoseAt(0.1 * i)), toPose(poses_.back().pose));
    EXPECT_LT(error.head<2>().norm(), 0.03) << i;
    EXPECT_LT(std::abs(error.z()), 0.01) << i;
  }
  EXPECT_EQ("0", diagnostic("Scans", "Without a pose: rejected"));
  ASSERT_TRUE(waitFor([&] { return !edges.messages.empty(); }));
  const auto& edge = edges.messages.front();
  EXPECT_LT(edge.from_stamp.toSec(), timeOf(30)) << "from the last key pose before";
  const Pose moved =
      between(bagPoseAt(edge.from_stamp.toSec() - kBagStart), bagPoseAt(edge.to_stamp.toSec() - kBagStart));
  EXPECT_LT((toPose(edge.transform) - moved).norm(), 0.04);
  // odom -> base_frame is smooth, so map -> odom has jumped.
  const ros::Time stamp(timeOf(49));
  ASSERT_TRUE(waitFor([&] { return buffer.canTransform(frame("map_frame"), frame("odom_frame"), stamp); }));
  const auto odom = buffer.lookupTransform(frame("map_frame"), frame("odom_frame"), stamp);
  const Pose expected = compose(to_map, between(odometry_frame_, Pose::Zero()));
  EXPECT_LT((toPose(tf2::transformToEigen(odom)) - expected).norm(), 0.1);
}

TEST_F(MapCorrection, OthersAreRefusedAndTheMapStays) {
  start();
  ASSERT_TRUE(drive(0, 25));
  const MultiMap before = map();
  int refused = 0;
  const auto expectRefused = [&](const mapping_msgs::CorrectedMap& message) {
    corrected_.publish(message);
    expectDiagnostic("Map", "Corrected maps refused", std::to_string(++refused));
    EXPECT_EQ(0.0, difference(before, map()));
  };
  for (const auto& faulty : mapping_common::faultyCopies(messageOf(mapOf(kLast)))) expectRefused(faulty);
  MapOptions options;
  options.resolution = 0.05;
  expectRefused(messageOf(MultiMap(options)));
  options = {};
  options.levels = 2;
  expectRefused(messageOf(MultiMap(options)));
  expectDiagnostic("Map", "Corrected maps taken", "0");
  ASSERT_TRUE(drive(25, 27));
  EXPECT_LT(errorAt(26), 0.03);
}

TEST_F(MapCorrection, WhatFellOutIsSaid) {
  setParam("corrected_map_memory", 0.02);  // about five scans
  mapping_common::LogRecorder log(node_);
  start();
  ASSERT_TRUE(log.waitForLink());
  ASSERT_TRUE(drive(0, 30));
  corrected_.publish(messageOf(mapOf(kLast)));
  EXPECT_TRUE(log.waitFor("corrected map lacks scans"));
  ASSERT_TRUE(drive(30, 32));
}

}  // namespace
}  // namespace intensity_hector_slam

int main(int argc, char** argv) {
  testing::InitGoogleTest(&argc, argv);
  ros::init(argc, argv, "test_map_correction");
  ros::NodeHandle keep_alive;
  return RUN_ALL_TESTS();
}
