// SPDX-License-Identifier: BSD-3-Clause
#include "laser_intensity_calib/ros/conversions.h"

#include <cmath>
#include <cstdint>
#include <cstring>
#include <limits>
#include <stdexcept>
#include <string>

namespace laser_intensity_calib {
namespace {

using sensor_msgs::PointField;

template <class T>
float loadAs(const std::uint8_t* data) {
  T value;
  std::memcpy(&value, data, sizeof(value));
  return static_cast<float>(value);
}

struct FieldReader {
  std::size_t offset = 0, size = 0;
  float (*load)(const std::uint8_t*) = nullptr;

  explicit operator bool() const { return load != nullptr; }
  float operator()(const std::uint8_t* point) const { return load(point + offset); }
};

template <class T>
FieldReader readerOf(const PointField& field) {
  return {field.offset, sizeof(T), loadAs<T>};
}

FieldReader readerOf(const PointField& field) {
  switch (field.datatype) {
    case PointField::INT8:
      return readerOf<std::int8_t>(field);
    case PointField::UINT8:
      return readerOf<std::uint8_t>(field);
    case PointField::INT16:
      return readerOf<std::int16_t>(field);
    case PointField::UINT16:
      return readerOf<std::uint16_t>(field);
    case PointField::INT32:
      return readerOf<std::int32_t>(field);
    case PointField::UINT32:
      return readerOf<std::uint32_t>(field);
    case PointField::FLOAT32:
      return readerOf<float>(field);
    case PointField::FLOAT64:
      return readerOf<double>(field);
    default:
      throw std::invalid_argument("field " + field.name + " of unknown type " +
                                  std::to_string(field.datatype));
  }
}

FieldReader find(const sensor_msgs::PointCloud2& cloud, const std::string& name) {
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

FieldReader require(const sensor_msgs::PointCloud2& cloud, const std::string& name) {
  const FieldReader reader = find(cloud, name);
  if (!reader) throw std::invalid_argument("no field " + name);
  return reader;
}

struct Layout {
  std::size_t width, height, row_step;
};

Layout layoutOf(const sensor_msgs::PointCloud2& cloud) {
  if (cloud.is_bigendian) throw std::invalid_argument("big-endian data, expected little-endian");
  const std::size_t row_size = static_cast<std::size_t>(cloud.width) * cloud.point_step;
  const Layout layout{cloud.width, cloud.height, cloud.height > 1 ? cloud.row_step : row_size};
  if (layout.row_step < row_size ||
      (cloud.height > 0 && cloud.data.size() < (layout.height - 1) * layout.row_step + row_size)) {
    throw std::invalid_argument(std::to_string(cloud.data.size()) + " bytes, too few for " +
                                std::to_string(cloud.height) + " x " + std::to_string(cloud.width) +
                                " points of " + std::to_string(cloud.point_step));
  }
  return layout;
}

template <class Use>
void visitPoints(const sensor_msgs::PointCloud2& cloud, const Layout& layout, const Use& use) {
  Eigen::Index index = 0;
  for (std::size_t row = 0; row < layout.height; ++row) {
    const std::uint8_t* point = cloud.data.data() + row * layout.row_step;
    for (std::size_t column = 0; column < layout.width; ++column, point += cloud.point_step)
      use(point, index++);
  }
}

}  // namespace

ScanArrays readScan(const sensor_msgs::LaserScan& scan) {
  if (!std::isfinite(scan.angle_min) || !std::isfinite(scan.angle_increment) ||
      scan.angle_increment == 0.0F) {
    throw std::invalid_argument("angles that are not finite, or an angle_increment of 0");
  }
  if (scan.intensities.empty()) {
    throw std::invalid_argument("no intensities: let the driver publish them, or the scanner send them");
  }
  if (scan.intensities.size() != scan.ranges.size()) {
    throw std::invalid_argument(std::to_string(scan.intensities.size()) + " intensities for " +
                                std::to_string(scan.ranges.size()) + " ranges");
  }
  const auto n = static_cast<Eigen::Index>(scan.ranges.size());
  ScanArrays arrays{Eigen::Map<const Eigen::ArrayXf>(scan.ranges.data(), n),
                    Eigen::Map<const Eigen::ArrayXf>(scan.intensities.data(), n)};
  arrays.ranges = (arrays.ranges >= scan.range_min && arrays.ranges <= scan.range_max)
                      .select(arrays.ranges, std::numeric_limits<float>::quiet_NaN());
  return arrays;
}

CloudArrays readCloud(const sensor_msgs::PointCloud2& cloud) {
  const Layout layout = layoutOf(cloud);
  const FieldReader x = require(cloud, "x"), y = require(cloud, "y"), z = require(cloud, "z");
  const FieldReader intensity = require(cloud, "intensity");
  const FieldReader vp_x = find(cloud, "vp_x"), vp_y = find(cloud, "vp_y"), vp_z = find(cloud, "vp_z");
  const FieldReader ring = find(cloud, "ring");
  const bool viewpoints = vp_x && vp_y && vp_z;
  const auto n = static_cast<Eigen::Index>(layout.width * layout.height);
  CloudArrays arrays{Eigen::Matrix3Xf(3, n), Eigen::Matrix3Xf::Zero(3, viewpoints ? n : 1), Eigen::ArrayXf(n),
                     Eigen::ArrayXi(ring ? n : 0),
                     layout.height > 1 ? static_cast<Eigen::Index>(layout.width) : 0};
  visitPoints(cloud, layout, [&](const std::uint8_t* point, Eigen::Index i) {
    arrays.points.col(i) << x(point), y(point), z(point);
    arrays.intensities[i] = intensity(point);
    if (ring) arrays.lasers[i] = static_cast<int>(ring(point));
    if (viewpoints) arrays.viewpoints.col(i) << vp_x(point), vp_y(point), vp_z(point);
  });
  return arrays;
}

sensor_msgs::PointCloud2 withReflectivity(const sensor_msgs::PointCloud2& cloud,
                                          const Eigen::ArrayXf& reflectivity) {
  const Layout layout = layoutOf(cloud);
  if (reflectivity.size() != static_cast<Eigen::Index>(layout.width * layout.height)) {
    throw std::invalid_argument(std::to_string(reflectivity.size()) + " reflectivities for " +
                                std::to_string(layout.width * layout.height) + " points");
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
  visitPoints(cloud, layout, [&](const std::uint8_t* point, Eigen::Index i) {
    std::uint8_t* to = result.data.data() + static_cast<std::size_t>(i) * result.point_step;
    std::memcpy(to, point, cloud.point_step);
    std::memcpy(to + field.offset, &reflectivity[i], sizeof(float));
  });
  return result;
}

}  // namespace laser_intensity_calib
