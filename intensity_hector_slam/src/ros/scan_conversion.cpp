// SPDX-License-Identifier: BSD-3-Clause
#include "intensity_hector_slam/ros/scan_conversion.h"

#include <algorithm>
#include <cmath>
#include <vector>

namespace intensity_hector_slam {
namespace {

using mapping_common::LaserReading;

// Calls use(beam, direction) for each beam, in the frame of the scanner.
template <class Use>
void forEachBeam(const sensor_msgs::LaserScan& message, const Use& use) {
  Eigen::Vector2d direction = Eigen::Rotation2Dd(message.angle_min) * Eigen::Vector2d::UnitX();
  const Eigen::Matrix2d next = Eigen::Rotation2Dd(message.angle_increment).toRotationMatrix();
  for (std::size_t i = 0; i < message.ranges.size(); ++i, direction = next * direction) use(i, direction);
}

bool isWithin(double range, const LaserReading& reading, const ScanLimits& limits) {
  return reading.isReturn(range) && range >= limits.min_range && range <= limits.max_range;
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

Scan toScan(const sensor_msgs::LaserScan& message, LaserReading& reading,
            const Eigen::Isometry3d& sensor_in_body, const ScanLimits& limits) {
  Scan scan;
  scan.stamp = message.header.stamp.toSec();
  scan.origin = sensor_in_body.translation().head<2>().cast<float>();
  scan.points.reserve(message.ranges.size());
  const double free_range = std::min(limits.no_return_free_range, limits.max_range);
  forEachBeam(message, [&](std::size_t beam, const Eigen::Vector2d& direction) {
    const double range = message.ranges[beam];
    const bool is_return = isWithin(range, reading, limits);
    const bool is_free = !is_return && free_range > 0.0 &&
                         (reading.isNoReturn(range) || (reading.isReturn(range) && range > limits.max_range));
    if (!is_return && !is_free) return;
    const Eigen::Vector2d end = (is_return ? range : std::min(free_range, reading.max_range)) * direction;
    const Eigen::Vector3d point = sensor_in_body * Eigen::Vector3d(end.x(), end.y(), 0.0);
    const double height = point.z() - sensor_in_body.translation().z();
    if (height < limits.min_z || height > limits.max_z) return;
    (is_return ? scan.points : scan.free).push_back(point.head<2>().cast<float>());
    if (is_return && reading.has_intensities) {
      scan.reflectivities.push_back(
          static_cast<float>(limits.reflectivity_scale * message.intensities[beam]));
    }
    if (reading.time_increment != 0.0) {
      (is_return ? scan.times : scan.free_times).push_back(static_cast<float>(beam * reading.time_increment));
    }
  });
  if (median(scan.reflectivities) > limits.max_median_reflectivity) {
    scan.reflectivities.clear();
    reading.warnings["raw intensities"] =
        "raw intensities are left out: reflectivity_scale is to make them about 0 (black) to 1 (white paper)";
  }
  return scan;
}

Scan toScan(const sensor_msgs::LaserScan& message, const Eigen::Isometry3d& sensor_in_body,
            const ScanLimits& limits) {
  LaserReading reading = mapping_common::LaserScans().read(message);
  return toScan(message, reading, sensor_in_body, limits);
}

sensor_msgs::PointCloud toPointCloud(const sensor_msgs::LaserScan& message, const LaserReading& reading,
                                     const ScanLimits& limits) {
  sensor_msgs::PointCloud cloud;
  cloud.header = message.header;
  sensor_msgs::ChannelFloat32 index, intensity;
  index.name = "index";
  intensity.name = "intensity";
  forEachBeam(message, [&](std::size_t beam, const Eigen::Vector2d& direction) {
    const double range = message.ranges[beam];
    if (!isWithin(range, reading, limits)) return;
    geometry_msgs::Point32 point;
    point.x = static_cast<float>(range * direction.x());
    point.y = static_cast<float>(range * direction.y());
    cloud.points.push_back(point);
    index.values.push_back(static_cast<float>(beam));
    if (reading.has_intensities) intensity.values.push_back(message.intensities[beam]);
  });
  cloud.channels.push_back(index);
  if (reading.has_intensities) cloud.channels.push_back(intensity);
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
