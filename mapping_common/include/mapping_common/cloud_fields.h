// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <sensor_msgs/PointCloud2.h>

#include <cstddef>
#include <cstdint>
#include <string>

namespace mapping_common {

/// Reads a field of a cloud's points as a number.
class CloudField {
 public:
  CloudField() = default;
  /// Whether there is such a field; without, it can't be read.
  explicit operator bool() const { return load_ != nullptr; }
  /// @param point its first byte
  float operator()(const std::uint8_t* point) const { return static_cast<float>(load_(point + offset_)); }
  /// With all its digits: of a time.
  double number(const std::uint8_t* point) const { return load_(point + offset_); }
  /// One of sensor_msgs/PointField.
  std::uint8_t type() const { return type_; }

  /// @return no field where the cloud has none of that name
  /// @throws std::invalid_argument that says what is malformed
  static CloudField find(const sensor_msgs::PointCloud2& cloud, const std::string& name);
  /// @throws std::invalid_argument where there is none, too
  static CloudField require(const sensor_msgs::PointCloud2& cloud, const std::string& name);
  /// Of a coordinate, which is float32 or float64.
  static CloudField requireFloat(const sensor_msgs::PointCloud2& cloud, const std::string& name);

 private:
  explicit CloudField(const sensor_msgs::PointField& field);

  std::size_t offset_ = 0, size_ = 0;
  std::uint8_t type_ = 0;
  double (*load_)(const std::uint8_t*) = nullptr;
};

/// Bytes from row to row.
/// @throws std::invalid_argument if the data is big-endian or too short for what the cloud says
std::size_t checkedRowStep(const sensor_msgs::PointCloud2& cloud);

/// Calls use(point, index) for the first byte of each point, row by row.
/// @throws std::invalid_argument as checkedRowStep
template <class Use>
void visitPoints(const sensor_msgs::PointCloud2& cloud, const Use& use) {
  const std::size_t row_step = checkedRowStep(cloud);
  std::size_t index = 0;
  for (std::size_t row = 0; row < cloud.height; ++row) {
    const std::uint8_t* point = cloud.data.data() + row * row_step;
    for (std::size_t column = 0; column < cloud.width; ++column, point += cloud.point_step)
      use(point, index++);
  }
}

}  // namespace mapping_common
