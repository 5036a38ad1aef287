// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <intensity_hector_slam/options.h>
#include <intensity_hector_slam/pose.h>
#include <intensity_hector_slam/ros/scan_conversion.h>
#include <mapping_common/parameters.h>
#include <xmlrpcpp/XmlRpcValue.h>

#include <string>
#include <vector>

namespace intensity_hector_slam {

/// What the nodelet and the bag runner are started with; config/slam.yaml explains each.
struct SlamParameters {
  SlamOptions slam;
  ScanLimits scan;
  Pose start = Pose::Zero();
  double key_pose_distance = 0.5;  ///< m
  double key_pose_angle = 0.5;     ///< rad

  std::string base_frame = "base_link", odom_frame = "odom", map_frame = "map";
  std::string scan_topic = "scan", sys_msg_topic = "syscommand", pose_update_topic = "poseupdate";
  std::string tf_map_scanmatch_transform_frame_name = "scanmatcher_frame";
  bool use_tf_scan_transformation = true;
  bool map_with_known_poses = false;
  bool pub_map_odom_transform = true, pub_map_scanmatch_transform = true, pub_odometry = false;
  bool advertise_map_service = true, output_timing = false;
  int scan_subscriber_queue_size = 5;
  double transform_timeout = 0.5;  ///< s
  double map_pub_period = 2.0;     ///< s
  std::string map_file, save_on_shutdown;
  std::vector<std::string> warnings;  ///< on parameters of hector_mapping that do nothing here

  /// Whether odometry is the first guess, where it is there.
  bool usesOdometry() const { return slam.guess == Guess::kOdometry && odom_frame != base_frame; }
};

/// @throws std::invalid_argument that names the parameter, its value and the allowed range
SlamParameters readSlamParameters(mapping_common::Parameters& parameters);

/// A YAML file as rosparam would load it.
/// @throws std::runtime_error that names the file and the line
XmlRpc::XmlRpcValue loadYaml(const std::string& path);

}  // namespace intensity_hector_slam
