// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <mapping_simulation/posed_scan.h>
#include <ros/time.h>
#include <rosbag/bag.h>

#include <Eigen/Geometry>
#include <string>
#include <vector>

namespace rosbag_tests {

/// The four frames need names of their own. Topics are taken from the root if they have no leading slash.
struct ScanBagOptions {
  std::string map_frame = "map";
  std::string odom_frame = "odom";
  std::string base_frame = "base_link";
  std::string sensor_frame = "sensor";
  std::string cloud_topic = "/cloud";
  std::string pose_topic = "/ground_truth";                          ///< of base_frame in map_frame
  Eigen::Isometry3d map_to_odom = Eigen::Isometry3d::Identity();     ///< pose of odom_frame in map_frame
  Eigen::Isometry3d base_to_sensor = Eigen::Isometry3d::Identity();  ///< pose of sensor_frame in base_frame
  double stamp_offset = 1000.0;                                      ///< s, added to the stamps of the scans
};

/// Writes scans with poses as a bag that can be played to any mapper: the cloud (PointCloud2, float32 x y z
/// intensity, sensor frame), /tf map -> odom -> base_link, /tf_static base_link -> sensor (latched), the true
/// pose (PoseStamped), and /clock at 100 Hz from 1 s before the first scan to 1 s after the last.
///
/// /tf is recorded 1 ms before its scan and holds the pose at the stamp and 1 ms before and after it, so that
/// whoever waits for the transform of a scan has it when the scan comes.
///
/// The bag is written as `file`.part and renamed by close(). Errors are std::runtime_error.
class ScanBagWriter {
 public:
  explicit ScanBagWriter(const std::string& file, const ScanBagOptions& options = ScanBagOptions());

  /// Removes the unfinished bag if close() wasn't called.
  ~ScanBagWriter();

  ScanBagWriter(const ScanBagWriter&) = delete;
  ScanBagWriter& operator=(const ScanBagWriter&) = delete;

  /// Stamps must rise by more than 2 ms from scan to scan.
  void write(const mapping_simulation::PosedScan& scan);

  /// Completes the bag under its name.
  void close();

 private:
  void start(const ros::Time& time, const Eigen::Isometry3d& base);
  void writeTransforms(const ros::Time& time, const std::vector<ros::Time>& stamps,
                       const Eigen::Isometry3d& base);
  void writeClock(const ros::Time& until);

  std::string file_, part_;
  ScanBagOptions options_;
  rosbag::Bag bag_;
  bool open_ = false;
  ros::Time last_stamp_, next_clock_;  // zero before the first scan
};

}  // namespace rosbag_tests
