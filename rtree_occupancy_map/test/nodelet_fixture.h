// SPDX-License-Identifier: BSD-3-Clause
//
// A mapping nodelet in the manager /manager, a namespace for each test, and what it takes to feed and to
// watch it.
#pragma once

#include <diagnostic_msgs/DiagnosticArray.h>
#include <gtest/gtest.h>
#include <nodelet/NodeletLoad.h>
#include <nodelet/NodeletUnload.h>
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

/// Lets callbacks run until the condition holds. @return false if it didn't in time
inline bool waitFor(const std::function<bool()>& condition, double seconds = 10.0) {
  const ros::WallTime end = ros::WallTime::now() + ros::WallDuration(seconds);
  while (ros::ok()) {
    ros::spinOnce();
    if (condition()) return true;
    if (ros::WallTime::now() > end) return false;
    ros::WallDuration(0.01).sleep();
  }
  return false;
}

inline void spinFor(double seconds) {
  waitFor([] { return false; }, seconds);
}

/// All messages of a topic.
template <class Message>
class Recorder {
 public:
  Recorder(ros::NodeHandle& node, const std::string& topic)
      : subscriber_(node.subscribe<Message>(
            topic, 100,
            [this](const boost::shared_ptr<const Message>& message) { messages.push_back(*message); })) {}
  bool waitForOne() {
    const std::size_t before = messages.size();
    return waitFor([&] { return messages.size() > before; });
  }
  std::vector<Message> messages;

 private:
  ros::Subscriber subscriber_;
};

class NodeletTest : public ::testing::Test {
 protected:
  NodeletTest()
      : test_(::testing::UnitTest::GetInstance()->current_test_info()->name()),
        node_("/" + test_),
        name_("/" + test_ + "/mapping"),
        map_frame_(test_ + "_map"),
        diagnostics_(node_, "/diagnostics") {
    ros::param::set(name_ + "/frame_id", map_frame_);
    ros::param::set(name_ + "/publish_rate", 50.0);
  }
  ~NodeletTest() override { unload(); }

  template <class T>
  void setParam(const std::string& parameter, const T& value) {
    ros::param::set(name_ + "/" + parameter, value);
  }

  bool load() {
    nodelet::NodeletLoad load;
    load.request.name = name_;
    load.request.type = "rtree_occupancy_map/MappingNodelet";
    EXPECT_TRUE(ros::service::waitForService("/manager/load_nodelet", ros::Duration(-1.0)));
    if (!ros::service::call("/manager/load_nodelet", load) || !load.response.success) return false;
    loaded_ = true;
    clouds_ = node_.advertise<sensor_msgs::PointCloud2>("cloud_in", 100);
    scans_ = node_.advertise<sensor_msgs::LaserScan>("scan", 100);
    tf_ = node_.advertise<tf2_msgs::TFMessage>("/tf", 100);
    return waitFor([this] {
      return clouds_.getNumSubscribers() > 0 && scans_.getNumSubscribers() > 0 && tf_.getNumSubscribers() > 0;
    });
  }

  void unload() {
    nodelet::NodeletUnload unload;
    unload.request.name = name_;
    if (loaded_) ros::service::call("/manager/unload_nodelet", unload);
    loaded_ = false;
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
    spinFor(0.1);  // tf2_ros::MessageFilter may overlook a transform that comes together with the message
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

  /// The latest value of the nodelet's diagnostics, empty before there is any.
  std::string diagnostic(const std::string& status_name, const std::string& key) {
    std::string value;
    for (const auto& message : diagnostics_.messages) {
      for (const auto& status : message.status) {
        if (status.name.find(test_ + "/mapping: " + status_name) == std::string::npos) continue;
        for (const auto& pair : status.values) {
          if (pair.key == key) value = pair.value;
        }
      }
    }
    return value;
  }
  void expectDiagnostic(const std::string& status, const std::string& key, const std::string& value) {
    EXPECT_TRUE(waitFor([&] { return diagnostic(status, key) == value; }, 5.0))
        << key << " is " << diagnostic(status, key) << ", expected " << value;
  }

  const std::string test_;
  ros::NodeHandle node_;
  const std::string name_, map_frame_;
  OccupancyMap reference_;
  ros::Publisher clouds_, scans_, tf_;
  tf2_ros::StaticTransformBroadcaster broadcaster_;
  Recorder<diagnostic_msgs::DiagnosticArray> diagnostics_;
  bool loaded_ = false;
};

inline Eigen::Isometry3d poseOf(double x, double y, double z, double yaw = 0.0) {
  Eigen::Isometry3d pose(Eigen::AngleAxisd(yaw, Eigen::Vector3d::UnitZ()));
  pose.translation() = Eigen::Vector3d(x, y, z);
  return pose;
}

}  // namespace rtree_occupancy_map
