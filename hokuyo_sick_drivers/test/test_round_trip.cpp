// SPDX-License-Identifier: BSD-3-Clause
//
// Drivers against the emulated devices, in virtual time. ROUND_TRIP_MINUTES and TEST_SEED make a soak of it.
#include <gtest/gtest.h>

#include <cstdio>
#include <memory>
#include <vector>

#include "device_link.h"
#include "hokuyo_device.h"
#include "hokuyo_sick_drivers/hokuyo.h"
#include "hokuyo_sick_drivers/lms2xx.h"
#include "round_trip.h"
#include "sick_device.h"

namespace hokuyo_sick_drivers {
namespace {

using device_emulators::Fault;

const long kMinutes = environment("ROUND_TRIP_MINUTES", 1);
const auto kSeed = static_cast<std::uint64_t>(environment("TEST_SEED", 1));

class HokuyoRoundTrip {
 public:
  HokuyoRoundTrip(const device_emulators::HokuyoOptions& options, const HokuyoSettings& settings)
      : comparison(25 * kMillisecond * (1 + settings.skip)),
        device(options, std::make_shared<device_emulators::RoomSource>()),
        driver({}, settings, {[this](const HokuyoScan& scan) { take(scan); }, [](auto, const auto&) {}}),
        link(driver, device, 0) {}

  void run(Nanoseconds duration) {
    link.runUntil(link.now() + duration, [this](Nanoseconds) {
      for (const auto& scan : device.takeSentScans()) comparison.sent(expectedHokuyo(scan));
      for (const auto& scan : received_) comparison.received(scan);
      if (!received_.empty()) last_scan = link.now();
      received_.clear();
    });
    comparison.finish(link.now());
  }

  std::uint64_t faults(HokuyoFault fault) const {
    return driver.status().faults[static_cast<std::size_t>(fault)];
  }

  Comparison comparison;
  device_emulators::HokuyoDevice device;
  Hokuyo driver;
  DeviceLink link;
  Nanoseconds last_scan = 0;

