// SPDX-License-Identifier: BSD-3-Clause
#include "intensity_hector_slam/ros/bag_runner.h"

#include <mapping_common/laser_scans.h>
#include <mapping_common/transform_queue.h>
#include <nav_msgs/Odometry.h>
#include <rosbag/bag.h>
#include <rosbag/view.h>
#include <tf2/buffer_core.h>
#include <tf2_eigen/tf2_eigen.h>
#include <tf2_msgs/TFMessage.h>

#include <algorithm>
#include <chrono>
#include <ctime>
#include <memory>
#include <optional>
#include <stdexcept>

namespace intensity_hector_slam {
namespace {

constexpr char kOdometry[] = "odometry", kBody[] = "body";

// "scan" and "/scan" are one topic.
std::vector<std::string> spellings(const std::string& topic) {
  const std::string bare =
      topic.substr(topic.find_first_not_of('/') == std::string::npos ? 0 : topic.find_first_not_of('/'));
  return {bare, '/' + bare};
}

// All transforms of a bag at once, so that each scan finds those after it.
std::unique_ptr<tf2::BufferCore> makeBuffer(const rosbag::Bag& bag) {
  rosbag::View all(bag);
  return std::make_unique<tf2::BufferCore>(all.getEndTime() - all.getBeginTime() + ros::Duration(3600.0));
}

std::unique_ptr<tf2::BufferCore> readTransforms(const rosbag::Bag& bag) {
  auto buffer = makeBuffer(bag);
  rosbag::View view(bag,
                    rosbag::TopicQuery(std::vector<std::string>{"/tf", "tf", "/tf_static", "tf_static"}));
  for (const rosbag::MessageInstance& instance : view) {
    const auto message = instance.instantiate<tf2_msgs::TFMessage>();
    if (!message) continue;
    const bool is_static = instance.getTopic().find("static") != std::string::npos;
    for (geometry_msgs::TransformStamped transform : message->transforms) {
      transform.header.frame_id = mapping_common::withoutSlash(transform.header.frame_id);
      transform.child_frame_id = mapping_common::withoutSlash(transform.child_frame_id);
      buffer->setTransform(transform, "bag", is_static);
    }
  }
  return buffer;
}

// A topic of odometry as transforms from kOdometry to kBody.
std::unique_ptr<tf2::BufferCore> readOdometry(const rosbag::Bag& bag, const std::string& topic) {
  auto buffer = makeBuffer(bag);
  rosbag::View view(bag, rosbag::TopicQuery(spellings(topic)));
  if (view.size() == 0) throw std::runtime_error(bag.getFileName() + " has no messages on " + topic);
  for (const rosbag::MessageInstance& instance : view) {
    const auto message = instance.instantiate<nav_msgs::Odometry>();
    if (!message) throw std::runtime_error(topic + " isn't a nav_msgs/Odometry");
    geometry_msgs::TransformStamped transform;
    transform.header.stamp = message->header.stamp;
    transform.header.frame_id = kOdometry;
    transform.child_frame_id = kBody;
    const auto& pose = message->pose.pose;
    transform.transform.translation.x = pose.position.x;
    transform.transform.translation.y = pose.position.y;
    transform.transform.translation.z = pose.position.z;
    transform.transform.rotation = pose.orientation;
    buffer->setTransform(transform, "bag");
  }
  return buffer;
}

Eigen::Isometry3d lookup(const tf2::BufferCore& buffer, const std::string& target, const std::string& source,
                         const ros::Time& stamp) {
  return tf2::transformToEigen(buffer.lookupTransform(target, source, stamp));
}

// The frame above all others that tf has the body moving in, beside the map; empty: there is none.
std::string odometryIn(const tf2::BufferCore& buffer, const SlamParameters& parameters) {
  const std::string& body = parameters.base_frame;
  std::string top = body, parent;
  for (int depth = 0; depth < 100 && buffer._getParent(top, ros::Time(0), parent); ++depth) {
    if (parent == parameters.map_frame) break;
    top = parent;
  }
  if (top == body || !buffer.canTransform(top, body, ros::Time(0))) return "";
  const bool is_fixed = buffer.lookupTransform(top, body, ros::Time(0)).header.stamp.isZero();
  return is_fixed ? "" : top;
}

}  // namespace

BagResult runBag(const BagOptions& options, const SlamParameters& parameters,
                 const std::function<void(double)>& progress,
                 const std::function<void(const Scan&)>& processed) {
  rosbag::Bag bag(options.bag);
  const auto transforms = readTransforms(bag);
  const auto odometry_poses = options.odom_topic.empty() ? nullptr : readOdometry(bag, options.odom_topic);
  rosbag::View view(bag, rosbag::TopicQuery(spellings(options.scan_topic)));
  if (view.size() == 0) throw std::runtime_error(options.bag + " has no messages on " + options.scan_topic);

  Slam slam(parameters.slam);
  slam.setPose(parameters.start);
  if (!parameters.map_file.empty()) {
    slam.setMap(MultiMap::load(parameters.map_file, parameters.slam.map), parameters.start);
    if (parameters.relocalize_at_start) slam.setLost();
  }
  KeyPoses key_poses(parameters.key_pose_distance, parameters.key_pose_angle, parameters.drift);
  LoopFinder loops(parameters.loop, parameters.slam);
  mapping_common::LaserScans scans;
  BagResult result;
  if (options.odom_frame.empty() && options.odom_topic.empty())
    result.unused_odometry = odometryIn(*transforms, parameters);
  std::size_t done = 0;
  for (const rosbag::MessageInstance& instance : view) {
    if (progress) progress(static_cast<double>(done) / view.size());
    if (done++ % options.every != 0) continue;
    const auto message = instance.instantiate<sensor_msgs::LaserScan>();
    if (!message) throw std::runtime_error(options.scan_topic + " isn't a sensor_msgs/LaserScan");
    try {
      const std::string scanner = mapping_common::withoutSlash(message->header.frame_id);
      const ros::Time& stamp = message->header.stamp;
      if (done == 1) {
        result.scanner_is_body = scanner == parameters.base_frame || !parameters.use_tf_scan_transformation ||
                                 !transforms->_frameExists(scanner);
        if (result.scanner_is_body && !options.odom_frame.empty() && scanner != parameters.base_frame &&
            !transforms->_frameExists(parameters.base_frame)) {
          throw std::runtime_error(options.bag + " has no transforms of " + parameters.base_frame);
        }
      }
      const Eigen::Isometry3d sensor = result.scanner_is_body
                                           ? Eigen::Isometry3d::Identity()
                                           : lookup(*transforms, parameters.base_frame, scanner, stamp);
      std::optional<Pose> odometry;
      if (odometry_poses) {
        odometry = toPose(lookup(*odometry_poses, kOdometry, kBody, stamp));
      } else if (!options.odom_frame.empty()) {
        odometry = toPose(lookup(*transforms, mapping_common::withoutSlash(options.odom_frame),
                                 parameters.base_frame, stamp));
      }
      mapping_common::LaserReading reading = scans.read(*message);
      const Scan scan = toScan(*message, reading, sensor, parameters.scan);
      for (const auto& [what, why] : reading.warnings) result.warnings[what].add(why);
      const auto start = std::chrono::steady_clock::now();
      const SlamResult slam_result = slam.process(scan, odometry);
      const std::chrono::duration<double> time = std::chrono::steady_clock::now() - start;
      const bool found_again = slam_result.place && slam_result.place->sure;
      if (slam_result.time_jumped_back || (found_again && !odometry)) key_poses.breakChain();
      const auto edge = key_poses.add(scan.stamp, slam_result);
      if (edge) result.edges.push_back(*edge);
      if (parameters.loops && key_poses.last() && key_poses.last()->stamp == scan.stamp) {
        const std::clock_t loop_start = std::clock();
        for (const Edge& loop : loops.add(*key_poses.last(), slam.undistorted(scan), edge)) {
          result.edges.push_back(loop);
          if (!parameters.follow_loops || !isJump(loop)) continue;
          const Pose correction = correctionOf(loop);
          slam.move(correction);
          key_poses.correct(correction);
        }
        const double loop_time = static_cast<double>(std::clock() - loop_start) / CLOCKS_PER_SEC;
        result.loop_seconds += loop_time;
        result.longest_loop_seconds = std::max(result.longest_loop_seconds, loop_time);
      }
      result.entries.push_back({scan.stamp, slam_result, time.count()});
      if (processed) processed(scan);
    } catch (const tf2::TransformException& e) {
      result.dropped["no transform"].add(e.what());
    } catch (const std::invalid_argument& e) {
      result.dropped["malformed"].add(e.what());
    }
  }
  if (progress) progress(1.0);
  result.map = slam.map();
  result.loops = loops.counts();
  return result;
}

}  // namespace intensity_hector_slam
