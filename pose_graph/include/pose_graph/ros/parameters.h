// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <mapping_common/parameters.h>
#include <ros/console.h>
#include <ros/node_handle.h>

#include <stdexcept>
#include <string>

#include "pose_graph/appearance.h"
#include "pose_graph/online_graph.h"
#include "pose_graph/session.h"

namespace pose_graph {

enum class FrontEndPose { kTopic, kTf };
constexpr auto choicesOf(FrontEndPose) {
  return mapping_common::choices<FrontEndPose>(
      {{"topic", FrontEndPose::kTopic, "geometry_msgs/PoseStamped on `pose`"},
       {"tf", FrontEndPose::kTf, "tf map_frame -> base_frame"}});
}

enum class KeyPoses { kEdges, kClouds };
constexpr auto choicesOf(KeyPoses) {
  return mapping_common::choices<KeyPoses>(
      {{"edges", KeyPoses::kEdges, "consecutive edges of the front end"},
       {"clouds", KeyPoses::kClouds,
        "each cloud, of whose place nothing is known but by edges: stop, scan, go"}});
}

struct PoseGraphParameters {
  KeyPoses key_poses = KeyPoses::kEdges;
  std::string edge_topics = "edges, loop_closures, places";
  FrontEndPose front_end_pose = FrontEndPose::kTopic;
  std::string map_frame = "map", odom_frame = "odom", base_frame = "base_link";
  bool publish_tf = false;
  double transform_timeout = 5.0;
  int queue_size = 1000;
  OnlineOptions graph;
  std::string session_file;
  SessionWriterOptions session;
  bool keep_scans = true, keep_clouds = true;
  std::string slam = "slam", mapping = "mapping";
  bool match_appearances = true;
  AppearanceOptions appearance;
  bool rebuild_map = true, rebuild_cloud_map = true;
  double rebuild_distance = 0.05, rebuild_period = 10.0;
  double publish_period = 1.0;

  void describe(mapping_common::OptionList& o) {
    o.section("what comes");
    o("edge_topics", edge_topics, "",
      "mapping_msgs/EdgeConstraint, any number with spaces or commas between them, or a list. The first that "
      "brings consecutive edges makes the key poses")
        .notEmpty();
    o("key_poses", key_poses, "", "what makes them");
    o("queue_size", queue_size, "",
      "edges of each topic that wait for the nodelet, and clouds where they make key poses")
        .within(1, 100000);
    o("front_end_pose", front_end_pose, "",
      "where the pose between key poses comes from, at full rate: edges of other stamps, such as a camera's, "
      "are attached by it");
    o("map_frame", map_frame, "", "of the front end's poses, and of all that is published").notEmpty();
    o("base_frame", base_frame, "",
      "the body, whose poses are the graph's. Edges of other frames are moved there, by tf")
        .notEmpty();
    o("transform_timeout", transform_timeout, "s", "that edges and scans wait for tf of their sensors")
        .within(0.0, 1000.0);
    o.group("graph", "the graph and its loops", graph);
    o.section("the session");
    o("session_file", session_file, "",
      "path of the session that all is kept in; one that there is goes on. Empty: a temporary file, which is "
      "gone at the end");
    o.group("session", "how it is written", session);
    o("keep_scans", keep_scans, "",
      "true: the scan at each key pose is kept, for maps and for edges by appearance");
    o("keep_clouds", keep_clouds, "", "true: a cloud after each key pose, too");
    o.section("corrected maps");
    o("slam", slam, "",
      "SLAM nodelet whose parameters scans are read and 2D maps are made by; without any, the defaults are");
    o("mapping", mapping, "", "the same of the R-tree map");
    o("rebuild_map", rebuild_map, "", "true: after loops the 2D map is made anew");
    o("rebuild_cloud_map", rebuild_cloud_map, "", "true: the R-tree map, too");
    o("rebuild_distance", rebuild_distance, "m", "that some pose must have moved by for maps to be made anew")
        .within(0.0, 1000.0)
        .dynamic();
    o("rebuild_period", rebuild_period, "s", "from one map to the next, at least").within(0.0, 1e6).dynamic();
    o.section("edges by appearance alone");
    o("match_appearances", match_appearances, "",
      "true: the laser scans of both poses are matched, which gives the edge a transform, or refuses it");
    o.group("appearance", "the match", appearance);
    o.section("the output");
    o("publish_period", publish_period, "s", "between paths and graphs at least")
        .within(0.05, 1000.0)
        .dynamic();
    o("publish_tf", publish_tf, "",
      "true: tf map_frame -> odom_frame (REP 105). Nobody else may publish it then: set "
      "pub_map_odom_transform of SLAM false. Where clouds make the key poses, map_frame -> base_frame at "
      "each of known place");
    o("odom_frame", odom_frame, "", "publish_tf: the frame of odometry").notEmpty();
    o.require(key_poses != KeyPoses::kClouds || keep_clouds, "keep_clouds",
              "true where clouds make the key poses");
  }
};

/// As another nodelet has them, by its name, or their defaults.
template <class Others>
Others parametersOf(const ros::NodeHandle& node, const std::string& nodelet) {
  Others others;
  XmlRpc::XmlRpcValue values;
  if (nodelet.empty() || !node.getParam(nodelet, values)) return others;
  try {
    mapping_common::Parameters(values).read(others);
  } catch (const std::invalid_argument& e) {
    ROS_WARN_STREAM_THROTTLE(60.0, "The parameters of " << nodelet << " aren't used: " << e.what());
  }
  return others;
}

/// A file's name that nobody else has, in the folder for temporary files.
/// @throws std::runtime_error
std::string temporaryPath();

}  // namespace pose_graph
