// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <sensor_msgs/LaserScan.h>
#include <sensor_msgs/PointCloud2.h>

#include <Eigen/Core>

namespace laser_intensity_calib {

/// Ranges (m), NaN where there was no return (mapping_common::LaserReading), and intensities.
struct ScanArrays {
  Eigen::ArrayXf ranges, intensities;
};
/// @throws std::invalid_argument that says what is malformed, or that there are no intensities
ScanArrays readScan(const sensor_msgs::LaserScan& scan);

/// Points, where they were seen from, and their intensities.
struct CloudArrays {
  Eigen::Matrix3Xf points;      ///< m, fields x y z; row by row if the cloud is organised
  Eigen::Matrix3Xf viewpoints;  ///< m, fields vp_x vp_y vp_z; one column, 0, where there are no such fields
  Eigen::ArrayXf intensities;
  Eigen::ArrayXi lasers;   ///< numbers, field ring; empty where there is no such field
  Eigen::Index width = 0;  ///< of the rows of an organised cloud, 0: it isn't
};
/// Coordinates are float32 or float64, the field `intensity` of any numeric type.
/// @throws std::invalid_argument that says what is malformed, or that there are no intensities
CloudArrays readCloud(const sensor_msgs::PointCloud2& cloud);

/// The same cloud with the field `reflectivity` (float32) added. A field of that name, which some scanners
/// have of their own, is called `reflectivity_device`.
/// @throws std::invalid_argument unless there is a value for each point
sensor_msgs::PointCloud2 withReflectivity(const sensor_msgs::PointCloud2& cloud,
                                          const Eigen::ArrayXf& reflectivity);

}  // namespace laser_intensity_calib
