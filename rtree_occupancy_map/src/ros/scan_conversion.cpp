// SPDX-License-Identifier: BSD-3-Clause
#include "rtree_occupancy_map/ros/scan_conversion.h"

#include <cmath>
#include <cstdint>
#include <cstring>
#include <stdexcept>
#include <string>

namespace rtree_occupancy_map {
namespace {

using sensor_msgs::PointField;

template <class T>
float loadAs(const std::uint8_t* data) {
  T value;
  std::memcpy(&value, data, sizeof(value));
  return static_cast<float>(value);
}

// How to read a field of a point; size 0 where there is no such field.
struct FieldReader {
  std::size_t offset = 0;
  std::size_t size = 0;
  float (*load)(const std::uint8_t*) = nullptr;

  float operator()(const std::uint8_t* point) const { return load(point + offset); }
};

template <class T>
FieldReader readerOf(std::size_t offset) {
  return {offset, sizeof(T), loadAs<T>};
}

FieldReader readerOf(const PointField& field) {
  switch (field.datatype) {
    case PointField::INT8:
      return readerOf<std::int8_t>(field.offset);
    case PointField::UINT8:
      return readerOf<std::uint8_t>(field.offset);
    case PointField::INT16:
      return readerOf<std::int16_t>(field.offset);
    case PointField::UINT16:
      return readerOf<std::uint16_t>(field.offset);
    case PointField::INT32:
      return readerOf<std::int32_t>(field.offset);
    case PointField::UINT32:
      return readerOf<std::uint32_t>(field.offset);
    case PointField::FLOAT32:
      return readerOf<float>(field.offset);
    case PointField::FLOAT64:
      return readerOf<double>(field.offset);
    default:
      throw std::invalid_argument("field " + field.name + " of unknown type " +
                                  std::to_string(field.datatype));
  }
}

FieldReader findField(const sensor_msgs::PointCloud2& cloud, const std::string& name) {
  for (const PointField& field : cloud.fields) {
    if (field.name != name) continue;
    const FieldReader reader = readerOf(field);
    if (reader.offset + reader.size > cloud.point_step) {
      throw std::invalid_argument("field " + name + " ends beyond the point's " +
                                  std::to_string(cloud.point_step) + " bytes");
    }
    return reader;
  }
  return {};
}

FieldReader findCoordinate(const sensor_msgs::PointCloud2& cloud, const std::string& name) {
  for (const PointField& field : cloud.fields) {
    if (field.name == name &&
        (field.datatype == PointField::FLOAT32 || field.datatype == PointField::FLOAT64)) {
      return findField(cloud, name);
    }
  }
  throw std::invalid_argument("no field " + name + " of type float32 or float64");
}

}  // namespace

ConvertedScan toScan(const sensor_msgs::PointCloud2& cloud, const Eigen::Isometry3d& sensor_in_map,
                     const ScanLimits& limits) {
  if (cloud.is_bigendian) throw std::invalid_argument("big-endian data, expected little-endian");
  const FieldReader x = findCoordinate(cloud, "x"), y = findCoordinate(cloud, "y"),
                    z = findCoordinate(cloud, "z");
  FieldReader reflectivity = findField(cloud, "reflectivity");
  if (reflectivity.size == 0) reflectivity = findField(cloud, "intensity");

  const std::size_t width = cloud.width, height = cloud.height, row_size = width * cloud.point_step;
  const std::size_t row_step = height > 1 ? cloud.row_step : row_size;
  if (row_step < row_size || (height > 0 && cloud.data.size() < (height - 1) * row_step + row_size)) {
    throw std::invalid_argument(std::to_string(cloud.data.size()) + " bytes in rows of " +
                                std::to_string(row_step) + ", too few for " + std::to_string(height) + " x " +
                                std::to_string(width) + " points of " + std::to_string(cloud.point_step));
  }

  ConvertedScan converted;
  Scan& scan = converted.scan;
  scan.origin = sensor_in_map.translation().cast<float>();
  scan.hits.reserve(width * height);
  if (reflectivity.size > 0) scan.reflectivity.reserve(width * height);
  const Eigen::Isometry3f pose = sensor_in_map.cast<float>();
  for (std::size_t row = 0; row < height; ++row) {
    const std::uint8_t* point = cloud.data.data() + row * row_step;
    for (const std::uint8_t* end = point + row_size; point != end; point += cloud.point_step) {
      const Eigen::Vector3f hit = pose * Eigen::Vector3f(x(point), y(point), z(point));
      if (hit.z() < limits.min_z || hit.z() > limits.max_z) {
        ++converted.outside_z;
        continue;
      }
      scan.hits.push_back(hit);
      if (reflectivity.size > 0) scan.reflectivity.push_back(reflectivity(point));
    }
  }
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
