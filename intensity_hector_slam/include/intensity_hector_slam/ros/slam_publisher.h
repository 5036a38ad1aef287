// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <intensity_hector_slam/key_poses.h>
#include <intensity_hector_slam/ros/map_publisher.h>
#include <intensity_hector_slam/ros/parameters.h>
#include <nav_msgs/Path.h>
#include <ros/ros.h>
#include <tf2_ros/transform_broadcaster.h>

#include <optional>

namespace intensity_hector_slam {

/// Publishes poses, transforms, key poses with their edges, and maps, on hector_mapping's topics.
class SlamPublisher {
 public:
  SlamPublisher(ros::NodeHandle& node, const SlamParameters& parameters);

  /// A key pose, and its edge from the one before, if they are connected.
  struct NewKeyPose {
    KeyPose key;
    std::optional<Edge> edge;
  };
  /// The pose with its covariance, and the next key pose where it is one.
  std::optional<NewKeyPose> publishPose(const ros::Time& stamp, const SlamResult& result);
  void publishEdge(const Edge& edge);
  /// The scan of a key pose, for who makes maps of these elsewhere.
  void publishKeyScan(const sensor_msgs::LaserScan& scan);
  /// @param odometry pose of the body in the odometry's frame, if known
  /// @param odometry_exists false: there is no such frame, it is taken for that of the body; true, and
  ///   `odometry` isn't known: it stays where it was in the map
  void publishTransforms(const ros::Time& stamp, const Pose& pose, const std::optional<Pose>& odometry,
                         bool odometry_exists);
  /// The ends of the beams, if somebody wants them.
  void publishCloud(const sensor_msgs::LaserScan& scan, const mapping_common::LaserReading& reading);
  /// Of the finest level, which has to be told what changes.
  MapPublisher& maps() { return maps_; }

  /// Key poses so far don't connect to those that follow, and the map is another.
  void restart();
  /// The map is another, which `correction` moves the poses to, of the path those later than the stamp.
  void correct(const ros::Time& stamp, const Pose& correction);
  /// The key pose at that time, or the last before; none where there is no key pose.
  std::optional<Pose> keyPoseAt(const ros::Time& stamp) const;

 private:
  std::optional<NewKeyPose> publishKeyPose(const ros::Time& stamp, const SlamResult& result);

  SlamParameters parameters_;
  KeyPoses key_poses_;
  nav_msgs::Path path_;  // of the key poses
  MapPublisher maps_;
  std::optional<ros::Time> last_without_odometry_;

  tf2_ros::TransformBroadcaster broadcaster_;
  ros::Publisher pose_publisher_, update_publisher_, odometry_publisher_, path_publisher_, edge_publisher_,
      key_scan_publisher_, cloud_publisher_;
};

}  // namespace intensity_hector_slam
