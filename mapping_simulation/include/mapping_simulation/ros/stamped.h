// SPDX-License-Identifier: BSD-3-Clause
//
// What those who write recordings need: headers, transforms, and the topic of transforms that don't change.
#pragma once

#include <geometry_msgs/TransformStamped.h>
#include <rosbag/bag.h>

#include <Eigen/Geometry>
#include <string>
#include <vector>

namespace mapping_simulation {

std_msgs::Header makeHeader(const ros::Time& stamp, const std::string& frame);

/// @param pose of the child in the parent
geometry_msgs::TransformStamped makeTransform(const ros::Time& stamp, const std::string& parent,
                                              const std::string& child, const Eigen::Isometry3d& pose);

/// Writes to /tf_static, which players of the bag latch.
void writeStaticTransforms(rosbag::Bag& bag, const ros::Time& time,
                           const std::vector<geometry_msgs::TransformStamped>& transforms);

}  // namespace mapping_simulation
