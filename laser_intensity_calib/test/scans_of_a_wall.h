// SPDX-License-Identifier: BSD-3-Clause
//
// Messages of a scanner, see scanner_model.h, that faces a wall.
#pragma once

#include <sensor_msgs/LaserScan.h>
#include <sensor_msgs/PointCloud2.h>
#include <sensor_msgs/point_cloud2_iterator.h>

#include <cmath>
#include <cstring>
#include <limits>
#include <random>
#include <vector>

#include "scanner_model.h"

namespace laser_intensity_calib {

/// The wall is `distance` (m) ahead, its normal turned by `turn` (rad); beams that miss it have no return.
inline sensor_msgs::LaserScan scanOfWall(double distance, double turn, double reflectivity,
                                         std::mt19937& random, double range_noise = 0.003) {
  constexpr int kBeams = 541;
  std::normal_distribution<double> gauss;
  sensor_msgs::LaserScan scan;
  scan.header.frame_id = "laser";
  scan.angle_increment = static_cast<float>(0.5 * kRadians);
  scan.angle_min = -270 * scan.angle_increment;
  scan.angle_max = -scan.angle_min;
  scan.range_min = 0.1F;
  scan.range_max = 20.0F;
  for (int i = 0; i < kBeams; ++i) {
    const double angle = scan.angle_min + i * scan.angle_increment, incidence = std::abs(angle - turn);
    const double range = distance / std::cos(incidence);
    const bool hit = incidence < 85.0 * kRadians && range < 8.0;
    scan.ranges.push_back(hit ? static_cast<float>(range + range_noise * gauss(random))
                              : std::numeric_limits<float>::infinity());
    scan.intensities.push_back(
        hit ? static_cast<float>(reflectivity * response(range, incidence) * (1.0 + 0.02 * gauss(random)))
            : 0.0F);
  }
  return scan;
}

/// Points x y z, an intensity of another type, and their viewpoints if there are any.
inline sensor_msgs::PointCloud2 makeCloud(const std::vector<Eigen::Vector3f>& points,
                                          const std::vector<std::uint16_t>& intensities,
                                          const std::vector<Eigen::Vector3f>& viewpoints = {}) {
  using sensor_msgs::PointField;
  sensor_msgs::PointCloud2 cloud;
  cloud.header.frame_id = "lidar";
  sensor_msgs::PointCloud2Modifier modifier(cloud);
  if (viewpoints.empty()) {
    modifier.setPointCloud2Fields(4, "x", 1, PointField::FLOAT32, "y", 1, PointField::FLOAT32, "z", 1,
                                  PointField::FLOAT32, "intensity", 1, PointField::UINT16);
  } else {
    modifier.setPointCloud2Fields(7, "x", 1, PointField::FLOAT32, "y", 1, PointField::FLOAT32, "z", 1,
                                  PointField::FLOAT32, "vp_x", 1, PointField::FLOAT32, "vp_y", 1,
                                  PointField::FLOAT32, "vp_z", 1, PointField::FLOAT32, "intensity", 1,
                                  PointField::UINT16);
  }
  modifier.resize(points.size());
  // Points of 14 or 26 bytes: every second one isn't aligned as a float.
  const auto put = [&cloud](std::size_t point, std::size_t field, auto value) {
    std::memcpy(&cloud.data[point * cloud.point_step + cloud.fields[field].offset], &value, sizeof value);
  };
  for (std::size_t i = 0; i < points.size(); ++i) {
    for (int axis = 0; axis < 3; ++axis) {
      put(i, axis, points[i][axis]);
      if (!viewpoints.empty()) put(i, 3 + axis, viewpoints[i][axis]);
    }
    put(i, cloud.fields.size() - 1, intensities[i]);
  }
  return cloud;
}

/// The same cloud with the field ring: the laser of each point.
inline sensor_msgs::PointCloud2 withRings(const sensor_msgs::PointCloud2& cloud,
                                          const std::vector<std::uint16_t>& rings) {
  sensor_msgs::PointCloud2 result = cloud;
  sensor_msgs::PointField field;
  field.name = "ring";
  field.offset = cloud.point_step;
  field.datatype = sensor_msgs::PointField::UINT16;
  field.count = 1;
  result.fields.push_back(field);
  result.point_step += sizeof(std::uint16_t);
  result.row_step = result.point_step * result.width;
  result.data.resize(rings.size() * result.point_step);
  for (std::size_t i = 0; i < rings.size(); ++i) {
    std::uint8_t* point = result.data.data() + i * result.point_step;
    std::memcpy(point, cloud.data.data() + i * cloud.point_step, cloud.point_step);
    std::memcpy(point + field.offset, &rings[i], sizeof(std::uint16_t));
  }
  return result;
}

}  // namespace laser_intensity_calib
