// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <intensity_hector_slam/pose.h>
#include <intensity_hector_slam/scan.h>
#include <mapping_common/laser_scans.h>
#include <mapping_common/options.h>
#include <sensor_msgs/LaserScan.h>
#include <sensor_msgs/PointCloud.h>

#include <Eigen/Geometry>

namespace intensity_hector_slam {

/// Which measurements become part of a Scan.
struct ScanLimits {
  double min_range = 0.4, max_range = 30.0;  ///< from the scanner; the message's own limits hold, too
  double min_z = -1.0, max_z = 1.0;          ///< in the frame of the body
  double reflectivity_scale = 1.0;
  double max_median_reflectivity = 2.0;
  double no_return_free_range = 0.0;

  void describe(mapping_common::OptionList& o) {
    o("laser_min_dist", min_range, "m", "nearer returns are left out: the robot itself").within(0.0, 10000.0);
    o("laser_max_dist", max_range, "m", "farther ones, too").within(0.0, 10000.0);
    o("laser_z_min_value", min_z, "m",
      "returns this far below the scanner are left out: the floor, with a tilted scanner")
        .within(-10000.0, 10000.0);
    o("laser_z_max_value", max_z, "m", "or above").within(-10000.0, 10000.0);
    o("reflectivity_scale", reflectivity_scale, "",
      "factor on the intensities, for 0 (black) to 1 (white paper). Raw ones: 1 / that of white")
        .above(0.0)
        .atMost(1e9);
    o("max_median_reflectivity", max_median_reflectivity, "",
      "of a scan; with more its intensities are taken for raw ones and left out, with a warning")
        .atLeast(0.0);
    o("no_return_free_range", no_return_free_range, "m",
      "beams without a return mark space as free up to here. 0: they say nothing, as black and mirroring "
      "surfaces don't return either")
        .within(0.0, 10000.0);
    o.require(max_range >= min_range, "laser_max_dist", "laser_min_dist or more");
    o.require(max_z >= min_z, "laser_z_max_value", "laser_z_min_value or more");
  }
};

/// What isn't within all limits is left out.
/// @param reading of the message, by mapping_common::LaserScans; gets a warning where intensities are raw
/// @param sensor_in_body pose of the scanner
Scan toScan(const sensor_msgs::LaserScan& message, mapping_common::LaserReading& reading,
            const Eigen::Isometry3d& sensor_in_body, const ScanLimits& limits);
/// Of a message by itself. @throws std::invalid_argument that says what is malformed
Scan toScan(const sensor_msgs::LaserScan& message, const Eigen::Isometry3d& sensor_in_body,
            const ScanLimits& limits);

/// The same beams but for their height, in the frame of the scanner; channels: their index and intensity.
sensor_msgs::PointCloud toPointCloud(const sensor_msgs::LaserScan& message,
                                     const mapping_common::LaserReading& reading, const ScanLimits& limits);

/// x, y and yaw.
Pose toPose(const Eigen::Isometry3d& transform);
Eigen::Isometry3d toIsometry(const Pose& pose);

}  // namespace intensity_hector_slam
