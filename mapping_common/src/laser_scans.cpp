// SPDX-License-Identifier: BSD-3-Clause
#include "mapping_common/laser_scans.h"

#include <algorithm>
#include <cmath>
#include <sstream>
#include <stdexcept>
#include <vector>

namespace mapping_common {
namespace {

constexpr double kTurn = 2.0 * M_PI;
constexpr double kMostTurns = 2.0;        // of a sweep; with more its angles are in degrees
constexpr double kMillimetres = 300.0;    // m, beyond the median range of any planar scanner in use
constexpr std::size_t kFewest = 8;        // equal ranges that make a plateau ...
constexpr double kFewestShare = 0.02;     // ... and of all beams
constexpr float kBelow = 0.05F;           // m, where hardly any other range is
constexpr std::size_t kIntervals = 9;     // that the median is of
constexpr double kLongestInterval = 1.0;  // s, as long as none is known
constexpr double kTolerance = 1.2;        // of stamps

template <class... Parts>
std::string text(const Parts&... parts) {
  std::ostringstream out;
  (out << ... << parts);
  return out.str();
}

double median(std::vector<double> values) {
  const auto middle = values.begin() + values.size() / 2;
  std::nth_element(values.begin(), middle, values.end());
  return *middle;
}

void checkAngles(const sensor_msgs::LaserScan& message) {
  if (!std::isfinite(message.angle_min) || !std::isfinite(message.angle_increment)) {
    throw std::invalid_argument("angles that are not finite");
  }
  if (message.ranges.size() < 2) return;
  if (message.angle_increment == 0.0F) {
    throw std::invalid_argument("angle_increment is 0: all beams have one direction");
  }
  const double sweep = std::abs(message.angle_increment) * static_cast<double>(message.ranges.size() - 1);
  if (sweep > kMostTurns * kTurn) {
    throw std::invalid_argument(text("angle_increment ", message.angle_increment, " rad turns ",
                                     message.ranges.size(), " beams ", sweep / kTurn,
                                     " times around: is it in degrees?"));
  }
}

// Ranges in millimetres are beyond a range_max in metres, all of them, and a thousandth isn't.
void checkUnit(const std::vector<float>& returns, const LaserReading& reading) {
  if (returns.empty()) return;
  const auto [least, greatest] = std::minmax_element(returns.begin(), returns.end());
  const double typical = median({returns.begin(), returns.end()});
  const bool beyond = *least >= reading.max_range && *least < *greatest && typical < *greatest &&
                      reading.isReturn(1e-3 * typical);
  if (beyond || (std::isinf(reading.max_range) && typical > kMillimetres)) {
    throw std::invalid_argument(text("ranges look like millimetres: their median is ", typical,
                                     ", with range_max ", reading.max_range, " m. They must be in metres"));
  }
}

}  // namespace

LaserReading LaserScans::read(const sensor_msgs::LaserScan& message) {
  checkAngles(message);
  if (!std::isfinite(message.time_increment))
    throw std::invalid_argument("a time_increment that is not finite");
  LaserReading reading;
  readMaxRange(message, reading);
  readTimes(message, reading);
  const std::size_t intensities = message.intensities.size(), ranges = message.ranges.size();
  reading.has_intensities = intensities > 0 && intensities == ranges;
  if (intensities > 0 && intensities != ranges) {
    reading.warnings["intensities"] =
        text(intensities, " intensities for ", ranges, " ranges: the ranges are used without");
  }
  return reading;
}

void LaserScans::readMaxRange(const sensor_msgs::LaserScan& message, LaserReading& reading) {
  reading.min_range = message.range_min;
  if (message.range_max > 0.0F) {
    reading.max_range = message.range_max;
  } else {
    reading.warnings["range_max"] = text("range_max is ", message.range_max, ": it is not used as a limit");
  }
  if (!(reading.min_range < reading.max_range)) {
    throw std::invalid_argument(
        text("range_min ", message.range_min, " and range_max ", message.range_max, " that are no interval"));
  }
  std::vector<float> finite;
  for (const float range : message.ranges) {
    if (range > 0.0F && std::isfinite(range)) finite.push_back(range);
  }
  checkUnit(finite, reading);

  finite.erase(std::remove_if(finite.begin(), finite.end(), [&](float r) { return !reading.isReturn(r); }),
               finite.end());
  const float greatest = finite.empty() ? 0.0F : *std::max_element(finite.begin(), finite.end());
  const std::size_t equal = std::count(finite.begin(), finite.end(), greatest);
  const std::size_t less = std::count_if(finite.begin(), finite.end(), [greatest](float range) {
    return range < greatest && range > greatest - kBelow;
  });
  if (none_ && greatest > *none_) none_.reset();
  const auto fewest = std::max<std::size_t>(kFewest, kFewestShare * message.ranges.size());
  if (equal >= fewest && equal > 2 * less) none_ = greatest;
  if (!none_ || !(*none_ < reading.max_range)) return;
  if (std::isfinite(reading.max_range)) {
    reading.warnings["ranges"] = text("beams without a return come as ", *none_, " m, below range_max ",
                                      reading.max_range, " m: that range is taken for none");
  } else {
    reading.warnings["ranges"] =
        text("beams without a return come as ", *none_, " m: that range is taken for none");
  }
  reading.max_range = *none_;
}

void LaserScans::readTimes(const sensor_msgs::LaserScan& message, LaserReading& reading) {
  const double stamp = message.header.stamp.toSec();
  if (last_stamp_ && stamp > *last_stamp_) {
    intervals_.push_back(stamp - *last_stamp_);
    if (intervals_.size() > kIntervals) intervals_.pop_front();
  }
  last_stamp_ = stamp;
  const double interval = !intervals_.empty()        ? median({intervals_.begin(), intervals_.end()})
                          : message.scan_time > 0.0F ? message.scan_time
                                                     : kLongestInterval;
  const double sweep = std::abs(message.time_increment) * static_cast<double>(message.ranges.size());
  if (sweep <= kTolerance * interval) {
    reading.time_increment = message.time_increment;
  } else {
    reading.warnings["time_increment"] =
        text("time_increment ", message.time_increment, " s makes a sweep of ", sweep, " s, longer than the ",
             interval, " s between scans: it is ignored");
  }
}

}  // namespace mapping_common
