// SPDX-License-Identifier: BSD-3-Clause
//
// A drive in a room, before a node that is running.
#pragma once

#include <geometry_msgs/PoseStamped.h>
#include <mapping_common/testing/nodelet_test.h>
#include <ros/ros.h>

#include <string>
#include <vector>

#include "room_bag.h"

namespace intensity_hector_slam {

class RoomDrive {
 protected:
  /// Topics are in `name_space`, frames begin with its name.
  explicit RoomDrive(const std::string& name_space)
      : name_space_(name_space),
        node_("/" + name_space),
        pose_subscriber_(node_.subscribe("slam_out_pose", 100, &RoomDrive::gotPose, this)),
        scans_(node_.advertise<sensor_msgs::LaserScan>("scan", 100)),
        tf_(node_.advertise<tf2_msgs::TFMessage>("/tf", 100)) {}

  std::string frame(const std::string& name) const { return name_space_ + "_" + name; }
  bool waitForNode() const {
    return mapping_common::waitFor([this] {
      return scans_.getNumSubscribers() > 0 && tf_.getNumSubscribers() > 0 &&
             pose_subscriber_.getNumPublishers() > 0;
    });
  }

  void send(sensor_msgs::LaserScan scan, double time) {
    scan.header.stamp = ros::Time(time);
    scan.header.frame_id = frame("laser");
    scans_.publish(scan);
  }
  void sendTransform(const Pose& pose, const std::string& parent, const std::string& child, double time) {
    tf2_msgs::TFMessage message;
    message.transforms = {transformMessage(pose, frame(parent), frame(child), ros::Time(time))};
    tf_.publish(message);
  }
  void sendOdometry(double time) {
    sendTransform(compose(odometry_frame_, bagPoseAt(time - kBagStart)), "odom_frame", "base_frame", time);
  }
  void sendTransforms(double time) {
    sendTransform(kMount, "base_frame", "laser", time);
    if (odometry_) sendOdometry(time);
  }
  static double timeOf(int i) { return kBagStart + 0.1 * i; }
  void sendScan(int i) { send(roomMessage(bagPoseAt(0.1 * i), ros::Time(timeOf(i)), i), timeOf(i)); }
  void step(int i) {
    sendTransforms(timeOf(i));
    sendScan(i);
  }
  /// Drives on from scan to scan. @return whether there was a pose for each
  bool drive(int from, int to) {
    for (int i = from; i < to; ++i) {
      step(i);
      if (!mapping_common::waitFor([&] { return isAt(i); })) return false;
    }
    return true;
  }
  /// Drives on without waiting until there are so many poses: the node may hear late of this test's
  /// transforms, or wait for odometry. @return the next scan
  int driveUntil(int from, std::size_t poses) {
    int next = from;
    for (; next < from + 100 && poses_.size() < poses; ++next) {
      step(next);
      mapping_common::spinFor(0.02);
    }
    return next;
  }
  bool isAt(int i) const { return !poses_.empty() && poses_.back().header.stamp == ros::Time(timeOf(i)); }
  /// The map begins where the first scan was that had transforms.
  Pose roomInMap() const {
    const double time = (poses_.front().header.stamp - ros::Time(kBagStart)).toSec();
    return compose(toPose(poses_.front().pose), between(bagPoseAt(time), Pose::Zero()));
  }
  double errorAt(int i) const {
    return (toPose(poses_.back().pose) - compose(roomInMap(), bagPoseAt(0.1 * i))).head<2>().norm();
  }

  void gotPose(const geometry_msgs::PoseStamped& pose) { poses_.push_back(pose); }

  const std::string name_space_;
  ros::NodeHandle node_;
  ros::Subscriber pose_subscriber_;
  std::vector<geometry_msgs::PoseStamped> poses_;
  ros::Publisher scans_, tf_;
  bool odometry_ = true;
  Pose odometry_frame_ = kOdometryFrame;  // the room's origin in the frame of the odometry
};

}  // namespace intensity_hector_slam
