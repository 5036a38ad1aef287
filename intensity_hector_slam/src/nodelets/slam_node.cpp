// SPDX-License-Identifier: BSD-3-Clause
//
// SlamNodelet as a node, for launch files that start hector_mapping.
#include <nodelet/loader.h>
#include <ros/ros.h>

int main(int argc, char** argv) {
  ros::init(argc, argv, "slam");
  nodelet::Loader loader(false);
  const bool loaded = loader.load(ros::this_node::getName(), "intensity_hector_slam/SlamNodelet",
                                  ros::names::getRemappings(), nodelet::V_string());
  if (!loaded) return 1;
  ros::spin();
  return 0;
}
