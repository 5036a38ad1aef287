// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <algorithm>
#include <cstdint>
#include <deque>
#include <optional>
#include <vector>

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

/// A time as two clocks show it: by one, and how much further the other is.
struct ClockOffset {
  Nanoseconds time = 0, offset = 0;
};

/// Offset and drift of one clock against another.
struct ClockLine {
  ClockOffset point;
  double drift = 0.0;
  Nanoseconds offsetAt(Nanoseconds time) const;
};

/// Of all lines below the points, with a drift between these bounds, the one closest to them.
///
/// Messages arrive after a delay that is a constant plus a jitter of at least zero. The jitter has no upper
/// bound, but some messages have next to none, and those tell how two clocks run against each other (Moon,
/// Skelly, Towsley: Estimation and removal of clock skew from network delay measurements, INFOCOM 1999).
/// @param points one or more, in the order of time
ClockLine lineBelow(const std::deque<ClockOffset>& points, double min_drift, double max_drift);

struct Interval {
  double least, greatest;
  double middle() const { return (least + greatest) / 2.0; }
  bool contains(double value, double slack) const {
    return value >= least - slack && value <= greatest + slack;
  }
  void include(double value) {
    least = std::min(least, value);
    greatest = std::max(greatest, value);
  }
};

/// All lines that pass between two bounds at each of some times.
class LineSet {
 public:
  /// @param points one or more; a line is at most so much below and above
  /// @param tolerance of either bound; where there is no line, it is doubled
  LineSet(const std::deque<ClockOffset>& points, Nanoseconds below, Nanoseconds above, double max_drift,
          Nanoseconds tolerance);
  Interval offsetsAt(Nanoseconds time) const;
  Interval drifts() const;

 private:
  struct Line {
    double offset, drift;
    double offsetAt(double age) const { return offset + drift * age; }
  };
  ClockOffset origin_;
  std::vector<Line> corners_;  // of the polygon of these lines, from the origin
};

/// Tells the host's time of a time of the device, from messages that carry the device's time and arrive after
/// a delay that is a constant plus a jitter of at least zero. The device's time is exact but for its drift.
class DeviceClock {
 public:
  struct Options {
    Nanoseconds window = 60 * kSecond;   ///< of arrivals that count
    Nanoseconds block = kSecond / 2;     ///< of arrivals of which the earliest counts
    Nanoseconds recent = 2 * kSecond;    ///< of arrivals that count while the drift isn't known
    Nanoseconds warm_up = 30 * kSecond;  ///< of arrivals before they tell a drift
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

/// Tells when a device began its scans, by the host, from stamps that are cut down to multiples of a
/// resolution, of which a scan is known to have been later than its stamp by less than that.
///
/// There are three clocks. The motor makes scans at regular intervals: the line below their arrivals over
/// their number tells within seconds, and much more finely than the stamps, when they were but for the
/// constant delay of the line. The device's quartz counts: each stamp says between which two times of it that
/// was. The probes compare the quartz with the host before the first scan. Hence a line in a band that all
/// stamps leave open is the quartz against the arrivals, and less the offset of the probes the constant
/// delay. Until the motor's phase has swept through the resolution, as the clocks drift, the band is as wide
/// as that, and the middle may be off by half of it.
class ScanClock {
 public:
  struct Options {
    Nanoseconds resolution = kMillisecond;     ///< of stamps and probes
    Nanoseconds motor_window = 4 * kSecond;    ///< during which the motor turns regularly
    int motor_scans = 40;                      ///< that this is to hold, at the least
    Nanoseconds quartz_window = 60 * kSecond;  ///< during which the quartz's drift is constant
    Nanoseconds tolerance = 100'000;           ///< of what the motor's line may be wrong by
    double max_motor_drift = 0.02;             ///< of the motor's speed
    double max_quartz_drift = 2e-4;
    Nanoseconds smoothing = 1 * kSecond;  ///< time constant of the times told, beyond the motor's drift
  };

  ScanClock() : ScanClock(Options()) {}
  explicit ScanClock(const Options& options) : options_(options) {}

  /// The device counts anew, or its messages take another way.
  /// @param period nominal, between two scans
  /// @param delay the constant part of the arrivals' delay, in case that there are no probes
  void restart(Nanoseconds period, Nanoseconds delay);
  /// A question for the device's time, before any scan.
  void addProbe(Nanoseconds sent, Nanoseconds stamp, Nanoseconds received);
  /// Width of what the probes leave open, kNever before the first.
  Nanoseconds probeWidth() const;
  /// @param stamp after that of the scan before; there may be scans left out
  /// @return the host's time of the scan: never decreases; makes no jumps after the first motor_window
  Nanoseconds addScan(Nanoseconds stamp, Nanoseconds received);

  /// Whether there has been a probe or a scan since the restart.
  bool known() const { return probes_ || told_; }
  /// The host's time of a stamp, roughly.
  Nanoseconds estimate(Nanoseconds stamp) const;
  /// Host seconds per second of the quartz, less one.
  double drift() const { return drift_; }

 private:
  struct Probes {
    Nanoseconds stamp, earliest, latest;  // of the last; bounds of host - device
    Nanoseconds middle() const { return (earliest + latest) / 2; }
  };
  Nanoseconds turn(Nanoseconds stamp, Nanoseconds received);
  void takeReadings(Nanoseconds turned);

  Options options_;
  Nanoseconds period_ = 0, motor_window_ = 0;
  Nanoseconds delay_ = 0;
  std::optional<Probes> probes_;
  std::deque<ClockOffset> stamps_,
      arrivals_;                      // of the motor's window, by the motor if it had its nominal speed
  ClockLine motor_;                   // below the arrivals
  std::deque<ClockOffset> readings_;  // of that line at the scans, by the quartz
  Nanoseconds settled_ = -1;          // by the motor, until where they are taken for good
  std::optional<LineSet> quartz_;     // that the readings allow
  double drift_ = 0.0;
  std::optional<ClockOffset> told_;  // the last scan, by the motor
  Nanoseconds last_stamp_ = 0;
};

}  // namespace hokuyo_sick_drivers
