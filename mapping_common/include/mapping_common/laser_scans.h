// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <sensor_msgs/LaserScan.h>

#include <deque>
#include <limits>
#include <map>
#include <optional>
#include <string>

namespace mapping_common {

/// What a sensor_msgs/LaserScan means, whatever its driver makes of REP 117.
struct LaserReading {
  double min_range = 0.0;  ///< m
  double max_range = std::numeric_limits<double>::infinity();
  double time_increment = 0.0;   ///< s
  bool has_intensities = false;  ///< one for each range
  /// What is used in another way than the message has it, and why: by the name of its field.
  std::map<std::string, std::string> warnings;

  /// Whether a beam ended on something. A range of 0 never is one: drivers send it for "no return".
  bool isReturn(double range) const { return range > 0.0 && range >= min_range && range < max_range; }
  /// Whether a beam met nothing up to max_range. NaN, -inf and what is too near don't tell.
  bool isNoReturn(double range) const { return range == 0.0 || range >= max_range; }
};

/// Reads the messages of one scanner. What a single one doesn't tell follows from those before: the time
/// between scans, and what its driver sends for beams without a return.
class LaserScans {
 public:
  /// - range_max that isn't above 0 is no limit.
  /// - Where many ranges are the same to the bit, the greatest, and hardly any is a little less, beams
  ///   without a return come so: max_range is theirs. It stays until something farther returns.
  /// - time_increment whose sweep is longer than the time between scans is ignored.
  /// - Intensities of another number than ranges are, too.
  /// @throws std::invalid_argument that says what is malformed, also ranges in millimetres
  LaserReading read(const sensor_msgs::LaserScan& message);

 private:
  void readMaxRange(const sensor_msgs::LaserScan& message, LaserReading& reading);
  void readTimes(const sensor_msgs::LaserScan& message, LaserReading& reading);

  std::optional<float> none_;     // m, what came for beams without a return
  std::deque<double> intervals_;  // s, between the last stamps
  std::optional<double> last_stamp_;
};

}  // namespace mapping_common
