// SPDX-License-Identifier: BSD-3-Clause
#include <mapping_simulation/ros/conversions.h>
#include <mapping_simulation/ros/stamped.h>
#include <tf2_msgs/TFMessage.h>

#include <boost/make_shared.hpp>

namespace mapping_simulation {

std_msgs::Header makeHeader(const ros::Time& stamp, const std::string& frame) {
  std_msgs::Header header;
  header.stamp = stamp;
  header.frame_id = frame;
  return header;
}

geometry_msgs::TransformStamped makeTransform(const ros::Time& stamp, const std::string& parent,
                                              const std::string& child, const Eigen::Isometry3d& pose) {
  geometry_msgs::TransformStamped transform;
  transform.header = makeHeader(stamp, parent);
  transform.child_frame_id = child;
  transform.transform = toTransform(pose);
  return transform;
}

void writeStaticTransforms(rosbag::Bag& bag, const ros::Time& time,
                           const std::vector<geometry_msgs::TransformStamped>& transforms) {
  namespace traits = ros::message_traits;
  tf2_msgs::TFMessage message;
  message.transforms = transforms;
  auto connection = boost::make_shared<ros::M_string>();
  (*connection)["type"] = traits::datatype(message);
  (*connection)["md5sum"] = traits::md5sum(message);
  (*connection)["message_definition"] = traits::definition(message);
  (*connection)["latching"] = "1";
  bag.write("/tf_static", time, message, connection);
}

}  // namespace mapping_simulation
