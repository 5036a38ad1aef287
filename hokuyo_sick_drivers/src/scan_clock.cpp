// SPDX-License-Identifier: BSD-3-Clause
#include "hokuyo_sick_drivers/scan_clock.h"

#include <algorithm>
#include <cmath>

namespace hokuyo_sick_drivers {

void ScanClock::restart(Nanoseconds period, Nanoseconds delay) {
  period_ = period;
  motor_window_ = std::max(options_.motor_window, options_.motor_scans * period);
  delay_ = delay;
  probes_.reset();
  stamps_.clear();
  arrivals_.clear();
  motor_ = ClockLine();
  settled_ = -1;
  readings_.clear();
  quartz_.reset();
  told_.reset();
}

// The device read its clock after the question was sent and before the answer was received, and cut the time
// down.
void ScanClock::addProbe(Nanoseconds sent, Nanoseconds stamp, Nanoseconds received) {
  const Nanoseconds earliest = sent - stamp - options_.resolution, latest = received - stamp;
  if (!probes_) probes_ = Probes{stamp, earliest, latest};
  probes_->stamp = stamp;
  probes_->earliest = std::max(probes_->earliest, earliest);
  probes_->latest = std::min(probes_->latest, latest);
}

Nanoseconds ScanClock::probeWidth() const {
  return probes_ ? probes_->latest - probes_->earliest : kNever;
}

Nanoseconds ScanClock::estimate(Nanoseconds stamp) const {
  if (!told_) return stamp + probes_->middle();
  return told_->time + told_->offset + stamp - last_stamp_;
}

Nanoseconds ScanClock::addScan(Nanoseconds stamp, Nanoseconds received) {
  const Nanoseconds turned = turn(stamp, received);
  takeReadings(turned);
  if (probes_ && stamp - probes_->stamp < options_.quartz_window) {
    delay_ = std::llround(quartz_->offsetsAt(probes_->stamp).middle()) - probes_->middle();
  }
  // Where the motor is not so regular, or nothing arrived in time, the stamp knows better.
  const Interval quartz = quartz_->offsetsAt(stamp);
  const Nanoseconds least = stamp + std::llround(quartz.least);
  const Nanoseconds greatest = stamp + std::llround(quartz.greatest) + options_.resolution;
  Nanoseconds offset = std::clamp(turned + motor_.offsetAt(turned), least, greatest) - delay_ - turned;
  if (told_) {
    const Nanoseconds step = turned - told_->time;
    const Nanoseconds expected = told_->offset + std::llround(motor_.drift * step);
    const double part = turned < motor_window_ ? 1.0 : std::min(1.0, 1.0 * step / options_.smoothing);
    offset = std::max<Nanoseconds>(expected + std::llround(part * (offset - expected)), told_->offset - step);
  }
  told_ = ClockOffset{turned, offset};
  last_stamp_ = stamp;
  return turned + offset;
}

// @return when the scan was by the motor
Nanoseconds ScanClock::turn(Nanoseconds stamp, Nanoseconds received) {
  Nanoseconds turned = 0;
  if (told_) {
    const double turns = (stamp - last_stamp_) / (period_ * (1.0 + motor_.drift));
    turned = told_->time + period_ * std::max(1LL, std::llround(turns));
  }
  stamps_.push_back({turned, stamp - turned});
  arrivals_.push_back({turned, received - turned});
  while (stamps_.front().time < turned - motor_window_) {
    stamps_.pop_front();
    arrivals_.pop_front();
  }
  // Arrivals of a short time, or held up, tell less of the motor's speed than the stamps.
  Interval speeds{-options_.max_motor_drift, options_.max_motor_drift};
  if (turned < motor_window_) {
    const LineSet possible(stamps_, 0, options_.resolution, options_.max_motor_drift, options_.tolerance);
    speeds.least = speeds.greatest = possible.drifts().middle();
  } else if (const ClockOffset& first = stamps_.front(); turned > first.time) {
    const double time = turned - first.time, late = stamp - turned - first.offset;
    speeds.least = (late - options_.resolution) / time - options_.max_quartz_drift;
    speeds.greatest = (late + options_.resolution) / time + options_.max_quartz_drift;
  }
  motor_ = lineBelow(arrivals_, speeds.least, speeds.greatest);
  return turned;
}

// The line below the arrivals is best known in the middle of its window, and is read there; at the beginning
// it is read anew with each scan.
void ScanClock::takeReadings(Nanoseconds turned) {
  const bool young = turned < motor_window_;
  const Nanoseconds margin = motor_window_ / 4, until = young ? turned : turned - margin;
  if (settled_ < 0) {
    readings_.clear();
    quartz_.reset();
  } else if (turned < settled_ + 3 * margin) {
    return;
  }
  for (const ClockOffset& scan : stamps_) {
    if (scan.time <= settled_ || scan.time > until) continue;
    const ClockOffset reading{scan.time + scan.offset, motor_.offsetAt(scan.time) - scan.offset};
    // A line that nothing reaches in time tells nothing.
    if (quartz_ && !quartz_->offsetsAt(reading.time).contains(reading.offset, 2 * options_.resolution))
      continue;
    readings_.push_back(reading);
  }
  settled_ = young ? -1 : until;
  while (!readings_.empty() && readings_.front().time < readings_.back().time - options_.quartz_window) {
    readings_.pop_front();
  }
  quartz_ = LineSet(readings_, options_.resolution, 0, options_.max_quartz_drift, options_.tolerance);
  drift_ = quartz_->drifts().middle();
}

}  // namespace hokuyo_sick_drivers
