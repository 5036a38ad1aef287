// SPDX-License-Identifier: BSD-3-Clause
//
// Driver and fake device in virtual time, and what a test wants to know of the scans.
#pragma once

#include <gtest/gtest.h>

#include <cmath>
#include <string>
#include <vector>

#include "fake_hokuyo.h"
#include "hokuyo_sick_drivers/hokuyo.h"

namespace hokuyo_sick_drivers {

class HokuyoDialogue {
 public:
  explicit HokuyoDialogue(const Hokuyo::Options& options = {}, const HokuyoSettings& settings = {})
      : driver(options, settings,
               {[this](const HokuyoScan& scan) { take(scan); },
                [this](Hokuyo::Level, const std::string& text) { said.push_back(text); }}) {}

  void connect() { driver.connected(now); }

  // Goes on for some time. A port that the driver wants to be opened anew is, at once.
  void run(double seconds) {
    const Nanoseconds end = now + std::llround(1e9 * seconds);
    while (true) {
      for (auto output = driver.takeOutput(); !output.empty(); output = driver.takeOutput()) {
        if (!output.bytes.empty() && baud_rate_is_right) device.input(output.bytes, now);
        if (output.baud_rate != 0) {
          baud_rates.push_back(output.baud_rate);
          baud_rate_is_right = right_baud_rate == 0 || output.baud_rate == right_baud_rate;
        }
        if (output.reconnect) {
          ++reconnects;
          driver.disconnected(now);
          driver.connected(now);
        }
      }
      const Nanoseconds next = std::min(driver.deadline(), device.next());
      if (next > end) break;
      now = std::max(now, next);
      const std::string bytes = device.output(now);
      for (std::size_t i = 0; i < bytes.size(); i += piece) driver.received(bytes.substr(i, piece), now);
      driver.tick(now);
    }
    now = end;
  }

  std::uint64_t fault(HokuyoFault fault) const {
    return driver.status().faults[static_cast<std::size_t>(fault)];
  }
  bool wasSaid(const std::string& text) const {
    for (const std::string& line : said) {
      if (line.find(text) != std::string::npos) return true;
    }
    return false;
  }

  Nanoseconds now = 1000 * kSecond;
  FakeHokuyo device;
  Hokuyo driver;
  std::size_t piece = 1u << 20;  // bytes that arrive together
  int right_baud_rate = 0;
  bool baud_rate_is_right = true;

  std::vector<int> baud_rates;
  std::vector<std::string> said;
  int reconnects = 0;
  HokuyoScan last;
  std::uint64_t scans = 0;
  double largest_error = 0.0;  // ms, of the stamps
  Nanoseconds warm_up_end = 0;

 private:
  // Every ray must be of the same scan, and of the right step.
  void take(const HokuyoScan& scan) {
    ++scans;
    last = scan;
    ASSERT_GT(scan.rays(), 0u);
    const auto millimetres = [&](std::size_t echo) {
      return static_cast<int>(std::lround(1e3 * scan.ranges[echo]));
    };
    const double increment = M_PI / 720.0;
    const int cluster = static_cast<int>(std::lround(scan.angle_increment / increment));
    const int first = static_cast<int>(std::lround(scan.angle_min / increment - 0.5 * (cluster - 1))) + 540;
    std::uint64_t number = device.scans;
    do {
      ASSERT_GT(number, 0u) << "not a scan of the device";
      --number;
    } while (static_cast<int>(FakeHokuyo::distance(number, first)) != millimetres(0));
    for (std::size_t ray = 0; ray < scan.rays(); ++ray) {
      const int step = first + static_cast<int>(ray) * cluster;
      const auto begin = scan.first_echo[ray], end = scan.first_echo[ray + 1];
      ASSERT_EQ(millimetres(begin), static_cast<int>(FakeHokuyo::distance(number, step)));
      if (end - begin == 2) {
        ASSERT_EQ(millimetres(begin + 1), millimetres(begin) + 500);
      }
      if (!scan.intensities.empty()) {
        ASSERT_EQ(scan.intensities[begin], 300 + step);
      }
    }
    if (now < warm_up_end) return;
    const double turn = 1e9 * device.period;
    const Nanoseconds truth =
        device.passed.at(number) + std::llround((first + 0.5 * (cluster - 1)) / 1440.0 * turn);
    largest_error = std::max(largest_error, 1e-6 * std::abs(static_cast<double>(scan.stamp - truth)));
  }
};

}  // namespace hokuyo_sick_drivers
