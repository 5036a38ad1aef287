// SPDX-License-Identifier: BSD-3-Clause
#include "intensity_hector_slam/ros/parameters.h"

#include <mapping_common/transform_queue.h>
#include <yaml-cpp/yaml.h>

#include <algorithm>
#include <stdexcept>

namespace intensity_hector_slam {
namespace {

XmlRpc::XmlRpcValue toXmlRpc(const YAML::Node& node) {
  XmlRpc::XmlRpcValue value;
  if (node.IsMap()) {
    for (const auto& member : node) value[member.first.as<std::string>()] = toXmlRpc(member.second);
    return value;
  }
  bool flag = false;
  int whole = 0;
  double number = 0.0;
  if (node.Tag() == "!") return XmlRpc::XmlRpcValue(node.as<std::string>());  // quoted
  if (YAML::convert<bool>::decode(node, flag)) return XmlRpc::XmlRpcValue(flag);
  if (YAML::convert<int>::decode(node, whole)) return XmlRpc::XmlRpcValue(whole);
  if (YAML::convert<double>::decode(node, number)) return XmlRpc::XmlRpcValue(number);
  return XmlRpc::XmlRpcValue(node.as<std::string>());
}

// Parameters have the names that the options' checks know them by.
void readMap(mapping_common::Parameters& p, MapOptions& o) {
  o.resolution = p.get("map_resolution", o.resolution, 0.001, 10.0);
  o.levels = p.get("map_multi_res_levels", o.levels, 1, 10);
  o.size_x = o.size_y = o.resolution * p.get("map_size", 1024, 2 << o.levels, 1 << 15);
  o.start_x = p.get("map_start_x", o.start_x);
  o.start_y = p.get("map_start_y", o.start_y);
  o.grow = p.get("map_grow", o.grow);
  o.max_size = std::max(p.get("max_size", o.max_size), o.size_x);
  o.update_factor_free = p.get("update_factor_free", o.update_factor_free);
  o.update_factor_occupied = p.get("update_factor_occupied", o.update_factor_occupied);
  o.clear_margin = p.get("clear_margin", o.clear_margin);
  o.sure_free = p.get("sure_free", o.sure_free);
  o.min_probability = p.get("min_probability", o.min_probability);
  o.max_probability = p.get("max_probability", o.max_probability);
  o.max_count = p.get("max_count", o.max_count);
}

void readMatcher(mapping_common::Parameters& p, MatcherOptions& o) {
  o.cost = parseCost(p.get<std::string>("cost", "combined"));
  o.occupancy_weight = p.get("occupancy_weight", o.occupancy_weight);
  o.reflectivity_weight = p.get("reflectivity_weight", o.reflectivity_weight);
  o.robust_kernel = parseRobustKernel(p.get<std::string>("robust_kernel", "cauchy"));
  o.robust_scale = p.get("robust_scale", o.robust_scale);
  o.max_iterations = p.get("max_iterations", o.max_iterations);
  o.max_halvings = p.get("max_halvings", o.max_halvings);
  o.max_step_distance = p.get("max_step_distance", o.max_step_distance);
  o.max_step_angle = p.get("max_step_angle", o.max_step_angle);
  o.min_step_distance = p.get("min_step_distance", o.min_step_distance);
  o.min_step_angle = p.get("min_step_angle", o.min_step_angle);
  o.coarse_step = p.get("coarse_step", o.coarse_step);
  o.coarse_spacing = p.get("coarse_spacing", o.coarse_spacing);
  o.min_cost_change = p.get("min_cost_change", o.min_cost_change);
  o.coarse_points = p.get("coarse_points", o.coarse_points);
  o.surface_length = p.get("surface_length", o.surface_length);
  o.min_observability = p.get("min_observability", o.min_observability);
  o.min_texture = p.get("min_texture", o.min_texture);
  o.min_geometry = p.get("min_geometry", o.min_geometry);
  o.auto_max_spacing = p.get("auto_max_spacing", o.auto_max_spacing);
  o.auto_min_known = p.get("auto_min_known", o.auto_min_known);
  o.sigma = p.get("sigma", o.sigma);
  o.covariance_scale = p.get("covariance_scale", o.covariance_scale);
  o.covariance_floor = p.get("covariance_floor", o.covariance_floor);
  o.unobservable_distance = p.get("unobservable_distance", o.unobservable_distance);
  o.unobservable_angle = p.get("unobservable_angle", o.unobservable_angle);
  o.search = parseSearch(p.get<std::string>("search", "when_unsure"));
  o.search_gap = p.get("search_gap", o.search_gap);
  o.search_motion_distance = p.get("search_motion_distance", o.search_motion_distance);
  o.search_motion_angle = p.get("search_motion_angle", o.search_motion_angle);
  o.search_contradiction = p.get("search_contradiction", o.search_contradiction);
  o.search_min_gain = p.get("search_min_gain", o.search_min_gain);
  o.search_distance = p.get("search_distance", o.search_distance);
  o.search_angle = p.get("search_angle", o.search_angle);
  o.search_points = p.get("search_points", o.search_points);
}

void readSlam(mapping_common::Parameters& p, SlamOptions& o) {
  readMap(p, o.map);
  readMatcher(p, o.matcher);
  o.guess = parseGuess(p.get<std::string>("guess", "odometry"));
  o.localization = p.get("localization", o.localization);
  o.deskew = p.get("deskew", o.deskew);
  o.update_distance = p.get("map_update_distance_thresh", o.update_distance);
  o.update_angle = p.get("map_update_angle_thresh", o.update_angle);
  o.update_period = p.get("map_update_period", o.update_period);
  o.min_points = p.get("min_points", o.min_points);
  o.max_contradiction = p.get("max_contradiction", o.max_contradiction);
  o.max_correction_distance = p.get("max_correction_distance", o.max_correction_distance);
  o.max_correction_angle = p.get("max_correction_angle", o.max_correction_angle);
  o.max_speed = p.get("max_speed", o.max_speed);
  o.max_turn_rate = p.get("max_turn_rate", o.max_turn_rate);
  o.max_acceleration = p.get("max_acceleration", o.max_acceleration);
  o.max_angular_acceleration = p.get("max_angular_acceleration", o.max_angular_acceleration);
  o.max_gap = p.get("max_gap", o.max_gap);
  o.validate();
}

// Names that hector_mapping has for what is done in another way here.
void readSubstitutes(mapping_common::Parameters& p, SlamParameters& s) {
  if (!p.get("use_tf_pose_start_estimate", true) && s.slam.guess == Guess::kOdometry) {
    s.slam.guess = Guess::kConstantVelocity;
  }
  if (p.get("pub_drawings", false)) {
    s.warnings.push_back(
        "~pub_drawings does nothing: the topics path and edges show the way, config/slam.rviz all");
  }
  if (p.get("pub_debug_output", false)) {
    s.warnings.push_back(
        "~pub_debug_output does nothing: what became of the scans is in /diagnostics, and ~output_timing "
        "logs it");
  }
}

}  // namespace

SlamParameters readSlamParameters(mapping_common::Parameters& p) {
  SlamParameters s;
  try {
    readSlam(p, s.slam);
  } catch (const std::invalid_argument& e) {
    const std::string what = e.what();
    throw std::invalid_argument(what[0] == '~' ? what : '~' + what);
  }
  s.scan.min_range = p.get("laser_min_dist", s.scan.min_range, 0.0, 1e4);
  s.scan.max_range = p.get("laser_max_dist", s.scan.max_range, s.scan.min_range, 1e4);
  s.scan.min_z = p.get("laser_z_min_value", s.scan.min_z, -1e4, 1e4);
  s.scan.max_z = p.get("laser_z_max_value", s.scan.max_z, s.scan.min_z, 1e4);
  s.scan.reflectivity_scale = p.get("reflectivity_scale", s.scan.reflectivity_scale, 1e-9, 1e9);
  s.scan.max_median_reflectivity = p.get("max_median_reflectivity", s.scan.max_median_reflectivity, 0.0, 1e9);
  s.start = {p.get("start/x", 0.0, -1e6, 1e6), p.get("start/y", 0.0, -1e6, 1e6),
             p.get("start/yaw", 0.0, -2.0 * M_PI, 2.0 * M_PI)};
  s.key_pose_distance = p.get("key_pose_distance", s.key_pose_distance, 1e-3, 1e4);
  s.key_pose_angle = p.get("key_pose_angle", s.key_pose_angle, 1e-3, 1e4);

  const auto name = [&p](const char* parameter, std::string& value) {
    value = p.get(parameter, value);
    if (value.empty() || value == "/") {
      mapping_common::rejectParameter(parameter, '\'' + value + '\'', "allowed is a name");
    }
  };
  name("base_frame", s.base_frame);
  name("odom_frame", s.odom_frame);
  name("map_frame", s.map_frame);
  name("scan_topic", s.scan_topic);
  name("sys_msg_topic", s.sys_msg_topic);
  name("pose_update_topic", s.pose_update_topic);
  name("tf_map_scanmatch_transform_frame_name", s.tf_map_scanmatch_transform_frame_name);
  for (std::string* frame : {&s.base_frame, &s.odom_frame, &s.map_frame})
    *frame = mapping_common::withoutSlash(*frame);
  s.use_tf_scan_transformation = p.get("use_tf_scan_transformation", s.use_tf_scan_transformation);
  s.map_with_known_poses = p.get("map_with_known_poses", s.map_with_known_poses);
  s.pub_map_odom_transform = p.get("pub_map_odom_transform", s.pub_map_odom_transform);
  s.pub_map_scanmatch_transform = p.get("pub_map_scanmatch_transform", s.pub_map_scanmatch_transform);
  s.pub_odometry = p.get("pub_odometry", s.pub_odometry);
  s.advertise_map_service = p.get("advertise_map_service", s.advertise_map_service);
  s.output_timing = p.get("output_timing", s.output_timing);
  s.scan_subscriber_queue_size = p.get("scan_subscriber_queue_size", s.scan_subscriber_queue_size, 1, 10000);
  s.transform_timeout = p.get("transform_timeout", s.transform_timeout, 0.0, 10.0);
  s.map_pub_period = p.get("map_pub_period", s.map_pub_period, 0.01, 1e6);
  s.map_file = p.get("map_file", s.map_file);
  s.save_on_shutdown = p.get("save_on_shutdown", s.save_on_shutdown);
  if (s.slam.localization && s.map_file.empty()) {
    mapping_common::rejectParameter("localization", "true", "allowed is false without a map_file");
  }
  readSubstitutes(p, s);
  return s;
}

XmlRpc::XmlRpcValue loadYaml(const std::string& path) {
  try {
    return toXmlRpc(YAML::LoadFile(path));
  } catch (const YAML::Exception& e) {
    throw std::runtime_error(path + " was not loaded: " + e.what());
  }
}

}  // namespace intensity_hector_slam
