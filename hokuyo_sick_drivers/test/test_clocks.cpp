// SPDX-License-Identifier: BSD-3-Clause
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <deque>
#include <random>
#include <string>

#include "hokuyo_sick_drivers/clock_line.h"
#include "hokuyo_sick_drivers/counter_unwrapper.h"
#include "hokuyo_sick_drivers/device_clock.h"
#include "hokuyo_sick_drivers/scan_clock.h"

namespace hokuyo_sick_drivers {
namespace {

TEST(CounterUnwrapperTest, goesOnWhereTheCounterStartsAnew) {
  CounterUnwrapper counter(24);
  EXPECT_EQ(counter.unwrap(16777200), 16777200);
  EXPECT_EQ(counter.unwrap(16777215), 16777215);
  EXPECT_EQ(counter.unwrap(9), 16777225);
  EXPECT_EQ(counter.unwrap(8), 16777224);
  EXPECT_EQ(counter.unwrap(8000000), 24777216);
}

TEST(ClockLineTest, isThatOfTheFastestMessages) {
  std::deque<ClockOffset> points;
  for (int i = 0; i < 100; ++i)  // every seventh message has no jitter
    points.push_back({i * kSecond, 5000 + i * 100 + (i % 7 == 0 ? 0 : 1'000'000 + 777 * i)});
  const ClockLine line = lineBelow(points, -1e-3, 1e-3);
  EXPECT_NEAR(line.drift, 1e-7, 1e-12);
  EXPECT_EQ(line.offsetAt(50 * kSecond), 10000);
  // The drift may not be so great: the line turns about the point in the middle of what is allowed.
  EXPECT_EQ(lineBelow(points, 0.0, 0.0).offsetAt(0), 5000);
}

TEST(LineSetTest, holdsTheLinesThatPassCloseByAllPoints) {
  const std::deque<ClockOffset> points = {{0, 0}, {1000, 100}, {2000, 200}};
  const LineSet lines(points, 10, 30, 1.0, 0);
  EXPECT_NEAR(lines.offsetsAt(0).least, -10.0, 1e-6);
  EXPECT_NEAR(lines.offsetsAt(0).greatest, 30.0, 1e-6);
  EXPECT_NEAR(lines.drifts().least, 0.08, 1e-9);     // from 30 above the first to 10 below the last
  EXPECT_NEAR(lines.drifts().greatest, 0.12, 1e-9);  // and the other way round
  EXPECT_NEAR(lines.offsetsAt(1000).middle(), 110.0, 1e-6);
  // No line passes within 1 of these: the bounds become wider until one does.
  const LineSet none({{0, 0}, {1000, 100}, {2000, 0}}, 0, 0, 1.0, 1);
  EXPECT_GE(none.offsetsAt(1000).greatest, 50.0 - 1e-6);
}

// A scanner's motor, quartz and line, whose messages and answers take up to 5 ms longer than need be, each
// way.
struct Scanner {
  Scanner(unsigned seed, double drift, double period = 0.025) : random(seed), drift(drift), period(period) {
    now = 3.0 + 1e-3 * std::uniform_real_distribution<double>()(random);
  }

  Nanoseconds host(double time) const { return 1234567890123456 + std::llround(1e9 * time); }
  Nanoseconds stamp(double time) const {
    return static_cast<Nanoseconds>(std::floor(1e3 * (0.4 + time * (1.0 - drift)))) * kMillisecond;
  }
  Nanoseconds jitter() { return std::llround(line_jitter(random)); }
  void probe(ScanClock& clock) {
    for (int i = 0; i < 100; ++i, now += 0.0053) {
      const Nanoseconds sent = host(now) - jitter();
      clock.addProbe(sent, stamp(now), host(now) + jitter());
    }
  }
  double nextScan() {
    ++scans;
    const double turned = scans * period;
    const double wander =
        wander_amplitude * kWanderPeriod / (2 * M_PI) * (1.0 - std::cos(2 * M_PI * turned / kWanderPeriod));
    return now + turned + wander +
           motor_jitter * (2.0 * std::uniform_real_distribution<double>()(random) - 1.0);
  }

