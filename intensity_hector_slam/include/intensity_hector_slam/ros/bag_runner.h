// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <intensity_hector_slam/key_poses.h>
#include <intensity_hector_slam/loop_finder.h>
#include <intensity_hector_slam/ros/parameters.h>

#include <functional>
#include <map>
#include <string>
#include <vector>

namespace intensity_hector_slam {

struct BagOptions {
  std::string bag;
  std::string scan_topic;  ///< sensor_msgs/LaserScan
  /// Odometry, the first guess, of tf: its fixed frame; or of a topic (nav_msgs/Odometry): the pose of the
  /// body in any fixed frame. Both empty: there is none.
  std::string odom_frame, odom_topic;
  std::size_t every = 1;  ///< uses each n-th scan alone
};

struct BagResult {
  struct Entry {
    double stamp = 0.0;  ///< s
    SlamResult result;
    double seconds = 0.0;  ///< what it took, from the Scan on
  };
  std::vector<Entry> entries;  ///< one for each scan that was processed
  std::vector<Edge> edges;     ///< of the key poses, and their loops
  LoopFinder::Counts loops;
  double loop_seconds = 0.0,
         longest_loop_seconds = 0.0;  ///< of processor time for them, and for one key pose
  MultiMap map;
  /// Scans of one kind, and what is said of the first.
  struct Fault {
    std::size_t count = 0;
    std::string why;

    void add(const std::string& text) {
      if (count++ == 0) why = text;
    }
  };
  std::map<std::string, Fault> dropped;   ///< by the reason
  std::map<std::string, Fault> warnings;  ///< scans that were used, see mapping_common::LaserReading
  std::string unused_odometry;            ///< frame of odometry in tf that options don't name; empty: none
  bool scanner_is_body =
      false;  ///< the bag doesn't tell where the scanner is mounted: the poses are the scanner's
};

/// SLAM over a recording, as fast as it goes. The same recording and parameters give the same result, but for
/// the times.
/// @param progress is told the share that is done, 0 to 1
/// @param processed is told each scan that becomes one of the entries
/// @throws std::runtime_error, rosbag::BagException, that say what can't be read
BagResult runBag(const BagOptions& options, const SlamParameters& parameters,
                 const std::function<void(double)>& progress = {},
                 const std::function<void(const Scan&)>& processed = {});

}  // namespace intensity_hector_slam
