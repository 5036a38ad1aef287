// SPDX-License-Identifier: BSD-3-Clause
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <stdexcept>
#include <string>
#include <vector>

#include "hokuyo_dialogue.h"

namespace hokuyo_sick_drivers {
namespace {

bool got(const FakeHokuyo& device, const std::string& command) {
  return std::find(device.commands.begin(), device.commands.end(), command) != device.commands.end();
}

TEST(HokuyoTest, measuresDistancesAndIntensities) {
  HokuyoDialogue dialogue;
  dialogue.connect();
  dialogue.run(2.0);
  EXPECT_GT(dialogue.scans, 50u);
  EXPECT_EQ(dialogue.last.rays(), 1081u);
  EXPECT_EQ(dialogue.last.intensities.size(), 1081u);
  EXPECT_NEAR(dialogue.last.angle_min, -0.75 * M_PI, 1e-9);
  EXPECT_NEAR(dialogue.last.angle_max, 0.75 * M_PI, 1e-9);
  EXPECT_NEAR(dialogue.last.time_increment, 0.025 / 1440, 1e-12);
  EXPECT_NEAR(dialogue.last.scan_time, 0.025, 1e-12);
  EXPECT_NEAR(dialogue.last.range_min, 0.023, 1e-9);
  EXPECT_NEAR(dialogue.last.range_max, 60.0, 1e-9);
  const Hokuyo::Status status = dialogue.driver.status();
  EXPECT_TRUE(status.measuring);
  EXPECT_EQ(status.info.at("STAT"), "Sensor works well.");
  EXPECT_EQ(status.info.at("VEND"), "Hokuyo Automatic Co.,Ltd.");
  EXPECT_EQ(status.settings.intensity, true);
  EXPECT_FALSE(got(dialogue.device, "RS"));
}

TEST(HokuyoTest, takesBytesInPiecesOfAnySize) {
  for (const std::size_t piece : {1, 7, 64}) {
    HokuyoDialogue dialogue;
    dialogue.piece = piece;
    dialogue.connect();
    dialogue.run(1.0);
    EXPECT_GT(dialogue.scans, 10u);
    EXPECT_EQ(dialogue.fault(HokuyoFault::kLostScan), 0u);
  }
}

// ---- what state the device is found in

TEST(HokuyoStartTest, deviceThatMeasuresAlready) {
  HokuyoDialogue dialogue;
  dialogue.device.stream("MD0000108001000", dialogue.now);
  dialogue.run(0.09);
  dialogue.connect();
  dialogue.run(2.0);
  EXPECT_GT(dialogue.scans, 40u);
  EXPECT_EQ(dialogue.fault(HokuyoFault::kForeign), 0u);
}

TEST(HokuyoStartTest, deviceThatMeasuresAlreadyTheSameWay) {
  HokuyoDialogue dialogue;
  dialogue.device.stream("ME0000108001000", dialogue.now);
  dialogue.connect();
  dialogue.run(2.0);
  EXPECT_GT(dialogue.scans, 40u);
}

TEST(HokuyoStartTest, halfTypedCommand) {
  HokuyoDialogue dialogue;
  dialogue.device.input("MD00", dialogue.now);
  dialogue.connect();
  dialogue.run(2.0);
  EXPECT_GT(dialogue.scans, 40u);
}

TEST(HokuyoStartTest, garbageBeforeTheFirstReply) {
  HokuyoDialogue dialogue;
  dialogue.device.say(std::string(100000, 'x') + "\n0?X0", dialogue.now + 600 * kMillisecond);
  dialogue.connect();
  dialogue.run(4.0);
  EXPECT_GT(dialogue.scans, 40u);
}

TEST(HokuyoStartTest, timeMode) {
  HokuyoDialogue dialogue;
  dialogue.device.time_mode = true;
  dialogue.connect();
  dialogue.run(2.0);
  EXPECT_GT(dialogue.scans, 40u);
}

TEST(HokuyoStartTest, oldProtocol) {
  HokuyoDialogue dialogue;
  dialogue.device.old_protocol = true;
  dialogue.connect();
  dialogue.run(2.0);
  EXPECT_TRUE(got(dialogue.device, "SCIP2.0"));
  EXPECT_GT(dialogue.scans, 40u);
}

TEST(HokuyoStartTest, linesThatEndWithCrLf) {
  HokuyoDialogue dialogue;
  dialogue.device.crlf = true;
  dialogue.connect();
  dialogue.run(2.0);
  EXPECT_GT(dialogue.scans, 40u);
}

TEST(HokuyoStartTest, errorThatPasses) {
  HokuyoDialogue dialogue;
  dialogue.device.statuses["ME"] = "50";
  dialogue.connect();
  dialogue.run(3.0);
  EXPECT_EQ(dialogue.scans, 0u);
  EXPECT_GE(dialogue.fault(HokuyoFault::kErrorStatus), 2u);
  dialogue.device.statuses.clear();
  dialogue.run(3.0);
  EXPECT_GT(dialogue.scans, 40u);
}

TEST(HokuyoStartTest, otherBaudRate) {
  Hokuyo::Options options;
  options.baud_rates = {115200, 19200, 500000};
  HokuyoDialogue dialogue(options);
  dialogue.right_baud_rate = 500000;
  dialogue.connect();
  dialogue.run(6.0);
  EXPECT_GT(dialogue.scans, 40u);
  EXPECT_EQ(dialogue.baud_rates, (std::vector<int>{115200, 19200, 500000}));
  EXPECT_EQ(dialogue.driver.status().baud_rate, 500000);
  EXPECT_EQ(dialogue.reconnects, 0);
}

TEST(HokuyoStartTest, noDevice) {
  HokuyoDialogue dialogue;
  dialogue.device.silent = true;
  dialogue.connect();
  dialogue.run(10.0);
  EXPECT_GT(dialogue.reconnects, 3);
  EXPECT_GT(dialogue.fault(HokuyoFault::kTimeout), 10u);
  EXPECT_TRUE(dialogue.wasSaid("no reply to QT"));
  dialogue.device.silent = false;
  dialogue.run(2.0);
  EXPECT_GT(dialogue.scans, 10u);
}

TEST(HokuyoStartTest, resetWhereWanted) {
  Hokuyo::Options options;
  options.reset = true;
  HokuyoDialogue dialogue(options);
  dialogue.connect();
  dialogue.run(2.0);
  EXPECT_TRUE(got(dialogue.device, "RS"));
  EXPECT_GT(dialogue.scans, 40u);
}

// ---- what is measured

TEST(HokuyoSettingsTest, anglesClusterAndSkip) {
  HokuyoSettings settings;
  settings.angle_min = -0.5;
  settings.angle_max = 0.5;
  settings.cluster = 3;
  settings.skip = 4;
  HokuyoDialogue dialogue({}, settings);
  dialogue.connect();
  dialogue.run(3.0);
  // -0.5 rad are 114.6 steps; 229 steps make 76 clusters of 3.
  EXPECT_TRUE(got(dialogue.device, "ME0426065303400"));
  EXPECT_EQ(dialogue.last.rays(), 76u);
  EXPECT_NEAR(dialogue.last.angle_min, (427 - 540) * M_PI / 720, 1e-9);
  EXPECT_NEAR(dialogue.last.angle_max, dialogue.last.angle_min + 75 * 3 * M_PI / 720, 1e-9);
  EXPECT_NEAR(dialogue.last.angle_increment, 3 * M_PI / 720, 1e-9);
  EXPECT_NEAR(dialogue.last.time_increment, 3 * 0.025 / 1440, 1e-12);
  EXPECT_NEAR(dialogue.last.scan_time, 0.125, 1e-9);
  EXPECT_GT(dialogue.scans, 15u);
  EXPECT_EQ(dialogue.fault(HokuyoFault::kTimeout), 0u);
}

TEST(HokuyoSettingsTest, multipleEchoes) {
  HokuyoSettings settings;
  settings.multi_echo = true;
  for (const bool intensity : {false, true}) {
    settings.intensity = intensity;
    HokuyoDialogue dialogue({}, settings);
    dialogue.connect();
    dialogue.run(2.0);
    EXPECT_GT(dialogue.scans, 40u);
    EXPECT_EQ(dialogue.last.rays(), 1081u);
    EXPECT_EQ(dialogue.last.ranges.size(), 1081u + 361u);
    EXPECT_EQ(dialogue.last.intensities.size(), intensity ? 1442u : 0u);
  }
}

TEST(HokuyoSettingsTest, changeWhileMeasuring) {
  HokuyoDialogue dialogue;
  dialogue.connect();
  dialogue.run(2.0);
  HokuyoSettings settings;
  settings.angle_min = 0.0;
  settings.intensity = false;
  settings.cluster = 2;
  dialogue.driver.configure(settings, dialogue.now);
  const std::uint64_t before = dialogue.scans;
  dialogue.run(1.0);
  EXPECT_GT(dialogue.scans, before + 10);
  EXPECT_EQ(dialogue.last.rays(), 270u);
  EXPECT_TRUE(dialogue.last.intensities.empty());
  EXPECT_EQ(dialogue.fault(HokuyoFault::kRestart), 0u);
  EXPECT_EQ(dialogue.fault(HokuyoFault::kLostScan), 0u);

  settings.angle_min = 3.0;  // behind the device
  settings.angle_max = 3.1;
  EXPECT_THROW(dialogue.driver.configure(settings, dialogue.now), std::invalid_argument);
  const std::uint64_t unchanged = dialogue.scans;
  dialogue.run(1.0);
  EXPECT_GT(dialogue.scans, unchanged + 30);
}

TEST(HokuyoSettingsTest, refusedModesAreTriedAgainAfterReconnection) {
  HokuyoSettings settings;
  settings.multi_echo = true;
  HokuyoDialogue dialogue({}, settings);
  dialogue.device.refused = {"NE", "ND", "ME"};
  dialogue.connect();
  dialogue.run(2.0);
  EXPECT_GT(dialogue.scans, 40u);
  EXPECT_TRUE(dialogue.last.intensities.empty());
  EXPECT_EQ(dialogue.fault(HokuyoFault::kRefused), 2u);
  EXPECT_TRUE(dialogue.wasSaid("without intensities"));
  EXPECT_FALSE(dialogue.driver.status().settings.intensity);

  dialogue.device.refused.clear();
  dialogue.driver.disconnected(dialogue.now);
  dialogue.connect();
  dialogue.run(2.0);
  EXPECT_EQ(dialogue.last.intensities.size(), 1442u);
}

// ---- what the device says of itself

TEST(HokuyoStateTest, isToldOnDemandWithoutTheLossOfAScan) {
  HokuyoDialogue dialogue;
  dialogue.connect();
  dialogue.run(1.0);
  dialogue.device.commands.clear();
  dialogue.device.state = "Trouble!! Error No. =[00->33]";
  const std::uint64_t informed = dialogue.driver.status().informed;
  const HokuyoFaults faults = dialogue.driver.status().faults;
  dialogue.driver.updateStatus(dialogue.now);
  dialogue.driver.updateStatus(dialogue.now);  // is under way
  dialogue.run(1.0);
  EXPECT_EQ(dialogue.device.commands, (std::vector<std::string>{"II"}));
  EXPECT_EQ(dialogue.driver.status().informed, informed + 1);
  EXPECT_EQ(dialogue.driver.status().trouble(), "Trouble!! Error No. =[00->33]");
  EXPECT_TRUE(dialogue.driver.status().measuring);
  EXPECT_GE(dialogue.scans + 1, dialogue.device.scans);  // one is on its way
  EXPECT_EQ(dialogue.driver.status().faults, faults);
}

TEST(HokuyoStateTest, isToldByADeviceThatHasToStopForThat) {
  for (const std::string status : {"", "10", "0E"}) {
    HokuyoDialogue dialogue;
    dialogue.device.state_while_measuring = status;
    dialogue.device.jitter = 2 * kMillisecond;
    dialogue.connect();
    dialogue.run(2.0);
    const std::uint64_t informed = dialogue.driver.status().informed, before = dialogue.device.scans;
    dialogue.driver.updateStatus(dialogue.now);
    const Nanoseconds begin = dialogue.now;
    while (dialogue.driver.status().measuring && dialogue.now < begin + kSecond) dialogue.run(0.001);
    const Nanoseconds stopped = dialogue.now;
    const std::uint64_t scans = dialogue.scans;
    while (dialogue.scans == scans && dialogue.now < begin + 5 * kSecond) dialogue.run(0.001);
    EXPECT_EQ(dialogue.driver.status().informed, informed + 1);
    EXPECT_GT(dialogue.device.scans, before);
    EXPECT_LT(dialogue.now - stopped, 500 * kMillisecond);
    RecordProperty("ms_without_scans_" + status, static_cast<int>((dialogue.now - stopped) / kMillisecond));
  }
}

TEST(HokuyoStateTest, knowsWhatDevicesSayWhereAllIsWell) {
  Hokuyo::Status status;
  EXPECT_EQ(status.trouble(), "");
  for (const char* words : {"Sensor works well.", "Stable 000 no error.", "sensor is working normally"}) {
    status.info["STAT"] = words;
    EXPECT_EQ(status.trouble(), "") << words;
  }
  for (const char* words : {"Trouble!! Error No. =[00->33]", "Unstable 003 error", "Sensor error", "?"}) {
    status.info["STAT"] = words;
    EXPECT_EQ(status.trouble(), words);
  }
}

TEST(HokuyoStateTest, goesWithTheReasonNotToMeasure) {
  HokuyoDialogue dialogue;
  dialogue.device.statuses["ME"] = "0L";
  dialogue.device.state = "Trouble!! Error No. =[00->33]";
  dialogue.connect();
  dialogue.run(6.0);
  const std::string problem =
      "the device doesn't start measuring, status 0L (abnormal state); the device says: Trouble!! Error No. "
      "=[00->33]";
  EXPECT_TRUE(dialogue.wasSaid("Measuring starts anew: " + problem));
  EXPECT_TRUE(dialogue.wasSaid("the port is opened anew: " + problem));
  EXPECT_FALSE(dialogue.wasSaid("No dialogue"));
  EXPECT_EQ(dialogue.driver.status().problem, problem);
  EXPECT_GE(dialogue.reconnects, 1);
  EXPECT_EQ(dialogue.fault(HokuyoFault::kRefused), 0u);

  dialogue.device.statuses.clear();
  dialogue.run(3.0);
  EXPECT_GT(dialogue.scans, 40u);
  EXPECT_EQ(dialogue.driver.status().problem, "");
}

TEST(HokuyoStateTest, isToldWithAnyOtherRefusal) {
  HokuyoDialogue dialogue;
  dialogue.device.statuses["PP"] = "50";
  dialogue.connect();
  dialogue.run(3.0);
  EXPECT_TRUE(dialogue.wasSaid("the device answers PP with status 50 (hardware trouble)"));
}

TEST(HokuyoTest, stopsTheDeviceAtTheEnd) {
  HokuyoDialogue dialogue;
  dialogue.connect();
  dialogue.run(1.0);
  dialogue.device.commands.clear();
  dialogue.driver.shutDown(dialogue.now);
  dialogue.run(0.2);
  EXPECT_TRUE(dialogue.driver.done());
  EXPECT_TRUE(got(dialogue.device, "QT"));

  HokuyoDialogue silent;
  silent.device.silent = true;
  silent.connect();
  silent.driver.shutDown(silent.now);
  silent.run(1.0);
  EXPECT_TRUE(silent.driver.done());
}

// ---- stamps

TEST(HokuyoStampTest, areRightUnderJitterAndDriftAndAcrossTheWrap) {
  for (const double drift : {-1e-4, 1e-4}) {
    HokuyoDialogue dialogue;
    dialogue.device.jitter = 5 * kMillisecond;
    dialogue.device.drift = drift;
    dialogue.device.clock_start = (1 << 24) - 1000 * 1000 - 60 * 1000;  // the clock is at 1000 s
    dialogue.warm_up_end = dialogue.now + 15 * kSecond;
    dialogue.connect();
    dialogue.run(120.0);
    EXPECT_LT(dialogue.largest_error, 1.0);
    EXPECT_EQ(dialogue.fault(HokuyoFault::kStamp), 0u);
    EXPECT_EQ(dialogue.fault(HokuyoFault::kLostScan), 0u);
    EXPECT_GE(dialogue.scans + 1, dialogue.device.scans);  // one is on its way
  }
}

TEST(HokuyoStampTest, withoutTheDevicesTime) {
  HokuyoDialogue dialogue;
  dialogue.device.statuses["TM"] = "10";
  dialogue.warm_up_end = dialogue.now + 5 * kSecond;
  dialogue.connect();
  dialogue.run(20.0);
  EXPECT_TRUE(dialogue.wasSaid("doesn't tell its time"));
  EXPECT_GT(dialogue.scans, 700u);
  EXPECT_LT(dialogue.largest_error, 3.0);  // the transport's 2 ms stay unknown
}

TEST(HokuyoStampTest, clockThatStartsAnew) {
  HokuyoDialogue dialogue;
  dialogue.connect();
  dialogue.run(5.0);
  dialogue.device.clock_start = -1000 * 1000;
  dialogue.run(3.0);
  EXPECT_EQ(dialogue.fault(HokuyoFault::kClockRestart), 1u);
  EXPECT_EQ(dialogue.fault(HokuyoFault::kStamp), 4u);
  const std::uint64_t before = dialogue.scans;
  dialogue.run(1.0);
  EXPECT_GE(dialogue.scans, before + 39);
  EXPECT_LT(dialogue.largest_error, 1.0);
}

}  // namespace
}  // namespace hokuyo_sick_drivers
