// SPDX-License-Identifier: BSD-3-Clause
//
// SlamNodelet as a node, for launch files that start hector_mapping.
#include <nodelet/loader.h>
#include <ros/ros.h>

#include <iostream>
#include <string>
#include <vector>

namespace {

constexpr const char* kUsage =
    "Usage: slam [NAME:=VALUE]...\n"
    "The nodelet intensity_hector_slam/SlamNodelet as a node: SLAM with the topics, parameters, frames and\n"
    "services of hector_mapping. It needs a master (roscore).\n"
    "  TOPIC:=OTHER       remaps a topic, e.g. scan:=front/scan\n"
    "  _PARAMETER:=VALUE  sets a parameter, e.g. _base_frame:=base_footprint\n"
    "  __name:=NAME       names the node, __ns:=NAMESPACE its namespace\n"
    "Parameters and what they do: rospack find intensity_hector_slam, there config/slam.yaml\n";

}  // namespace

int main(int argc, char** argv) {
  std::vector<std::string> words;
  ros::removeROSArgs(argc, argv, words);
  if (words.size() > 1) {
    const bool help = words[1] == "-h" || words[1] == "--help";
    (help ? std::cout : std::cerr) << kUsage;
    return help ? 0 : 2;
  }
  ros::init(argc, argv, "slam");
  nodelet::Loader loader(false);
  const bool loaded = loader.load(ros::this_node::getName(), "intensity_hector_slam/SlamNodelet",
                                  ros::names::getRemappings(), nodelet::V_string());
  if (!loaded) return 1;
  ros::spin();
  return 0;
}
