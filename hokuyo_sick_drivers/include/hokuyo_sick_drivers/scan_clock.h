// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <deque>
#include <optional>

#include "hokuyo_sick_drivers/clock_line.h"
#include "hokuyo_sick_drivers/protocol.h"

namespace hokuyo_sick_drivers {

/// Tells when a scanner began its scans, by the host, to a fraction of a millisecond, although the scanner
/// stamps them with whole milliseconds, cut down. Three clocks take part:
///
/// - The motor makes scans at regular intervals. The line below the scans' arrivals (lineBelow), over their
///   number, tells within seconds when each arrived at the earliest: when it began plus a constant delay.
/// - The scanner's quartz stamps the scans. A stamp says that the scan began less than a resolution later.
/// The
///   offset of the motor's line from the quartz is hence known at each scan to within a resolution, and a
///   LineSet holds all that it may be.
/// - The host has asked for the quartz's time before the first scan (the probes): that is their offset.
///
/// The second less the third is the constant delay, and with it the motor's line tells the beginning of
/// scans. At first the LineSet is as wide as the resolution and its middle may be off by half of it; it
/// narrows as the motor's phase sweeps through the milliseconds.
class ScanClock {
 public:
  struct Options {
    Nanoseconds resolution = kMillisecond;     ///< of stamps and probes
    Nanoseconds motor_window = 4 * kSecond;    ///< for so long the motor turns evenly
    int motor_scans = 40;                      ///< longer, if it holds fewer scans than that
    Nanoseconds quartz_window = 60 * kSecond;  ///< for so long the quartz's drift is constant
    Nanoseconds tolerance = 100'000;           ///< by which the motor's line may be wrong
    double max_motor_drift = 0.02;             ///< of the motor's speed from the nominal one
    double max_quartz_drift = 2e-4;
    Nanoseconds smoothing = 1 * kSecond;  ///< time constant with which the times told follow the estimate
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
