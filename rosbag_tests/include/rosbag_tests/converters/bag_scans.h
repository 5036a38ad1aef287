// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <rosbag/bag.h>
#include <rosbag/view.h>
#include <rosbag_tests/converters/scan_files.h>
#include <tf2/buffer_core.h>

#include <Eigen/Geometry>
#include <cstddef>
#include <string>

namespace rosbag_tests {

struct BagScansOptions {
  std::string topic;  ///< sensor_msgs PointCloud2 or LaserScan; empty: the bag's only such topic
  std::string fixed_frame = "map";  ///< frame of the poses that are looked up in /tf and /tf_static
  /// geometry_msgs PoseStamped, TransformStamped or nav_msgs Odometry that gives the poses in place of /tf,
  /// in whatever frame they are in; empty: /tf.
  std::string pose_topic;
  /// Frame whose poses `pose_topic` gives; the transform from it to the scans' frame comes from /tf and
  /// /tf_static. Empty: the messages' child_frame_id or, as a PoseStamped has none, the scans' own frame.
  std::string body_frame;
  bool need_poses = true;  ///< false: scans without a pose aren't left out, theirs is the identity
};

/// The scans of a ROS 1 bag, each with its sensor's pose at the stamp in its header (interpolated).
/// Transforms are read first, so that they may come after their scan in the bag. Scans without a transform at
/// their stamp and malformed messages are left out and counted. size() counts them too.
class BagScans : public ScanSource {
 public:
  /// Throws std::runtime_error if the file is no indexed bag or has no such topic of a fitting type; it then
  /// names the topics that are there.
  explicit BagScans(const std::string& file, const BagScansOptions& options = BagScansOptions());

  std::size_t size() const override { return size_; }
  bool next(mapping_simulation::PosedScan& scan) override;
  void rewind() override;

  const std::string& topic() const { return options_.topic; }

  /// Scans left out since the last rewind() because there was no transform for their stamp.
  std::size_t withoutPose() const { return without_pose_; }

  /// Scans left out since the last rewind() because they were malformed.
  std::size_t malformed() const { return malformed_; }

  /// Messages of tf and of the pose topic that were malformed.
  std::size_t malformedPoses() const { return malformed_poses_; }

 private:
  void readTransforms(const std::string& topic, bool is_static);
  void readPoses();
  bool poseAt(const std::string& frame, const ros::Time& stamp, Eigen::Isometry3d& pose) const;

  BagScansOptions options_;
  rosbag::Bag bag_;
  rosbag::View view_;
  rosbag::View::iterator next_;
  tf2::BufferCore tf_;
  tf2::BufferCore poses_;  // of the pose topic: fixed frame -> body frame
  std::size_t size_ = 0, without_pose_ = 0, malformed_ = 0, malformed_poses_ = 0;
};

}  // namespace rosbag_tests
