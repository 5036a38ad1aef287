// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstdint>
#include <limits>
#include <string>
#include <string_view>

namespace hokuyo_sick_drivers {

/// Time of the host's steady clock.
using Nanoseconds = std::int64_t;
constexpr Nanoseconds kSecond = 1'000'000'000, kMillisecond = 1'000'000;
constexpr Nanoseconds kNever = std::numeric_limits<Nanoseconds>::max();

/// What a driver says over a connection, as a state machine without input, output or clock: bytes and the
/// time go in, bytes come out. Connection runs one on a port; tests run it against a device in no time.
class Protocol {
 public:
  /// What is to be done with the port, in this order.
  struct Output {
    std::string bytes;       ///< to be sent
    int baud_rate = 0;       ///< speed to switch to once they are out; 0: as it is
    bool reconnect = false;  ///< nothing helps: close the port and open it again
    bool empty() const { return bytes.empty() && baud_rate == 0 && !reconnect; }
  };

  virtual ~Protocol() = default;

  /// The port is open, with whatever device in whatever state behind it.
  virtual void connected(Nanoseconds now) = 0;
  /// The port is gone. Nothing but connected() or shutDown() follows.
  virtual void disconnected(Nanoseconds /*now*/) {}
  /// Bytes that came, cut anywhere.
  virtual void received(std::string_view bytes, Nanoseconds now) = 0;
  /// The time has come that was named by deadline(), or a later one.
  virtual void tick(Nanoseconds now) = 0;
  /// kNever where there is nothing to wait for.
  virtual Nanoseconds deadline() const = 0;
  /// Asked again until it is empty.
  virtual Output takeOutput() = 0;
  /// Stops the device and leaves it as the user wants it; done() says when that is through or given up.
  virtual void shutDown(Nanoseconds now) = 0;
  virtual bool done() const = 0;
};

}  // namespace hokuyo_sick_drivers
