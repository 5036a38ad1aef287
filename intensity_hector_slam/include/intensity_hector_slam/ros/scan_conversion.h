// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <intensity_hector_slam/pose.h>
#include <intensity_hector_slam/scan.h>
#include <sensor_msgs/LaserScan.h>
#include <sensor_msgs/PointCloud.h>

#include <Eigen/Geometry>

namespace intensity_hector_slam {

/// Which measurements become part of a Scan.
struct ScanLimits {
  double min_range = 0.4, max_range = 30.0;  ///< m, from the scanner; the message's own limits hold, too
  double min_z = -1.0, max_z = 1.0;          ///< m, above the scanner, in the frame of the body
  double reflectivity_scale = 1.0;           ///< factor on the message's intensities, to get about 0 to 1
  double max_median_reflectivity = 2.0;      ///< of a scan; with more, its intensities are raw and left out
};

/// Beams after REP 117: what isn't finite or not within all limits is left out.
/// @param sensor_in_body pose of the scanner
/// @param raw set to whether there are intensities that were left out
/// @throws std::invalid_argument that says what is malformed
Scan toScan(const sensor_msgs::LaserScan& message, const Eigen::Isometry3d& sensor_in_body,
            const ScanLimits& limits, bool* raw = nullptr);

/// The same beams but for their height, in the frame of the scanner; channels: their index and intensity.
/// @throws std::invalid_argument that says what is malformed
sensor_msgs::PointCloud toPointCloud(const sensor_msgs::LaserScan& message, const ScanLimits& limits);

/// x, y and yaw.
Pose toPose(const Eigen::Isometry3d& transform);
Eigen::Isometry3d toIsometry(const Pose& pose);

}  // namespace intensity_hector_slam
