// SPDX-License-Identifier: BSD-3-Clause
#include <mapping_common/laser_scans.h>
#include <rosbag_tests/converters/conversions.h>

#include <cmath>
#include <limits>
#include <stdexcept>

#include "point_fields.h"

namespace rosbag_tests {

void fromPointCloud2(const sensor_msgs::PointCloud2& message, pcl::PointCloud<pcl::PointXYZI>& cloud) {
  readPoints(message, cloud);
}

void fromLaserScan(const sensor_msgs::LaserScan& message, pcl::PointCloud<pcl::PointXYZI>& cloud) {
  if (message.ranges.empty()) throw std::runtime_error("laser scan without ranges");
  if (!message.intensities.empty() && message.intensities.size() != message.ranges.size())
    throw std::runtime_error("laser scan with unequal numbers of ranges and intensities");
  const mapping_common::LaserReading reading = mapping_common::LaserScans().read(message);
  constexpr float kNan = std::numeric_limits<float>::quiet_NaN();
  cloud.resize(message.ranges.size());
  for (std::size_t i = 0; i < cloud.size(); ++i) {
    const double range = message.ranges[i];
    const double angle = message.angle_min + static_cast<double>(i) * message.angle_increment;
    cloud[i].getVector3fMap() = reading.isReturn(range)
                                    ? Eigen::Vector3f(range * std::cos(angle), range * std::sin(angle), 0.0f)
                                    : Eigen::Vector3f::Constant(kNan);
    cloud[i].intensity = message.intensities.empty() ? 0.0f : message.intensities[i];
  }
  cloud.is_dense = false;
}

}  // namespace rosbag_tests
