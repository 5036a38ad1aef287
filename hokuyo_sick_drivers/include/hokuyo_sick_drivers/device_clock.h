// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstdint>
#include <deque>
#include <optional>

#include "hokuyo_sick_drivers/protocol.h"

namespace hokuyo_sick_drivers {

/// Turns a counter of few bits that starts anew at 2^bits into one that doesn't.
class CounterUnwrapper {
 public:
  explicit CounterUnwrapper(int bits) : modulus_(std::int64_t{1} << bits) {}
  /// @param value the latest, at most half of the counter's span before or after the one before
  std::int64_t unwrap(std::int64_t value);
  void restart() { last_.reset(); }

 private:
  std::int64_t modulus_;
  std::optional<std::int64_t> last_;
};

/// Tells when a device that measures at regular intervals did so, from stamps that are cut down to multiples
/// of a resolution: an alpha-beta filter of the stamps' middles that never leaves what the stamp allows.
class StampSmoother {
 public:
  explicit StampSmoother(Nanoseconds resolution = kMillisecond) : resolution_(resolution) {}
  /// @param period nominal, between two stamps
  void restart(Nanoseconds period);
  /// @param stamp increasing; there may be some left out
  Nanoseconds smooth(Nanoseconds stamp);

 private:
  Nanoseconds resolution_;
  double period_ = 0.0;
  double count_ = 0.0;  // of stamps that the estimate rests on
  std::optional<double> last_;
};

/// Tells the host's time of a time of the device, from messages that carry the device's time and arrive after
/// a delay that is a constant plus a jitter of at least zero.
///
/// The jitter has no upper bound, but some messages have next to none: the clocks' drift is that of the line
/// which lies closest below all arrivals (Moon, Skelly, Towsley: Estimation and removal of clock skew from
/// network delay measurements, INFOCOM 1999). The constant part of the delay is in no arrival; it comes from
/// the answers to probes, for the device's time was read between the question and the answer.
class DeviceClock {
 public:
  struct Options {
    Nanoseconds resolution = kMillisecond;  ///< the device cuts its answers down to multiples of this
    Nanoseconds window = 60 * kSecond;      ///< of arrivals that count
    Nanoseconds block = kSecond / 2;        ///< of arrivals of which the earliest counts
    Nanoseconds recent = 2 * kSecond;       ///< of arrivals that count while the drift isn't known
    Nanoseconds warm_up = 30 * kSecond;     ///< of arrivals before they tell a drift
    double max_drift = 1e-3;                ///< of the device's clock
    double max_slew = 3e-4;                 ///< of the time told, beyond the drift
  };

  DeviceClock() : DeviceClock(Options()) {}
  explicit DeviceClock(const Options& options) : options_(options) {}

  /// The device counts anew, or its messages take another way. The drift stays.
  /// @param delay the constant part of the arrivals' delay, in case that there are no probes
  void restart(Nanoseconds delay);
  /// A question for the device's time, before any arrival.
  void addProbe(Nanoseconds sent, Nanoseconds device, Nanoseconds received);
  /// Width of what the probes leave open, kNever before the first.
  Nanoseconds probeWidth() const;
  /// A message with the device's time as the device says it, cut down or not, in the order of that.
  void addArrival(Nanoseconds device, Nanoseconds received);

  /// Whether there has been a probe or an arrival since the restart; until then there is no host time to
  /// tell.
  bool known() const { return probes_ || !blocks_.empty(); }
  /// The host's time by all that is known.
  Nanoseconds estimate(Nanoseconds device) const { return device + offsetAt(device); }
  /// The same for stamps: never decreases; makes no jumps, except during the warm-up where there are no
  /// probes.
  /// @param device not before the one asked for before
  Nanoseconds toHost(Nanoseconds device);
  /// Host seconds per device second, less one.
  double drift() const { return drift_; }

 private:
  struct Arrival {
    Nanoseconds device, offset;  // host - device
  };
  struct Probes {
    Nanoseconds device, earliest, latest;  // when, by the device; bounds of host - device
    Nanoseconds middle() const { return (earliest + latest) / 2; }
  };
  void fit();
  Arrival lowest(double drift, Nanoseconds since) const;
  double lineAt(Nanoseconds device) const;
  Nanoseconds offsetAt(Nanoseconds device) const;

  Options options_;
  Nanoseconds delay_ = 0;
  std::optional<Probes> probes_;
  std::deque<Arrival> blocks_;  // the earliest arrival of each
  Nanoseconds block_end_ = 0;
  bool warm_ = false;
  double drift_ = 0.0;
  Arrival line_{};  // a point of the line below all arrivals
  bool delay_known_ = false;
  std::optional<Arrival> told_;  // the last stamp
};

}  // namespace hokuyo_sick_drivers
