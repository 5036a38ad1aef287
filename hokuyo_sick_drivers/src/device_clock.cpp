// SPDX-License-Identifier: BSD-3-Clause
#include "hokuyo_sick_drivers/device_clock.h"

#include <algorithm>
#include <cmath>
#include <utility>
#include <vector>

namespace hokuyo_sick_drivers {
namespace {

constexpr double kAnySlew = 1.0;

// The offset of a clock that doesn't jump: as near to the one asked for as the slew allows, never so that
// the other clock decreases.
Nanoseconds follow(const ClockOffset& last, Nanoseconds time, Nanoseconds offset, double drift,
                   double max_slew) {
  const Nanoseconds step = time - last.time;
  const Nanoseconds expected = last.offset + std::llround(drift * step), slew = std::llround(max_slew * step);
  return std::max(std::clamp(offset, expected - slew, expected + slew), last.offset - step);
}

// What a half-plane leaves of a convex polygon.
// @param inside of a corner: its distance to the edge, in any unit; linear, at least zero if it stays
template <class Corner, class Distance>
void cut(std::vector<Corner>& polygon, Distance inside) {
  if (std::all_of(polygon.begin(), polygon.end(),
                  [&](const Corner& corner) { return inside(corner) >= 0.0; }))
    return;
  std::vector<Corner> rest;
  for (std::size_t i = 0; i < polygon.size(); ++i) {
    const Corner &from = polygon[i], &to = polygon[(i + 1) % polygon.size()];
    const double a = inside(from), b = inside(to);
    if (a >= 0.0) rest.push_back(from);
    if ((a >= 0.0) != (b >= 0.0)) {
      const double part = a / (a - b);
      rest.push_back(
          {from.offset + part * (to.offset - from.offset), from.drift + part * (to.drift - from.drift)});
    }
  }
  polygon = std::move(rest);
}

}  // namespace

std::int64_t CounterUnwrapper::unwrap(std::int64_t value) {
  if (last_) {
    std::int64_t step = (value - *last_) % modulus_;
    if (step < 0) step += modulus_;
    if (step > modulus_ / 2) step -= modulus_;
    value = *last_ + step;
  }
  last_ = value;
  return value;
}

Nanoseconds ClockLine::offsetAt(Nanoseconds time) const {
  return point.offset + std::llround(drift * static_cast<double>(time - point.time));
}

// The edge of the lower convex hull that spans the mean of the abscissae.
ClockLine lineBelow(const std::deque<ClockOffset>& points, double min_drift, double max_drift) {
  const ClockOffset& first = points.front();
  std::vector<ClockOffset> hull;
  double mean = 0.0;
  for (const ClockOffset& point : points) {
    const auto isAbove = [&](const ClockOffset& from, const ClockOffset& middle) {
      return static_cast<double>(middle.time - from.time) * (point.offset - from.offset) <=
             static_cast<double>(middle.offset - from.offset) * (point.time - from.time);
    };
    while (hull.size() > 1 && isAbove(hull[hull.size() - 2], hull.back())) hull.pop_back();
    hull.push_back(point);
    mean += static_cast<double>(point.time - first.time) / points.size();
  }
  ClockLine line;
  if (hull.size() > 1) {
    std::size_t end = 1;
    while (end + 1 < hull.size() && hull[end].time - first.time < mean) ++end;
    const ClockOffset &from = hull[end - 1], &to = hull[end];
    line.drift = static_cast<double>(to.offset - from.offset) / (to.time - from.time);
  }
  line.drift = std::clamp(line.drift, min_drift, max_drift);
  const auto height = [&](const ClockOffset& point) {
    return point.offset - first.offset - line.drift * (point.time - first.time);
  };
  line.point = *std::min_element(hull.begin(), hull.end(), [&](const ClockOffset& a, const ClockOffset& b) {
    return height(a) < height(b);
  });
  return line;
}

// Of the polygon of the lines that are possible, by offset at the first strip and by drift, each strip cuts
// off what doesn't pass through it at both ends.
LineSet::LineSet(const std::deque<ClockOffset>& points, Nanoseconds below, Nanoseconds above,
                 double max_drift, Nanoseconds tolerance)
    : origin_(points.front()) {
  for (double slack = tolerance; corners_.empty(); slack *= 2.0) {
    const double least = -slack - below, greatest = above + slack;
    corners_ = {{least, -max_drift}, {greatest, -max_drift}, {greatest, max_drift}, {least, max_drift}};
    for (const ClockOffset& point : points) {
      const double age = point.time - origin_.time, offset = point.offset - origin_.offset;
      cut(corners_, [&](const Line& line) { return offset + greatest - line.offsetAt(age); });
      cut(corners_, [&](const Line& line) { return line.offsetAt(age) - (offset + least); });
    }
  }
}

Interval LineSet::offsetsAt(Nanoseconds time) const {
  const double age = time - origin_.time;
  Interval offsets{INFINITY, -INFINITY};
  for (const Line& line : corners_) offsets.include(origin_.offset + line.offsetAt(age));
  return offsets;
}

Interval LineSet::drifts() const {
  Interval drifts{INFINITY, -INFINITY};
  for (const Line& line : corners_) drifts.include(line.drift);
  return drifts;
}

// --------------------------------------------------------------------------------------------------------

void DeviceClock::restart(Nanoseconds delay) {
  delay_ = delay;
  blocks_.clear();
  told_.reset();
  warm_ = false;
}

void DeviceClock::addArrival(Nanoseconds device, Nanoseconds received) {
  const ClockOffset arrival{device, received - device};
  if (blocks_.empty() || device >= block_end_) {
    blocks_.push_back(arrival);
    block_end_ = device + options_.block;
  } else if (arrival.offset < blocks_.back().offset) {
    blocks_.back() = arrival;
  } else {
    return;
  }
  while (blocks_.front().time < device - options_.window) blocks_.pop_front();
  warm_ = warm_ || device - blocks_.front().time >= options_.warm_up;
  if (warm_) {
    line_ = lineBelow(blocks_, -options_.max_drift, options_.max_drift);
  } else {
    const auto recent = std::find_if(blocks_.begin(), blocks_.end(), [&](const ClockOffset& block) {
      return block.time >= device - options_.recent;
    });
    line_ = lineBelow({recent, blocks_.end()}, line_.drift, line_.drift);
  }
}

Nanoseconds DeviceClock::toHost(Nanoseconds device) {
  Nanoseconds offset = line_.offsetAt(device) - delay_;
  if (told_) offset = follow(*told_, device, offset, line_.drift, warm_ ? options_.max_slew : kAnySlew);
  told_ = ClockOffset{device, offset};
  return device + offset;
}

// --------------------------------------------------------------------------------------------------------

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
