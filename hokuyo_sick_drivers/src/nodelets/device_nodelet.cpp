// SPDX-License-Identifier: BSD-3-Clause
#include "device_nodelet.h"

#include <ros/ros.h>

#include <cmath>

namespace hokuyo_sick_drivers {

void DeviceNodelet::connect(const Endpoint& endpoint, Protocol& protocol,
                            const Connection::Options& options) {
  endpoint_ = endpoint;
  Connection::Events events;
  events.connected = [this] {
    NODELET_INFO_STREAM("Connected to " << endpoint_.name());
    port_problem_.clear();
  };
  events.lost = [this](const std::string& why) {
    NODELET_WARN_STREAM("Connection to " << endpoint_.name() << " lost: " << why);
    port_problem_ = why;
    ++disconnects_;
  };
  events.refused = [this](const std::string& why) {
    if (why != port_problem_) NODELET_WARN_STREAM("No connection, trying again: " << why);
    port_problem_ = why;
  };
  events.failed = [this](const std::string& what) {
    NODELET_ERROR_STREAM("The driver of " << endpoint_.name() << " failed: " << what);
  };
  connection_ = std::make_unique<Connection>(endpoint_, protocol, events, options);
}

void DeviceNodelet::disconnect() {
  endCallbacks();
  connection_.reset();
}

void DeviceNodelet::report() {
  connection_->post([this](Nanoseconds) { reportHere(); });
}

std::int64_t DeviceNodelet::toRosTime(Nanoseconds steady, double offset) const {
  Nanoseconds shortest = kNever;
  std::int64_t time = 0;
  for (int i = 0; i < 3; ++i) {  // the thread may be put aside between two clocks
    const Nanoseconds before = Connection::now();
    const auto now = static_cast<std::int64_t>(ros::Time::now().toNSec());
    const Nanoseconds after = Connection::now();
    if (after - before >= shortest) continue;
    shortest = after - before;
    time = now - ((before + after) / 2 - steady);
  }
  time += std::llround(1e9 * offset);
  if (time <= 0) NODELET_WARN_THROTTLE(10.0, "Scans are dropped until simulated time begins");
  return time;
}

}  // namespace hokuyo_sick_drivers