 private:
  void take(const HokuyoScan& scan) { received_.push_back({scan.stamp, scan.ranges, scan.intensities}); }
  std::vector<ReceivedScan> received_;
};

// Per message: what takes long must come seldom for a start to get through.
double rateOf(Fault fault) {
  const bool long_one = fault == Fault::kSilence || fault == Fault::kStall || fault == Fault::kDisconnect ||
                        fault == Fault::kReboot;
  return long_one ? 0.004 : 0.02;
}

void setAllFaults(device_emulators::FaultOptions& faults) {
  for (const Fault fault : device_emulators::allFaults()) faults.rate(fault) = rateOf(fault) / 4.0;
  faults.rate(Fault::kAlreadyStreaming) = faults.rate(Fault::kHalfMessage) = 0.5;
  faults.rate(Fault::kNak) = 0.05;  // per command, and those are few
}

device_emulators::HokuyoOptions hokuyo(const std::string& model) {
  device_emulators::HokuyoOptions options;
  options.model = device_emulators::hokuyoModel(model);
  options.seed = kSeed;
  return options;
}

// 5 ms of jitter, 100 ppm of drift, the counter wraps in between.
TEST(HokuyoRoundTrip, EveryScanArrivesUnchangedWithItsTime) {
  for (const bool intensity : {true, false}) {
    for (const bool multi_echo : {false, true}) {
      SCOPED_TRACE(std::to_string(intensity) + std::to_string(multi_echo));
      auto options = hokuyo("UTM-30LX-EW");
      options.line.jitter = 5 * kMillisecond;
      options.line.packet_size = 64;
      options.line.random_packets = true;
      options.drift_ppm = multi_echo ? -100.0 : 100.0;
      options.start_ms = (1u << 24) - 20000;
      HokuyoSettings settings;
      settings.intensity = intensity;
      settings.multi_echo = multi_echo;
      HokuyoRoundTrip trip(options, settings);
      trip.run(kMinutes * 60 * kSecond);
      EXPECT_GT(trip.comparison.equal_or_wrong, static_cast<std::size_t>(kMinutes) * 2300);
      EXPECT_EQ(0u, trip.comparison.wrong);
      EXPECT_EQ(0u, trip.comparison.invented);
      EXPECT_EQ(0u, trip.comparison.lost);
      EXPECT_LT(trip.comparison.worstStampError(), 1.0);
      RecordProperty("worst_stamp_error_us", static_cast<int>(1000 * trip.comparison.worstStampError()));
    }
  }
}

TEST(HokuyoRoundTrip, PartOfTheScanInClusters) {
  HokuyoSettings settings;
  settings.angle_min = -1.047;
  settings.angle_max = 0.5;
  settings.cluster = 3;
  settings.skip = 2;
  HokuyoRoundTrip trip(hokuyo("UTM-30LX"), settings);
  trip.run(20 * kSecond);
  EXPECT_GT(trip.comparison.equal_or_wrong, 200u);
  EXPECT_EQ(0u, trip.comparison.wrong + trip.comparison.invented + trip.comparison.lost);
  EXPECT_LT(trip.comparison.worstStampError(), 1.0);
}

// Faults of each kind, all the time. Not a wrong scan, and back each time.
TEST(HokuyoRoundTrip, FaultsOfEveryKind) {
  for (const Fault fault :
       {Fault::kBytesLost, Fault::kBitsFlipped, Fault::kCut, Fault::kGarbage, Fault::kSilence, Fault::kStall,
        Fault::kDisconnect, Fault::kReboot, Fault::kWrongSum, Fault::kUnstable, Fault::kErrorStatus}) {
    SCOPED_TRACE(device_emulators::faultName(fault));
    auto options = hokuyo("UTM-30LX-EW");
    options.faults.rate(fault) = rateOf(fault);
    options.faults.rate(Fault::kAlreadyStreaming) = options.faults.rate(Fault::kHalfMessage) = 0.5;
    options.boot_delay = kSecond;
    HokuyoRoundTrip trip(options, HokuyoSettings());
    trip.run(kMinutes * 60 * kSecond);
    EXPECT_GT(trip.device.faults().count(fault), 5u);
    EXPECT_EQ(0u, trip.comparison.wrong);
    EXPECT_EQ(0u, trip.comparison.invented);
    EXPECT_GT(trip.comparison.equal_or_wrong, static_cast<std::size_t>(kMinutes) * 200);
    EXPECT_GT(trip.last_scan, trip.link.now() - 5 * kSecond);
    std::uint64_t counted = 0;
    for (const std::uint64_t count : trip.driver.status().faults) counted += count;
    EXPECT_GT(counted, 0u);
  }
}

template <class Trip>
void printCounts(const Trip& trip) {
  std::printf("%zu scans, %zu wrong, %zu invented; injected:", trip.comparison.equal_or_wrong,
              trip.comparison.wrong, trip.comparison.invented);
  for (const Fault fault : device_emulators::allFaults())
    std::printf(" %s %zu", device_emulators::faultName(fault), trip.device.faults().count(fault));
  std::printf("\n");
}

TEST(HokuyoRoundTrip, AllFaultsAtOnce) {
  auto options = hokuyo("UTM-30LX-EW");
  setAllFaults(options.faults);
  options.boot_delay = kSecond;
  HokuyoRoundTrip trip(options, HokuyoSettings());
  trip.run(5 * kMinutes * 60 * kSecond);
  printCounts(trip);
  for (const Fault fault : device_emulators::allFaults()) {
    const bool is_sick = fault == Fault::kNak || fault == Fault::kCountMismatch;
    EXPECT_EQ(is_sick, trip.device.faults().count(fault) == 0) << device_emulators::faultName(fault);
  }
  EXPECT_EQ(0u, trip.comparison.wrong);
  EXPECT_EQ(0u, trip.comparison.invented);
  EXPECT_GT(trip.comparison.equal_or_wrong, static_cast<std::size_t>(kMinutes) * 500);
  EXPECT_GT(trip.last_scan, trip.link.now() - 20 * kSecond);
}

TEST(HokuyoRoundTrip, BackWithinTwoSecondsOfAReconnect) {
  auto options = hokuyo("UTM-30LX");
  options.faults.outage = 3 * kSecond;
  for (int i = 1; i <= 10; ++i) options.faults.moments.push_back({Fault::kDisconnect, i * 20 * kSecond});
  HokuyoRoundTrip trip(options, HokuyoSettings());
  for (int i = 1; i <= 10; ++i) {
    trip.link.runUntil(i * 20 * kSecond + options.faults.outage);
    const auto scans = trip.driver.status().scans;
    trip.link.runUntil(trip.link.now() + 2 * kSecond);
    EXPECT_GT(trip.driver.status().scans, scans) << i;
  }
  EXPECT_EQ(10u, trip.device.faults().count(Fault::kDisconnect));
  EXPECT_EQ(10u, trip.faults(HokuyoFault::kReconnect));
}

// ---- SICK ----

class SickRoundTrip {
 public:
  SickRoundTrip(const device_emulators::SickOptions& options, const LmsOptions& lms, Nanoseconds period,
                std::uint32_t top = 0x1FFF)
      : comparison(period),
        device(options, std::make_shared<device_emulators::RoomSource>()),
        driver(lms,
               [this](const lms::Scan& scan) {
                 received_.push_back({scan.stamp, scan.ranges, scan.intensities});
               }),
        link(driver, device, lms.baud_rate),
        top_(top) {}

  void run(Nanoseconds duration) {
    link.runUntil(link.now() + duration, [this](Nanoseconds) {
      for (const auto& scan : device.takeSentScans()) comparison.sent(expectedSick(scan, top_));
      for (const auto& scan : received_) comparison.received(scan);
      if (!received_.empty()) last_scan = link.now();
      received_.clear();
    });
    comparison.finish(link.now());
  }

  Comparison comparison;
  device_emulators::SickDevice device;
  Lms2xx driver;
  DeviceLink link;
  Nanoseconds last_scan = 0;

