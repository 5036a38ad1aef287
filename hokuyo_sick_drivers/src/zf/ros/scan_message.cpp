// SPDX-License-Identifier: BSD-3-Clause
#include "scan_message.h"

#include <utility>

namespace hokuyo_sick_drivers {

sensor_msgs::PointCloud2 toMessage(ScanCloud&& cloud, const std_msgs::Header& header) {
  sensor_msgs::PointCloud2 message;
  message.header = header;
  message.width = cloud.width;
  message.height = cloud.height;
  for (const auto& [name, offset] : cloud.fields()) {
    sensor_msgs::PointField field;
    field.name = name;
    field.offset = offset;
    field.datatype = sensor_msgs::PointField::FLOAT32;
    field.count = 1;
    message.fields.push_back(field);
  }
  message.point_step = cloud.pointStep();
  message.row_step = message.point_step * message.width;
  message.is_dense = static_cast<std::uint8_t>(cloud.points == std::uint64_t{cloud.width} * cloud.height);
  message.data = std::move(cloud.data);
  return message;
}

geometry_msgs::TransformStamped toMessage(const Eigen::Isometry3d& pose, const std_msgs::Header& header,
                                          const std::string& parent) {
  const Eigen::Quaterniond rotation(pose.linear());
  geometry_msgs::TransformStamped transform;
  transform.header = header;
  transform.header.frame_id = parent;
  transform.child_frame_id = header.frame_id;
  transform.transform.translation.x = pose.translation().x();
  transform.transform.translation.y = pose.translation().y();
  transform.transform.translation.z = pose.translation().z();
  transform.transform.rotation.w = rotation.w();
  transform.transform.rotation.x = rotation.x();
  transform.transform.rotation.y = rotation.y();
  transform.transform.rotation.z = rotation.z();
  return transform;
}

}  // namespace hokuyo_sick_drivers
