// SPDX-License-Identifier: BSD-3-Clause
//
// Byte strings that public drivers are known to send and get, and others worked out from the layouts.
#include <gtest/gtest.h>

#include "fake_lms.h"

namespace hokuyo_sick_drivers::lms {
namespace {

struct Vector {
  const char* name;
  const char* telegram;
};
std::ostream& operator<<(std::ostream& out, const Vector& vector) {
  return out << vector.name;
}

const std::vector<Vector> kRequests = {
    {"one scan", "02 00 02 00 30 01 31 18"},
    {"stream all values", "02 00 02 00 20 24 34 08"},
    {"stop", "02 00 02 00 20 25 35 08"},
    {"38400 baud", "02 00 02 00 20 40 50 08"},
    {"19200 baud", "02 00 02 00 20 41 51 08"},
    {"9600 baud", "02 00 02 00 20 42 52 08"},
    {"500000 baud", "02 00 02 00 20 48 58 08"},
    {"installation mode", "02 00 0A 00 20 00 53 49 43 4B 5F 4C 4D 53 BE C5"},
    {"reset", "02 00 01 00 10 34 12"},
    {"status", "02 00 01 00 31 15 12"},
    {"errors", "02 00 01 00 32 16 12"},
    {"type", "02 00 01 00 3A 1E 12"},
    {"configuration", "02 00 01 00 74 50 12"},
    {"variant 180, 1", "02 00 05 00 3B B4 00 64 00 97 49"},
    {"variant 180, 0.5", "02 00 05 00 3B B4 00 32 00 3B 1F"},
    {"variant 100, 0.25", "02 00 05 00 3B 64 00 19 00 E7 72"},
    {"interlaced", "02 00 02 00 20 2A 3A 08"},
    {"intensities 1 to 181", "02 00 08 00 20 2B 01 00 01 00 B5 00 AF 5A"},
    {"intensities 1 to 121", "02 00 08 00 20 2B 01 00 01 00 79 00 37 97"},
    {"intensities 30 to 149", "02 00 08 00 20 2B 01 00 1E 00 95 00 17 06"},
    {"one scan with intensities", "02 00 07 00 75 01 00 01 00 B5 00 34 92"},
    {"write configuration",
     "02 00 23 00 77 00 00 00 00 01 0D 01 00 00 02 02 00 00 00 0A 0A 50 64 00 0A 0A 50 64 00 0A 0A 50 64 00 "
     "00 00 "
     "00 02 00 D9 9B"}};

const char* const kModeChanged = "02 80 03 00 A0 00 10 16 0A";
const char* const kWrongPassword = "02 80 03 00 A0 01 10 14 0B";
const char* const kReset = "02 80 02 00 91 10 79 30";
const char* const kUnknownCommand = "02 80 02 00 92 10 7F 33";
const char* const kVariantAccepted = "02 80 07 00 BB 01 B4 00 32 00 10 03 9D";
const char* const kTypeReply =
    "02 80 16 00 BA 4C 4D 53 32 39 31 3B 53 30 35 3B 56 30 32 2E 33 30 20 20 20 10 99 13";
const char* const kThreeRanges = "02 80 0A 00 B0 03 00 64 00 C8 00 2C 01 10 BE 64";
const char* const kThreeIntensities =
    "02 80 16 00 F5 01 00 01 00 03 00 03 40 E8 03 0A 00 D0 07 14 00 B8 0B 1E 00 10 C7 0F";
const char* const kThreeIntensitiesWithIndex =
    "02 80 17 00 F5 01 00 01 00 03 00 03 40 E8 03 0A 00 D0 07 14 00 B8 0B 1E 00 2A 10 E0 33";
const char* const kConfiguredReply =
    "02 80 25 00 F7 01 00 00 00 00 01 0D 01 00 00 02 02 00 00 00 0A 0A 50 64 00 0A 0A 50 64 00 0A 0A 50 64 "
    "00 00 00 "
    "00 02 00 10 55 5D";
const char* const kConfigurationReply =
    "02 80 24 00 F4 00 00 00 00 01 0D 01 00 00 02 02 00 00 00 0A 0A 50 64 00 0A 0A 50 64 00 0A 0A 50 64 00 "
    "00 00 00 "
    "02 00 10 AC DC";

// All telegrams in a stream.
std::vector<Telegram> parse(Parser& parser, const std::string& bytes) {
  parser.add(bytes);
  std::vector<Telegram> telegrams;
  Telegram telegram;
  for (auto event = parser.next(telegram); event != Parser::Event::kNone; event = parser.next(telegram)) {
    if (event == Parser::Event::kTelegram) telegrams.push_back(telegram);
  }
  return telegrams;
}
Telegram parseOne(const std::string& bytes) {
  Parser parser;
  const auto telegrams = parse(parser, bytes);
  EXPECT_EQ(1u, telegrams.size());
  return telegrams.empty() ? Telegram() : telegrams[0];
}
// As the parser would return it.
Telegram telegramOf(const std::string& code_and_data) {
  return {static_cast<std::uint8_t>(code_and_data[0]), code_and_data.substr(1), 0x10};
}
std::string words(const std::vector<int>& values) {
  std::string bytes;
  for (int v : values) bytes += word(v);
  return bytes;
}

// --------------------------------------------------------------------------------------------------------
// frames

class LmsRequest : public ::testing::TestWithParam<Vector> {};

TEST_P(LmsRequest, IsEncoded) {
  const std::string telegram = bytesOf(GetParam().telegram);
  EXPECT_EQ(telegram, encode(telegram.substr(4, telegram.size() - 6)));
}
INSTANTIATE_TEST_SUITE_P(Requests, LmsRequest, ::testing::ValuesIn(kRequests));

class LmsReply : public ::testing::TestWithParam<const char*> {};

TEST_P(LmsReply, IsParsed) {
  const std::string bytes = bytesOf(GetParam());
  const Telegram telegram = parseOne(bytes);
  EXPECT_EQ(bytes, answer(static_cast<char>(telegram.code) + telegram.data, telegram.status));
  EXPECT_EQ(0x10, telegram.status);
  EXPECT_EQ(bytes.size(), telegram.size());
}
INSTANTIATE_TEST_SUITE_P(Replies, LmsReply,
                         ::testing::Values(kModeChanged, kWrongPassword, kReset, kUnknownCommand,
                                           kVariantAccepted, kTypeReply, kThreeRanges, kThreeIntensities,
                                           kThreeIntensitiesWithIndex, kConfiguredReply,
                                           kConfigurationReply));

TEST(LmsStatusByte, TellsWhatIsTheMatter) {
  EXPECT_EQ(0, Status(0x10).severity);
  EXPECT_FALSE(Status(0x10).pollution || Status(0x10).implausible);
  EXPECT_EQ(3, Status(0x13).severity);
  EXPECT_TRUE(Status(0x90).pollution);
  EXPECT_TRUE(Status(0x50).implausible);
}

// --------------------------------------------------------------------------------------------------------
// streams

TEST(LmsParser, TakesBytesOneByOne) {
  Parser parser;
  Telegram telegram;
  int telegrams = 0, acks = 0;
  for (char c : "\x06" + bytesOf(kThreeRanges) + "\x06" + bytesOf(kModeChanged)) {
    parser.add({&c, 1});
    const auto event = parser.next(telegram);
    telegrams += event == Parser::Event::kTelegram;
    acks += event == Parser::Event::kAck;
  }
  EXPECT_EQ(2, telegrams);
  EXPECT_EQ(2, acks);
  EXPECT_EQ(0u, parser.counts().skipped);
}

TEST(LmsParser, TellsAckFromNak) {
  Parser parser;
  Telegram telegram;
  parser.add("\x15\x06");
  EXPECT_EQ(Parser::Event::kNak, parser.next(telegram));
  EXPECT_EQ(Parser::Event::kAck, parser.next(telegram));
  EXPECT_EQ(Parser::Event::kNone, parser.next(telegram));
}

TEST(LmsParser, DoesNotTakeRubbishForAcknowledgements) {
  Parser parser;
  Telegram telegram;
  parser.add("rubbish\x06\x15");
  EXPECT_EQ(Parser::Event::kNone, parser.next(telegram));
}

// Wherever a telegram is cut off, the reply right behind isn't lost.
TEST(LmsParser, FindsTheReplyBehindAnyCutTelegram) {
  const std::string scan = bytesOf(kThreeIntensities), reply = "\x06" + bytesOf(kModeChanged);
  for (std::size_t cut = 0; cut < scan.size(); ++cut) {
    for (int followers : {0, 3}) {
      Parser parser;
      std::string bytes = scan + scan.substr(0, cut) + reply;
      for (int i = 0; i < followers; ++i) bytes += scan;
      auto telegrams = parse(parser, bytes);
      while (parser.pending() > 0) {  // silence
        parser.endOfTelegram();
        for (const Telegram& t : parse(parser, "")) telegrams.push_back(t);
      }
      ASSERT_EQ(2u + followers, telegrams.size()) << cut;
      EXPECT_EQ(lms::kModeChanged, telegrams[1].code) << cut;
    }
  }
}

TEST(LmsParser, FindsTheNextTelegramBehindALostByte) {
  const std::string scan = bytesOf(kThreeIntensities);
  for (std::size_t lost = 0; lost < scan.size(); ++lost) {
    Parser parser;
    std::string bytes = scan + scan + scan + scan;
    bytes.erase(scan.size() + lost, 1);
    EXPECT_EQ(3u, parse(parser, bytes).size()) << lost;
  }
}

TEST(LmsParser, DropsTelegramsWithAnyBitFlipped) {
  const std::string scan = bytesOf(kThreeIntensities);
  for (std::size_t bit = 0; bit < 8 * scan.size(); ++bit) {
    Parser parser;
    std::string broken = scan;
    broken[bit / 8] = static_cast<char>(broken[bit / 8] ^ 1 << bit % 8);
    auto telegrams = parse(parser, broken + scan);
    while (parser.pending() > 0) {
      parser.endOfTelegram();
      for (const Telegram& t : parse(parser, "")) telegrams.push_back(t);
    }
    ASSERT_EQ(1u, telegrams.size()) << bit;
    EXPECT_EQ(scan, answer(static_cast<char>(telegrams[0].code) + telegrams[0].data)) << bit;
    const auto& counts = parser.counts();
    EXPECT_GT(counts.bad_crc + counts.bad_length + counts.cut + counts.skipped, 0u) << bit;
  }
}

TEST(LmsParser, NeverWaitsForMoreThanATelegram) {
  Parser parser;
  parse(parser, "\x02\x80" + word(65535) + std::string(2000, '\x7F'));
  EXPECT_EQ(0u, parser.pending());
  EXPECT_EQ(1u, parser.counts().bad_length);
  parse(parser, "\x02\x80" + word(812) + std::string(2000, '\x7F'));
  EXPECT_EQ(0u, parser.pending());
  parse(parser, "\x02\x80" + word(1) + std::string(2000, '\x7F'));
  EXPECT_EQ(0u, parser.pending());
}

TEST(LmsParser, TakesTheLongestTelegrams) {
  EXPECT_EQ(802u, parseOne(answer("\xB0" + word(401) + std::string(802, '\1'))).data.size() - 2);
  EXPECT_EQ(813u, answer("\xB0" + word(401) + std::string(803, '\1')).size());
  EXPECT_EQ(803u, parseOne(answer("\xB0" + word(401) + std::string(803, '\1'))).data.size() - 2);
}

// --------------------------------------------------------------------------------------------------------
// replies

TEST(LmsDecode, Replies) {
  EXPECT_EQ(0, decodeModeChange(parseOne(bytesOf(kModeChanged))));
  EXPECT_EQ(1, decodeModeChange(parseOne(bytesOf(kWrongPassword))));
  EXPECT_EQ("LMS291;S05;V02.30", decodeType(parseOne(bytesOf(kTypeReply))));
  EXPECT_EQ(lms::kUnknown, parseOne(bytesOf(kUnknownCommand)).code);
  const VariantReply variant = decodeVariant(parseOne(bytesOf(kVariantAccepted)));
  EXPECT_TRUE(variant.accepted);
  EXPECT_EQ((Variant{180, 50}), variant.variant);
  EXPECT_TRUE(decodeConfigured(parseOne(bytesOf(kConfiguredReply))));
  const std::string configuration = decodeConfiguration(parseOne(bytesOf(kConfigurationReply)));
  EXPECT_EQ(34u, configuration.size());
  EXPECT_EQ(0x0D, configuration[kMeasuringMode]);
  EXPECT_EQ(1, configuration[kUnit]);
  EXPECT_EQ(kHighestAvailability, configuration[kAvailability]);
}

TEST(LmsDecode, OlderConfigurationsAreShorter) {
  EXPECT_EQ(32u, decodeConfiguration(telegramOf("\xF4" + std::string(32, '\0'))).size());
  EXPECT_THROW(decodeConfiguration(telegramOf("\xF4" + std::string(31, '\0'))), DecodeError);
}

TEST(LmsDecode, Status) {
  FakeLms device;
  device.angle = 100;
  device.resolution = 25;
  EXPECT_EQ(160u, device.status().size());
  const DeviceStatus status = decodeStatus(parseOne(device.status()));
  EXPECT_EQ((Variant{100, 25}), status.variant);
  EXPECT_EQ("X02.30", status.software_version);
  EXPECT_THROW(decodeStatus(telegramOf("\xB1" + std::string(100, '\0'))), DecodeError);
}

TEST(LmsDecode, ShortRepliesAreRejected) {
  EXPECT_THROW(decodeModeChange(telegramOf("\xA0")), DecodeError);
  EXPECT_THROW(decodeVariant(telegramOf("\xBB\x01\xB4")), DecodeError);
  EXPECT_THROW(decodeConfigured(telegramOf("\xF7")), DecodeError);
}

// --------------------------------------------------------------------------------------------------------
// scans

TEST(LmsDecode, Ranges) {
  const Values values = decodeRanges(parseOne(bytesOf(kThreeRanges)));
  EXPECT_EQ((std::vector<std::uint16_t>{100, 200, 300}), values.ranges);
  EXPECT_EQ(Unit::kCentimetre, values.unit);
  EXPECT_FALSE(values.partial_scan || values.real_time_index);
}

TEST(LmsDecode, RangesOfAPartialScanWithIndex) {
  const Values values =
      decodeRanges(telegramOf("\xB0" + word(0x4000 | 0x2000 | 3 << 11 | 2) + words({7, 8}) + '\xFE'));
  EXPECT_EQ(Unit::kMillimetre, values.unit);
  EXPECT_EQ(3, values.partial_scan);
  EXPECT_EQ(254, values.real_time_index.value());
  EXPECT_EQ((std::vector<std::uint16_t>{7, 8}), values.ranges);
}

TEST(LmsDecode, RangesMustBeAsManyAsTheySay) {
  const auto defect = [](const std::string& data) {
    try {
      decodeRanges(telegramOf("\xB0" + data));
    } catch (const DecodeError& e) {
      return static_cast<int>(e.defect);
    }
    return -1;
  };
  EXPECT_EQ(static_cast<int>(Defect::kSize), defect(word(3) + words({1, 2})));
  EXPECT_EQ(static_cast<int>(Defect::kSize), defect(word(1) + words({1, 2})));
  EXPECT_EQ(static_cast<int>(Defect::kSize), defect("\1"));
  EXPECT_EQ(static_cast<int>(Defect::kUnit), defect(word(0xC001) + words({1})));
  EXPECT_EQ(-1, defect(word(0x8001) + words({1})));
}

TEST(LmsDecode, Intensities) {
  for (const char* bytes : {kThreeIntensities, kThreeIntensitiesWithIndex}) {
    const auto groups = decodeIntensities(parseOne(bytesOf(bytes)));
    ASSERT_EQ(1u, groups.size());
    EXPECT_EQ((std::vector<std::uint16_t>{1000, 2000, 3000}), groups[0].ranges);
    EXPECT_EQ((std::vector<std::uint16_t>{10, 20, 30}), groups[0].intensities);
    EXPECT_EQ(Unit::kMillimetre, groups[0].unit);
    EXPECT_EQ(1, groups[0].start);
    EXPECT_EQ(3, groups[0].stop);
    EXPECT_EQ(bytes == kThreeIntensitiesWithIndex, groups[0].real_time_index == 0x2A);
  }
}

// Groups of 1, 2, ... values.
std::string intensities(int groups, const std::function<std::string(int)>& behind_group) {
  std::string data = "\xF5" + word(groups);
  for (int g = 0; g < groups; ++g) {
    data += words({10 * g + 1, 10 * g + 1 + g, g + 1});
    for (int i = 0; i <= g; ++i) data += words({100 * g + i, 1000 + i});
    data += behind_group(g);
  }
  return data;
}

TEST(LmsDecode, IntensitiesOfSeveralGroupsWithIndicesWherever) {
  for (int n = 1; n <= 5; ++n) {
    const auto none = [](int) { return std::string(); };
    const auto each = [](int g) { return std::string(1, static_cast<char>(g + 9)); };
    const auto last = [n](int g) { return std::string(g == n - 1, '\x2A'); };
    for (const auto& behind : std::vector<std::function<std::string(int)>>{none, each, last}) {
      const auto groups = decodeIntensities(telegramOf(intensities(n, behind)));
      ASSERT_EQ(static_cast<std::size_t>(n), groups.size());
      for (int g = 0; g < n; ++g) {
        EXPECT_EQ(10 * g + 1, groups[g].start);
        ASSERT_EQ(static_cast<std::size_t>(g + 1), groups[g].ranges.size());
        EXPECT_EQ(100 * g + g, groups[g].ranges.back());
        EXPECT_EQ(1000 + g, groups[g].intensities.back());
      }
    }
    const auto with_indices = decodeIntensities(telegramOf(intensities(n, each)));
    EXPECT_EQ(n + 8, with_indices.back().real_time_index.value());
    EXPECT_EQ(0x2A, decodeIntensities(telegramOf(intensities(n, last)))[0].real_time_index.value());
  }
}

TEST(LmsDecode, OtherSurplusIsRejected) {
  for (int n = 1; n <= 5; ++n) {
    for (int surplus : {2, 3, 4, 6, 7}) {
      if (surplus == n) continue;
      const auto behind = [&](int g) { return std::string(g == n - 1 ? surplus : 0, '\0'); };
      EXPECT_THROW(decodeIntensities(telegramOf(intensities(n, behind))), DecodeError) << n << ' ' << surplus;
    }
    std::string data = intensities(n, [](int) { return std::string(); });
    data.pop_back();
    EXPECT_THROW(decodeIntensities(telegramOf(data)), DecodeError);
  }
}

TEST(LmsDecode, ImpossibleGroupsAreRejected) {
  const auto none = [](int) { return std::string(); };
  EXPECT_THROW(decodeIntensities(telegramOf(intensities(0, none))), DecodeError);
  EXPECT_THROW(decodeIntensities(telegramOf(intensities(6, none))), DecodeError);
  EXPECT_THROW(decodeIntensities(telegramOf("\xF5" + words({1, 1, 4, 3}) + std::string(12, '\0'))),
               DecodeError);
  EXPECT_THROW(decodeIntensities(telegramOf("\xF5" + words({1, 5, 4, 0}))), DecodeError);
  EXPECT_THROW(decodeIntensities(telegramOf("\xF5" + words({1, 1, 1, 0xC001, 5, 6}))), DecodeError);
  EXPECT_THROW(decodeIntensities(telegramOf("\xF5")), DecodeError);
}

TEST(LmsDecode, Reflectivities) {
  const std::string head = "\xC4" + word(3) + words({11, 12, 13});
  const Values all = decodeReflectivities(telegramOf(head + words({3, 1, 3}) + "\x01\x02\xFF"));
  EXPECT_EQ((std::vector<std::uint16_t>{11, 12, 13}), all.ranges);
  EXPECT_EQ((std::vector<std::uint16_t>{1, 2, 255}), all.intensities);
  EXPECT_FALSE(all.real_time_index);
  const Values part = decodeReflectivities(telegramOf(head + words({2, 2, 3}) + "\x01\x02\x2A"));
  EXPECT_EQ((std::vector<std::uint16_t>{12, 13}), part.ranges);
  EXPECT_EQ(0x2A, part.real_time_index.value());
  EXPECT_THROW(decodeReflectivities(telegramOf(head + words({4, 1, 4}) + "\1\1\1\1")), DecodeError);
  EXPECT_THROW(decodeReflectivities(telegramOf(head + words({2, 1, 3}) + "\1\1\1")), DecodeError);
  EXPECT_THROW(decodeReflectivities(telegramOf(head + words({2, 0, 1}) + "\1\1")), DecodeError);
  EXPECT_THROW(decodeReflectivities(telegramOf(head + words({2, 3, 4}) + "\1\1")), DecodeError);
  EXPECT_THROW(decodeReflectivities(telegramOf(head + words({3, 1, 3}) + "\1\1\1\1\1")), DecodeError);
}

}  // namespace
}  // namespace hokuyo_sick_drivers::lms
