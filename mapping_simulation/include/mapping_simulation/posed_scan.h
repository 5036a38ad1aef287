// SPDX-License-Identifier: BSD-3-Clause
#pragma once

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

}  // namespace mapping_simulation
