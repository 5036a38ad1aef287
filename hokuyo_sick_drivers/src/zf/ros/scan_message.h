// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <geometry_msgs/TransformStamped.h>
#include <sensor_msgs/PointCloud2.h>

#include <string>

#include "hokuyo_sick_drivers/zf/scan_cloud.h"

namespace hokuyo_sick_drivers {

/// The points move over, they aren't copied.
sensor_msgs::PointCloud2 toMessage(ScanCloud&& cloud, const std_msgs::Header& header);

/// The pose of header.frame_id in `parent`.
geometry_msgs::TransformStamped toMessage(const Eigen::Isometry3d& pose, const std_msgs::Header& header,
                                          const std::string& parent);

}  // namespace hokuyo_sick_drivers
