// SPDX-License-Identifier: BSD-3-Clause
#include "mapping_common/stamps.h"

#include <algorithm>
#include <stdexcept>
#include <utility>

namespace mapping_common {
namespace {

constexpr double kLate = 1.0;               // s, that messages are out of order by at most
constexpr std::size_t kMostSensors = 1000;  // where each message has another frame

}  // namespace

Stamps::Order Stamps::check(const std::string& sensor, const ros::Time& stamp) {
  require(stamp, "its stamp");
  if (stamp.isZero()) return Order::kNext;
  if (ros::Time::isSimTime()) {
    const ros::Time before = std::exchange(clock_, ros::Time::now());
    if (clock_ < before) return jumpedBack(sensor, stamp, before.toSec() - clock_.toSec());
  }

  if (sensors_.size() > kMostSensors) sensors_.clear();
  Sensor& s = sensors_[sensor];
  if (stamp >= s.newest) {
    s = {stamp, false};
    return Order::kNext;
  }
  const double late = (s.newest - stamp).toSec();
  // A single message may be late, by less than tf remembers.
  if (late > kLatest || (late > kLate && s.was_late)) return jumpedBack(sensor, stamp, late);
  s.was_late = late > kLate;
  return Order::kLate;
}

void Stamps::require(const ros::Time& stamp, const std::string& what) {
  if (stamp.sec > kLastSecond)
    throw std::invalid_argument(what + " is " + std::to_string(stamp.sec) + " s, after 2038");
}

Stamps::Order Stamps::jumpedBack(const std::string& sensor, const ros::Time& stamp, double by) {
  sensors_ = {{sensor, {stamp, false}}};
  jump_ = by;
  return Order::kJumpedBack;
}

}  // namespace mapping_common