  static constexpr double kWanderPeriod = 20.0;
  std::mt19937 random;
  double drift, period;           // of the quartz; of the motor, s
  double wander_amplitude = 0.0;  // of the motor's speed
  double motor_jitter = 0.0;      // s
  Nanoseconds constant_delay = 21 * kMillisecond;
  double now;  // s
  long scans = 0;
  std::uniform_real_distribution<double> line_jitter{0.0, 5e6};
};

struct Errors {
  double largest = 0.0;       // ms
  double largest_step = 0.0;  // ms that the time between two stamps is off
  bool monotone = true;
};

Errors run(Scanner& scanner, ScanClock& clock, double seconds) {
  clock.restart(25 * kMillisecond, 0);
  scanner.probe(clock);
  Errors errors;
  Nanoseconds last = 0;
  double last_scan = 0.0;
  while (last_scan < scanner.now + seconds) {
    const double scan = scanner.nextScan();
    const Nanoseconds told =
        clock.addScan(scanner.stamp(scan), scanner.host(scan) + scanner.constant_delay + scanner.jitter());
    const double error = 1e-6 * static_cast<double>(told - scanner.host(scan));
    if (last != 0) {
      errors.monotone = errors.monotone && told >= last;
      const double step = 1e-6 * (told - last) - 1e3 * (scan - last_scan);
      errors.largest_step = std::max(errors.largest_step, std::abs(step));
    }
    last = told;
    last_scan = scan;
    errors.largest = std::max(errors.largest, std::abs(error));
  }
  return errors;
}

void expectRight(double period, double wander, double motor_jitter, double limit) {
  for (unsigned seed = 0; seed < 5; ++seed) {
    for (const double drift : {-3e-5, 0.0, 1e-5, 1e-4}) {
      SCOPED_TRACE("seed " + std::to_string(seed) + ", drift " + std::to_string(1e6 * drift) + " ppm");
      Scanner scanner(seed, drift, period);
      scanner.wander_amplitude = wander;
      scanner.motor_jitter = motor_jitter;
      ScanClock clock;
      const Errors errors = run(scanner, clock, 60.0);
      EXPECT_LT(errors.largest, limit);
      EXPECT_LT(errors.largest_step, 0.6);
      EXPECT_TRUE(errors.monotone);
      EXPECT_NEAR(clock.drift(), drift, 2e-5);
    }
  }
}

TEST(ScanClockTest, isRightWithinAMillisecondFromTheFirstScanOn) {
  for (const double period : {0.025, 0.0251}) expectRight(period, 0.0, 0.0, 1.0);
}

// The stamps' last digit stays for 400 scans.
TEST(ScanClockTest, isRightWherePeriodAndResolutionBeat) {
  expectRight(0.0250025, 0.0, 0.0, 1.0);
}

// Within four seconds the motor then is by 0.3 ms not where a line has it.
TEST(ScanClockTest, bearsAMotorThatWanders) {
  expectRight(0.025, 5e-4, 20e-6, 1.3);
}

TEST(ScanClockTest, bearsLostScansAndATrafficJam) {
  Scanner scanner(1, 1e-4);
  ScanClock clock;
  run(scanner, clock, 30.0);
  const double drift = clock.drift();
  for (int lost = 0; lost < 40; ++lost) scanner.nextScan();
  Nanoseconds last = 0, jam_end = 0;
  for (int i = 0; i < 80; ++i) {
    const double scan = scanner.nextScan();
    if (i == 0) jam_end = scanner.host(scan + 2.0) + scanner.constant_delay;
    const Nanoseconds told = clock.addScan(scanner.stamp(scan), jam_end);
    EXPECT_NEAR(1e-6 * static_cast<double>(told - scanner.host(scan)), 0.0, 1.5);
    EXPECT_GE(told, last);
    last = told;
  }
  EXPECT_NEAR(clock.drift(), drift, 2e-5);
}

// Without probes the constant delay is as good as what the caller knows of it.
TEST(ScanClockTest, takesTheDelayItIsToldWithoutProbes) {
  ScanClock clock;
  clock.restart(25 * kMillisecond, 20 * kMillisecond);
  EXPECT_FALSE(clock.known());
  for (Nanoseconds i = 0; i < 400; ++i) {
    const Nanoseconds stamp = i * 25 * kMillisecond, late = (i % 7) * kMillisecond;
    const Nanoseconds told = clock.addScan(stamp, stamp + kSecond + 20 * kMillisecond + late);
    EXPECT_NEAR(static_cast<double>(told - stamp - kSecond), 0.0, 1e3);
  }
  EXPECT_TRUE(clock.known());
}

// A device whose time is exact, but for its drift.
TEST(DeviceClockTest, findsTheDriftUnderJitter) {
  std::mt19937 random(1);
  std::uniform_real_distribution<double> jitter(0.0, 5e6);
  DeviceClock clock;
  clock.restart(20 * kMillisecond);
  for (Nanoseconds i = 0; i < 4000; ++i) {
    const Nanoseconds device = i * 25 * kMillisecond, host = device + device / 10000 + kSecond;
    clock.addArrival(device, host + 20 * kMillisecond + std::llround(jitter(random)));
    const Nanoseconds told = clock.toHost(device);
    if (i < 2000) continue;
    EXPECT_NEAR(static_cast<double>(told - host), 0.0, 0.3e6);
  }
  EXPECT_NEAR(clock.drift(), 1e-4, 5e-6);
}

}  // namespace
}  // namespace hokuyo_sick_drivers
