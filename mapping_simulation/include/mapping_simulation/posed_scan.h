// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <mapping_simulation/sensors.h>
#include <pcl/point_cloud.h>
#include <pcl/point_types.h>

#include <Eigen/Geometry>
#include <string>

namespace mapping_simulation {

/// One scan of a 3D sensor with the pose that it was taken from: what every reader gives and every evaluation
/// takes.
struct PosedScan {
  std::string name;    ///< of the file or message, for progress and errors
  double stamp = 0.0;  ///< s
  Eigen::Isometry3d pose = Eigen::Isometry3d::Identity();  ///< sensor frame -> map frame
  pcl::PointCloud<pcl::PointXYZI> cloud;                   ///< sensor frame, m; non-finite: no return
};

/// Organised cloud, one row per elevation and one column per azimuth; points as the sensor gives them, each
/// in the sensor frame of its own time; NaN without a return.
PosedScan toPosedScan(const SensorConfig& sensor, const Sweep& sweep);

}  // namespace mapping_simulation
