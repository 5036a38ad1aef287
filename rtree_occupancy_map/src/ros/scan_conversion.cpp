// SPDX-License-Identifier: BSD-3-Clause
#include "rtree_occupancy_map/ros/scan_conversion.h"

#include <mapping_common/cloud_fields.h>
#include <sensor_msgs/PointField.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <cstring>
#include <optional>
#include <sstream>
#include <stdexcept>
#include <string>
#include <vector>

namespace rtree_occupancy_map {
namespace {

using mapping_common::CloudField;
using mapping_common::LaserReading;
using mapping_common::SweepTimes;

constexpr double kLongestSweep = 1.0;  // s
constexpr std::size_t kSteps = 1024;   // of a sweep, each with its pose: 0.1 ms at 10 Hz

// ---- clouds -----------------------------------------------------------------------------------------

// Reads the colours of a cloud's points, where it has some.
class CloudColors {
 public:
  CloudColors() = default;
  explicit CloudColors(const sensor_msgs::PointCloud2& cloud) {
    using sensor_msgs::PointField;
    for (const char* name : {"rgb", "rgba"}) {
      const CloudField field = CloudField::find(cloud, name);
      if (!field) continue;
      if (field.type() != PointField::FLOAT32 && field.type() != PointField::UINT32 &&
          field.type() != PointField::INT32)
        throw std::invalid_argument(std::string("field ") + name +
                                    " is neither float32 nor uint32, which have the four bytes of a colour");
      for (const PointField& f : cloud.fields)
        if (f.name == name) packed_at_ = f.offset;
      return;
    }
    for (int i = 0; i < 3; ++i) {
      channels_[i] = CloudField::find(cloud, std::string(1, "rgb"[i]));
      if (!channels_[i] || channels_[i].type() != PointField::UINT8) return;
    }
    has_channels_ = true;
  }

  explicit operator bool() const { return packed_at_ || has_channels_; }
  Color operator()(const std::uint8_t* point) const {
    if (packed_at_) {
      std::uint32_t packed;
      std::memcpy(&packed, point + *packed_at_, sizeof(packed));
      return unpackedColor(packed);
    }
    Color color;
    for (int i = 0; i < 3; ++i) color[i] = static_cast<std::uint8_t>(channels_[i].number(point));
    return color;
  }

 private:
  std::optional<std::size_t> packed_at_;  // bytes from the point's first
  std::array<CloudField, 3> channels_;
  bool has_channels_ = false;
};

// Takes points of a cloud into a scan.
class CloudReader {
 public:
  CloudReader(const sensor_msgs::PointCloud2& cloud, const ScanLimits& limits)
      : limits_(limits),
        x_(CloudField::requireFloat(cloud, "x")),
        y_(CloudField::requireFloat(cloud, "y")),
        z_(CloudField::requireFloat(cloud, "z")),
        reflectivity_(CloudField::find(cloud, "reflectivity")) {
    if (!reflectivity_) reflectivity_ = CloudField::find(cloud, "intensity");
    if (limits.color) colors_ = CloudColors(cloud);
    mapping_common::checkedRowStep(cloud);
    const std::size_t points = static_cast<std::size_t>(cloud.width) * cloud.height;
    converted.scan.hits.reserve(points);
    if (reflectivity_) converted.scan.reflectivity.reserve(points);
    if (colors_) converted.scan.colors.reserve(points);
  }

  Eigen::Vector3f measured(const std::uint8_t* point) const { return {x_(point), y_(point), z_(point)}; }
  /// @return whether it is in the limits
  bool add(const std::uint8_t* point, const Eigen::Isometry3f& pose) {
    const Eigen::Vector3f in_sensor = measured(point);
    converted.at_infinity += in_sensor.array().isInf().any();
    const Eigen::Vector3f hit = pose * in_sensor;
    if (hit.z() < limits_.min_z || hit.z() > limits_.max_z) {
      ++converted.outside_z;
      return false;
    }
    converted.scan.hits.push_back(hit);
    if (reflectivity_) converted.scan.reflectivity.push_back(reflectivity_(point));
    if (colors_) converted.scan.colors.push_back(colors_(point));
    return true;
  }

  ConvertedScan converted;

