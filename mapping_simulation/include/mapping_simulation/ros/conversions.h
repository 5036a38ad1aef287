// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <geometry_msgs/Pose.h>
#include <geometry_msgs/Transform.h>
#include <pcl/point_cloud.h>
#include <pcl/point_types.h>
#include <sensor_msgs/PointCloud2.h>

#include <Eigen/Geometry>

namespace mapping_simulation {

/// A message of float32 x y z intensity, one row, from points in the frame of `header`.
/// @param column_duration s. If given, there is a field `time`, too: when the point was measured, s after the
/// stamp, where
///   the columns of an organised cloud follow one another
sensor_msgs::PointCloud2 toPointCloud2(const pcl::PointCloud<pcl::PointXYZI>& cloud,
                                       const std_msgs::Header& header, double column_duration = 0.0);

geometry_msgs::Pose toPose(const Eigen::Isometry3d& pose);
geometry_msgs::Transform toTransform(const Eigen::Isometry3d& pose);

/// Throws std::runtime_error if a number isn't finite or the quaternion is more than 1 % from unit length.
Eigen::Isometry3d fromPose(const geometry_msgs::Pose& pose);
Eigen::Isometry3d fromTransform(const geometry_msgs::Transform& transform);

}  // namespace mapping_simulation
