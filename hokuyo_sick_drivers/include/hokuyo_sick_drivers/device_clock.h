// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <deque>
#include <optional>

#include "hokuyo_sick_drivers/clock_line.h"
#include "hokuyo_sick_drivers/protocol.h"

namespace hokuyo_sick_drivers {

/// Tells the host's time of a time of the device, from messages that carry the device's time and arrive late.
/// The time of an arrival less the device's time is the offset of the clocks plus the message's delay. A
/// delay is a constant, which has to be known, and what came on top of it that time, which is never negative:
/// so the line below all arrivals (lineBelow) is the offset of the clocks plus the constant. That needs a
/// time of the device that is exact but for its drift, as a count of the mirror's turns is.
class DeviceClock {
 public:
  struct Options {
    Nanoseconds window = 60 * kSecond;   ///< arrivals count for so long
    Nanoseconds block = kSecond / 2;     ///< of all arrivals within such a time the earliest counts
    Nanoseconds recent = 2 * kSecond;    ///< while the drift isn't known, arrivals count for so long only
    Nanoseconds warm_up = 30 * kSecond;  ///< the drift is known after so long
    double max_drift = 1e-3;             ///< of the device's clock
    double max_slew = 3e-4;              ///< of the time told, beyond the drift
  };

  DeviceClock() : DeviceClock(Options()) {}
  explicit DeviceClock(const Options& options) : options_(options) {}

  /// The device counts anew, or its messages take another way. The drift stays.
  /// @param delay the constant part of the arrivals' delay
  void restart(Nanoseconds delay);
  /// A message with the device's time, in the order of that.
  void addArrival(Nanoseconds device, Nanoseconds received);
  /// The host's time by the arrivals so far, of which there must be one. For toHost, it may jump.
  Nanoseconds estimate(Nanoseconds device) const { return device + line_.offsetAt(device) - delay_; }
  /// The host's time, after an arrival; never decreases; makes no jumps, except during the warm-up.
  /// @param device not before the one asked for before
  Nanoseconds toHost(Nanoseconds device);
  /// Host seconds per device second, less one.
  double drift() const { return line_.drift; }

 private:
  Options options_;
  Nanoseconds delay_ = 0;
  std::deque<ClockOffset> blocks_;  // the earliest arrival of each
  Nanoseconds block_end_ = 0;
  bool warm_ = false;
  ClockLine line_;                   // below the arrivals
  std::optional<ClockOffset> told_;  // the last time
};

}  // namespace hokuyo_sick_drivers
