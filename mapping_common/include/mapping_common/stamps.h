// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <ros/time.h>

#include <cstdint>
#include <limits>
#include <map>
#include <string>

namespace mapping_common {

/// Tells from the stamps of messages whether time goes on. Each sensor has a delay of its own, so that a late
/// one is told apart from time that has jumped back, as it does where a recording begins anew.
class Stamps {
 public:
  enum class Order {
    kNext,
    kLate,       ///< earlier than the one before
    kJumpedBack  ///< time has jumped back, which is said once for all sensors
  };

  /// Differences of earlier stamps, and of those a minute later, are within ros::Duration's range; beyond it
  /// ros::Time throws.
  static constexpr std::uint32_t kLastSecond = std::numeric_limits<std::int32_t>::max() - 60;
  /// s, later ones are of no use: tf knows no transforms any more.
  static constexpr double kLatest = 10.0;

  /// @param sensor what tells sensors apart, e.g. topic and frame
  /// @param stamp zero, "at any time", says nothing about time
  /// @throws std::invalid_argument if the stamp is after kLastSecond
  Order check(const std::string& sensor, const ros::Time& stamp);
  /// @param what the stamp is, e.g. "its stamp"
  /// @throws std::invalid_argument if it is after kLastSecond
  static void require(const ros::Time& stamp, const std::string& what);
  /// s, by how much time has jumped back at last.
  double jump() const { return jump_; }

 private:
  struct Sensor {
    ros::Time newest;
    bool was_late = false;  // by more than a second
  };
  Order jumpedBack(const std::string& sensor, const ros::Time& stamp, double by);

  std::map<std::string, Sensor> sensors_;
  ros::Time clock_;  // when it is simulated
  double jump_ = 0.0;
};

}  // namespace mapping_common
