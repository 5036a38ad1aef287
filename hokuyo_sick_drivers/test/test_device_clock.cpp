// SPDX-License-Identifier: BSD-3-Clause
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <random>

#include "hokuyo_sick_drivers/device_clock.h"

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

// A device whose messages and answers take up to 5 ms longer than need be, each way.
struct Link {
  explicit Link(unsigned seed, double drift) : random(seed), drift(drift) {}

  Nanoseconds host(double device) const {  // device: true time of its clock (s), not cut down to ms
    return offset + std::llround(1e9 * device * (1.0 + drift));
  }
  Nanoseconds delay() { return constant_delay + std::llround(jitter(random)); }
  static Nanoseconds stamp(double device) {
    return static_cast<Nanoseconds>(std::floor(1e3 * device)) * kMillisecond;
  }
  void probe(DeviceClock& clock, int count, double& device) {
    for (int i = 0; i < count; ++i) {
      const Nanoseconds read = host(device), sent = read - delay() + constant_delay;
      clock.addProbe(sent, stamp(device), read + delay() - constant_delay);
      device += 0.0053;
    }
  }

  std::mt19937 random;
  double drift;
  Nanoseconds offset = 1234567890123456;
  Nanoseconds constant_delay = 21 * kMillisecond;
  std::uniform_real_distribution<double> jitter{0.0, 5e6};
};

struct Errors {
  double largest = 0.0;       // ms
  double largest_step = 0.0;  // ms that the time between two stamps is off
  bool monotone = true;
};

Errors run(Link& link, DeviceClock& clock, double period, double seconds, double warm_up) {
  double device = 3.0 + 1e-3 * std::uniform_real_distribution<double>()(link.random);
  StampSmoother smoother;
  smoother.restart(25 * kMillisecond);
  clock.restart(0);
  link.probe(clock, 100, device);
  Errors errors;
  Nanoseconds last = 0;
  double last_device = 0.0;
  for (const double begin = device; device < begin + seconds; device += period) {
    const Nanoseconds time = smoother.smooth(Link::stamp(device));
    clock.addArrival(time, link.host(device) + link.delay());
    const Nanoseconds told = clock.toHost(time);
    if (last != 0) {
      errors.monotone = errors.monotone && told >= last;
      const double step = 1e-6 * (told - last) - 1e3 * (device - last_device);
      errors.largest_step = std::max(errors.largest_step, std::abs(step));
    }
    last = told;
    last_device = device;
    if (device - begin < warm_up) continue;
    const double error = 1e-6 * static_cast<double>(told - link.host(device));
    errors.largest = std::max(errors.largest, std::abs(error));
  }
  return errors;
}

void expectRight(double period, double limit) {
  for (unsigned seed = 0; seed < 20; ++seed) {
    for (const double drift : {-1e-4, 0.0, 1e-4}) {
      Link link(seed, drift);
      DeviceClock clock;
      const Errors errors = run(link, clock, period, 600.0, 30.0);
      EXPECT_LT(errors.largest, limit) << "seed " << seed << ", drift " << drift << ", period " << period;
      EXPECT_TRUE(errors.monotone);
      EXPECT_LT(errors.largest_step, 1.1);
      EXPECT_NEAR(clock.drift(), drift, 1e-5);
    }
  }
}

TEST(DeviceClockTest, isRightWithinAMillisecondUnderJitterAndDrift) {
  for (const double period : {0.025, 0.0251}) expectRight(period, 1.0);
}

// The stamps' last digit stays for 400 scans; what is cut off then can't be averaged.
TEST(DeviceClockTest, isRightWherePeriodAndResolutionBeat) {
  expectRight(0.0250025, 1.2);
}

// Without probes the constant delay is as good as what the caller knows of it.
TEST(DeviceClockTest, takesTheDelayItIsToldWithoutProbes) {
  DeviceClock clock;
  clock.restart(20 * kMillisecond);
  EXPECT_FALSE(clock.known());
  for (Nanoseconds i = 0; i < 400; ++i) {
    const Nanoseconds device = i * 25 * kMillisecond, late = (i % 7) * kMillisecond;
    clock.addArrival(device, device + kSecond + 20 * kMillisecond + late);
    EXPECT_EQ(clock.toHost(device), device + kSecond);
  }
}

// A device that can't be heard for a while, or a host that is busy.
TEST(DeviceClockTest, isNotMisledByATrafficJam) {
  Link link(1, 1e-4);
  DeviceClock clock;
  run(link, clock, 0.025, 30.0, 20.0);
  const double drift = clock.drift();
  Nanoseconds last = 0;
  for (double device = 40.0; device < 42.0; device += 0.025) {
    clock.addArrival(Link::stamp(device), link.host(42.0) + link.constant_delay);
    const Nanoseconds told = clock.toHost(Link::stamp(device));
    EXPECT_NEAR(1e-6 * static_cast<double>(told - link.host(device)), 0.0, 2.0);
    EXPECT_GE(told, last);
    last = told;
  }
  EXPECT_NEAR(clock.drift(), drift, 2e-5);
}

}  // namespace
}  // namespace hokuyo_sick_drivers
