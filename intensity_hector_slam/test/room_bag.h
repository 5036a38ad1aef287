// SPDX-License-Identifier: BSD-3-Clause
//
// A recording of a drive in a room: scan, tf of odometry and mounting, odometry as messages.
#pragma once

#include <nav_msgs/Odometry.h>
#include <rosbag/bag.h>
#include <sensor_msgs/LaserScan.h>
#include <tf2_eigen/tf2_eigen.h>
#include <tf2_msgs/TFMessage.h>

#include <limits>
#include <string>

#include "flat_world.h"
#include "intensity_hector_slam/ros/map_conversion.h"
#include "intensity_hector_slam/ros/scan_conversion.h"

namespace intensity_hector_slam {

constexpr double kBagStart = 1000.0;  // s
const Pose kMount(0.2, 0.1, 0.3);     // of the scanner in base_link
const Pose kOdometryFrame(5.0, 2.0, 1.0);

inline Pose bagPoseAt(double time) {
  return {1.2 * std::sin(0.4 * time), 1.2 - 1.2 * std::cos(0.4 * time), 0.4 * time};
}

inline sensor_msgs::LaserScan roomMessage(const Pose& base, const ros::Time& stamp, unsigned seed) {
  Scanner scanner;
  scanner.beams = 361;
  scanner.range_noise = 0.005;
  scanner.reflectivity_noise = 0.02;
  std::vector<Wall> walls = furnishedRoom();
  const Scan scan = look(walls, compose(base, kMount), scanner, seed);
  sensor_msgs::LaserScan message;
  message.header.stamp = stamp;
  message.header.frame_id = "laser";
  message.angle_min = static_cast<float>(scanner.angle_min);
  message.angle_max = static_cast<float>(scanner.angle_max);
  message.angle_increment = static_cast<float>((scanner.angle_max - scanner.angle_min) / (scanner.beams - 1));
  message.range_min = 0.1F;
  message.range_max = 30.0F;
  message.ranges.assign(scanner.beams, std::numeric_limits<float>::infinity());
  message.intensities.assign(scanner.beams, 0.0F);
  for (std::size_t i = 0; i < scan.points.size(); ++i) {
    const double angle = std::atan2(scan.points[i].y(), scan.points[i].x());
    const auto beam = std::lround((angle - message.angle_min) / message.angle_increment);
    message.ranges[beam] = scan.points[i].norm();
    message.intensities[beam] = 1000.0F * scan.reflectivities[i];
  }
  return message;
}

inline geometry_msgs::TransformStamped transformMessage(const Pose& pose, const std::string& parent,
                                                        const std::string& child, const ros::Time& stamp) {
  geometry_msgs::TransformStamped message = tf2::eigenToTransform(toIsometry(pose));
  message.header.frame_id = parent;
  message.header.stamp = stamp;
  message.child_frame_id = child;
  return message;
}

/// @param tf whether the transforms are in it
inline void writeRoomBag(const std::string& path, int scans, bool tf = true) {
  rosbag::Bag bag(path, rosbag::bagmode::Write);
  for (int i = 0; i < scans; ++i) {
    const double time = 0.1 * i;
    const ros::Time stamp(kBagStart + time);
    const Pose base = bagPoseAt(time);
    tf2_msgs::TFMessage transforms;
    transforms.transforms = {transformMessage(compose(kOdometryFrame, base), "odom", "base_link", stamp),
                             transformMessage(kMount, "base_link", "laser", stamp)};
    if (tf) bag.write("/tf", stamp, transforms);
    nav_msgs::Odometry odometry;
    odometry.header = transforms.transforms[0].header;
    odometry.header.frame_id = "wheels";
    odometry.child_frame_id = "base_link";
    odometry.pose.pose = toMessage(compose(kOdometryFrame, base));
    bag.write("/odom", stamp, odometry);
    bag.write("/scan", stamp, roomMessage(base, stamp, i));
  }
}

}  // namespace intensity_hector_slam
