// SPDX-License-Identifier: BSD-3-Clause
#include "hokuyo_sick_drivers/device_clock.h"

#include <algorithm>
#include <cmath>

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

}  // namespace

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

}  // namespace hokuyo_sick_drivers
