// SPDX-License-Identifier: BSD-3-Clause
//
// sensor_msgs::PointCloud2 and pcl::PCLPointCloud2 have the same members and type codes: one reader for both.
#pragma once

#include <pcl/point_cloud.h>
#include <pcl/point_types.h>

#include <cstdint>
#include <cstring>
#include <limits>
#include <stdexcept>
#include <string>

namespace rosbag_tests {

/// Bytes of a value of a PointField type code; 0 for an unknown code.
inline std::size_t fieldSize(int type) {
  constexpr std::size_t kSizes[] = {0, 1, 1, 2, 2, 4, 4, 4, 8};
  return type >= 1 && type <= 8 ? kSizes[type] : 0;
}

template <typename T>
float loadAs(const std::uint8_t* data) {
  T value;
  std::memcpy(&value, data, sizeof(value));
  return static_cast<float>(value);
}

/// The value at `data` of a PointField type code.
inline float fieldValue(const std::uint8_t* data, int type) {
  switch (type) {
    case 1:
      return loadAs<std::int8_t>(data);
    case 2:
      return loadAs<std::uint8_t>(data);
    case 3:
      return loadAs<std::int16_t>(data);
    case 4:
      return loadAs<std::uint16_t>(data);
    case 5:
      return loadAs<std::int32_t>(data);
    case 6:
      return loadAs<std::uint32_t>(data);
    case 7:
      return loadAs<float>(data);
    case 8:
      return loadAs<double>(data);
    default:
      return std::numeric_limits<float>::quiet_NaN();
  }
}

/// Fills `cloud` from the fields x y z and, if there, intensity (else 0). Throws std::runtime_error saying
/// what is malformed, with `cloud` unchanged.
template <typename Message>
void readPoints(const Message& message, pcl::PointCloud<pcl::PointXYZI>& cloud) {
  const std::size_t width = message.width, height = message.height;
  const std::size_t step = message.point_step, row_step = message.row_step;
  if (width == 0 || height == 0) throw std::runtime_error("cloud without points");
  if (message.is_bigendian) throw std::runtime_error("big-endian cloud, expected little-endian");
  const auto find = [&](const char* name) {
    for (const auto& field : message.fields) {
      if (field.name != name) continue;
      const std::size_t size = fieldSize(field.datatype);
      if (size == 0 || field.offset + size > step)
        throw std::runtime_error("field " + field.name + " of unknown type or beyond the point's " +
                                 std::to_string(step) + " bytes");
      return &field;
    }
    return static_cast<decltype(message.fields.data())>(nullptr);
  };
  const auto *x = find("x"), *y = find("y"), *z = find("z"), *intensity = find("intensity");
  if (!x || !y || !z) throw std::runtime_error("cloud without the fields x, y and z");
  if ((height > 1 && row_step < width * step) || message.data.size() < (height - 1) * row_step + width * step)
    throw std::runtime_error("cloud of " + std::to_string(message.data.size()) + " bytes, expected " +
                             std::to_string(height) + " x " + std::to_string(width) + " points of " +
                             std::to_string(step) + " bytes");

  cloud.resize(width * height);
  auto out = cloud.begin();
  for (std::size_t row = 0; row < height; ++row) {
    const std::uint8_t* point = message.data.data() + row * row_step;
    for (std::size_t column = 0; column < width; ++column, point += step, ++out) {
      out->x = fieldValue(point + x->offset, x->datatype);
      out->y = fieldValue(point + y->offset, y->datatype);
      out->z = fieldValue(point + z->offset, z->datatype);
      out->intensity = intensity ? fieldValue(point + intensity->offset, intensity->datatype) : 0.0f;
    }
  }
  cloud.is_dense = false;
}

}  // namespace rosbag_tests
