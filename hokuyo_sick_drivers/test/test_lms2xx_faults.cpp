// SPDX-License-Identifier: BSD-3-Clause
//
// Bad lines, power cuts, devices that come and go. Whatever happens, no wrong scan, and scans again soon.
#include <gtest/gtest.h>

#include <random>

#include "fake_lms.h"

namespace hokuyo_sick_drivers {
namespace {

LmsOptions withIntensities(int baud_rate = 500000) {
  LmsOptions options;
  options.baud_rate = baud_rate;
  options.intensity = LmsOptions::Intensity::kNormalised;
  options.unit = lms::Unit::kCentimetre;
  options.real_time_index = true;
  return options;
}

class Lms2xxFaults : public ::testing::Test {
 protected:
  explicit Lms2xxFaults(const LmsOptions& options = withIntensities()) : bench_(options) {
    bench_.device.rate = bench_.host_rate = options.baud_rate;
  }
  void start() {
    bench_.connect();
    ASSERT_TRUE(bench_.runUntilScans(3, 10.0));
  }
  // Seconds until scans come, negative if they don't.
  double recovery(double seconds) {
    const std::size_t before = bench_.scans.size();
    return bench_.runUntil([&] { return bench_.scans.size() > before; }, seconds);
  }
  // As the device measured them.
  void expectAllRight() {
    for (const lms::Scan& scan : bench_.scans) {
      ASSERT_EQ(181u, scan.ranges.size());
      ASSERT_EQ(181u, scan.intensities.size());
      const int base = static_cast<int>(std::lround(100.0f * scan.ranges[0])) - 1;
      for (int i = 0; i < 181; ++i) {
        ASSERT_FLOAT_EQ(0.01 * (base + 1 + i), scan.ranges[i]);
        ASSERT_EQ(5.0f * i, scan.intensities[i] - scan.intensities[0]);
      }
    }
    for (std::size_t i = 1; i < bench_.scans.size(); ++i) {
      ASSERT_GT(bench_.scans[i].stamp, bench_.scans[i - 1].stamp);
    }
  }

