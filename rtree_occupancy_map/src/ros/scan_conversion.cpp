// SPDX-License-Identifier: BSD-3-Clause
#include "rtree_occupancy_map/ros/scan_conversion.h"

#include <mapping_common/cloud_fields.h>

#include <cmath>
#include <cstdint>
#include <cstring>
#include <stdexcept>
#include <string>

namespace rtree_occupancy_map {
ConvertedScan toScan(const sensor_msgs::PointCloud2& cloud, const Eigen::Isometry3d& sensor_in_map,
                     const ScanLimits& limits) {
  using mapping_common::CloudField;
  mapping_common::checkedRowStep(cloud);
  const auto x = CloudField::requireFloat(cloud, "x"), y = CloudField::requireFloat(cloud, "y"),
             z = CloudField::requireFloat(cloud, "z");
  CloudField reflectivity = CloudField::find(cloud, "reflectivity");
  if (!reflectivity) reflectivity = CloudField::find(cloud, "intensity");
  const std::size_t points = static_cast<std::size_t>(cloud.width) * cloud.height;

  ConvertedScan converted;
  Scan& scan = converted.scan;
  scan.origin = sensor_in_map.translation().cast<float>();
  scan.hits.reserve(points);
  if (reflectivity) scan.reflectivity.reserve(points);
  const Eigen::Isometry3f pose = sensor_in_map.cast<float>();
  mapping_common::visitPoints(cloud, [&](const std::uint8_t* point, std::size_t) {
    const Eigen::Vector3f measured(x(point), y(point), z(point));
    converted.at_infinity += measured.array().isInf().any();
    const Eigen::Vector3f hit = pose * measured;
    if (hit.z() < limits.min_z || hit.z() > limits.max_z) {
      ++converted.outside_z;
      return;
    }
    scan.hits.push_back(hit);
    if (reflectivity) scan.reflectivity.push_back(reflectivity(point));
  });
  return converted;
}

ConvertedScan toScan(const sensor_msgs::LaserScan& message, const Eigen::Isometry3d& sensor_in_map,
                     const ScanLimits& limits) {
  if (!std::isfinite(message.angle_min) || !std::isfinite(message.angle_increment)) {
    throw std::invalid_argument("angles that are not finite");
  }
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

  ConvertedScan converted;
  Scan& scan = converted.scan;
  scan.origin = sensor_in_map.translation().cast<float>();
  scan.hits.reserve(beams);
  if (intensities) scan.reflectivity.reserve(beams);
  for (std::size_t i = 0; i < beams; ++i) {
    const float range = message.ranges[i];
    const double angle = message.angle_min + static_cast<double>(i) * message.angle_increment;
    const auto pointAt = [&](double r) -> Eigen::Vector3f {
      return (sensor_in_map * Eigen::Vector3d(r * std::cos(angle), r * std::sin(angle), 0.0)).cast<float>();
    };
    if (range > message.range_max) {
      if (limits.no_return_clears && std::isfinite(message.range_max)) {
        scan.misses.push_back(pointAt(message.range_max));
      }
      continue;
    }
    if (std::isfinite(range) && range < message.range_min) {
      ++converted.below_minimum;
      continue;
    }
    const Eigen::Vector3f hit = pointAt(range);
    if (hit.z() < limits.min_z || hit.z() > limits.max_z) {
      ++converted.outside_z;
      continue;
    }
    scan.hits.push_back(hit);
    if (intensities) scan.reflectivity.push_back(message.intensities[i]);
  }
  return converted;
}

}  // namespace rtree_occupancy_map
