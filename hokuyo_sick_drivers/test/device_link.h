// SPDX-License-Identifier: BSD-3-Clause
//
// A driver and an emulated device, joined without a port and in virtual time: an hour passes in seconds.
#pragma once

#include <algorithm>

#include "device.h"
#include "hokuyo_sick_drivers/protocol.h"

namespace hokuyo_sick_drivers {

/// Does what Connection does on a real port. Time of the device and of the driver is the same, from `start`
/// on.
class DeviceLink {
 public:
  DeviceLink(Protocol& driver, device_emulators::Device& device, int baud_rate, Nanoseconds start = kSecond)
      : driver_(driver), device_(device), baud_rate_(baud_rate), now_(start), connect_at_(start) {}

  Nanoseconds now() const { return now_; }

  /// @param step called after each event with the time
  template <class Step>
  void runUntil(Nanoseconds end, Step step) {
    while (true) {
      const Nanoseconds next = std::min(device_.deadline(), connected_ ? driver_.deadline() : connect_at_);
      if (next > end) break;
      now_ = std::max(now_, next);
      device_.tick(now_);
      if (!connected_ && now_ >= connect_at_) connect();
      if (connected_ && now_ >= driver_.deadline()) driver_.tick(now_);
      exchange();
      step(now_);
    }
    now_ = end;
  }
  void runUntil(Nanoseconds end) {
    runUntil(end, [](Nanoseconds) {});
  }

 private:
  static constexpr Nanoseconds kRetry = kSecond / 10;

  void connect() {
    if (!device_.linkUp()) {
      connect_at_ = now_ + kRetry;
      return;
    }
    connected_ = true;
    device_.setHostBaudRate(baud_rate_);
    device_.connect(now_);
    driver_.connected(now_);
  }

  void disconnect() {
    connected_ = false;
    connect_at_ = now_ + kRetry;
    driver_.disconnected(now_);
  }

  void exchange() {
    for (bool busy = true; busy;) {
      busy = false;
      for (auto out = device_.takeOutput(); !out.empty(); out = device_.takeOutput()) {
        busy = true;
        if (connected_ && !out.bytes.empty()) driver_.received(out.bytes, now_);
        if (connected_ && out.disconnect) disconnect();
      }
      if (!connected_) break;
      for (auto out = driver_.takeOutput(); connected_ && !out.empty(); out = driver_.takeOutput()) {
        busy = true;
        if (!out.bytes.empty()) device_.received(out.bytes, now_);
        if (out.baud_rate != 0) device_.setHostBaudRate(out.baud_rate);
        if (out.reconnect) {
          device_.disconnect(now_);
          disconnect();
        }
      }
    }
  }

  Protocol& driver_;
  device_emulators::Device& device_;
  const int baud_rate_;
  Nanoseconds now_, connect_at_;
  bool connected_ = false;
};

}  // namespace hokuyo_sick_drivers
