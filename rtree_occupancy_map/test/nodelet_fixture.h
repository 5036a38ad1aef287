// SPDX-License-Identifier: BSD-3-Clause
//
// A mapping nodelet in the manager /manager, a namespace for each test, and what it takes to feed and to
// watch it.
#pragma once

#include <gtest/gtest.h>
#include <mapping_common/testing/nodelet_test.h>
#include <ros/ros.h>
#include <rtree_occupancy_map/CellsInBox.h>
#include <sensor_msgs/LaserScan.h>
#include <tf2_eigen/tf2_eigen.h>
#include <tf2_msgs/TFMessage.h>
#include <tf2_ros/static_transform_broadcaster.h>

#include <cmath>
#include <functional>
#include <map>
#include <string>
#include <vector>

#include "rtree_occupancy_map/ros/cell_conversion.h"
#include "rtree_occupancy_map/ros/scan_conversion.h"
#include "test_messages.h"

namespace rtree_occupancy_map {

/// Probability of each known voxel.
using Voxels = std::map<Voxel, float>;

inline void addVoxels(const std::array<int, 6>& box, float probability, Voxels& voxels) {
  for (int x = box[0]; x < box[3]; ++x) {
    for (int y = box[1]; y < box[4]; ++y) {
      for (int z = box[2]; z < box[5]; ++z) voxels[{x, y, z}] = probability;
    }
  }
}

inline Voxels voxelsOf(const OccupancyMap& map) {
  Voxels voxels;
  map.tree().visitAll([&voxels](const Cell& c) {
    addVoxels({c.box.min[0], c.box.min[1], c.box.min[2], c.box.max[0], c.box.max[1], c.box.max[2]},
              static_cast<float>(OccupancyMap::probability(c.log_odds)), voxels);
    return true;
  });
  return voxels;
}

using mapping_common::Recorder;
using mapping_common::spinFor;
using mapping_common::waitFor;

class NodeletTest : public mapping_common::NodeletTest {
 protected:
  NodeletTest()
      : mapping_common::NodeletTest("rtree_occupancy_map/MappingNodelet", "mapping"),
        map_frame_(test_ + "_map") {
    ros::param::set(name_ + "/frame_id", map_frame_);
    ros::param::set(name_ + "/publish_rate", 50.0);
  }
  bool load() {
    if (!mapping_common::NodeletTest::load()) return false;
    clouds_ = node_.advertise<sensor_msgs::PointCloud2>(cloud_topic_, 100);
    scans_ = node_.advertise<sensor_msgs::LaserScan>("scan", 100);
    tf_ = node_.advertise<tf2_msgs::TFMessage>("/tf", 100);
    return waitFor([this] {
      return clouds_.getNumSubscribers() > 0 && scans_.getNumSubscribers() > 0 && tf_.getNumSubscribers() > 0;
    });
  }

  std::string frame(const std::string& name) const { return test_ + "_" + name; }

  geometry_msgs::TransformStamped transformOf(const std::string& sensor, const Eigen::Isometry3d& pose,
                                              const ros::Time& stamp) const {
    geometry_msgs::TransformStamped transform = tf2::eigenToTransform(pose);
    transform.header.frame_id = map_frame_;
    transform.header.stamp = stamp;
    transform.child_frame_id = frame(sensor);
    return transform;
  }
  void sendStaticPose(const std::string& sensor, const Eigen::Isometry3d& pose) {
    broadcaster_.sendTransform(transformOf(sensor, pose, ros::Time(0)));
  }
  void sendPose(const std::string& sensor, const Eigen::Isometry3d& pose, const ros::Time& stamp) {
    tf2_msgs::TFMessage message;
    message.transforms.push_back(transformOf(sensor, pose, stamp));
    tf_.publish(message);
  }

  /// Publishes, and puts it in the reference map as well.
  template <class Message>
  void publish(Message message, const std::string& sensor, const Eigen::Isometry3d& pose,
               const ros::Time& stamp = ros::Time::now()) {
    send(message, sensor, stamp);
    reference_.insertScan(toScan(message, tf2::transformToEigen(transformOf(sensor, pose, stamp)), {}).scan);
  }
  void send(sensor_msgs::PointCloud2 message, const std::string& sensor,
            const ros::Time& stamp = ros::Time::now()) {
    message.header.frame_id = frame(sensor);
    message.header.stamp = stamp;
    clouds_.publish(message);
  }
  void send(sensor_msgs::LaserScan message, const std::string& sensor,
            const ros::Time& stamp = ros::Time::now()) {
    message.header.frame_id = frame(sensor);
    message.header.stamp = stamp;
    scans_.publish(message);
  }

  CellsInBox::Response cellsInBox(double half_size, bool occupied_only) {
    CellsInBox service;
    service.request.min = toPoint(Eigen::Vector3d::Constant(-half_size));
    service.request.max = toPoint(Eigen::Vector3d::Constant(half_size));
    service.request.occupied_only = occupied_only;
    EXPECT_TRUE(ros::service::call(name_ + "/cells_in_box", service));
    return service.response;
  }

  /// The nodelet's map.
  Voxels voxels() {
    Voxels voxels;
    for (const MapCell& cell : cellsInBox(1000.0, false).cells) {
      const Eigen::Vector3d min = toEigen(cell.min), max = toEigen(cell.max);
      addVoxels(boxOf(0.5 * (min + max), max - min, 0.2), cell.probability, voxels);
    }
    return voxels;
  }
  bool waitForMap(const OccupancyMap& expected) {
    const Voxels voxels_expected = voxelsOf(expected);
    return waitFor([&] { return voxels() == voxels_expected; });
  }

  const std::string map_frame_;
  std::string cloud_topic_ = "cloud_in";
  OccupancyMap reference_;
  ros::Publisher clouds_, scans_, tf_;
  tf2_ros::StaticTransformBroadcaster broadcaster_;
};

inline Eigen::Isometry3d poseOf(double x, double y, double z, double yaw = 0.0) {
  Eigen::Isometry3d pose(Eigen::AngleAxisd(yaw, Eigen::Vector3d::UnitZ()));
  pose.translation() = Eigen::Vector3d(x, y, z);
  return pose;
}

}  // namespace rtree_occupancy_map
