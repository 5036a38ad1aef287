// SPDX-License-Identifier: BSD-3-Clause
#include "mapping_common/cloud_fields.h"

#include <cstring>
#include <stdexcept>

namespace mapping_common {
namespace {

using sensor_msgs::PointField;

template <class T>
double loadAs(const std::uint8_t* data) {
  T value;
  std::memcpy(&value, data, sizeof(value));
  return static_cast<double>(value);
}

}  // namespace

CloudField::CloudField(const PointField& field) : offset_(field.offset), type_(field.datatype) {
  const auto is = [this](auto value) {
    size_ = sizeof(value);
    load_ = loadAs<decltype(value)>;
  };
  switch (field.datatype) {
    case PointField::INT8:
      is(std::int8_t());
      break;
    case PointField::UINT8:
      is(std::uint8_t());
      break;
    case PointField::INT16:
      is(std::int16_t());
      break;
    case PointField::UINT16:
      is(std::uint16_t());
      break;
    case PointField::INT32:
      is(std::int32_t());
      break;
    case PointField::UINT32:
      is(std::uint32_t());
      break;
    case PointField::FLOAT32:
      is(float());
      break;
    case PointField::FLOAT64:
      is(double());
      break;
    default:
      throw std::invalid_argument("field " + field.name + " of unknown type " +
                                  std::to_string(field.datatype));
  }
}

CloudField CloudField::find(const sensor_msgs::PointCloud2& cloud, const std::string& name) {
  for (const PointField& field : cloud.fields) {
    if (field.name != name) continue;
    const CloudField found(field);
    if (found.offset_ + found.size_ > cloud.point_step) {
      throw std::invalid_argument("field " + name + " ends beyond the point's " +
                                  std::to_string(cloud.point_step) + " bytes");
    }
    return found;
  }
  return {};
}

CloudField CloudField::require(const sensor_msgs::PointCloud2& cloud, const std::string& name) {
  const CloudField field = find(cloud, name);
  if (!field) throw std::invalid_argument("no field " + name);
  return field;
}

CloudField CloudField::requireFloat(const sensor_msgs::PointCloud2& cloud, const std::string& name) {
  const CloudField field = find(cloud, name);
  if (field.load_ != loadAs<float> && field.load_ != loadAs<double>) {
    throw std::invalid_argument("no field " + name + " of type float32 or float64");
  }
  return field;
}

std::size_t checkedRowStep(const sensor_msgs::PointCloud2& cloud) {
  if (cloud.is_bigendian) throw std::invalid_argument("big-endian data, expected little-endian");
  const std::size_t row_size = static_cast<std::size_t>(cloud.width) * cloud.point_step;
  const std::size_t row_step = cloud.height > 1 ? cloud.row_step : row_size;
  if (row_step < row_size ||
      (cloud.height > 0 && cloud.data.size() < (cloud.height - std::size_t{1}) * row_step + row_size)) {
    throw std::invalid_argument(std::to_string(cloud.data.size()) + " bytes in rows of " +
                                std::to_string(row_step) + ", too few for " + std::to_string(cloud.height) +
                                " x " + std::to_string(cloud.width) + " points of " +
                                std::to_string(cloud.point_step));
  }
  return row_step;
}

}  // namespace mapping_common
