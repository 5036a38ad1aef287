// SPDX-License-Identifier: BSD-3-Clause
//
// The start-up, from all states that a device may be in.
#include <gtest/gtest.h>

#include <set>

#include "fake_lms.h"

namespace hokuyo_sick_drivers {
namespace {

using Intensity = LmsOptions::Intensity;
using lms::Variant;

LmsOptions withIntensities(int baud_rate = 38400) {
  LmsOptions options;
  options.baud_rate = baud_rate;
  options.intensity = Intensity::kNormalised;
  options.unit = lms::Unit::kCentimetre;
  options.real_time_index = true;
  return options;
}
LmsOptions ranges(int angle, int resolution, int baud_rate = 500000) {
  LmsOptions options;
  options.baud_rate = baud_rate;
  options.variant = Variant{angle, resolution};
  return options;
}
// A device that is set up for that.
void prepare(FakeLms& device) {
  device.configuration[lms::kMeasuringMode] = 0x0D;
  device.configuration[lms::kAvailability] = lms::kSendRealTimeIndex;
}
std::size_t count(const FakeLms& device, const std::string& command) {
  return std::count(device.commands.begin(), device.commands.end(), command);
}
bool streams(Bench& bench, double seconds = 5.0) {
  bench.connect();
  return bench.runUntilScans(3, seconds);
}
// Whether all values are those that the device measured.
void expectRight(const lms::Scan& scan, int first = 1) {
  const double unit = lms::toMetres(scan.unit);
  const int base = static_cast<int>(std::lround(scan.ranges[0] / unit)) - first;
  for (std::size_t i = 0; i < scan.ranges.size(); ++i) {
    ASSERT_FLOAT_EQ((base + first + static_cast<int>(i)) * unit, scan.ranges[i]);
  }
}
// Its message, or an empty one.
std::string whyNot(const LmsOptions& options) {
  try {
    Lms2xx lms(options, [](const lms::Scan&) {});
  } catch (const std::invalid_argument& e) {
    return e.what();
  }
  return "";
}

// --------------------------------------------------------------------------------------------------------
// start-up

TEST(Lms2xx, SetsUpIntensitiesOnAFactoryFreshDevice) {
  Bench bench(withIntensities());
  ASSERT_TRUE(streams(bench));
  EXPECT_EQ(38400, bench.device.rate);
  EXPECT_EQ(1, bench.device.writes);
  EXPECT_EQ(std::string("\x2B\x01\x00\x01\x00\xB5\x00", 7), bench.device.stream);
  std::string expected = kFactoryConfiguration;
  expected[lms::kMeasuringMode] = 0x0D;
  expected[lms::kAvailability] = lms::kSendRealTimeIndex;
  EXPECT_EQ(expected, bench.device.configuration);
  EXPECT_FALSE(bench.device.installing);

  const LmsReport& report = bench.lms.report();
  EXPECT_EQ(LmsReport::Phase::kStreaming, report.phase);
  EXPECT_EQ("", report.problem + report.warning);
  EXPECT_EQ("LMS291;S05;V02.30", report.type);
  EXPECT_EQ("X02.30", report.software_version);
  EXPECT_TRUE(report.real_time_index);
  for (const lms::Scan& scan : bench.scans) {
    ASSERT_EQ(181u, scan.ranges.size());
    ASSERT_EQ(181u, scan.intensities.size());
    expectRight(scan);
    EXPECT_NEAR(-M_PI_2, scan.angle_min, 1e-9);
    EXPECT_NEAR(M_PI / 180.0, scan.angle_increment, 1e-9);
    EXPECT_FLOAT_EQ(5.0f * 180.0f, scan.intensities[180] - scan.intensities[0]);
  }
}

TEST(Lms2xx, WritesNothingThatIsThereAlready) {
  Bench bench(withIntensities(9600));
  prepare(bench.device);
  ASSERT_TRUE(streams(bench));
  EXPECT_EQ(0, bench.device.writes);
  EXPECT_EQ(0u, count(bench.device, std::string("\x20\x00SICK_LMS", 10)));
  for (const std::string& command : bench.device.commands) EXPECT_NE('\x3B', command[0]);
}

TEST(Lms2xx, WritesBackAsManyBytesAsItRead) {
  Bench bench(withIntensities());
  bench.device.configuration.resize(32);
  ASSERT_TRUE(streams(bench));
  EXPECT_EQ(1, bench.device.writes);
  EXPECT_EQ(32u, bench.device.configuration.size());
  EXPECT_EQ(0x0D, bench.device.configuration[lms::kMeasuringMode]);
}

TEST(Lms2xx, FindsAnyRateAndSetsAnyOther) {
  for (int from : {9600, 19200, 38400, 500000}) {
    for (int to : {9600, 19200, 38400, 500000}) {
      Bench bench(withIntensities(to));
      bench.device.rate = from;
      EXPECT_TRUE(streams(bench, 10.0)) << from << " to " << to;
      EXPECT_EQ(to, bench.device.rate);
      EXPECT_EQ(to, bench.host_rate);
    }
  }
}

TEST(Lms2xx, TakesOverADeviceThatStreams) {
  for (int rate : {9600, 38400, 500000}) {
    for (const std::string& stream : {std::string("\x24"), std::string("\x2B\x01\x00\x01\x00\xB5\x00", 7)}) {
      Bench bench(withIntensities(rate));
      bench.device.rate = bench.host_rate = rate;
      prepare(bench.device);
      bench.leaveStreaming(stream);
      bench.run(0.35);
      EXPECT_TRUE(streams(bench, rate == 9600 ? 5.0 : 2.0)) << rate;
      for (const lms::Scan& scan : bench.scans) EXPECT_EQ(181u, scan.intensities.size());
    }
  }
}

TEST(Lms2xx, IsPatientWithChangesOfModeThatTakeThreeSeconds) {
  for (int rate : {38400, 500000}) {
    for (bool streaming : {false, true}) {
      Bench bench(withIntensities(rate));
      bench.device.rate = bench.host_rate = 38400;
      bench.device.mode_time = 3 * kSecond;
      if (streaming) bench.leaveStreaming("\x24");
      bench.run(0.1);
      EXPECT_TRUE(streams(bench, 60.0)) << rate << streaming;
      EXPECT_EQ(1, bench.device.writes);
    }
  }
}

TEST(Lms2xx, IsPatientWithWriting) {
  Bench bench(withIntensities());
  bench.device.write_time = 10 * kSecond;
  EXPECT_TRUE(streams(bench, 20.0));
  EXPECT_EQ(1, bench.device.writes);
}

TEST(Lms2xx, WaitsBeforeItsFirstWordOnly) {
  LmsOptions options = withIntensities();
  options.connect_delay = 5 * kSecond;
  Bench bench(options);
  bench.connect();
  bench.run(4.9);
  EXPECT_TRUE(bench.device.commands.empty());
  EXPECT_TRUE(bench.runUntilScans(1, 5.0));
  bench.lms.disconnected(bench.now);
  bench.device.commands.clear();
  bench.connect();
  bench.run(0.1);
  EXPECT_FALSE(bench.device.commands.empty());
}

TEST(Lms2xx, GoesOnWithoutWhatTheDeviceWontWrite) {
  LmsOptions options = ranges(180, 100);
  options.real_time_index = true;
  for (bool at_once : {false, true}) {
    Bench bench(options);
    bench.device.refuses_write = !at_once;
    bench.device.refuses_installation = at_once;
    EXPECT_TRUE(streams(bench));
    EXPECT_NE("", bench.lms.report().warning);
    EXPECT_EQ(kFactoryConfiguration, bench.device.configuration);
  }
}

TEST(Lms2xx, SaysWhenTheDeviceWontHaveIntensities) {
  Bench bench(withIntensities());
  bench.device.refuses_write = true;
  bench.connect();
  bench.run(300.0);
  EXPECT_TRUE(bench.scans.empty());
  EXPECT_NE(std::string::npos, bench.lms.report().problem.find("measuring mode"));
  EXPECT_LT(bench.lms.report().configurations_written, 20u);
  bench.device.refuses_write = false;
  EXPECT_TRUE(bench.runUntilScans(3, 70.0));
  EXPECT_EQ("", bench.lms.report().problem);
}

TEST(Lms2xx, LeavesTheVariantOpen) {
  LmsOptions options;
  options.baud_rate = 500000;
  for (const Variant variant : {Variant{180, 50}, Variant{100, 25}, Variant{100, 100}}) {
    Bench bench(options);
    bench.device.angle = variant.angle;
    bench.device.resolution = variant.resolution;
    ASSERT_TRUE(streams(bench));
    EXPECT_EQ(static_cast<std::size_t>(variant.values()), bench.scans[0].ranges.size());
    EXPECT_EQ(variant, bench.lms.report().variant);
  }
}

TEST(Lms2xx, LeavesNoMeasuringModeWithoutRanges) {
  Bench bench(ranges(180, 100));
  bench.device.configuration[lms::kMeasuringMode] = 0x0D;
  ASSERT_TRUE(streams(bench));
  EXPECT_EQ(0, bench.device.mode());
}

TEST(Lms2xx, SetsWhatIsAskedFor) {
  LmsOptions options = ranges(180, 50);
  options.unit = lms::Unit::kMillimetre;
  options.measuring_mode = 5;
  options.sensitivity = 3;
  options.highest_availability = true;
  options.ignore_dazzling = false;
  Bench bench(options);
  bench.device.configuration[lms::kAvailability] = lms::kIgnoreDazzling | lms::kSendRealTimeIndex;
  ASSERT_TRUE(streams(bench));
  EXPECT_EQ(3, bench.device.configuration[lms::kSensitivity]);
  EXPECT_EQ(lms::kHighestAvailability | lms::kSendRealTimeIndex,
            bench.device.configuration[lms::kAvailability]);
  EXPECT_EQ(5, bench.device.mode());
  EXPECT_EQ(lms::Unit::kMillimetre, bench.scans[0].unit);
  EXPECT_NEAR(32.758, bench.scans[0].range_max, 1e-9);
  expectRight(bench.scans[0]);
}

TEST(Lms2xx, PartialScansHaveTheirOwnAngles) {
  for (int resolution : {100, 50, 25}) {
    LmsOptions options = ranges(180, resolution);
    options.interlaced = true;
    options.real_time_index = true;
    Bench bench(options);
    bench.connect();
    ASSERT_TRUE(bench.runUntilScans(40, 5.0));
    EXPECT_EQ(resolution == 25 ? 100 : 180, bench.device.angle);
    std::set<int> offsets;
    for (const lms::Scan& scan : bench.scans) {
      const double offset = scan.angle_min * 180.0 / M_PI + 90.0;
      offsets.insert(static_cast<int>(std::lround(100.0 * offset)));
      EXPECT_EQ(offset == 0.0 ? 181u : 180u, scan.ranges.size());
      EXPECT_NEAR(M_PI / 180.0, scan.angle_increment, 1e-9);
      EXPECT_NEAR(1.0 / 75.0, scan.scan_time, 1e-9);
    }
    EXPECT_EQ(static_cast<std::size_t>(100 / resolution), offsets.size());
    EXPECT_EQ(0u, bench.lms.report().lost);
  }
}

TEST(Lms2xx, FastTypesHaveReflectivities) {
  for (bool intensities : {false, true}) {
    LmsOptions options;
    options.baud_rate = 500000;
    if (intensities) options.intensity = Intensity::kNormalised;
    Bench bench(options);
    bench.device.type = "LMS291;S14;V02.30   ";
    bench.device.angle = 90;
    bench.device.resolution = 50;
    ASSERT_TRUE(streams(bench));
    EXPECT_EQ(intensities ? std::string("\x50\x01\x00\xB5\x00", 5) : std::string("\x24"),
              bench.device.stream);
    EXPECT_EQ(0, bench.device.writes);
    const lms::Scan& scan = bench.scans[0];
    ASSERT_EQ(181u, scan.ranges.size());
    expectRight(scan);
    EXPECT_NEAR(-M_PI_4, scan.angle_min, 1e-9);
    EXPECT_NEAR(M_PI / 360.0, scan.angle_increment, 1e-9);
    EXPECT_EQ(intensities ? 181u : 0u, scan.intensities.size());
    if (intensities) {
      EXPECT_EQ(181.0f, scan.intensities[180]);
    }
  }
}

TEST(Lms2xx, PartsOfAScan) {
  LmsOptions options = withIntensities(500000);
  options.variant = Variant{180, 50};
  options.first_index = 100;
  options.last_index = 260;
  Bench bench(options);
  ASSERT_TRUE(streams(bench));
  ASSERT_EQ(161u, bench.scans[0].ranges.size());
  expectRight(bench.scans[0], 100);
  EXPECT_NEAR((-90.0 + 49.5) * M_PI / 180.0, bench.scans[0].angle_min, 1e-9);
}

// --------------------------------------------------------------------------------------------------------
// the end

TEST(Lms2xx, StopsTheDevice) {
  Bench bench(withIntensities());
  ASSERT_TRUE(streams(bench));
  bench.lms.shutDown(bench.now);
  EXPECT_GE(bench.runUntil([&] { return bench.lms.done(); }, 1.0), 0.0);
  EXPECT_EQ("", bench.device.stream);
  EXPECT_EQ(38400, bench.device.rate);
  EXPECT_EQ(0x0D, bench.device.mode());
}

TEST(Lms2xx, LeavesTheDeviceAsItWasFound) {
  LmsOptions options = withIntensities(500000);
  options.restore_on_exit = true;
  Bench bench(options);
  bench.device.rate = bench.host_rate = 19200;
  bench.device.angle = 100;
  bench.device.resolution = 25;
  ASSERT_TRUE(streams(bench));
  EXPECT_EQ(180, bench.device.angle);
  EXPECT_NE(kFactoryConfiguration, bench.device.configuration);
  bench.lms.disconnected(bench.now);  // another start doesn't change what was found
  ASSERT_TRUE(streams(bench));

  bench.lms.shutDown(bench.now);
  EXPECT_GE(bench.runUntil([&] { return bench.lms.done(); }, 10.0), 0.0);
  EXPECT_EQ("", bench.device.stream);
  EXPECT_EQ(19200, bench.device.rate);
  EXPECT_EQ(100, bench.device.angle);
  EXPECT_EQ(25, bench.device.resolution);
  EXPECT_EQ(kFactoryConfiguration, bench.device.configuration);
  EXPECT_EQ(2, bench.device.writes);
  EXPECT_FALSE(bench.device.installing);
}

TEST(Lms2xx, IsDoneAtOnceWithoutADevice) {
  Bench bench(withIntensities());
  bench.device.off = true;
  bench.connect();
  bench.run(1.0);
  EXPECT_FALSE(bench.lms.done());
  bench.lms.shutDown(bench.now);
  EXPECT_TRUE(bench.lms.done());
}

TEST(Lms2xx, GivesUpStoppingAMuteDevice) {
  for (bool restore : {false, true}) {
    LmsOptions options = withIntensities();
    options.restore_on_exit = restore;
    Bench bench(options);
    ASSERT_TRUE(streams(bench));
    bench.device.mute = true;
    bench.lms.shutDown(bench.now);
    EXPECT_GE(bench.runUntil([&] { return bench.lms.done(); }, 1e-9 * Lms2xx::kRestoreTime), 0.0);
  }
}

// --------------------------------------------------------------------------------------------------------
// options

TEST(LmsOptions, NonsenseIsRefused) {
  EXPECT_EQ("", whyNot({}));
  EXPECT_EQ("", whyNot(withIntensities()));

  LmsOptions options;
  options.baud_rate = 115200;
  EXPECT_NE(std::string::npos, whyNot(options).find("115200"));

  EXPECT_NE("", whyNot(ranges(90, 50)));
  EXPECT_NE("", whyNot(ranges(180, 0)));
  EXPECT_NE("", whyNot(ranges(0, 100)));
  EXPECT_NE(std::string::npos, whyNot(ranges(180, 25)).find("interlaced"));

  options = ranges(180, 25);
  options.interlaced = true;
  EXPECT_EQ("", whyNot(options));
  options.intensity = Intensity::kDirect;
  EXPECT_NE(std::string::npos, whyNot(options).find("intensities"));
  options = ranges(100, 25);
  options.interlaced = true;
  EXPECT_NE("", whyNot(options));

  options = withIntensities();
  options.variant = Variant{180, 50};
  EXPECT_NE(std::string::npos, whyNot(options).find("361 values with intensities don't fit"));
  options.first_index = 100;
  options.last_index = 297;
  EXPECT_EQ("", whyNot(options));
  options.last_index = 298;
  EXPECT_NE("", whyNot(options));
  options.real_time_index = false;
  EXPECT_EQ("", whyNot(options));
  options.last_index = 362;
  EXPECT_NE(std::string::npos, whyNot(options).find("1 to 361"));
  options.last_index = 99;
  EXPECT_NE("", whyNot(options));

  options = LmsOptions();
  options.first_index = 2;
  EXPECT_NE(std::string::npos, whyNot(options).find("first_index"));
  options = withIntensities();
  options.measuring_mode = 0;
  EXPECT_NE("", whyNot(options));
  options = LmsOptions();
  options.measuring_mode = 0x3F;
  EXPECT_NE("", whyNot(options));
  options.measuring_mode = 0x0F;
  EXPECT_EQ("", whyNot(options));
  options.sensitivity = 4;
  EXPECT_NE("", whyNot(options));
}

}  // namespace
}  // namespace hokuyo_sick_drivers
