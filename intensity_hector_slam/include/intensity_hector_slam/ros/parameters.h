// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <intensity_hector_slam/key_poses.h>
#include <intensity_hector_slam/options.h>
#include <intensity_hector_slam/pose.h>
#include <intensity_hector_slam/ros/scan_conversion.h>

#include <string>
#include <vector>

namespace intensity_hector_slam {

/// What the nodelet and the bag runner are started with. Names are those of hector_mapping where it has the
/// like.
struct SlamParameters {
  SlamOptions slam;
  ScanLimits scan;
  bool loops = true, follow_loops = false;
  LoopOptions loop;
  Pose start = Pose::Zero();
  double key_pose_distance = 0.5, key_pose_angle = 0.5;
  Drift drift = {0.02, 0.004, 0.02};

  std::string base_frame = "base_link", odom_frame = "odom", map_frame = "map";
  std::string scan_topic = "scan", sys_msg_topic = "syscommand", pose_update_topic = "poseupdate";
  std::string tf_map_scanmatch_transform_frame_name = "scanmatcher_frame";
  bool use_tf_scan_transformation = true, use_tf_pose_start_estimate = true;
  bool map_with_known_poses = false;
  bool pub_map_odom_transform = true, pub_map_scanmatch_transform = true, pub_odometry = false;
  bool advertise_map_service = true, output_timing = false;
  bool pub_drawings = false, pub_debug_output = false;
  int scan_subscriber_queue_size = 5;
  double transform_timeout = 0.5;
  double map_pub_period = 2.0;
  std::string map_file, save_on_shutdown;
  bool relocalize_at_start = false;
  double corrected_map_memory = 64.0;  ///< MiB

  void describe(mapping_common::OptionList& o);

  /// Whether odometry is the first guess, where it is there.
  bool usesOdometry() const { return slam.guess == Guess::kOdometry && odom_frame != base_frame; }
  /// On parameters of hector_mapping that do nothing here.
  std::vector<std::string> warnings() const;
  /// To be called once they are read. Does what hector_mapping's names ask for: no slash before frames, the
  /// guess.
  /// @throws std::invalid_argument where there is no map to localize in
  void resolve();
};

}  // namespace intensity_hector_slam