  Bench bench_;
};

TEST_F(Lms2xxFaults, ComesBackAfterAPowerCut) {
  start();
  EXPECT_EQ(1, bench_.device.writes);
  for (double seconds : {5.0, 33.0, 120.0}) {
    bench_.powerOff();
    bench_.run(seconds);
    EXPECT_NE(LmsReport::Phase::kStreaming, bench_.lms.report().phase);
    bench_.powerOn();
    const double time = recovery(10.0);
    EXPECT_GE(time, 0.0);
    EXPECT_LT(time, 4.0);
  }
  EXPECT_EQ(1, bench_.device.writes);  // it is in the EEPROM
  EXPECT_GE(bench_.reconnects, 1);
  expectAllRight();
}

TEST_F(Lms2xxFaults, HearsTheDeviceSayThatItWasSwitchedOn) {
  start();
  bench_.device.stream.clear();
  bench_.device.rate = 500000;  // a permanent rate
  bench_.toHost(answer("\x90LMS291"));
  EXPECT_LT(recovery(10.0), 1.0);
  EXPECT_EQ(1u, bench_.lms.report().power_ons);
}

TEST_F(Lms2xxFaults, ComesBackAfterAPulledCable) {
  start();
  for (double seconds : {0.2, 3.0, 100.0}) {
    bench_.lms.disconnected(bench_.now);
    EXPECT_EQ(kNever, bench_.lms.deadline());
    bench_.mangle = [](const std::string&) { return std::string(); };
    bench_.run(seconds);
    bench_.mangle = [](const std::string& bytes) { return bytes; };
    bench_.connect();
    const double time = recovery(10.0);
    EXPECT_GE(time, 0.0);
    EXPECT_LT(time, 2.0);
  }
  expectAllRight();
}

TEST_F(Lms2xxFaults, ComesBackAfterSilence) {
  start();
  bench_.device.mute = true;
  bench_.run(20.0);
  EXPECT_GT(bench_.lms.report().timeouts, 0u);
  bench_.device.mute = false;
  EXPECT_GE(recovery(5.0), 0.0);
}

TEST_F(Lms2xxFaults, NoticesThatAnotherProgramStoppedTheStream) {
  start();
  bench_.device.stream.clear();
  EXPECT_LT(recovery(5.0), 2.5);
  EXPECT_EQ(1u, bench_.lms.report().timeouts);
}

TEST_F(Lms2xxFaults, RepeatsWhatWasNotUnderstood) {
  int naks = 0;
  bench_.mangle = [&](const std::string& bytes) {
    const bool nak = bytes.size() > 1 && naks < 2 && bytes[4] == '\xBA';
    naks += nak;
    return nak ? "\x15" : bytes;
  };
  start();
  EXPECT_EQ(2, naks);
  EXPECT_EQ(2u, bench_.lms.report().repeated);
}

TEST_F(Lms2xxFaults, ALostAnswerToWritingCostsNoOtherWrite) {
  bool lost = false;
  bench_.mangle = [&](const std::string& bytes) {
    if (bytes.size() < 6 || bytes[4] != '\xF7' || lost) return bytes;
    lost = true;
    return bytes.substr(0, 20);
  };
  start();
  EXPECT_TRUE(lost);
  EXPECT_EQ(1, bench_.device.writes);
}

// A device that says yes and stays as it is must not be written to for ever.
TEST_F(Lms2xxFaults, SparesTheEeprom) {
  bench_.mangle = [&](const std::string& bytes) {
    if (bytes.size() > 6 && bytes[4] == '\xF4') bench_.device.configuration = kFactoryConfiguration;
    return bytes.size() > 6 && bytes[4] == '\xF4' ? answer("\xF4" + kFactoryConfiguration) : bytes;
  };
  bench_.connect();
  bench_.run(600.0);
  EXPECT_TRUE(bench_.scans.empty());
  EXPECT_LE(bench_.device.writes, 35);
  EXPECT_NE("", bench_.lms.report().problem);
}

TEST_F(Lms2xxFaults, DropsScansOfAnotherVariant) {
  start();
  const std::size_t before = bench_.scans.size();
  bench_.device.stream = std::string("\x2B\x01\x00\x01\x00\x79\x00", 7);
  bench_.run(0.3);
  EXPECT_EQ(before, bench_.scans.size());
  EXPECT_GT(bench_.lms.report().defects[static_cast<std::size_t>(lms::Defect::kOtherVariant)], 0u);
  EXPECT_GE(bench_.runUntil([&] { return !bench_.lms.report().problem.empty(); }, 2.0), 0.0);
  const std::string problem = bench_.lms.report().problem;
  EXPECT_EQ(problem.find("scans fail to appear; dropped: "), 0u) << problem;
  EXPECT_NE(problem.find(" other variant"), std::string::npos) << problem;
  EXPECT_EQ(problem.find("checksum"), std::string::npos) << problem;
  EXPECT_GE(recovery(5.0), 0.0);
}

TEST_F(Lms2xxFaults, TellsWhyScansDoNotStart) {
  bench_.device.start_result = 2;
  bench_.connect();
  bench_.run(10.0);
  EXPECT_EQ(bench_.lms.report().problem,
            "the device doesn't accept the command to send scans: a fault in the device");
  bench_.device.start_result = 0;
  EXPECT_GE(recovery(10.0), 0.0);
}

// Each kind of fault, many times.
class Lms2xxLine : public Lms2xxFaults, public ::testing::WithParamInterface<int> {};

TEST_P(Lms2xxLine, NeverMakesAWrongScan) {
  std::mt19937 random(GetParam());
  const auto below = [&](std::size_t n) {
    return std::uniform_int_distribution<std::size_t>(0, n - 1)(random);
  };
  std::size_t faults = 0;
  bool clean = true;
  bench_.mangle = [&](std::string bytes) {
    if (clean || below(3) > 0) return bytes;
    ++faults;
    switch (GetParam()) {
      case 0:
        bytes[below(bytes.size())] ^= static_cast<char>(1 << below(8));
        break;
      case 1:
        bytes.erase(below(bytes.size()), 1 + below(20));
        break;
      case 2:
        bytes.resize(below(bytes.size()));
        break;
      case 3:
        bytes.insert(below(bytes.size()), std::string(1 + below(10), static_cast<char>(below(256))));
        break;
      case 4:
        for (char& c : bytes) c = static_cast<char>(below(256));
        break;
      default:
        bytes.clear();
    }
    return bytes;
  };
  start();
  clean = false;
  bench_.run(120.0);
  EXPECT_GT(faults, 500u);
  expectAllRight();
  const LmsReport& report = bench_.lms.report();
  EXPECT_GT(report.scans, 500u);
  const std::size_t counted = report.lost + report.line.bad_crc + report.line.bad_length + report.line.cut;
  EXPECT_GT(counted, faults / 2);
  clean = true;
  EXPECT_GE(recovery(5.0), 0.0);
  EXPECT_LE(bench_.device.writes, 1);
}
INSTANTIATE_TEST_SUITE_P(Faults, Lms2xxLine, ::testing::Range(0, 6));

}  // namespace
}  // namespace hokuyo_sick_drivers
