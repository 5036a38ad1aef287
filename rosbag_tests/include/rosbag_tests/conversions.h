// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <geometry_msgs/Pose.h>
#include <geometry_msgs/Transform.h>
#include <pcl/point_cloud.h>
#include <pcl/point_types.h>
#include <sensor_msgs/LaserScan.h>
#include <sensor_msgs/PointCloud2.h>

#include <Eigen/Geometry>

namespace rosbag_tests {

/// A message of float32 x y z intensity, one row, from points in the frame of `header`.
sensor_msgs::PointCloud2 toPointCloud2(const pcl::PointCloud<pcl::PointXYZI>& cloud,
                                       const std_msgs::Header& header);

/// Points from the fields x y z and, if there, intensity (else 0), each of any numeric type; other fields are
/// ignored, non-finite points kept. Throws std::runtime_error saying what is malformed, with `cloud`
/// unchanged.
void fromPointCloud2(const sensor_msgs::PointCloud2& message, pcl::PointCloud<pcl::PointXYZI>& cloud);

/// A point per beam in the plane z = 0 of the scan's frame, intensity 0 if the scan has none. What is no
/// return within range_min and range_max (inf, NaN and others, see REP 117) becomes a NaN point. The sensor
/// is taken to stand still during the sweep. Throws std::runtime_error saying what is malformed, with `cloud`
/// unchanged.
void fromLaserScan(const sensor_msgs::LaserScan& message, pcl::PointCloud<pcl::PointXYZI>& cloud);

geometry_msgs::Pose toPose(const Eigen::Isometry3d& pose);
geometry_msgs::Transform toTransform(const Eigen::Isometry3d& pose);

/// Throws std::runtime_error if a number isn't finite or the quaternion is more than 1 % from unit length.
Eigen::Isometry3d fromPose(const geometry_msgs::Pose& pose);
Eigen::Isometry3d fromTransform(const geometry_msgs::Transform& transform);

}  // namespace rosbag_tests
