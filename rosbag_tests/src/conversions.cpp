// SPDX-License-Identifier: BSD-3-Clause
#include <rosbag_tests/conversions.h>
#include <sensor_msgs/PointField.h>

#include <cmath>
#include <cstring>
#include <limits>
#include <stdexcept>

#include "point_fields.h"

namespace rosbag_tests {
namespace {

template <typename Position, typename Rotation>
Eigen::Isometry3d toIsometry(const Position& p, const Rotation& r) {
  const Eigen::Vector3d translation(p.x, p.y, p.z);
  const Eigen::Quaterniond rotation(r.w, r.x, r.y, r.z);
  if (!translation.allFinite() || !(std::abs(rotation.norm() - 1.0) < 0.01))
    throw std::runtime_error("pose that isn't finite or whose quaternion isn't of unit length");
  Eigen::Isometry3d pose(rotation.normalized());
  pose.translation() = translation;
  return pose;
}

template <typename Position, typename Rotation>
void fill(const Eigen::Isometry3d& pose, Position& p, Rotation& r) {
  const Eigen::Quaterniond q(pose.rotation());
  p.x = pose.translation().x();
  p.y = pose.translation().y();
  p.z = pose.translation().z();
  r.x = q.x();
  r.y = q.y();
  r.z = q.z();
  r.w = q.w();
}

}  // namespace

sensor_msgs::PointCloud2 toPointCloud2(const pcl::PointCloud<pcl::PointXYZI>& cloud,
                                       const std_msgs::Header& header) {
  sensor_msgs::PointCloud2 message;
  message.header = header;
  message.height = 1;
  message.width = cloud.size();
  for (const char* name : {"x", "y", "z", "intensity"}) {
    sensor_msgs::PointField field;
    field.name = name;
    field.offset = message.point_step;
    field.datatype = sensor_msgs::PointField::FLOAT32;
    field.count = 1;
    message.fields.push_back(field);
    message.point_step += sizeof(float);
  }
  message.row_step = message.width * message.point_step;
  message.data.resize(cloud.size() * message.point_step);
  message.is_dense = true;
  std::uint8_t* out = message.data.data();
  for (const auto& point : cloud) {
    const float values[] = {point.x, point.y, point.z, point.intensity};
    std::memcpy(out, values, sizeof(values));
    out += sizeof(values);
    if (!point.getVector3fMap().allFinite()) message.is_dense = false;
  }
  return message;
}

void fromPointCloud2(const sensor_msgs::PointCloud2& message, pcl::PointCloud<pcl::PointXYZI>& cloud) {
  readPoints(message, cloud);
}

void fromLaserScan(const sensor_msgs::LaserScan& message, pcl::PointCloud<pcl::PointXYZI>& cloud) {
  if (message.ranges.empty()) throw std::runtime_error("laser scan without ranges");
  if (!message.intensities.empty() && message.intensities.size() != message.ranges.size())
    throw std::runtime_error("laser scan with unequal numbers of ranges and intensities");
  if (!std::isfinite(message.angle_min) || !std::isfinite(message.angle_increment) ||
      message.angle_increment == 0.0f)
    throw std::runtime_error("laser scan without valid angles");
  constexpr float kNan = std::numeric_limits<float>::quiet_NaN();
  cloud.resize(message.ranges.size());
  for (std::size_t i = 0; i < cloud.size(); ++i) {
    const double range = message.ranges[i];
    const double angle = message.angle_min + static_cast<double>(i) * message.angle_increment;
    const bool hit = std::isfinite(range) && range >= message.range_min && range <= message.range_max;
    cloud[i].getVector3fMap() = hit ? Eigen::Vector3f(range * std::cos(angle), range * std::sin(angle), 0.0f)
                                    : Eigen::Vector3f::Constant(kNan);
    cloud[i].intensity = message.intensities.empty() ? 0.0f : message.intensities[i];
  }
  cloud.is_dense = false;
}

geometry_msgs::Pose toPose(const Eigen::Isometry3d& pose) {
  geometry_msgs::Pose message;
  fill(pose, message.position, message.orientation);
  return message;
}

geometry_msgs::Transform toTransform(const Eigen::Isometry3d& pose) {
  geometry_msgs::Transform message;
  fill(pose, message.translation, message.rotation);
  return message;
}

Eigen::Isometry3d fromPose(const geometry_msgs::Pose& pose) {
  return toIsometry(pose.position, pose.orientation);
}

Eigen::Isometry3d fromTransform(const geometry_msgs::Transform& transform) {
  return toIsometry(transform.translation, transform.rotation);
}

}  // namespace rosbag_tests
