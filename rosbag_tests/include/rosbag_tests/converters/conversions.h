// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <pcl/point_cloud.h>
#include <pcl/point_types.h>
#include <sensor_msgs/LaserScan.h>
#include <sensor_msgs/PointCloud2.h>

namespace rosbag_tests {

/// Points from the fields x y z and, if there, intensity (else 0), each of any numeric type; other fields are
/// ignored, non-finite points kept. Throws std::runtime_error saying what is malformed, with `cloud`
/// unchanged.
void fromPointCloud2(const sensor_msgs::PointCloud2& message, pcl::PointCloud<pcl::PointXYZI>& cloud);

/// A point per beam in the plane z = 0 of the scan's frame, intensity 0 if the scan has none. What is no
/// return (mapping_common::LaserReading) becomes a NaN point. The sensor is taken to stand still during the
/// sweep. Throws std::runtime_error or std::invalid_argument saying what is malformed, with `cloud`
/// unchanged.
void fromLaserScan(const sensor_msgs::LaserScan& message, pcl::PointCloud<pcl::PointXYZI>& cloud);

}  // namespace rosbag_tests
