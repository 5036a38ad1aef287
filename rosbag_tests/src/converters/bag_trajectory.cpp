// SPDX-License-Identifier: BSD-3-Clause
#include <geometry_msgs/PoseStamped.h>
#include <geometry_msgs/PoseWithCovarianceStamped.h>
#include <geometry_msgs/TransformStamped.h>
#include <mapping_simulation/ros/conversions.h>
#include <nav_msgs/Odometry.h>
#include <rosbag/bag.h>
#include <rosbag/view.h>
#include <rosbag_tests/converters/bag_trajectory.h>
#include <tf2/buffer_core.h>
#include <tf2_msgs/TFMessage.h>

#include <map>
#include <set>
#include <stdexcept>

namespace rosbag_tests {

using mapping_simulation::fromPose;
using mapping_simulation::fromTransform;
using mapping_simulation::TimedPose;
using mapping_simulation::Trajectory;

namespace {

using Poses = std::map<ros::Time, Eigen::Isometry3d>;

void open(rosbag::Bag& bag, const std::string& file) {
  try {
    bag.open(file, rosbag::bagmode::Read);
  } catch (const rosbag::BagException& e) {
    throw std::runtime_error(file + ": " + e.what());
  }
}

template <typename T>
boost::shared_ptr<T> read(const rosbag::MessageInstance& message) {
  try {
    return message.instantiate<T>();
  } catch (const std::exception&) {
    return nullptr;  // truncated
  }
}

void addPose(const rosbag::MessageInstance& message, Poses& poses) {
  try {
    if (const auto odometry = read<nav_msgs::Odometry>(message))
      poses.emplace(odometry->header.stamp, fromPose(odometry->pose.pose));
    else if (const auto pose = read<geometry_msgs::PoseStamped>(message))
      poses.emplace(pose->header.stamp, fromPose(pose->pose));
    else if (const auto uncertain = read<geometry_msgs::PoseWithCovarianceStamped>(message))
      poses.emplace(uncertain->header.stamp, fromPose(uncertain->pose.pose));
    else if (const auto transform = read<geometry_msgs::TransformStamped>(message))
      poses.emplace(transform->header.stamp, fromTransform(transform->transform));
  } catch (const std::runtime_error&) {
    // Not finite, or no rotation.
  }
}

Trajectory toTrajectory(const Poses& poses, const std::string& none) {
  if (poses.empty()) throw std::runtime_error(none);
  std::vector<TimedPose> timed;
  for (const auto& pose : poses) timed.push_back({pose.first.toSec(), pose.second});
  return Trajectory(std::move(timed));
}

}  // namespace

Trajectory readPoseTopic(const std::string& file, const std::string& topic) {
  rosbag::Bag bag;
  open(bag, file);
  Poses poses;
  for (const rosbag::MessageInstance& message : rosbag::View(bag, rosbag::TopicQuery(topic)))
    addPose(message, poses);
  return toTrajectory(poses, file + ": no pose on topic " + topic +
                                 " (Odometry, PoseStamped, PoseWithCovarianceStamped or TransformStamped)");
}

Trajectory readTransforms(const std::string& file, const std::string& parent, const std::string& child) {
  rosbag::Bag bag;
  open(bag, file);
  tf2::BufferCore buffer(ros::Duration(3e8));  // of all of the bag
  std::set<ros::Time> stamps;
  for (const std::string topic : {"tf", "tf_static"}) {
    const std::vector<std::string> names{topic, "/" + topic};
    for (const rosbag::MessageInstance& message : rosbag::View(bag, rosbag::TopicQuery(names))) {
      const auto tf = read<tf2_msgs::TFMessage>(message);
      if (!tf) continue;
      for (const auto& transform : tf->transforms) {
        buffer.setTransform(transform, "bag", topic == "tf_static");
        if (topic == "tf" && !transform.header.stamp.isZero()) stamps.insert(transform.header.stamp);
      }
    }
  }
  Poses poses;
  for (const ros::Time& stamp : stamps) {
    try {
      poses.emplace(stamp, fromTransform(buffer.lookupTransform(parent, child, stamp).transform));
    } catch (const std::exception&) {
      // Not connected at that time.
    }
  }
  return toTrajectory(poses, file + ": /tf and /tf_static nowhere connect " + parent + " with " + child);
}

}  // namespace rosbag_tests
