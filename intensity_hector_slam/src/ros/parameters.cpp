// SPDX-License-Identifier: BSD-3-Clause
#include "intensity_hector_slam/ros/parameters.h"

#include <mapping_common/transform_queue.h>

#include <stdexcept>

namespace intensity_hector_slam {

void SlamParameters::describe(mapping_common::OptionList& o) {
  o.section("frames");
  o("base_frame", base_frame, "", "the body, whose pose is estimated").notEmpty();
  o("odom_frame", odom_frame, "",
    "fixed frame of the odometry; the same as base_frame: there is no odometry, and the transform published "
    "is map_frame "
    "-> base_frame. Where tf doesn't have it, mapping goes on without, and it is published where the body is")
      .notEmpty();
  o("map_frame", map_frame, "", "fixed frame of the map").notEmpty();
  o("start/x", start.x(), "m", "pose of the body in the map at the start, and after reset_map")
      .within(-1e6, 1e6);
  o("start/y", start.y(), "m", "the same").within(-1e6, 1e6);
  o("start/yaw", start.z(), "rad", "the same").within(-6.3, 6.3);
  slam.describe(o);
  o.section("loops");
  o("loops", loops, "",
    "true: key poses where a place is seen again are sought among the earlier ones, and published as edges");
  o("follow_loops", follow_loops, "",
    "true: after a loop that has the pose elsewhere in the map, SLAM goes on there, where nobody publishes "
    "corrected_map. Edges aren't of that jump. It keeps the map of a place from being drawn twice, and "
    "leaves what was "
    "drawn between as it is");
  loop.describe(o);
  o.section("poses of others");
  o("use_tf_pose_start_estimate", use_tf_pose_start_estimate, "",
    "false: constant_velocity instead of odometry, as in hector_mapping's launch file");
  o("map_with_known_poses", map_with_known_poses, "",
    "true: nothing is matched, tf map_frame -> base_frame of somebody else is the pose, and none is "
    "published");
  o.section("scan");
  o("scan_topic", scan_topic, "",
    "sensor_msgs/LaserScan; scan_reflectivity for that of laser_intensity_calib")
      .notEmpty();
  o("scan_subscriber_queue_size", scan_subscriber_queue_size, "",
    "scans that wait while others are processed; the oldest is dropped")
      .within(1, 10000);
  o("transform_timeout", transform_timeout, "s",
    "that a scan waits for transforms, by the stamps of later ones: more than odometry is late")
      .within(0.0, 10.0);
  o("use_tf_scan_transformation", use_tf_scan_transformation, "",
    "false: the scanner is at the origin of base_frame");
  scan.describe(o);
  o.section("output");
  o("map_file", map_file, "", "path of a map to go on with; its resolution and levels replace those above");
  o("relocalize_at_start", relocalize_at_start, "",
    "true: where the body is in map_file at the start is sought in all of it, and scans are rejected until a "
    "place is "
    "sure; false: it is at start/x, start/y, start/yaw");
  o("corrected_map_memory", corrected_map_memory, "MiB",
    "while somebody publishes corrected_map: of the last scans that went into the map, which are put into a "
    "corrected one where that lacks them; what exceeds this is lost then, with a warning")
      .within(0.0, 1e5);
  o("save_on_shutdown", save_on_shutdown, "", "path that the map is written to at the end. Empty: don't");
  o("pub_map_odom_transform", pub_map_odom_transform, "", "tf map_frame -> odom_frame");
  o("pub_map_scanmatch_transform", pub_map_scanmatch_transform, "",
    "tf map_frame -> tf_map_scanmatch_transform_frame_name: the pose itself");
  o("tf_map_scanmatch_transform_frame_name", tf_map_scanmatch_transform_frame_name, "", "its frame")
      .notEmpty();
  o("pub_odometry", pub_odometry, "", "true: the pose as nav_msgs/Odometry on scanmatch_odom, too");
  o("pose_update_topic", pose_update_topic, "", "of the pose with its covariance").notEmpty();
  o("sys_msg_topic", sys_msg_topic, "", "std_msgs/String; \"reset\" starts again").notEmpty();
  o("advertise_map_service", advertise_map_service, "", "dynamic_map");
  o("output_timing", output_timing, "", "true: logs what became of each scan, and the time that it took");
  o("pub_drawings", pub_drawings, "", "hector_mapping's, does nothing here but say what there is instead");
  o("pub_debug_output", pub_debug_output, "", "the same");
  o("map_pub_period", map_pub_period, "s", "between maps at least").within(0.01, 1e6).dynamic();
  o("key_pose_distance", key_pose_distance, "m", "between key poses: path and edges").within(0.001, 10000.0);
  o("key_pose_angle", key_pose_angle, "rad", "or turned").within(0.001, 10000.0);
  o("edge_drift_distance", drift.distance, "m",
    "standard deviation that an edge has after one metre, beyond that of the matches: of what builds up "
    "while the "
    "map grows. It grows with the square root of the way")
      .within(0.0, 10.0);
  o("edge_drift_angle", drift.angle, "rad", "the same of the angle").within(0.0, 1.0);
  o("edge_drift_turn", drift.turn, "rad", "the same, after a turn of one rad").within(0.0, 1.0);
  o.require(!mapping_common::withoutSlash(base_frame).empty(), "base_frame", "a name");
  o.require(!mapping_common::withoutSlash(odom_frame).empty(), "odom_frame", "a name");
  o.require(!mapping_common::withoutSlash(map_frame).empty(), "map_frame", "a name");
}

void SlamParameters::resolve() {
  if (slam.localization && map_file.empty())
    throw std::invalid_argument("~localization is true, allowed is false without a map_file");
  if (relocalize_at_start && map_file.empty())
    throw std::invalid_argument("~relocalize_at_start is true, allowed is false without a map_file");
  for (std::string* frame : {&base_frame, &odom_frame, &map_frame})
    *frame = mapping_common::withoutSlash(*frame);
  if (!use_tf_pose_start_estimate && slam.guess == Guess::kOdometry) slam.guess = Guess::kConstantVelocity;
}

std::vector<std::string> SlamParameters::warnings() const {
  std::vector<std::string> warnings;
  if (pub_drawings) {
    warnings.push_back(
        "~pub_drawings does nothing: the topics path and edges show the way, config/slam.rviz all");
  }
  if (pub_debug_output) {
    warnings.push_back(
        "~pub_debug_output does nothing: what became of the scans is in /diagnostics, and ~output_timing "
        "logs it");
  }
  return warnings;
}

}  // namespace intensity_hector_slam
