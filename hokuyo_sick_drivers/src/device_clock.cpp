// SPDX-License-Identifier: BSD-3-Clause
#include "hokuyo_sick_drivers/device_clock.h"

#include <algorithm>
#include <cmath>
#include <vector>

namespace hokuyo_sick_drivers {

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

void StampSmoother::restart(Nanoseconds period) {
  period_ = static_cast<double>(period);
  count_ = 0.0;
  last_.reset();
}

// Gains of a line fitted to all stamps (Kalata: The tracking index, 1984) until there are so many that the
// device's own irregularity counts for more. Where it is less regular than that, fewer count.
Nanoseconds StampSmoother::smooth(Nanoseconds stamp) {
  constexpr double kLeastGain = 0.01, kForget = 0.75;
  const double earliest = static_cast<double>(stamp), latest = earliest + resolution_;
  double time = (earliest + latest) / 2.0;
  if (last_) {
    const double steps = std::max(1.0, std::round((time - *last_) / period_));
    const double predicted = *last_ + steps * period_, error = time - predicted;
    ++count_;
    if (predicted < earliest || predicted > latest) count_ *= kForget;
    const double divisor = (count_ + 1.0) * (count_ + 2.0);
    if (std::abs(error) < 2 * resolution_) {
      period_ += std::max(kLeastGain * kLeastGain / 2.0, 6.0 / divisor) * error / steps;
      time = predicted + std::max(kLeastGain, 2.0 * (2.0 * count_ + 1.0) / divisor) * error;
      time = std::clamp(time, earliest, latest);
    } else {
      count_ = 0.0;
    }
  }
  last_ = time;
  return std::llround(time);
}

void DeviceClock::restart(Nanoseconds delay) {
  delay_ = delay;
  probes_.reset();
  blocks_.clear();
  told_.reset();
  warm_ = false;
  delay_known_ = false;
}

// The device read its clock after the question was sent and before the answer was received, and cut the time
// down.
void DeviceClock::addProbe(Nanoseconds sent, Nanoseconds device, Nanoseconds received) {
  const Nanoseconds earliest = sent - device - options_.resolution, latest = received - device;
  if (!probes_) probes_ = Probes{device, earliest, latest};
  probes_->earliest = std::max(probes_->earliest, earliest);
  probes_->latest = std::min(probes_->latest, latest);
}

Nanoseconds DeviceClock::probeWidth() const {
  return probes_ ? probes_->latest - probes_->earliest : kNever;
}

void DeviceClock::addArrival(Nanoseconds device, Nanoseconds received) {
  const Arrival arrival{device, received - device};
  if (blocks_.empty() || device >= block_end_) {
    blocks_.push_back(arrival);
    block_end_ = device + options_.block;
  } else if (arrival.offset < blocks_.back().offset) {
    blocks_.back() = arrival;
  } else {
    return;
  }
  while (blocks_.front().device < device - options_.window) blocks_.pop_front();
  delay_known_ = delay_known_ || (probes_ && device - probes_->device > 3 * options_.window / 2);
  fit();
}

// The edge of the lower convex hull that spans the mean of the abscissae: of all lines below the arrivals,
// the one closest to them.
void DeviceClock::fit() {
  const Arrival& first = blocks_.front();
  warm_ = warm_ || blocks_.back().device - first.device >= options_.warm_up;
  if (warm_) {
    std::vector<Arrival> hull;
    double mean = 0.0;
    for (const Arrival& point : blocks_) {
      const auto isAbove = [&](const Arrival& from, const Arrival& middle) {
        return static_cast<double>(middle.device - from.device) * (point.offset - from.offset) <=
               static_cast<double>(middle.offset - from.offset) * (point.device - from.device);
      };
      while (hull.size() > 1 && isAbove(hull[hull.size() - 2], hull.back())) hull.pop_back();
      hull.push_back(point);
      mean += static_cast<double>(point.device - first.device) / blocks_.size();
    }
    std::size_t end = 1;
    while (end + 1 < hull.size() && hull[end].device - first.device < mean) ++end;
    const Arrival &from = hull[end - 1], &to = hull[end];
    drift_ = std::clamp(static_cast<double>(to.offset - from.offset) / (to.device - from.device),
                        -options_.max_drift, options_.max_drift);
  }
  const Nanoseconds latest = blocks_.back().device;
  line_ = lowest(drift_, warm_ ? first.device : latest - options_.recent);
  // With a drift still unknown, only arrivals of the time of the probes tell the delay.
  if (probes_ && !delay_known_ && (warm_ || latest - first.device < options_.recent)) {
    delay_ = std::llround(lineAt(probes_->device)) - probes_->middle();
  }
}

// The arrival that a line of this slope touches from below.
DeviceClock::Arrival DeviceClock::lowest(double drift, Nanoseconds since) const {
  const auto height = [&](const Arrival& point) {
    return point.offset - blocks_.front().offset - drift * (point.device - blocks_.front().device);
  };
  const auto begin = std::find_if(blocks_.begin(), blocks_.end(),
                                  [&](const Arrival& point) { return point.device >= since; });
  return *std::min_element(begin, blocks_.end(),
                           [&](const Arrival& a, const Arrival& b) { return height(a) < height(b); });
}

double DeviceClock::lineAt(Nanoseconds device) const {
  return line_.offset + drift_ * (device - line_.device);
}

Nanoseconds DeviceClock::offsetAt(Nanoseconds device) const {
  if (!blocks_.empty()) return std::llround(lineAt(device)) - delay_;
  return probes_->middle() + std::llround(drift_ * (device - probes_->device));
}

Nanoseconds DeviceClock::toHost(Nanoseconds device) {
  Nanoseconds offset = offsetAt(device);
  if (told_) {
    const Nanoseconds step = device - told_->device;
    if (warm_ || probes_) {
      const Nanoseconds expected = told_->offset + std::llround(drift_ * step);
      const Nanoseconds slew = std::llround(options_.max_slew * step);
      offset = std::clamp(offset, expected - slew, expected + slew);
    }
    offset = std::max(offset, told_->offset - step);
  }
  told_ = Arrival{device, offset};
  return device + offset;
}

}  // namespace hokuyo_sick_drivers