 private:
  std::vector<ReceivedScan> received_;
  std::uint32_t top_;
};

device_emulators::SickOptions sick() {
  device_emulators::SickOptions options;
  options.seed = kSeed;
  return options;
}

constexpr Nanoseconds kTurn = kSecond / 75;

TEST(SickRoundTrip, IntensitiesOf181ValuesAtEitherRate) {
  for (const int baud_rate : {38400, 500000}) {
    for (const bool index : {false, true}) {
      SCOPED_TRACE(std::to_string(baud_rate) + (index ? " with index" : ""));
      LmsOptions lms;
      lms.baud_rate = baud_rate;
      lms.variant = lms::Variant{180, 100};
      lms.intensity = LmsOptions::Intensity::kNormalised;
      lms.real_time_index = index;
      auto options = sick();
      options.line.jitter = 5 * kMillisecond;
      SickRoundTrip trip(options, lms, kTurn);
      trip.run(kMinutes * 60 * kSecond);
      EXPECT_EQ(1u, trip.device.configurationWrites());
      EXPECT_GT(trip.comparison.equal_or_wrong,
                static_cast<std::size_t>(kMinutes) * (baud_rate > 38400 ? 1800 : 250));
      EXPECT_EQ(0u, trip.comparison.wrong);
      EXPECT_EQ(0u, trip.comparison.invented);
      EXPECT_EQ(0u, trip.comparison.lost);
      EXPECT_LT(trip.comparison.worstStampError(), 6.0);
      RecordProperty("worst_stamp_error_us", static_cast<int>(1000 * trip.comparison.worstStampError()));
    }
  }
}

TEST(SickRoundTrip, RangesOfEveryVariant) {
  for (const lms::Variant variant : {lms::Variant{180, 100}, lms::Variant{180, 50}, lms::Variant{100, 100},
                                     lms::Variant{100, 50}, lms::Variant{100, 25}}) {
    SCOPED_TRACE(std::to_string(variant.angle) + " " + std::to_string(variant.resolution));
    LmsOptions lms;
    lms.baud_rate = 500000;
    lms.variant = variant;
    lms.unit = lms::Unit::kMillimetre;
    SickRoundTrip trip(sick(), lms, kTurn * 100 / variant.resolution);
    trip.run(20 * kSecond);
    EXPECT_GT(trip.comparison.equal_or_wrong, 100u);
    EXPECT_EQ(0u, trip.comparison.wrong + trip.comparison.invented + trip.comparison.lost);
  }
}

TEST(SickRoundTrip, FaultsOfEveryKind) {
  for (const Fault fault :
       {Fault::kBytesLost, Fault::kBitsFlipped, Fault::kCut, Fault::kGarbage, Fault::kSilence, Fault::kStall,
        Fault::kDisconnect, Fault::kReboot, Fault::kWrongSum, Fault::kNak, Fault::kCountMismatch}) {
    SCOPED_TRACE(device_emulators::faultName(fault));
    auto options = sick();
    options.faults.rate(fault) = rateOf(fault);
    options.faults.rate(Fault::kAlreadyStreaming) = options.faults.rate(Fault::kHalfMessage) = 0.5;
    options.boot_delay = 2 * kSecond;
    LmsOptions lms;
    lms.baud_rate = 500000;
    lms.intensity = LmsOptions::Intensity::kNormalised;
    lms.real_time_index = true;
    SickRoundTrip trip(options, lms, kTurn);
    trip.run(kMinutes * 60 * kSecond);
    EXPECT_EQ(0u, trip.comparison.wrong);
    EXPECT_EQ(0u, trip.comparison.invented);
    EXPECT_GT(trip.comparison.equal_or_wrong, static_cast<std::size_t>(kMinutes) * 100);
    EXPECT_GT(trip.last_scan, trip.link.now() - 20 * kSecond);
  }
}

TEST(SickRoundTrip, AllFaultsAtOnce) {
  auto options = sick();
  setAllFaults(options.faults);
  options.boot_delay = 2 * kSecond;
  LmsOptions lms;
  lms.baud_rate = 500000;
  lms.intensity = LmsOptions::Intensity::kNormalised;
  lms.real_time_index = true;
  SickRoundTrip trip(options, lms, kTurn);
  trip.run(5 * kMinutes * 60 * kSecond);
  printCounts(trip);
  for (const Fault fault : device_emulators::allFaults()) {
    const bool is_hokuyo = fault == Fault::kUnstable || fault == Fault::kErrorStatus;
    EXPECT_EQ(is_hokuyo, trip.device.faults().count(fault) == 0) << device_emulators::faultName(fault);
  }
  EXPECT_EQ(0u, trip.comparison.wrong);
  EXPECT_EQ(0u, trip.comparison.invented);
  EXPECT_GT(trip.comparison.equal_or_wrong, static_cast<std::size_t>(kMinutes) * 1000);
  EXPECT_GT(trip.last_scan, trip.link.now() - 60 * kSecond);
}

}  // namespace
}  // namespace hokuyo_sick_drivers

int main(int argc, char** argv) {
  testing::InitGoogleTest(&argc, argv);
  return RUN_ALL_TESTS();
}