 private:
  const ScanLimits& limits_;
  CloudField x_, y_, z_, reflectivity_;
  CloudColors colors_;
};

// When points were measured, s from the cloud's stamp on.
class CloudTimes {
 public:
  explicit CloudTimes(const sensor_msgs::PointCloud2& cloud) : stamp_(cloud.header.stamp) {
    for (const char* name : {"t", "time", "timestamp", "offset_time", "time_offset", "time_stamp"}) {
      field_ = CloudField::find(cloud, name);
      if (field_) {
        name_ = name;
        return;
      }
    }
    throw std::invalid_argument(
        "its points have no field t, time, timestamp, offset_time, time_offset or time_stamp, by which "
        "~undistort "
        "would know when they were measured");
  }

  double operator()(const std::uint8_t* point) const {
    using sensor_msgs::PointField;
    const double value = field_.number(point);
    if (field_.type() == PointField::FLOAT32) return value;
    if (field_.type() != PointField::FLOAT64) return 1e-9 * value;
    // Since 1970, without rounding more than the value itself is.
    if (value > 1e16) return 1e-9 * (value - 1e9 * stamp_.sec - stamp_.nsec);
    if (value > 1e8) return value - stamp_.sec - 1e-9 * stamp_.nsec;
    return value;
  }
  const std::string& field() const { return name_; }

