// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <intensity_hector_slam/pose.h>
#include <sensor_msgs/LaserScan.h>
#include <tf2_ros/transform_listener.h>

#include <Eigen/Geometry>
#include <deque>
#include <functional>
#include <optional>
#include <string>
#include <vector>

namespace intensity_hector_slam {

/// tf2 knows no leading slashes, older drivers and launch files do.
std::string withoutSlash(const std::string& frame);

/// Scans wait here, in the order of their arrival, until tf tells where the scanner and the body were.
class ScanQueue {
 public:
  struct Options {
    std::string base_frame;        ///< the body
    std::string fixed_frame;       ///< that its pose is asked for in; empty: it isn't asked for
    bool use_sensor_frame = true;  ///< false: the scanner is the body
    bool needs_body = false;       ///< whether scans fail without a pose of the body
    double timeout = 0.5;          ///< s, by the stamps of later scans, that one waits at most
  };
  /// What tf says about a scan.
  struct Transforms {
    Eigen::Isometry3d sensor_in_body = Eigen::Isometry3d::Identity();
    std::optional<Pose> body;  ///< in the fixed frame
  };
  using Scan = sensor_msgs::LaserScan;
  using ScanPointer = boost::shared_ptr<const Scan>;

  /// Callbacks come with those of the node.
  /// @param ready gets each scan
  /// @param failed gets those that can't be transformed, and why
  ScanQueue(const ros::NodeHandle& node, const Options& options,
            std::function<void(const Scan&, const Transforms&)> ready,
            std::function<void(const Scan&, const std::string& why)> failed);
  ~ScanQueue();

  void add(const ScanPointer& scan);
  std::size_t waiting() const { return waiting_.size(); }
  /// Time has jumped: forgets the scans that wait, and transforms.
  /// @return how many scans
  std::size_t restart();

  const tf2_ros::Buffer& buffer() const { return buffer_; }
  /// Whether tf ever had a pose of the body in the fixed frame.
  bool bodyExists() const { return body_exists_; }
  /// Why the last scan had none.
  const std::string& whyNoBody() const { return why_no_body_; }

 private:
  void advance();
  bool knowsSensor(const Scan& scan, std::string* why) const;
  bool knowsBody(const Scan& scan, std::string* why) const;
  Transforms lookup(const Scan& scan, bool body) const;
  bool isLate() const;
  bool isOvertaken(bool (ScanQueue::*knows)(const Scan&, std::string*) const) const;
  bool expectsBody(const ros::Time& stamp) const;
  void wakeUpWith(const std::string& target, const std::string& source);

  Options options_;
  std::function<void(const Scan&, const Transforms&)> ready_;
  std::function<void(const Scan&, const std::string&)> failed_;

  tf2_ros::Buffer buffer_;
  tf2::TransformableCallbackHandle callback_;
  std::vector<tf2::TransformableRequestHandle> requests_;
  std::deque<ScanPointer> waiting_;
  ros::Time newest_;  // stamp
  // Whether it may just not have come yet, as at the start.
  bool body_may_come_ = true;
  bool body_exists_ = false;
  std::string why_no_body_;
  tf2_ros::TransformListener listener_;  // gone before the buffer that it feeds
};

}  // namespace intensity_hector_slam
