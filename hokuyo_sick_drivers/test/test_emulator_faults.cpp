// SPDX-License-Identifier: BSD-3-Clause
#include <gtest/gtest.h>

#include "emulator_host.h"
#include "hokuyo_device.h"
#include "mapping_common/testing/temp_dir.h"
#include "scip_text.h"
#include "sick_device.h"

namespace device_emulators {
namespace {

using mapping_common::errorOf;
using mapping_common::mentions;

std::shared_ptr<ScanSource> room() {
  return std::make_shared<RoomSource>();
}

// A Hokuyo that streams a few steps with these faults.
struct Stream {
  explicit Stream(const HokuyoOptions& options) : device(options, room()), host(device) {
    host.send("MD0540054901000\n");
  }
  HokuyoDevice device;
  Host host;
};

HokuyoOptions with(Fault fault, double rate) {
  HokuyoOptions options;
  options.faults.rate(fault) = rate;
  return options;
}

TEST(Transmitter, PacesByTenBitsPerByte) {
  LineOptions options;
  options.baud_rate = 38400;
  Transmitter transmitter(options, 1);
  transmitter.send(std::string(384, 'x'), kSecond);
  EXPECT_EQ(transmitter.freeAt(), kSecond + 100 * kMillisecond);
  std::size_t sent = 0;
  for (Nanoseconds t = transmitter.deadline(); t != kNever; t = transmitter.deadline()) {
    sent += transmitter.take(t).bytes.size();
    EXPECT_NEAR(static_cast<double>(t - kSecond), static_cast<double>(sent) * 10 / 38400 * kSecond, 1.0);
  }
  EXPECT_EQ(sent, 384u);
}

TEST(Transmitter, JitterDelaysMessagesInOrder) {
  LineOptions options;
  options.jitter = 5 * kMillisecond;
  Transmitter transmitter(options, 1);
  Nanoseconds earliest = kNever, latest = 0;
  for (int i = 0; i < 1000; ++i) {
    const Nanoseconds sent = i * 2 * kMillisecond;
    transmitter.send(std::to_string(i), sent);
    const Nanoseconds delay = transmitter.freeAt() - sent;
    earliest = std::min(earliest, delay);
    latest = std::max(latest, delay);
  }
  EXPECT_GE(earliest, 0);
  EXPECT_LE(latest, 5 * kMillisecond);
  EXPECT_GT(latest - earliest, 4 * kMillisecond);
  for (int i = 0; i < 1000; ++i) EXPECT_EQ(transmitter.take(10 * kSecond).bytes, std::to_string(i));
}

TEST(Transmitter, WritesInPackets) {
  LineOptions options;
  options.packet_size = 64;
  Transmitter fixed(options, 1);
  fixed.send(std::string(150, 'x'), 0);
  EXPECT_EQ(fixed.take(0).bytes.size(), 64u);
  EXPECT_EQ(fixed.take(0).bytes.size(), 64u);
  EXPECT_EQ(fixed.take(0).bytes.size(), 22u);
  options.random_packets = true;
  options.packet_gap = kMillisecond;
  Transmitter random(options, 1);
  random.send(std::string(10000, 'x'), 0);
  std::vector<int> sizes(65, 0);
  for (Nanoseconds t = 0; random.deadline() != kNever; t += kMillisecond) {
    EXPECT_EQ(random.deadline(), t);
    ++sizes[random.take(t).bytes.size()];
  }
  EXPECT_GT(std::count_if(sizes.begin(), sizes.end(), [](int n) { return n > 0; }), 50);
}

TEST(Faults, NamesAreRead) {
  for (const Fault fault : allFaults()) EXPECT_EQ(faultNamed(faultName(fault)), fault);
  EXPECT_TRUE(mentions(errorOf([] { faultNamed("fire"); }), {"fire", "bits-flipped"}));
}

TEST(Faults, OfMessagesComeAtTheirRateAndAreCounted) {
  for (const Fault fault : {Fault::kBytesLost, Fault::kBitsFlipped, Fault::kCut, Fault::kGarbage,
                            Fault::kWrongSum, Fault::kUnstable}) {
    Stream s(with(fault, 0.1));
    s.host.listen(100 * kSecond);
    EXPECT_NEAR(static_cast<double>(s.device.faults().count(fault)), 400.0, 70.0) << faultName(fault);
    for (const Fault other : allFaults()) {
      if (other == fault) continue;
      EXPECT_EQ(s.device.faults().count(other), 0u);
    }
    std::size_t marked = 0;
    for (const SentScan& scan : s.device.takeSentScans()) marked += scan.fault == faultName(fault);
    const bool is_lost = fault == Fault::kBytesLost || fault == Fault::kCut || fault == Fault::kUnstable;
    EXPECT_NEAR(static_cast<double>(marked), is_lost ? 0.0 : 400.0, is_lost ? 0.0 : 70.0) << faultName(fault);
  }
}

TEST(Faults, SameSeedSameBytes) {
  HokuyoOptions options;
  for (const Fault fault : {Fault::kBytesLost, Fault::kBitsFlipped, Fault::kCut, Fault::kGarbage})
    options.faults.rate(fault) = 0.05;
  const std::string bytes = Stream(options).host.listen(10 * kSecond);
  EXPECT_EQ(bytes, Stream(options).host.listen(10 * kSecond));
  options.seed = 2;
  EXPECT_NE(bytes, Stream(options).host.listen(10 * kSecond));
}

TEST(Faults, WrongSumIsInOneRow) {
  Stream s(with(Fault::kWrongSum, 1.0));
  const std::string bytes = s.host.listen(30 * kMillisecond);
  const std::string row = bytes.substr(bytes.size() - 2 - 31, 31);  // 10 steps and the sum
  EXPECT_NE(scipSum(row.substr(0, 30)), row[30]);
}

TEST(Faults, UnstableGoesOnAndErrorEnds) {
  Stream unstable(with(Fault::kUnstable, 0.0));
  unstable.device.inject(Fault::kUnstable, 500 * kMillisecond);
  const std::string with_gap = unstable.host.listen(kSecond);
  EXPECT_EQ(countOf(with_gap, "MD0540054901000\n0Mm\n\n"), 1u);
  EXPECT_EQ(countOf(with_gap, "99b"), 39u);

  Stream error(with(Fault::kErrorStatus, 0.0));
  error.device.inject(Fault::kErrorStatus, 500 * kMillisecond);
  const std::string ended = error.host.listen(kSecond);
  const std::string last = ended.substr(ended.rfind("MD"));
  EXPECT_GE(std::stoi(last.substr(16, 2)), 50);
  EXPECT_LE(std::stoi(last.substr(16, 2)), 97);
  EXPECT_EQ(error.host.listen(kSecond), "");
}

TEST(Faults, SilenceLosesAndStallDelays) {
  Stream silent(with(Fault::kSilence, 0.0));
  silent.device.inject(Fault::kSilence, 2 * kSecond);
  EXPECT_NEAR(countOf(silent.host.listen(5 * kSecond), "99b"), 4 * 40, 1);

  Stream stalled(with(Fault::kStall, 0.0));
  stalled.device.inject(Fault::kStall, 2 * kSecond);
  stalled.host.listen(2 * kSecond);
  EXPECT_EQ(stalled.host.listen(290 * kMillisecond), "");
  EXPECT_NEAR(countOf(stalled.host.listen(2710 * kMillisecond), "99b"), 3 * 40, 1);
}

TEST(Faults, PulledCable) {
  Stream s(with(Fault::kDisconnect, 0.0));
  s.device.inject(Fault::kDisconnect, kSecond);
  s.host.listen(1100 * kMillisecond);
  EXPECT_EQ(s.host.disconnects, 1);
  EXPECT_FALSE(s.device.linkUp());
  EXPECT_FALSE(s.device.connected());
  s.host.listen(500 * kMillisecond);
  ASSERT_TRUE(s.device.linkUp());
  s.device.connect(s.host.now());
  EXPECT_EQ(countOf(s.host.listen(kSecond), "99b"), 40u) << "the stream outlives the connection";
  EXPECT_EQ(s.device.faults().count(Fault::kDisconnect), 1u);
}

TEST(Faults, PowerFailure) {
  HokuyoOptions options;
  options.boot_delay = 2 * kSecond;
  options.start_ms = 100000;
  Stream s(options);
  s.device.inject(Fault::kReboot, kSecond);
  s.host.listen(2 * kSecond);
  EXPECT_EQ(s.host.disconnects, 1);
  s.device.connect(s.host.now());
  EXPECT_EQ(s.host.ask("QT\n", 500 * kMillisecond), "");
  s.host.listen(kSecond);
  EXPECT_EQ(s.host.ask("QT\n", kSecond), "QT\n00P\n\n");
  EXPECT_EQ(s.device.counter(s.host.now()), 3500u);

  SickOptions sick;
  sick.line.baud_rate = 500000;
  sick.boot_delay = kSecond;
  SickDevice lms(sick, room());
  Host host(lms);
  lms.inject(Fault::kReboot, kSecond);
  host.listen(kSecond + kMillisecond);
  EXPECT_EQ(lms.baudRate(), 9600);
}

TEST(Faults, AtConnect) {
  HokuyoOptions options;
  options.faults.rate(Fault::kAlreadyStreaming) = 1.0;
  options.faults.rate(Fault::kHalfMessage) = 1.0;
  HokuyoDevice device(options, room());
  Host host(device);
  const std::string bytes = host.listen(kSecond);
  EXPECT_GT(bytes.find("MD0000108001000\n99b"), 0u);
  EXPECT_EQ(countOf(bytes, "\nMD0000108001000\n99b"), 40u);

  SickOptions sick;
  sick.line.baud_rate = 500000;
  sick.faults = options.faults;
  SickDevice lms(sick, room());
  Host lms_host(lms);
  EXPECT_NEAR(countOf(lms_host.listen(kSecond), fromHex("02 80 6E 01 B0")), 75.0, 3.0);
  EXPECT_EQ(lms.faults().count(Fault::kHalfMessage), 1u);
}

TEST(Faults, OfSickTelegrams) {
  SickOptions options;
  options.line.baud_rate = 500000;
  options.faults.moments = {
      {Fault::kNak, 0}, {Fault::kCountMismatch, 0}, {Fault::kWrongSum, 300 * kMillisecond}};
  SickDevice device(options, room());
  Host host(device);
  const std::string part = fromHex("02 00 08 00 20 2B 01 00 01 00 79 00 37 97");
  EXPECT_EQ(host.ask(part, 50 * kMillisecond), "\x15");
  host.ask(part, kSecond);
  const auto scans = device.takeSentScans();
  std::size_t damaged = 0;
  for (const SentScan& scan : scans) damaged += !scan.fault.empty();
  EXPECT_EQ(damaged, 2u);
  EXPECT_EQ(scans[0].fault, "count-mismatch");
  for (const Fault fault : {Fault::kNak, Fault::kCountMismatch, Fault::kWrongSum})
    EXPECT_EQ(device.faults().count(fault), 1u);
}

TEST(Faults, SurvivesAllAtOnce) {
  HokuyoOptions hokuyo;
  SickOptions sick;
  sick.line.baud_rate = sick.power_up_baud_rate = 500000;
  sick.boot_delay = hokuyo.boot_delay = 100 * kMillisecond;
  for (DeviceOptions* options : {static_cast<DeviceOptions*>(&hokuyo), static_cast<DeviceOptions*>(&sick)}) {
    for (const Fault fault : allFaults()) options->faults.rate(fault) = 0.05;
    options->faults.silence = options->faults.stall = options->faults.outage = 50 * kMillisecond;
  }
  HokuyoDevice hokuyo_device(hokuyo, room());
  SickDevice sick_device(sick, room());
  const std::vector<std::pair<Device*, std::string>> devices = {
      {&hokuyo_device, "QT\nPP\nTM0\nTM1\nTM2\nMD0000108001000\n"},
      {&sick_device,
       fromHex("02 00 02 00 20 25 35 08 02 00 01 00 31 15 12 02 00 08 00 20 2B 01 00 01 00 79 00 37 97")}};
  for (const auto& [device, commands] : devices) {
    Host host(*device, false);
    for (int i = 0; i < 300; ++i) {
      if (device->linkUp() && !device->connected()) device->connect(host.now());
      host.ask(commands, 600 * kMillisecond);
      if (i % 100 == 99) device->disconnect(host.now());
    }
    EXPECT_GT(device->counts().scans, 100u);
    for (const Fault fault : {Fault::kBytesLost, Fault::kBitsFlipped, Fault::kCut, Fault::kGarbage,
                              Fault::kSilence, Fault::kStall, Fault::kDisconnect, Fault::kReboot})
      EXPECT_GT(device->faults().count(fault), 30u) << faultName(fault);
  }
}

TEST(Devices, TakeAnyInput) {
  HokuyoDevice hokuyo(HokuyoOptions("UTM-30LX-EW"), room());
  SickOptions options;
  options.line.baud_rate = 500000;
  options.mode_delay = options.configure_delay = kMillisecond;
  SickDevice sick(options, room());
  const std::vector<std::string> lines = {
      "MD0000108001000\n", "TM0\n",  "TM2\n", "HE0000108001\n", "QT\n", "BM\n", "RS\n", "%ST\n",
      "SS115200\n",        "DB03\n", "DB10\n"};
  const std::vector<std::string> telegrams = {fromHex("02 00 02 00 20 25 35 08"),
                                              fromHex("02 00 08 00 20 2B 01 00 01 00 B5 00 AF 5A"),
                                              fromHex("02 00 05 00 3B 64 00 19 00 E7 72"),
                                              fromHex("02 00 01 00 74 50 12"),
                                              fromHex("02 00 0A 00 20 00 53 49 43 4B 5F 4C 4D 53 BE C5"),
                                              fromHex("02 00 02 00 20 2A 3A 08")};
  std::mt19937 random(7);
  const std::vector<std::pair<Device*, std::vector<std::string>>> devices = {{&hokuyo, lines},
                                                                             {&sick, telegrams}};
  for (const auto& [device, commands] : devices) {
    Host host(*device);
    for (int i = 0; i < 5000; ++i) {
      std::string bytes = commands[random() % commands.size()];
      if (random() % 2) bytes[random() % bytes.size()] = static_cast<char>(random());
      if (random() % 4 == 0) bytes.resize(random() % bytes.size());
      host.ask(bytes, 10 * kMillisecond);
    }
    EXPECT_GT(device->counts().scans, 20u);
  }
}

}  // namespace
}  // namespace device_emulators