 private:
  ros::Time stamp_;
  CloudField field_;
  std::string name_;
};

// ---- laser scans ------------------------------------------------------------------------------------

// @param pose_of of the sensor in the map, by a beam's number
template <class PoseOf>
ConvertedScan convert(const sensor_msgs::LaserScan& message, const LaserReading& reading,
                      const ScanLimits& limits, bool moves, const PoseOf& pose_of) {
  const std::size_t beams = message.ranges.size();
  ConvertedScan converted;
  Scan& scan = converted.scan;
  scan.hits.reserve(beams);
  if (reading.has_intensities) scan.reflectivity.reserve(beams);
  for (std::size_t i = 0; i < beams; ++i) {
    const float range = message.ranges[i];
    const double angle = message.angle_min + static_cast<double>(i) * message.angle_increment;
    const Eigen::Isometry3d& pose = pose_of(i);
    const auto pointAt = [&](double r) -> Eigen::Vector3f {
      return (pose * Eigen::Vector3d(r * std::cos(angle), r * std::sin(angle), 0.0)).cast<float>();
    };
    if (range >= reading.max_range) {
      if (limits.no_return_clears && std::isfinite(reading.max_range)) {
        scan.misses.push_back(pointAt(reading.max_range));
        if (moves) scan.miss_origins.push_back(pose.translation().cast<float>());
      }
      continue;
    }
    if (std::isfinite(range) && !reading.isReturn(range)) {
      ++converted.below_minimum;
      continue;
    }
    const Eigen::Vector3f hit = pointAt(range);
    if (hit.z() < limits.min_z || hit.z() > limits.max_z) {
      ++converted.outside_z;
      continue;
    }
    scan.hits.push_back(hit);
    if (moves) scan.hit_origins.push_back(pose.translation().cast<float>());
    if (reading.has_intensities) scan.reflectivity.push_back(message.intensities[i]);
  }
  return converted;
}

}  // namespace

ConvertedScan toScan(const sensor_msgs::PointCloud2& cloud, const Eigen::Isometry3d& sensor_in_map,
                     const ScanLimits& limits) {
  CloudReader reader(cloud, limits);
  const Eigen::Isometry3f pose = sensor_in_map.cast<float>();
  reader.converted.scan.origin = pose.translation();
  mapping_common::visitPoints(cloud,
                              [&](const std::uint8_t* point, std::size_t) { reader.add(point, pose); });
  return std::move(reader.converted);
}

SweepTimes sweepTimesOf(const sensor_msgs::PointCloud2& cloud) {
  const CloudTimes time_of(cloud);
  const CloudReader reader(cloud, {});
  constexpr double kInfinity = std::numeric_limits<double>::infinity();
  SweepTimes times{kInfinity, -kInfinity};
  mapping_common::visitPoints(cloud, [&](const std::uint8_t* point, std::size_t) {
    const double time = time_of(point);
    if (!std::isfinite(time) || !reader.measured(point).allFinite()) return;
    times.first = std::min(times.first, time);
    times.last = std::max(times.last, time);
  });
  if (times.first > times.last) return {};  // nothing was measured
  if (times.first < -kLongestSweep || times.last > kLongestSweep) {
    std::ostringstream text;
    text << "its points' times, of the field " << time_of.field() << ", are " << times.first << " s to "
         << times.last << " s from its stamp on, allowed is +-" << kLongestSweep
         << " s: the field has another unit, or the sensor another clock than its stamps";
    throw std::invalid_argument(text.str());
  }
  return times;
}

SweepTimes sweepTimesOf(const sensor_msgs::LaserScan& scan) {
  if (scan.ranges.empty()) return {};
  const double last = static_cast<double>(scan.time_increment) * static_cast<double>(scan.ranges.size() - 1);
  if (!(std::abs(last) <= kLongestSweep)) return {};
  return {std::min(0.0, last), std::max(0.0, last)};
}

ConvertedScan toScan(const sensor_msgs::PointCloud2& cloud, const SensorPath& frame, const SensorPath& origin,
                     const ScanLimits& limits) {
  const SweepTimes times = sweepTimesOf(cloud);
  const CloudTimes time_of(cloud);
  CloudReader reader(cloud, limits);
  const double step = (times.last - times.first) / kSteps;

  // The points step by step.
  std::vector<std::uint16_t> steps;
  std::array<std::size_t, kSteps + 1> begin{};
  steps.reserve(reader.converted.scan.hits.capacity());
  mapping_common::visitPoints(cloud, [&](const std::uint8_t* point, std::size_t) {
    const double number = (time_of(point) - times.first) / step;  // NaN where all are of one moment
    steps.push_back(static_cast<std::uint16_t>(number > 0.0 ? std::min(number, kSteps - 1.0) : 0.0));
    ++begin[steps.back() + 1U];
  });
  for (std::size_t i = 0; i < kSteps; ++i) begin[i + 1] += begin[i];
  std::vector<const std::uint8_t*> points(steps.size());
  std::array<std::size_t, kSteps + 1> next = begin;
  mapping_common::visitPoints(
      cloud, [&](const std::uint8_t* point, std::size_t index) { points[next[steps[index]]++] = point; });

  Scan& scan = reader.converted.scan;
  scan.origin = origin.at(0.0).translation().cast<float>();
  scan.hit_origins.reserve(points.size());
  for (std::size_t i = 0; i < kSteps; ++i) {
    if (begin[i] == begin[i + 1]) continue;
    const double time = times.first + (static_cast<double>(i) + 0.5) * step;
    const Eigen::Isometry3f pose = frame.at(time).cast<float>();
    const Eigen::Vector3f start = origin.at(time).translation().cast<float>();
    for (std::size_t k = begin[i]; k < begin[i + 1]; ++k)
      if (reader.add(points[k], pose)) scan.hit_origins.push_back(start);
  }
  return std::move(reader.converted);
}

ConvertedScan toScan(const sensor_msgs::LaserScan& message, const LaserReading& reading,
                     const Eigen::Isometry3d& sensor_in_map, const ScanLimits& limits) {
  ConvertedScan converted = convert(message, reading, limits, false,
                                    [&](std::size_t) -> const Eigen::Isometry3d& { return sensor_in_map; });
  converted.scan.origin = sensor_in_map.translation().cast<float>();
  return converted;
}

ConvertedScan toScan(const sensor_msgs::LaserScan& message, const Eigen::Isometry3d& sensor_in_map,
                     const ScanLimits& limits) {
  return toScan(message, mapping_common::LaserScans().read(message), sensor_in_map, limits);
}

ConvertedScan toScan(const sensor_msgs::LaserScan& message, const LaserReading& reading,
                     const SensorPath& frame, const ScanLimits& limits) {
  Eigen::Isometry3d pose;
  ConvertedScan converted =
      convert(message, reading, limits, true, [&](std::size_t i) -> const Eigen::Isometry3d& {
        return pose = frame.at(reading.time_increment * static_cast<double>(i));
      });
  converted.scan.origin = frame.at(0.0).translation().cast<float>();
  return converted;
}

}  // namespace rtree_occupancy_map
