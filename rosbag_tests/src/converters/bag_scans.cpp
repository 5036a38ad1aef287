// SPDX-License-Identifier: BSD-3-Clause
#include <geometry_msgs/PoseStamped.h>
#include <geometry_msgs/TransformStamped.h>
#include <mapping_simulation/ros/conversions.h>
#include <nav_msgs/Odometry.h>
#include <rosbag_tests/converters/bag_scans.h>
#include <rosbag_tests/converters/conversions.h>
#include <tf2/exceptions.h>
#include <tf2_msgs/TFMessage.h>

#include <algorithm>
#include <set>
#include <stdexcept>
#include <vector>

namespace rosbag_tests {

using mapping_simulation::fromPose;
using mapping_simulation::fromTransform;
using mapping_simulation::PosedScan;
using mapping_simulation::toTransform;

namespace {

const ros::Duration kWholeBag(3e8);  // s: tf2 forgets what is older than this
const char kBody[] = "body";         // frame names within the buffer of the pose topic
const char kFixed[] = "fixed";

/// The message, or null if it can't be deserialized as T.
template <typename T>
boost::shared_ptr<T> read(const rosbag::MessageInstance& message) {
  try {
    return message.instantiate<T>();
  } catch (const std::exception&) {
    return nullptr;
  }
}

std::string withoutSlash(const std::string& name) {
  return name.rfind('/', 0) == 0 ? name.substr(1) : name;
}

/// The one topic of the bag that is of one of these types and, unless empty, named `wanted`.
std::string findTopic(const rosbag::Bag& bag, const std::string& wanted,
                      const std::vector<std::string>& types) {
  std::set<std::string> fitting;
  std::string all;
  for (const rosbag::ConnectionInfo* connection : rosbag::View(bag).getConnections()) {
    all += "\n  " + connection->topic + " (" + connection->datatype + ")";
    if ((wanted.empty() || withoutSlash(connection->topic) == withoutSlash(wanted)) &&
        std::find(types.begin(), types.end(), connection->datatype) != types.end())
      fitting.insert(connection->topic);
  }
  if (fitting.size() == 1) return *fitting.begin();
  std::string expected;
  for (const auto& type : types) expected += (expected.empty() ? "" : ", ") + type;
  throw std::runtime_error(bag.getFileName() + ": expected one topic" + (wanted.empty() ? "" : " " + wanted) +
                           " of " + expected + ", found " + std::to_string(fitting.size()) +
                           "; the bag holds:" + (all.empty() ? " nothing" : all));
}

}  // namespace

BagScans::BagScans(const std::string& file, const BagScansOptions& options)
    : options_(options), tf_(kWholeBag), poses_(kWholeBag) {
  try {
    bag_.open(file, rosbag::bagmode::Read);
  } catch (const rosbag::BagUnindexedException&) {
    throw std::runtime_error(file + ": bag without an index, run `rosbag reindex` on it");
  } catch (const rosbag::BagException& e) {
    throw std::runtime_error(file + ": " + e.what());
  }
  options_.topic = findTopic(bag_, options_.topic, {"sensor_msgs/PointCloud2", "sensor_msgs/LaserScan"});
  readTransforms("tf", false);
  readTransforms("tf_static", true);
  if (!options_.pose_topic.empty()) readPoses();
  view_.addQuery(bag_, rosbag::TopicQuery(options_.topic));
  size_ = view_.size();
  next_ = view_.begin();
}

void BagScans::readTransforms(const std::string& topic, bool is_static) {
  rosbag::View view(bag_, rosbag::TopicQuery(std::vector<std::string>{topic, "/" + topic}));
  for (const rosbag::MessageInstance& instance : view) {
    const auto message = read<tf2_msgs::TFMessage>(instance);
    if (!message) {
      ++malformed_poses_;
      continue;
    }
    for (const auto& transform : message->transforms) tf_.setTransform(transform, "bag", is_static);
  }
}

void BagScans::readPoses() {
  const std::string topic =
      findTopic(bag_, options_.pose_topic,
                {"geometry_msgs/PoseStamped", "geometry_msgs/TransformStamped", "nav_msgs/Odometry"});
  const auto add = [&](const std_msgs::Header& header, const std::string& child,
                       const Eigen::Isometry3d& pose) {
    if (options_.body_frame.empty()) options_.body_frame = withoutSlash(child);
    geometry_msgs::TransformStamped transform;
    transform.header.stamp = header.stamp;
    transform.header.frame_id = kFixed;
    transform.child_frame_id = kBody;
    transform.transform = toTransform(pose);
    poses_.setTransform(transform, "bag");
  };
  rosbag::View view(bag_, rosbag::TopicQuery(topic));
  for (const rosbag::MessageInstance& instance : view) {
    try {
      if (const auto pose = read<geometry_msgs::PoseStamped>(instance))
        add(pose->header, "", fromPose(pose->pose));
      else if (const auto transform = read<geometry_msgs::TransformStamped>(instance))
        add(transform->header, transform->child_frame_id, fromTransform(transform->transform));
      else if (const auto odometry = read<nav_msgs::Odometry>(instance))
        add(odometry->header, odometry->child_frame_id, fromPose(odometry->pose.pose));
      else
        ++malformed_poses_;
    } catch (const std::runtime_error&) {
      ++malformed_poses_;
    }
  }
}

bool BagScans::poseAt(const std::string& frame, const ros::Time& stamp, Eigen::Isometry3d& pose) const {
  if (stamp.isZero()) return false;  // would mean the latest pose to tf2
  const std::string& body = options_.body_frame;
  try {
    if (options_.pose_topic.empty()) {
      pose = fromTransform(tf_.lookupTransform(withoutSlash(options_.fixed_frame), frame, stamp).transform);
      return true;
    }
    pose = fromTransform(poses_.lookupTransform(kFixed, kBody, stamp).transform);
    if (!body.empty() && withoutSlash(body) != frame)
      pose = pose * fromTransform(tf_.lookupTransform(withoutSlash(body), frame, stamp).transform);
    return true;
  } catch (const tf2::TransformException&) {
    return false;
  }
}

bool BagScans::next(PosedScan& scan) {
  while (next_ != view_.end()) {
    std_msgs::Header header;
    try {
      if (const auto cloud = read<sensor_msgs::PointCloud2>(*next_)) {
        header = cloud->header;
        fromPointCloud2(*cloud, scan.cloud);
      } else if (const auto laser = read<sensor_msgs::LaserScan>(*next_)) {
        header = laser->header;
        fromLaserScan(*laser, scan.cloud);
      } else {
        throw std::runtime_error("message of another type or truncated");
      }
    } catch (const std::exception&) {
      ++malformed_;
      ++next_;
      continue;
    }
    ++next_;
    const bool known = poseAt(withoutSlash(header.frame_id), header.stamp, scan.pose);
    if (!known) scan.pose.setIdentity();
    if (known || !options_.need_poses) {
      scan.stamp = header.stamp.toSec();
      scan.name = options_.topic + " at " + std::to_string(scan.stamp) + " s";
      return true;
    }
    ++without_pose_;
  }
  return false;
}

void BagScans::rewind() {
  next_ = view_.begin();
  without_pose_ = malformed_ = 0;
}

}  // namespace rosbag_tests
