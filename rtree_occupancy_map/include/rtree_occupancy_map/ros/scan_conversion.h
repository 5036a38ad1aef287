// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <mapping_common/laser_scans.h>
#include <mapping_common/options.h>
#include <mapping_common/transform_queue.h>
#include <rtree_occupancy_map/occupancy_map.h>
#include <rtree_occupancy_map/sensor_path.h>
#include <sensor_msgs/LaserScan.h>
#include <sensor_msgs/PointCloud2.h>

#include <Eigen/Geometry>
#include <cstddef>
#include <limits>

namespace rtree_occupancy_map {

/// Which measurements become part of a Scan.
struct ScanLimits {
  double min_z = -std::numeric_limits<double>::infinity();
  double max_z = std::numeric_limits<double>::infinity();
  bool no_return_clears = true;
  bool color = false;  ///< of clouds: read their colours; not described, as the map's options say it

  void describe(mapping_common::OptionList& o) {
    o("pointcloud_min_z", min_z, "m",
      "map frame: returns below are left out as a whole, their beams don't clear either");
    o("pointcloud_max_z", max_z, "m", "the same above");
    o("no_return_clears", no_return_clears, "",
      "laser scans: a beam without a return clears up to the sensor's range_max. Points of clouds that "
      "are "
      "at infinity don't tell a direction, and clear nothing");
    o.require(min_z <= max_z, "pointcloud_max_z", "pointcloud_min_z or more");
  }
};

struct ConvertedScan {
  Scan scan;                      ///< non-finite points are still in it: the map counts them
  std::size_t outside_z = 0;      ///< returns left out: outside of the limits in z
  std::size_t below_minimum = 0;  ///< returns left out: nearer than the sensor's range_min
  std::size_t at_infinity = 0;    ///< points of a cloud: no returns whose direction isn't known
};

/// Points from the fields x y z (float32 or float64), reflectivity from the field `reflectivity`, or else
/// `intensity`, of any numeric type. Where limits.color says so, colours from `rgb` or `rgba`, four bytes as
/// PCL has them, or from `r`, `g` and `b` of a byte each. Other fields are ignored; the cloud may be
/// organised.
/// @throws std::invalid_argument that says what is malformed
ConvertedScan toScan(const sensor_msgs::PointCloud2& cloud, const Eigen::Isometry3d& sensor_in_map,
                     const ScanLimits& limits);

/// From the reading's max_range on a beam has no return; NaN, -inf and below range_min is no measurement, and
/// neither is 0, which drivers send for that as well as for no return. The sensor is taken to stand still
/// during the sweep.
/// @param reading of the message, by mapping_common::LaserScans
ConvertedScan toScan(const sensor_msgs::LaserScan& scan, const mapping_common::LaserReading& reading,
                     const Eigen::Isometry3d& sensor_in_map, const ScanLimits& limits);
/// Of a message by itself. @throws std::invalid_argument that says what is malformed
ConvertedScan toScan(const sensor_msgs::LaserScan& scan, const Eigen::Isometry3d& sensor_in_map,
                     const ScanLimits& limits);

// ---- a sensor that moves during the sweep ---------------------------------------------------------

/// When the finite points were measured, by the first of these fields that there is: `t`, `time`,
/// `timestamp`, `offset_time`, `time_offset`, `time_stamp`. Integers are ns from the stamp on (Ouster,
/// Livox), float32 s (Velodyne), float64 s or ns since 1970, or s from the stamp on where that is less than
/// three years (Hesai, RoboSense, Livox).
/// @throws std::invalid_argument that says what is malformed: there is no such field, or a time farther than
/// 1 s from the stamp
mapping_common::SweepTimes sweepTimesOf(const sensor_msgs::PointCloud2& cloud);
/// By its time_increment, which counts for nothing where the sweep would be longer than 1 s.
mapping_common::SweepTimes sweepTimesOf(const sensor_msgs::LaserScan& scan);

/// As above, each point from where the sensor was at its time, and each beam, too. Times are taken in 1024
/// steps of the sweep.
/// @param frame in the map, of the points, by s from the stamp on
/// @param origin in the map, of the beams, by the same
ConvertedScan toScan(const sensor_msgs::PointCloud2& cloud, const SensorPath& frame, const SensorPath& origin,
                     const ScanLimits& limits);
ConvertedScan toScan(const sensor_msgs::LaserScan& scan, const mapping_common::LaserReading& reading,
                     const SensorPath& frame, const ScanLimits& limits);

}  // namespace rtree_occupancy_map
