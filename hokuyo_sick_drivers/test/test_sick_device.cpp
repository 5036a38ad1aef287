// SPDX-License-Identifier: BSD-3-Clause
#include <gtest/gtest.h>

#include <cmath>
#include <limits>

#include "emulator_host.h"
#include "sick_device.h"

namespace device_emulators {
namespace {

constexpr float kInf = std::numeric_limits<float>::infinity();
constexpr float kNan = std::numeric_limits<float>::quiet_NaN();

const std::string kStream = fromHex("02 00 02 00 20 24 34 08");
const std::string kStop = fromHex("02 00 02 00 20 25 35 08");
const std::string kInstall = fromHex("02 00 0A 00 20 00 53 49 43 4B 5F 4C 4D 53 BE C5");
const std::string kConfigure = fromHex(
    "02 00 23 00 77 00 00 00 00 01 0D 01 00 00 02 02 00 00 00 0A 0A 50 64 00 0A 0A 50 64 00 0A 0A 50 64 00 "
    "00 "
    "00 00 02 00 D9 9B");
const std::string kStreamIntensities = fromHex("02 00 08 00 20 2B 01 00 01 00 B5 00 AF 5A");
const std::string kStatus = fromHex("02 00 01 00 31 15 12");
const std::string kModeChanged = "06 02 80 03 00 A0 00 10 16 0A";

// A host's telegram, the length and the CRC of which aren't in the document.
std::string command(const std::string& payload) {
  std::string bytes("\x02\x00", 2);
  appendWord(bytes, static_cast<unsigned>(payload.size()));
  bytes += payload;
  appendWord(bytes, lmsCrc(bytes));
  return bytes;
}

// (1000, 10) (2000, 20) (3000, 30) mm at the right end, then 4 m.
std::shared_ptr<FixedSource> exampleSource() {
  Scan scan;
  scan.angle_min = -M_PI / 2;
  scan.angle_increment = M_PI / 720;  // 0.25 degrees
  scan.ranges.assign(1, std::vector<float>(721, 4.0f));
  scan.intensities.assign(1, std::vector<float>(721, 100.0f));
  for (int i = 0; i < 3; ++i) {
    scan.ranges[0][4 * i] = 1.0f + static_cast<float>(i);
    scan.intensities[0][4 * i] = 10.0f + 10.0f * static_cast<float>(i);
  }
  scan.ranges[0][40] = kInf;
  scan.ranges[0][44] = kNan;
  return std::make_shared<FixedSource>(scan);
}

struct Emulation {
  explicit Emulation(const SickOptions& options = SickOptions())
      : device(options, exampleSource()), host(device) {}
  std::string ask(const std::string& bytes, Nanoseconds duration = kSecond) {
    return toHex(host.ask(bytes, duration));
  }
  void configure() {
    ask(kInstall);
    ask(kConfigure);
    ask(kStop);
  }
  SickDevice device;
  Host host;
};

SickOptions fast() {
  SickOptions options;
  options.line.baud_rate = 500000;
  return options;
}

TEST(LmsTelegram, CrcsOfTheDocument) {
  for (const char* text : {"02 00 02 00 30 01 31 18",
                           "02 00 02 00 20 24 34 08",
                           "02 00 02 00 20 25 35 08",
                           "02 00 02 00 20 40 50 08",
                           "02 00 02 00 20 41 51 08",
                           "02 00 02 00 20 42 52 08",
                           "02 00 02 00 20 48 58 08",
                           "02 00 0A 00 20 00 53 49 43 4B 5F 4C 4D 53 BE C5",
                           "02 80 03 00 A0 00 10 16 0A",
                           "02 00 01 00 10 34 12",
                           "02 00 01 00 31 15 12",
                           "02 00 01 00 32 16 12",
                           "02 00 01 00 3A 1E 12",
                           "02 00 01 00 74 50 12",
                           "02 00 05 00 3B B4 00 64 00 97 49",
                           "02 00 05 00 3B B4 00 32 00 3B 1F",
                           "02 00 05 00 3B 64 00 19 00 E7 72",
                           "02 80 07 00 BB 01 B4 00 32 00 10 03 9D",
                           "02 00 02 00 20 2A 3A 08",
                           "02 00 08 00 20 2B 01 00 01 00 B5 00 AF 5A",
                           "02 00 08 00 20 2B 01 00 01 00 79 00 37 97",
                           "02 00 08 00 20 2B 01 00 1E 00 95 00 17 06",
                           "02 00 07 00 75 01 00 01 00 B5 00 34 92",
                           "02 80 03 00 A0 01 10 14 0B",
                           "02 80 02 00 91 10 79 30",
                           "02 80 02 00 92 10 7F 33",
                           "02 80 0A 00 B0 03 00 64 00 C8 00 2C 01 10 BE 64"}) {
    const std::string bytes = fromHex(text);
    EXPECT_EQ(lmsCrc(bytes.substr(0, bytes.size() - 2)), wordAt(bytes, bytes.size() - 2)) << text;
    LmsReader reader(kSecond);
    const auto telegrams = reader.read(bytes, 0);
    if (bytes[1] == 0) {
      ASSERT_EQ(telegrams.size(), 1u) << text;
      EXPECT_TRUE(telegrams[0].good) << text;
    }
  }
}

TEST(LmsTelegram, ScansOfTheDocument) {
  SickConfiguration configuration;
  SentScan scan;
  scan.ranges = {100, 200, 300};
  EXPECT_EQ(toHex(lmsTelegram(encodeRanges("\xb0", scan, configuration, -1, 0), 0x10)),
            "02 80 0A 00 B0 03 00 64 00 C8 00 2C 01 10 BE 64");

  std::string mm = configuration.bytes();
  mm[5] = 0x0d;
  mm[6] = 0x01;
  ASSERT_TRUE(configuration.write(mm));
  const SentScan measured =
      measure(exampleSource()->at(0).get(), {180, 100}, configuration, SickCoding(), 1, 3);
  EXPECT_EQ(toHex(lmsTelegram(encodeIntensities({measured}, configuration, {}, 0, false), 0x10)),
            "02 80 16 00 F5 01 00 01 00 03 00 03 40 E8 03 0A 00 D0 07 14 00 B8 0B 1E 00 10 C7 0F");
  mm[4] = 0x03;
  ASSERT_TRUE(configuration.write(mm));
  EXPECT_EQ(toHex(lmsTelegram(encodeIntensities({measured}, configuration, {}, 0x2a, false), 0x10)),
            "02 80 17 00 F5 01 00 01 00 03 00 03 40 E8 03 0A 00 D0 07 14 00 B8 0B 1E 00 2A 10 E0 33");
}

TEST(LmsTelegram, ReaderDropsWhatIsLateOrNoTelegram) {
  LmsReader reader(14 * kMillisecond);
  EXPECT_TRUE(reader.read(kStop.substr(0, 5), 0).empty());
  EXPECT_EQ(reader.read(kStop.substr(5), 10 * kMillisecond).size(), 1u);
  EXPECT_TRUE(reader.read(kStop.substr(0, 5), 20 * kMillisecond).empty());
  EXPECT_TRUE(reader.read(kStop.substr(5), 40 * kMillisecond).empty());
  const auto telegrams = reader.read("xyz\x02\x02" + kStop + kStatus, 60 * kMillisecond);
  ASSERT_EQ(telegrams.size(), 2u);
  EXPECT_EQ(telegrams[1].payload, "1");
  EXPECT_TRUE(telegrams[0].good && telegrams[1].good);
  const auto bad = reader.read(fromHex("02 00 FF FF 01"), 80 * kMillisecond);
  ASSERT_EQ(bad.size(), 1u);
  EXPECT_FALSE(bad[0].good);
}

TEST(SickDevice, AnswersOfTheDocument) {
  Emulation s;
  EXPECT_EQ(s.ask(kStop), kModeChanged);
  EXPECT_EQ(s.ask(fromHex("02 00 01 00 3A 1E 12")),
            "06 02 80 16 00 BA 4C 4D 53 32 39 31 3B 53 30 35 3B 56 30 32 2E 33 30 20 20 20 10 99 13");
  EXPECT_EQ(s.ask(fromHex("02 00 05 00 3B B4 00 32 00 3B 1F")), "06 02 80 07 00 BB 01 B4 00 32 00 10 03 9D");
  EXPECT_EQ(s.ask(command("\x66")), "06 02 80 02 00 92 10 7F 33");
  EXPECT_EQ(s.ask(command(std::string("\x20\x00SICK_LMX", 10))), "06 02 80 03 00 A0 01 10 14 0B");
  EXPECT_EQ(s.ask(kInstall), kModeChanged);
  EXPECT_EQ(
      s.ask(kConfigure),
      "06 02 80 25 00 F7 01 00 00 00 00 01 0D 01 00 00 02 02 00 00 00 0A 0A 50 64 00 0A 0A 50 64 00 0A 0A 50 "
      "64 00 00 00 00 02 00 10 55 5D");
  EXPECT_EQ(s.ask(kStop), kModeChanged);
  EXPECT_EQ(
      s.ask(fromHex("02 00 01 00 74 50 12")),
      "06 02 80 24 00 F4 00 00 00 00 01 0D 01 00 00 02 02 00 00 00 0A 0A 50 64 00 0A 0A 50 64 00 0A 0A 50 64 "
      "00 00 00 00 02 00 10 AC DC");
  EXPECT_EQ(s.device.configurationWrites(), 1u);
  EXPECT_EQ(s.ask(fromHex("02 00 01 00 32 16 12")), "06 " + toHex(lmsTelegram("\xb2", 0x10)));
}

TEST(SickDevice, RefusesConfigurationOutsideOfInstallationMode) {
  for (const bool by_mode : {false, true}) {
    SickOptions options;
    options.refuse_by_mode = by_mode;
    Emulation s(options);
    const std::string refused = s.ask(kConfigure);
    EXPECT_EQ(refused.find(by_mode ? "06 02 80 03 00 A0 02" : "06 02 80 25 00 F7 00"), 0u) << refused;
    EXPECT_EQ(s.device.configurationWrites(), 0u);
  }
}

TEST(SickDevice, OldConfigurationHas32Bytes) {
  SickOptions options;
  options.configuration_size = 32;
  Emulation s(options);
  EXPECT_EQ(s.host.ask(fromHex("02 00 01 00 74 50 12"), kSecond).size(), 1 + 40u);
  s.ask(kInstall);
  EXPECT_EQ(s.ask(kConfigure).find("06 02 80 23 00 F7 00"), 0u);
  EXPECT_EQ(s.ask(command("\x77" + s.device.configuration().bytes())).find("06 02 80 23 00 F7 01"), 0u);
}

TEST(SickDevice, StatusTelegram) {
  Emulation s(fast());
  const std::string reply = s.host.ask(kStatus, kSecond);
  ASSERT_EQ(reply.size(), 1 + 160u);
  const std::string payload = reply.substr(5);
  EXPECT_EQ(payload[8], 0x25);
  EXPECT_EQ(wordAt(payload, 107), 180u);
  EXPECT_EQ(wordAt(payload, 109), 100u);
  EXPECT_EQ(static_cast<unsigned char>(payload[116]), 0x01);
}

TEST(SickDevice, NakForDamagedCommands) {
  Emulation s;
  std::string damaged = kStatus;
  damaged.back() ^= 1;
  EXPECT_EQ(s.ask(damaged), "15");
}

TEST(SickDevice, DelaysOfReplies) {
  SickOptions options;
  options.ack_delay = 60 * kMillisecond;
  options.mode_delay = 3 * kSecond;
  Emulation s(options);
  s.ask(kStop, 4 * kSecond);
  ASSERT_GE(s.host.writes.size(), 2u);
  EXPECT_EQ(s.host.writes[0].bytes, "\x06");
  EXPECT_NEAR(s.host.writes[0].time * 1e-9, 0.060 + 10.0 / 9600, 1e-4);
  EXPECT_NEAR(s.host.writes.back().time * 1e-9, 3.060 + 9 * 10.0 / 9600, 1e-4);
}

TEST(SickDevice, Variants) {
  Emulation s;
  EXPECT_NE(s.ask(fromHex("02 00 05 00 3B 64 00 19 00 E7 72")).find("BB 01 64 00 19 00"), std::string::npos);
  EXPECT_EQ(s.device.variant().values(), 401);
  EXPECT_EQ(s.ask(fromHex("02 00 02 00 30 01 31 18")).substr(0, 24), "06 02 80 26 03 B0 91 01 ");
  EXPECT_NE(s.ask(command(fromHex("3B B4 00 19 00"))).find("BB 00 64 00 19 00"), std::string::npos);
  EXPECT_NE(s.ask(fromHex("02 00 05 00 3B B4 00 64 00 97 49")).find("BB 01 B4 00 64 00"), std::string::npos);

  const SickOptions s14("LMS291-S14");
  Emulation fixed(s14);
  EXPECT_NE(fixed.ask(fromHex("02 00 05 00 3B B4 00 64 00 97 49")).find("BB 00 5A 00 32 00"),
            std::string::npos);
}

TEST(SickDevice, StreamsAt75HzWith500000Baud) {
  Emulation s(fast());
  EXPECT_EQ(s.ask(kStream, 110 * kMillisecond).substr(0, kModeChanged.size()), kModeChanged);
  s.host.listen(10 * kSecond);
  EXPECT_NEAR(static_cast<double>(s.device.counts().scans), 75 * 10, 2);
  EXPECT_EQ(s.device.counts().skipped, 0u);
  s.device.takeSentScans();
  s.host.listen(kSecond);
  const auto scans = s.device.takeSentScans();
  for (std::size_t i = 1; i < scans.size(); ++i) {
    EXPECT_EQ(scans[i].device_stamp, scans[i - 1].device_stamp + 1);
    EXPECT_NEAR(scans[i].start - scans[i - 1].start, kSecond / 75.0, 1.0);
  }
  EXPECT_EQ(scans[0].ranges[0], 100u);
  EXPECT_EQ(scans[0].ranges[10], 0x1ff7u);
  EXPECT_EQ(scans[0].ranges[11], 0x1fffu);
}

TEST(SickDevice, PacedAt38400BaudAndSkippingTurns) {
  SickOptions options;
  options.line.baud_rate = 38400;
  Emulation s(options);
  s.ask(kStream);
  s.host.writes.clear();
  const std::string stream = s.host.listen(100 * kSecond);
  // 372 bytes take 96.9 ms, so that every eighth turn of 13.3 ms is sent.
  EXPECT_NEAR(static_cast<double>(stream.size()), 100 * 372 * 75.0 / 8, 2 * 372);
  double busy = 0.0;
  for (const auto& write : s.host.writes) busy += static_cast<double>(write.bytes.size()) * 10 / 38400;
  EXPECT_LT(busy, 100.0);
  for (const auto& write : s.host.writes) ASSERT_LE(write.bytes.size(), 3u);
}

// CARMEN's driver gives up where nothing comes for 250 ms, and writes the configuration before each run.
TEST(SickDevice, AnswersBeforeCarmenGivesUp) {
  Emulation s;
  for (const std::string& asked :
       {kStop, fromHex("02 00 01 00 74 50 12"), kInstall, kConfigure, kStop, kStream}) {
    s.host.writes.clear();
    const Nanoseconds sent = s.host.now();
    s.host.ask(asked, 500 * kMillisecond);
    ASSERT_GE(s.host.writes.size(), 2u);
    EXPECT_LT(s.host.writes[0].time - sent, 250 * kMillisecond) << toHex(asked);
    EXPECT_LT(s.host.writes[1].time - s.host.writes[0].time, 250 * kMillisecond) << toHex(asked);
  }
}

TEST(SickDevice, MeansAndSubranges) {
  Emulation s(fast());
  s.ask(command(fromHex("20 26 05")), 110 * kMillisecond);  // means of 5 scans
  const std::string means = s.host.listen(kSecond);
  const auto scans = s.device.takeSentScans();
  EXPECT_NEAR(static_cast<double>(scans.size()), 15.0, 1.0);
  EXPECT_EQ(scans[1].device_stamp, scans[0].device_stamp + 5);
  EXPECT_EQ(scans[0].ranges.size(), 181u);
  EXPECT_EQ(scans[0].ranges[0], 100u);
  EXPECT_EQ(scans[0].ranges[11], 0x1fffu);
  EXPECT_NE(means.find(fromHex("B6 05 B5 00 64 00")), std::string::npos);

  s.ask(command(fromHex("20 27 0A 00 0C 00")), 110 * kMillisecond);
  EXPECT_NE(s.host.listen(kSecond).find(fromHex("B7 0A 00 0C 00 03 00")), std::string::npos);
  EXPECT_EQ(s.device.takeSentScans().back().ranges.size(), 3u);
  s.ask(command(fromHex("20 28 03 01 00 02 00")), 110 * kMillisecond);
  EXPECT_NE(s.host.listen(kSecond).find(fromHex("BF 03 01 00 02 00 02 00 64 00")), std::string::npos);

  s.ask(kStop);
  EXPECT_NE(s.ask(command(fromHex("36 05"))).find("B6 05 B5 00 64 00"), std::string::npos);
  EXPECT_NE(s.ask(command(fromHex("37 01 00 02 00"))).find("B7 01 00 02 00 02 00 64 00"), std::string::npos);
  EXPECT_NE(s.ask(command(fromHex("3F 02 01 00 02 00"))).find("BF 02 01 00 02 00 02 00 64 00"),
            std::string::npos);
  for (const char* wrong :
       {"36 01", "36 FB", "37 01 00 B6 00", "37 02 00 01 00", "3F 02 01 00", "20 26", "20 26 01"})
    EXPECT_NE(s.ask(command(fromHex(wrong))).find("92 10"), std::string::npos) << wrong;
}

TEST(SickDevice, MeansAreThoseOfReadings) {
  SentScan first, second;
  first.ranges = {100, 200, 0x1fff, 0x1fff};
  second.ranges = {103, 0x1ff7, 300, 0x1ffe};
  EXPECT_EQ(meanOf({first, second}, SickConfiguration()).ranges,
            (std::vector<std::uint32_t>{102, 200, 300, 0x1ffe}));
}

TEST(SickDevice, IntensitiesEverySecondTurn) {
  Emulation s(fast());
  s.configure();
  s.ask(kStreamIntensities, 130 * kMillisecond);
  s.host.listen(10 * kSecond);
  const auto scans = s.device.takeSentScans();
  // 740 bytes take 14.8 ms, longer than a turn.
  EXPECT_NEAR(static_cast<double>(scans.size()), 37.5 * 10.0, 2.0);
  EXPECT_EQ(scans[1].device_stamp, scans[0].device_stamp + 2);
  EXPECT_EQ(scans[0].ranges.size(), 181u);
  EXPECT_EQ(scans[0].ranges[1], 2000u);
  EXPECT_EQ(scans[0].intensities[2], 30u);
  EXPECT_DOUBLE_EQ(scans[0].resolution, 0.001);
}

TEST(SickDevice, IntensitiesOfPartsFitEachTurn) {
  Emulation s(fast());
  s.configure();
  s.ask(fromHex("02 00 08 00 20 2B 01 00 01 00 79 00 37 97"), 130 * kMillisecond);
  s.host.listen(10 * kSecond);
  EXPECT_NEAR(static_cast<double>(s.device.counts().scans), 75 * 10, 12);
  s.ask(fromHex("02 00 08 00 20 2B 01 00 1E 00 95 00 17 06"));
  s.device.takeSentScans();
  s.host.listen(kSecond);
  EXPECT_EQ(s.device.takeSentScans().back().first_step, 30);
}

TEST(SickDevice, TelegramOfPolledIntensities) {
  Emulation s(fast());
  s.configure();
  const std::string reply = s.host.ask(fromHex("02 00 07 00 75 01 00 01 00 B5 00 34 92"), kSecond);
  ASSERT_EQ(reply.size(), 1 + 740u);
  EXPECT_EQ(toHex(reply.substr(1, 25)),
            "02 80 DE 02 F5 01 00 01 00 B5 00 B5 40 E8 03 0A 00 D0 07 14 00 B8 0B 1E 00");
}

TEST(SickDevice, GroupsAndIndices) {
  for (const bool at_end : {false, true}) {
    SickOptions options = fast();
    options.coding.index_at_end = at_end;
    options.coding.flags = 5;
    Emulation s(options);
    s.ask(kInstall);
    std::string block = s.device.configuration().bytes();
    block[4] = 0x02;
    block[5] = 0x0d;
    s.ask(command("\x77" + block));
    s.ask(kStop);
    std::string five("\x20\x2b\x05\x00", 4);
    for (unsigned i = 0; i < 5; ++i) {
      appendWord(five, 1 + 10 * i);
      appendWord(five, 2 + 10 * i);
    }
    s.ask(command(five), 0);
    s.host.listen(110 * kMillisecond);
    s.device.takeSentScans();
    const std::size_t size = 4 + 1 + 2 + 5 * (6 + 8) + (at_end ? 1 : 5) + 1 + 2;
    const std::string stream = s.host.listen(kSecond);
    const std::string first = stream.substr(stream.find("\x02\x80"), size);
    EXPECT_EQ(lmsCrc(first.substr(0, size - 2)), wordAt(first, size - 2));
    EXPECT_EQ(wordAt(first, 5), 5u);
    EXPECT_EQ(wordAt(first, 13), 100u | 5u << 13);
    const auto index = static_cast<unsigned char>(s.device.takeSentScans()[0].device_stamp);
    EXPECT_NEAR(static_cast<unsigned char>(first[at_end ? size - 4 : 21]), index, 1);
    s.ask(kStop);
  }
}

TEST(SickDevice, RefusesGroupsThatDontFit) {
  Emulation s(fast());
  const std::string refused = "06 02 80 02 00 92 10 7F 33";
  EXPECT_EQ(s.ask(command(fromHex("20 2B 01 00 01 00 B6 00"))), refused);
  EXPECT_EQ(s.ask(command(fromHex("20 2B 00 00"))), refused);
  EXPECT_EQ(s.ask(command(fromHex("20 2B 01 00 00 00 B5 00"))), refused);
  EXPECT_EQ(s.ask(command(fromHex("20 2B 02 00 01 00 02 00"))), refused);
  EXPECT_EQ(s.ask(command(fromHex("20 50 01 00 B5 00"))), refused);
  s.ask(fromHex("02 00 05 00 3B B4 00 32 00 3B 1F"));
  EXPECT_EQ(s.ask(command(fromHex("20 2B 01 00 01 00 69 01"))), refused);
  EXPECT_EQ(s.ask(command(fromHex("20 2B 01 00 01 00 C7 00"))).substr(0, kModeChanged.size()), kModeChanged);
}

TEST(SickDevice, WithoutTheModeThereAreNoIntensities) {
  Emulation s(fast());
  s.ask(kStreamIntensities);
  const auto scans = s.device.takeSentScans();
  ASSERT_FALSE(scans.empty());
  EXPECT_EQ(scans[0].intensities, std::vector<std::uint32_t>(181, 0));
}

TEST(SickDevice, Interlaced) {
  Emulation s(fast());
  s.ask(fromHex("02 00 05 00 3B 64 00 19 00 E7 72"));
  s.ask(fromHex("02 00 02 00 20 2A 3A 08"), 120 * kMillisecond);
  const std::string stream = s.host.listen(kSecond);
  const auto scans = s.device.takeSentScans();
  ASSERT_GT(scans.size(), 70u);
  for (const SentScan& scan : scans) {
    const bool whole = scan.device_stamp % 4 == 0;
    EXPECT_EQ(scan.ranges.size(), whole ? 181u : 180u);
    const std::string bytes = encodeRanges("\xb0", scan, s.device.configuration(), scan.device_stamp % 4, 0);
    EXPECT_EQ(wordAt(bytes, 1), scan.ranges.size() | 0x2000u | (scan.device_stamp % 4) << 11);
    EXPECT_NE(stream.find(bytes), std::string::npos);
  }
}

TEST(SickDevice, ReflectivitiesOfTheFastType) {
  SickOptions options("LMS291-S14");
  options.line.baud_rate = 500000;
  Emulation s(options);
  s.ask(command(fromHex("20 50 01 00 B5 00")), 120 * kMillisecond);
  s.host.listen(10 * kSecond);
  EXPECT_NEAR(static_cast<double>(s.device.counts().scans), 75 * 10, 12);
  s.ask(kStop);
  const std::string reply = s.host.ask(command(fromHex("44 01 00 B5 00")), kSecond);
  EXPECT_EQ(reply.size(), 1 + 4 + 1 + 2 + 2 * 181 + 6 + 181 + 1 + 2u);
}

TEST(SickDevice, CommandCutsTheTelegramInProgress) {
  SickOptions options;
  options.line.baud_rate = 38400;
  Emulation s(options);
  s.ask(kStream, 400 * kMillisecond);
  s.host.listen(17 * kMillisecond);
  s.device.takeSentScans();
  const std::string reply = toHex(s.host.ask(kStop, kSecond));
  ASSERT_GE(reply.size(), kModeChanged.size());
  EXPECT_EQ(reply.substr(reply.size() - kModeChanged.size()), kModeChanged);
  EXPECT_LT(reply.size(), kModeChanged.size() + 3 * 25);
  EXPECT_TRUE(s.device.takeSentScans().empty());
  s.ask(kStream, 400 * kMillisecond);
  s.ask(kStatus);
  EXPECT_FALSE(s.device.takeSentScans().empty()) << "the stream goes on after another command";
}

TEST(SickDevice, ChangesTheRateAfterTheReply) {
  Emulation s;
  s.device.setHostBaudRate(9600);
  EXPECT_EQ(s.ask(fromHex("02 00 02 00 20 48 58 08")), kModeChanged);
  EXPECT_EQ(s.host.baud_rates, std::vector<int>{500000});
  EXPECT_EQ(s.ask(kStatus), "") << "a host at another rate isn't understood";
  s.device.setHostBaudRate(500000);
  EXPECT_EQ(s.host.ask(kStatus, kSecond).size(), 161u);
  s.ask(kStream);
  s.device.setHostBaudRate(38400);
  const std::string garbled = s.host.listen(kSecond);
  EXPECT_GT(garbled.size(), 1000u);
  EXPECT_LT(countOf(garbled, fromHex("02 80 6E 01 B0")), 2u);
}

TEST(SickDevice, ResetGoesBackTo9600AndTellsWhenItHasBooted) {
  Emulation s(fast());
  s.device.setHostBaudRate(500000);
  s.ask(kStream);
  s.configure();
  const std::string reply = s.ask(fromHex("02 00 01 00 10 34 12"));
  EXPECT_EQ(reply.substr(0, 29), "06 02 80 02 00 91 10 79 30");
  EXPECT_EQ(s.device.baudRate(), 9600);
  s.device.setHostBaudRate(9600);
  EXPECT_EQ(s.ask(kStatus, 28 * kSecond), "");
  const std::string boot = s.host.listen(2 * kSecond);
  EXPECT_EQ(boot, lmsTelegram("\x90LMS291;S05;V02.30   ", 0x10));
  EXPECT_EQ(s.device.mode(), 0x25u);
  EXPECT_EQ(s.device.configuration().mode(), 0x0du) << "the EEPROM is kept";
}

TEST(SickDevice, MuteWhileBootingAtTheStart) {
  SickOptions options;
  options.boot_delay = 5 * kSecond;
  options.power_up_at_start = true;
  Emulation s(options);
  EXPECT_EQ(s.ask(kStatus, 4 * kSecond), "");
  EXPECT_EQ(s.host.listen(2 * kSecond).substr(4, 1), "\x90");
}

TEST(SickDevice, OverflowCodesByWidth) {
  const auto scan = exampleSource()->at(0);
  SickConfiguration configuration;
  std::string block = configuration.bytes();
  const std::vector<std::pair<char, std::uint32_t>> modes = {
      {0x00, 0x1fff}, {0x03, 0x3fff}, {0x05, 0x7fff}, {0x0f, 0xffff}, {0x0d, 0x1fff}};
  for (const auto& [mode, largest] : modes) {
    block[5] = mode;
    ASSERT_TRUE(configuration.write(block));
    const SentScan sent = measure(scan.get(), {180, 100}, configuration, {}, 11, 12);
    EXPECT_EQ(sent.ranges, (std::vector<std::uint32_t>{largest - 8, largest}));
  }
  SickCoding wide;
  wide.wide_codes = true;
  EXPECT_EQ(measure(scan.get(), {180, 100}, configuration, wide, 11, 11).ranges[0], 0xfff7u);
  block[5] = 0x3f;
  ASSERT_TRUE(configuration.write(block));
  EXPECT_EQ(measure(scan.get(), {180, 100}, configuration, {}, 2, 2).ranges[0], 20u);
  block[5] = 0x07;
  EXPECT_FALSE(configuration.write(block));
}

}  // namespace
}  // namespace device_emulators
