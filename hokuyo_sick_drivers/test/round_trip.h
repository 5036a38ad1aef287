// SPDX-License-Identifier: BSD-3-Clause
//
// Scans as the emulator knows them against scans as the driver publishes them.
#pragma once

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <deque>
#include <limits>
#include <string>
#include <vector>

#include "hokuyo_sick_drivers/hokuyo_scan.h"
#include "hokuyo_sick_drivers/lms_scan.h"
#include "transmitter.h"

namespace hokuyo_sick_drivers {

/// What there should be.
struct ExpectedScan {
  Nanoseconds stamp = 0;  ///< of the first value
  std::vector<float> ranges, intensities;
  bool damaged = false;  ///< on its way
};

/// What there is.
struct ReceivedScan {
  Nanoseconds stamp = 0;
  std::vector<float> ranges, intensities;
};

inline bool same(const std::vector<float>& a, const std::vector<float>& b) {
  return std::equal(a.begin(), a.end(), b.begin(), b.end(), [](float x, float y) {
    return x == y || (std::isnan(x) && std::isnan(y)) || std::abs(x - y) < 1e-6f * std::abs(x);
  });
}

/// Finds for each received scan the one that was sent, both in the order of time.
class Comparison {
 public:
  /// @param period between scans
  explicit Comparison(Nanoseconds period) : period_(period) {}

  void sent(const ExpectedScan& scan) { sent_.push_back(scan); }
  void received(const ReceivedScan& scan) {
    while (!sent_.empty() && sent_.front().stamp < scan.stamp - period_ / 2) miss();
    if (sent_.empty() || sent_.front().stamp > scan.stamp + period_ / 2) {
      ++invented;
      return;
    }
    const ExpectedScan& expected = sent_.front();
    if (!same(expected.ranges, scan.ranges) || !same(expected.intensities, scan.intensities)) ++wrong;
    stamp_errors.push_back(static_cast<double>(scan.stamp - expected.stamp) / kMillisecond);
    ++equal_or_wrong;
    sent_.pop_front();
  }
  /// No more is to come. Scans sent within the last period may still be on their way.
  void finish(Nanoseconds now) {
    while (!sent_.empty() && sent_.front().stamp < now - 4 * period_) miss();
  }

  double worstStampError() const {
    double worst = 0.0;
    for (const double e : stamp_errors) worst = std::max(worst, std::abs(e));
    return worst;
  }

  std::size_t equal_or_wrong = 0;
  std::size_t wrong = 0;             ///< other values than were sent
  std::size_t invented = 0;          ///< nothing was sent then
  std::size_t lost = 0;              ///< sent undamaged, never received
  std::vector<double> stamp_errors;  ///< ms

 private:
  void miss() {
    if (!sent_.front().damaged) ++lost;
    sent_.pop_front();
  }
  const Nanoseconds period_;
  std::deque<ExpectedScan> sent_;
};

/// A UTM-30LX's distance as REP 117 wants it, section 3.5 of the protocol.
inline float expectedRange(std::uint32_t code) {
  constexpr float kInfinity = std::numeric_limits<float>::infinity();
  if (code == 1 || code > 60000) return kInfinity;
  if (code == 2) return -kInfinity;
  if (code < 23) return std::numeric_limits<float>::quiet_NaN();
  return static_cast<float>(code) / 1000.0f;
}

inline ExpectedScan expectedHokuyo(const device_emulators::SentScan& sent) {
  constexpr Nanoseconds kTurn = 25 * kMillisecond;
  ExpectedScan scan;
  scan.stamp =
      sent.start + static_cast<Nanoseconds>((sent.first_step + 0.5 * (sent.cluster - 1)) / 1440 * kTurn);
  for (const std::uint32_t code : sent.ranges) scan.ranges.push_back(expectedRange(code));
  for (const std::uint32_t value : sent.intensities) scan.intensities.push_back(static_cast<float>(value));
  scan.damaged = !sent.fault.empty();
  return scan;
}

/// @param top greatest value of the mode's ranges, of which the uppermost nine are codes
inline ExpectedScan expectedSick(const device_emulators::SentScan& sent, std::uint32_t top) {
  ExpectedScan scan;
  scan.stamp = sent.start;
  for (const std::uint32_t code : sent.ranges) {
    scan.ranges.push_back(code == top - 8  ? std::numeric_limits<float>::infinity()
                          : code > top - 8 ? std::numeric_limits<float>::quiet_NaN()
                                           : static_cast<float>(code * sent.resolution));
  }
  for (const std::uint32_t value : sent.intensities) scan.intensities.push_back(static_cast<float>(value));
  scan.damaged = !sent.fault.empty();
  return scan;
}

/// An environment variable as a number, so that a soak can go on for longer than a test.
inline long environment(const char* name, long fallback) {
  const char* text = std::getenv(name);
  return text ? std::atol(text) : fallback;
}

}  // namespace hokuyo_sick_drivers
