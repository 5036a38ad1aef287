// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <rosbag_tests/converters/carmen_log.h>

#include <cstddef>
#include <functional>
#include <string>

namespace rosbag_tests {

struct CarmenBagOptions {
  enum class Stamps { kIpc, kLogger, kRate };
  enum class Odometry {
    kScans,  ///< the robot's poses logged with the front laser's scans, exact at their stamps
    kLines,  ///< those of the ODOM lines; for logs whose scans have corrected poses
  };
  Stamps stamps = Stamps::kIpc;  ///< what stamps the messages have
  double rate = 0.0;    ///< Hz, with kRate: of the scans of the front laser, whose stamps are made up
  double offset = 0.0;  ///< s, added to the stamps
  Odometry odometry = Odometry::kScans;
  std::string scan_topic = "/scan";  ///< rear laser: with the suffix _rear, as its frame
  std::string laser_frame = "laser", odom_frame = "odom", base_frame = "base_link";
};

struct CarmenBagSummary {
  std::size_t scans = 0, rear_scans = 0, odometry = 0;
  std::size_t repaired_scans = 0;  ///< whose stamp didn't increase, see risingStamps()
};

/// Writes a log as a bag: LaserScan, nav_msgs/Odometry on /odom, /tf odom -> base_link, and /tf_static
/// base_link -> laser (latched). `stamps_file`, if given, gets a line `stamp original` for each scan whose
/// stamp isn't the ipc stamp of the log; `reference_file` the logged poses of base_link at the front laser's
/// scans, in TUM format. The bag is written under a temporary name. Errors are std::runtime_error.
CarmenBagSummary writeCarmenBag(const std::string& file, const CarmenLog& log,
                                const CarmenBagOptions& options, const std::string& stamps_file = "",
                                const std::string& reference_file = "",
                                const std::function<void(std::size_t)>& progress = {});

}  // namespace rosbag_tests
