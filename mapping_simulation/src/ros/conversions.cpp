// SPDX-License-Identifier: BSD-3-Clause
#include <mapping_simulation/ros/conversions.h>
#include <sensor_msgs/PointField.h>

#include <cmath>
#include <cstring>
#include <stdexcept>
#include <string>
#include <vector>

namespace mapping_simulation {
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
                                       const std_msgs::Header& header, double column_duration) {
  std::vector<std::string> fields{"x", "y", "z", "intensity"};
  if (column_duration > 0.0) fields.push_back("time");
  sensor_msgs::PointCloud2 message;
  message.header = header;
  message.height = 1;
  message.width = cloud.size();
  for (const std::string& name : fields) {
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
  for (std::size_t i = 0; i < cloud.size(); ++i, out += message.point_step) {
    const pcl::PointXYZI& point = cloud[i];
    const float values[] = {point.x, point.y, point.z, point.intensity,
                            static_cast<float>(column_duration * (i % cloud.width))};
    std::memcpy(out, values, message.point_step);
    if (!point.getVector3fMap().allFinite()) message.is_dense = false;
  }
  return message;
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

}  // namespace mapping_simulation
