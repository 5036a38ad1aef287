// SPDX-License-Identifier: BSD-3-Clause
#include "intensity_hector_slam/ros/scan_conversion.h"

#include <algorithm>
#include <cmath>
#include <stdexcept>
#include <string>

namespace intensity_hector_slam {

Scan toScan(const sensor_msgs::LaserScan& message, const Eigen::Isometry3d& sensor_in_body,
            const ScanLimits& limits) {
  if (!std::isfinite(message.angle_min) || !std::isfinite(message.angle_increment)) {
    throw std::invalid_argument("angles that are not finite");
  }
  if (!std::isfinite(message.time_increment))
    throw std::invalid_argument("a time_increment that is not finite");
  if (!(message.range_max > 0.0F) || !(message.range_min <= message.range_max)) {
    throw std::invalid_argument("range_min " + std::to_string(message.range_min) + " and range_max " +
                                std::to_string(message.range_max) + " that are no interval");
  }
  const std::size_t beams = message.ranges.size();
  const bool intensities = !message.intensities.empty();
  if (intensities && message.intensities.size() != beams) {
    throw std::invalid_argument(std::to_string(message.intensities.size()) + " intensities for " +
                                std::to_string(beams) + " ranges");
  }
  const double min_range = std::max<double>(limits.min_range, message.range_min);
  const double max_range = std::min<double>(limits.max_range, message.range_max);

  Scan scan;
  scan.stamp = message.header.stamp.toSec();
  scan.origin = sensor_in_body.translation().head<2>().cast<float>();
  scan.points.reserve(beams);
  Eigen::Vector2d direction = Eigen::Rotation2Dd(message.angle_min) * Eigen::Vector2d::UnitX();
  const Eigen::Matrix2d next = Eigen::Rotation2Dd(message.angle_increment).toRotationMatrix();
  for (std::size_t i = 0; i < beams; ++i, direction = next * direction) {
    const double range = message.ranges[i];
    if (!(range >= min_range && range <= max_range)) continue;
    const Eigen::Vector3d point =
        sensor_in_body * Eigen::Vector3d(range * direction.x(), range * direction.y(), 0.0);
    const double height = point.z() - sensor_in_body.translation().z();
    if (height < limits.min_z || height > limits.max_z) continue;
    scan.points.push_back(point.head<2>().cast<float>());
    if (intensities) {
      scan.reflectivities.push_back(static_cast<float>(limits.reflectivity_scale * message.intensities[i]));
    }
    if (message.time_increment != 0.0F) scan.times.push_back(static_cast<float>(i * message.time_increment));
  }
  return scan;
}

Pose toPose(const Eigen::Isometry3d& transform) {
  return {transform.translation().x(), transform.translation().y(),
          std::atan2(transform.linear()(1, 0), transform.linear()(0, 0))};
}

Eigen::Isometry3d toIsometry(const Pose& pose) {
  return Eigen::Translation3d(pose.x(), pose.y(), 0.0) *
         Eigen::AngleAxisd(pose.z(), Eigen::Vector3d::UnitZ());
}

}  // namespace intensity_hector_slam
