// SPDX-License-Identifier: BSD-3-Clause
#include "laser_intensity_calib/ros/conversions.h"

#include <mapping_common/cloud_fields.h>
#include <mapping_common/laser_scans.h>

#include <cmath>
#include <cstdint>
#include <cstring>
#include <limits>
#include <stdexcept>
#include <string>

namespace laser_intensity_calib {
using mapping_common::CloudField;
using sensor_msgs::PointField;

ScanArrays readScan(const sensor_msgs::LaserScan& scan) {
  if (scan.intensities.empty()) {
    throw std::invalid_argument("no intensities: let the driver publish them, or the scanner send them");
  }
  if (scan.intensities.size() != scan.ranges.size()) {
    throw std::invalid_argument(std::to_string(scan.intensities.size()) + " intensities for " +
                                std::to_string(scan.ranges.size()) + " ranges");
  }
  const mapping_common::LaserReading reading = mapping_common::LaserScans().read(scan);
  const auto n = static_cast<Eigen::Index>(scan.ranges.size());
  ScanArrays arrays{Eigen::Map<const Eigen::ArrayXf>(scan.ranges.data(), n),
                    Eigen::Map<const Eigen::ArrayXf>(scan.intensities.data(), n)};
  arrays.ranges = arrays.ranges
                      .unaryExpr([&](float range) {
                        return reading.isReturn(range) ? range : std::numeric_limits<float>::quiet_NaN();
                      })
                      .eval();
  return arrays;
}

CloudArrays readCloud(const sensor_msgs::PointCloud2& cloud) {
  mapping_common::checkedRowStep(cloud);
  const auto x = CloudField::requireFloat(cloud, "x"), y = CloudField::requireFloat(cloud, "y"),
             z = CloudField::requireFloat(cloud, "z"), intensity = CloudField::require(cloud, "intensity");
  const auto vp_x = CloudField::find(cloud, "vp_x"), vp_y = CloudField::find(cloud, "vp_y"),
             vp_z = CloudField::find(cloud, "vp_z"), ring = CloudField::find(cloud, "ring");
  const bool viewpoints = vp_x && vp_y && vp_z;
  const auto n = static_cast<Eigen::Index>(cloud.width) * cloud.height;
  CloudArrays arrays{Eigen::Matrix3Xf(3, n), Eigen::Matrix3Xf::Zero(3, viewpoints ? n : 1), Eigen::ArrayXf(n),
                     Eigen::ArrayXi(ring ? n : 0),
                     cloud.height > 1 ? static_cast<Eigen::Index>(cloud.width) : 0};
  constexpr float kMaxLasers = 65536.0F;
  mapping_common::visitPoints(cloud, [&](const std::uint8_t* point, Eigen::Index i) {
    arrays.points.col(i) << x(point), y(point), z(point);
    arrays.intensities[i] = intensity(point);
    if (ring) {
      const float laser = ring(point);
      arrays.lasers[i] = laser >= 0.0F && laser < kMaxLasers ? static_cast<int>(laser) : -1;
    }
    if (viewpoints) arrays.viewpoints.col(i) << vp_x(point), vp_y(point), vp_z(point);
  });
  return arrays;
}

sensor_msgs::PointCloud2 withReflectivity(const sensor_msgs::PointCloud2& cloud,
                                          const Eigen::ArrayXf& reflectivity) {
  mapping_common::checkedRowStep(cloud);
  const auto points = static_cast<Eigen::Index>(cloud.width) * cloud.height;
  if (reflectivity.size() != points) {
    throw std::invalid_argument(std::to_string(reflectivity.size()) + " reflectivities for " +
                                std::to_string(points) + " points");
  }
  sensor_msgs::PointCloud2 result;
  result.header = cloud.header;
  result.height = cloud.height;
  result.width = cloud.width;
  result.is_bigendian = false;
  result.is_dense = cloud.is_dense;
  result.fields = cloud.fields;
  for (PointField& field : result.fields) {
    if (field.name == "reflectivity") field.name = "reflectivity_device";
  }
  PointField field;
  field.name = "reflectivity";
  field.offset = (cloud.point_step + 3) / 4 * 4;
  field.datatype = PointField::FLOAT32;
  field.count = 1;
  result.fields.push_back(field);
  result.point_step = field.offset + sizeof(float);
  result.row_step = result.point_step * result.width;
  result.data.resize(static_cast<std::size_t>(result.row_step) * result.height);
  mapping_common::visitPoints(cloud, [&](const std::uint8_t* point, Eigen::Index i) {
    std::uint8_t* to = result.data.data() + static_cast<std::size_t>(i) * result.point_step;
    std::memcpy(to, point, cloud.point_step);
    std::memcpy(to + field.offset, &reflectivity[i], sizeof(float));
  });
  return result;
}

}  // namespace laser_intensity_calib
