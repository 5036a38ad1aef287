// SPDX-License-Identifier: BSD-3-Clause
#include "intensity_hector_slam/ros/slam_publisher.h"

#include <geometry_msgs/PoseStamped.h>
#include <geometry_msgs/PoseWithCovarianceStamped.h>
#include <nav_msgs/Odometry.h>
#include <tf2_eigen/tf2_eigen.h>

#include <algorithm>
#include <array>
#include <string>
#include <utility>

#include "intensity_hector_slam/ros/map_conversion.h"

namespace intensity_hector_slam {

SlamPublisher::SlamPublisher(ros::NodeHandle& node, const SlamParameters& parameters)
    : parameters_(parameters),
      key_poses_(parameters.key_pose_distance, parameters.key_pose_angle, parameters.drift),
      maps_(node, parameters.map_frame) {
  path_.header.frame_id = parameters_.map_frame;
  pose_publisher_ = node.advertise<geometry_msgs::PoseStamped>("slam_out_pose", 1000);
  update_publisher_ =
      node.advertise<geometry_msgs::PoseWithCovarianceStamped>(parameters_.pose_update_topic, 10);
  if (parameters_.pub_odometry)
    odometry_publisher_ = node.advertise<nav_msgs::Odometry>("scanmatch_odom", 50);
  path_publisher_ = node.advertise<nav_msgs::Path>("path", 1, true);
  cloud_publisher_ = node.advertise<sensor_msgs::PointCloud>("slam_cloud", 1);
  edge_publisher_ = node.advertise<mapping_msgs::EdgeConstraint>("edges", 1000);
  key_scan_publisher_ = node.advertise<sensor_msgs::LaserScan>("key_scans", 1000);
}

std::optional<SlamPublisher::NewKeyPose> SlamPublisher::publishPose(const ros::Time& stamp,
                                                                    const SlamResult& result) {
  geometry_msgs::PoseWithCovarianceStamped update;
  update.header.stamp = stamp;
  update.header.frame_id = parameters_.map_frame;
  update.pose.pose = toMessage(result.pose);
  constexpr std::array<int, 3> kRows = {0, 1, 5};  // x, y, yaw
  for (int row = 0; row < 3; ++row) {
    for (int column = 0; column < 3; ++column) {
      update.pose.covariance[6 * kRows[row] + kRows[column]] = result.covariance(row, column);
    }
  }
  update_publisher_.publish(update);
  geometry_msgs::PoseStamped pose;
  pose.header = update.header;
  pose.pose = update.pose.pose;
  pose_publisher_.publish(pose);
  if (parameters_.pub_odometry) {
    nav_msgs::Odometry odometry;
    odometry.header = update.header;
    odometry.child_frame_id = parameters_.base_frame;
    odometry.pose = update.pose;
    odometry_publisher_.publish(odometry);
  }
  return publishKeyPose(stamp, result);
}

void SlamPublisher::publishKeyScan(const sensor_msgs::LaserScan& scan) {
  key_scan_publisher_.publish(scan);
}

void SlamPublisher::publishEdge(const Edge& edge) {
  edge_publisher_.publish(toMessage(edge, parameters_.map_frame, parameters_.base_frame));
}

std::optional<SlamPublisher::NewKeyPose> SlamPublisher::publishKeyPose(const ros::Time& stamp,
                                                                       const SlamResult& result) {
  const auto edge = key_poses_.add(stamp.toSec(), result);
  if (!key_poses_.last() || key_poses_.last()->stamp != stamp.toSec()) return {};
  geometry_msgs::PoseStamped pose;
  pose.header.stamp = stamp;
  pose.header.frame_id = parameters_.map_frame;
  pose.pose = toMessage(result.pose);
  path_.header.stamp = stamp;
  path_.poses.push_back(pose);
  if (path_publisher_.getNumSubscribers() > 0) path_publisher_.publish(path_);
  if (edge) publishEdge(*edge);
  return NewKeyPose{*key_poses_.last(), edge};
}

void SlamPublisher::publishTransforms(const ros::Time& stamp, const Pose& pose,
                                      const std::optional<Pose>& odometry, bool odometry_exists) {
  const auto send = [&](const ros::Time& at, const Pose& transform, const std::string& child) {
    geometry_msgs::TransformStamped message = tf2::eigenToTransform(toIsometry(transform));
    message.header.stamp = at;
    message.header.frame_id = parameters_.map_frame;
    message.child_frame_id = child;
    broadcaster_.sendTransform(message);
  };
  if (parameters_.pub_map_odom_transform && odometry) {
    const Pose odometry_frame = compose(pose, between(*odometry, Pose::Zero()));
    // Nobody shall interpolate between the body and the true frame of the odometry.
    if (last_without_odometry_) {
      send(*last_without_odometry_ + ros::Duration(0, 1), odometry_frame, parameters_.odom_frame);
    }
    last_without_odometry_.reset();
    send(stamp, odometry_frame, parameters_.odom_frame);
  } else if (parameters_.pub_map_odom_transform && !odometry_exists) {
    send(stamp, pose, parameters_.odom_frame);
    last_without_odometry_ = stamp;
  }
  if (parameters_.pub_map_scanmatch_transform) {
    send(stamp, pose, parameters_.tf_map_scanmatch_transform_frame_name);
  }
}

void SlamPublisher::publishCloud(const sensor_msgs::LaserScan& scan,
                                 const mapping_common::LaserReading& reading) {
  if (cloud_publisher_.getNumSubscribers() > 0)
    cloud_publisher_.publish(toPointCloud(scan, reading, parameters_.scan));
}

void SlamPublisher::restart() {
  key_poses_.breakChain();
  path_.poses.clear();
  maps_.restart();
  last_without_odometry_.reset();
}

void SlamPublisher::correct(const ros::Time& stamp, const Pose& correction) {
  key_poses_.correct(correction);
  for (auto& pose : path_.poses)
    if (pose.header.stamp > stamp) pose.pose = toMessage(compose(correction, toPose(pose.pose)));
  maps_.restart();
}

std::optional<Pose> SlamPublisher::keyPoseAt(const ros::Time& stamp) const {
  if (path_.poses.empty()) return std::nullopt;
  const auto then =
      std::lower_bound(path_.poses.begin(), path_.poses.end(), stamp,
                       [](const auto& pose, const ros::Time& time) { return pose.header.stamp < time; });
  return toPose((then != path_.poses.end() ? *then : path_.poses.back()).pose);
}

}  // namespace intensity_hector_slam
