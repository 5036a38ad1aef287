// SPDX-License-Identifier: BSD-3-Clause
#include "intensity_hector_slam/ros/scan_conversion.h"

#include <algorithm>
#include <cmath>
#include <stdexcept>
#include <string>
#include <vector>

namespace intensity_hector_slam {
namespace {

// Calls use(beam, end) for each beam within the limits of range; its end is in the frame of the scanner.
template <class Use>
void forEachEnd(const sensor_msgs::LaserScan& message, const ScanLimits& limits, const Use& use) {
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
  if (!message.intensities.empty() && message.intensities.size() != beams) {
    throw std::invalid_argument(std::to_string(message.intensities.size()) + " intensities for " +
                                std::to_string(beams) + " ranges");
  }
  const double min_range = std::max<double>(limits.min_range, message.range_min);
  const double max_range = std::min<double>(limits.max_range, message.range_max);
  Eigen::Vector2d direction = Eigen::Rotation2Dd(message.angle_min) * Eigen::Vector2d::UnitX();
  const Eigen::Matrix2d next = Eigen::Rotation2Dd(message.angle_increment).toRotationMatrix();
  for (std::size_t i = 0; i < beams; ++i, direction = next * direction) {
    const double range = message.ranges[i];
    if (range >= min_range && range <= max_range) use(i, Eigen::Vector2d(range * direction));
  }
}

// Of those that are known; 0 without any.
float median(std::vector<float> values) {
  values.erase(std::remove_if(values.begin(), values.end(), [](float v) { return !std::isfinite(v); }),
               values.end());
  if (values.empty()) return 0.0F;
  const auto middle = values.begin() + values.size() / 2;
  std::nth_element(values.begin(), middle, values.end());
  return *middle;
}

}  // namespace

Scan toScan(const sensor_msgs::LaserScan& message, const Eigen::Isometry3d& sensor_in_body,
            const ScanLimits& limits, bool* raw) {
  Scan scan;
  scan.stamp = message.header.stamp.toSec();
  scan.origin = sensor_in_body.translation().head<2>().cast<float>();
  scan.points.reserve(message.ranges.size());
  forEachEnd(message, limits, [&](std::size_t beam, const Eigen::Vector2d& end) {
    const Eigen::Vector3d point = sensor_in_body * Eigen::Vector3d(end.x(), end.y(), 0.0);
    const double height = point.z() - sensor_in_body.translation().z();
    if (height < limits.min_z || height > limits.max_z) return;
    scan.points.push_back(point.head<2>().cast<float>());
    if (!message.intensities.empty()) {
      scan.reflectivities.push_back(
          static_cast<float>(limits.reflectivity_scale * message.intensities[beam]));
    }
    if (message.time_increment != 0.0F) {
      scan.times.push_back(static_cast<float>(beam * message.time_increment));
    }
  });
  const bool is_raw = median(scan.reflectivities) > limits.max_median_reflectivity;
  if (is_raw) scan.reflectivities.clear();
  if (raw != nullptr) *raw = is_raw;
  return scan;
}

sensor_msgs::PointCloud toPointCloud(const sensor_msgs::LaserScan& message, const ScanLimits& limits) {
  sensor_msgs::PointCloud cloud;
  cloud.header = message.header;
  sensor_msgs::ChannelFloat32 index, intensity;
  index.name = "index";
  intensity.name = "intensity";
  forEachEnd(message, limits, [&](std::size_t beam, const Eigen::Vector2d& end) {
    geometry_msgs::Point32 point;
    point.x = static_cast<float>(end.x());
    point.y = static_cast<float>(end.y());
    cloud.points.push_back(point);
    index.values.push_back(static_cast<float>(beam));
    if (!message.intensities.empty()) intensity.values.push_back(message.intensities[beam]);
  });
  cloud.channels.push_back(index);
  if (!message.intensities.empty()) cloud.channels.push_back(intensity);
  return cloud;
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
