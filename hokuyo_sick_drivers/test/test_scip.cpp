// SPDX-License-Identifier: BSD-3-Clause
//
// The byte strings are from recordings of real devices and from Hokuyo's specification of SCIP 2.
#include <gtest/gtest.h>

#include <cmath>
#include <string>
#include <vector>

#include "hokuyo_sick_drivers/hokuyo_scan.h"
#include "hokuyo_sick_drivers/scip.h"

namespace hokuyo_sick_drivers {
namespace {

const std::string kExample = "ME0540054201001\n00P\n\nME0540054201000\n99b\nBI9YM\n0?X0LA0O@04\\001000T\n\n";

HokuyoGeometry utm30() {
  HokuyoGeometry geometry;
  geometry.min_distance = 23;
  geometry.max_distance = 60000;
  geometry.resolution = 1440;
  geometry.last_step = 1080;
  geometry.front_step = 540;
  geometry.speed = 2400;
  return geometry;
}

std::vector<std::string_view> split(std::string_view text) {
  std::vector<std::string_view> lines;
  for (std::size_t end = text.find('\n'); end != std::string_view::npos; end = text.find('\n')) {
    lines.push_back(text.substr(0, end));
    text.remove_prefix(end + 1);
  }
  return lines;
}

TEST(ScipTest, sums) {
  for (const char* line :
       {"00P",       "01Q", "02R", "03S", "04T", "05U", "06V", "07W",   "10Q",
        "21S",       "50U", "97`", "98a", "99b", "0Aa", "0Bb", "0Cc",   "0Dd",
        "0Ee",       "0Ff", "0Gg", "0Hh", "0Ii", "0Ll", "0Mm", "BI9YM", "0?X0LA0O@04\\001000T",
        "0?X0O@7D`Q"}) {
    EXPECT_TRUE(scip::checked(line)) << line;
  }
  EXPECT_FALSE(scip::checked("00Q"));
  EXPECT_FALSE(scip::checked(""));
}

TEST(ScipTest, numbers) {
  EXPECT_EQ(scip::decode("CB"), 1234u);
  EXPECT_EQ(scip::decode("1Dh"), 5432u);
  EXPECT_EQ(scip::decode("00G"), 23u);
  EXPECT_EQ(scip::decode("00F"), 22u);
  EXPECT_EQ(scip::decode(">YP"), 60000u);
  EXPECT_EQ(scip::decode("000"), 0u);
  EXPECT_EQ(scip::decode("001"), 1u);
  EXPECT_EQ(scip::decode("m2@0"), 16000000u);
  EXPECT_EQ(scip::decode("oooo"), 16777215u);
  EXPECT_EQ(scip::decode("BI9Y"), 4821609u);
  EXPECT_EQ(scip::decode("<Sfk"), 3292603u);
  EXPECT_FALSE(scip::decode("0/0"));
  EXPECT_FALSE(scip::decode("0p0"));
}

TEST(ScipTest, keysAndValues) {
  const auto reply = scip::parseKeyValues(
      split("DMIN:23;7\nDMAX:60000;J\nARES:1440;^\nAMIN:0;?\nAMAX:1080;Z\nAFRT:540;0\nSCAN:2400;U\n"
            "PROT:SCIP 2.0;N\nVEND:Hokuyo Automatic Co.,Ltd.;[\nLASR:ON;9\n"
            "SCSP:Initial(2400[rpm])<-Default setting by user;1\nMESM:CLASSIC;^\nSBPS:USB Full Speed;P\n"
            "TIME:4991D0;d\nSTAT:Sensor works well.;8\n"),
      0);
  EXPECT_EQ(reply.bad_sums, 0);
  EXPECT_EQ(reply.bad_lines, 0);
  EXPECT_EQ(reply.values.size(), 15u);
  EXPECT_EQ(reply.values.at("DMAX"), "60000");
  EXPECT_EQ(reply.values.at("STAT"), "Sensor works well.");
  const HokuyoGeometry geometry = HokuyoGeometry::parse(reply);
  EXPECT_EQ(geometry.front_step, 540);
  EXPECT_EQ(geometry.period(), 25 * kMillisecond);
  EXPECT_NEAR(geometry.angle(0), -0.75 * M_PI, 1e-12);
}

TEST(ScipTest, sumsWithTheSemicolonOrWithoutTheComment) {
  const auto line = [](const std::string& text, const std::string& summed) {
    return text + scip::sum(summed) + "\n";
  };
  const std::string with = line("DMIN:23;", "DMIN:23;"), without_comment = line("A:B<-C;", "A:B");
  EXPECT_EQ(scip::parseKeyValues(split(with + without_comment), 0).bad_sums, 0);
  const auto semicolon = scip::parseKeyValues(split("SERI:00902676;;\n"), 0);
  EXPECT_EQ(semicolon.bad_sums + semicolon.bad_lines, 0) << "a sum may be a semicolon";
  EXPECT_EQ(semicolon.values.at("SERI"), "00902676");
  const auto bad = scip::parseKeyValues(split("DMIN:24;7\nnothing\n:\n;\n:;\nKEY:;\nKEY:\xbb;0\n"), 0);
  EXPECT_EQ(bad.bad_sums, 1);
  EXPECT_EQ(bad.values.at("DMIN"), "24");
  EXPECT_EQ(bad.bad_lines, 6);
  EXPECT_THROW(HokuyoGeometry::parse(bad), std::runtime_error);
}

TEST(ScipTest, geometryThatMakesNoSense) {
  scip::KeyValues reply;
  reply.values = {{"DMIN", "20"},  {"DMAX", "5600"}, {"ARES", "1024"}, {"AMIN", "44"},
                  {"AMAX", "725"}, {"AFRT", "384"},  {"SCAN", "600"}};
  EXPECT_NO_THROW(HokuyoGeometry::parse(reply));
  for (const auto& [key, value] : std::map<std::string, std::string>{
           {"DMAX", "19"}, {"ARES", "0"}, {"AMAX", "43"}, {"AMIN", "-1"}, {"SCAN", "0"}, {"AFRT", "3x"}}) {
    scip::KeyValues other = reply;
    other.values[key] = value;
    EXPECT_THROW(HokuyoGeometry::parse(other), std::runtime_error) << key;
  }
  reply.values.erase("SCAN");
  EXPECT_THROW(HokuyoGeometry::parse(reply), std::runtime_error);
}

// ---- messages

TEST(MessageReaderTest, cutsTheStreamWhereverItIsCut) {
  for (std::size_t piece = 1; piece <= kExample.size(); ++piece) {
    scip::MessageReader reader;
    std::vector<std::vector<std::string>> messages;
    std::vector<Nanoseconds> begun;
    for (std::size_t i = 0; i < kExample.size(); i += piece) {
      std::string_view bytes = std::string_view(kExample).substr(i, piece);
      while (!bytes.empty()) {
        bytes.remove_prefix(reader.consume(bytes, static_cast<Nanoseconds>(i)));
        if (!reader.complete()) continue;
        messages.emplace_back(reader.message().lines.begin(), reader.message().lines.end());
        begun.push_back(reader.message().begun);
      }
    }
    ASSERT_EQ(messages.size(), 2u);
    EXPECT_EQ(messages[0], (std::vector<std::string>{"ME0540054201001", "00P"}));
    EXPECT_EQ(messages[1],
              (std::vector<std::string>{"ME0540054201000", "99b", "BI9YM", "0?X0LA0O@04\\001000T"}));
    EXPECT_EQ(begun[1], static_cast<Nanoseconds>(21 / piece * piece));
  }
}

TEST(MessageReaderTest, linesMayEndWithCrLf) {
  std::string bytes;
  for (const char c : kExample) bytes += c == '\n' ? "\r\n" : std::string(1, c);
  scip::MessageReader reader, expected;
  std::string_view rest = bytes, expected_rest = kExample;
  for (int i = 0; i < 2; ++i) {
    rest.remove_prefix(reader.consume(rest, 0));
    expected_rest.remove_prefix(expected.consume(expected_rest, 0));
    ASSERT_TRUE(reader.complete());
    EXPECT_EQ(reader.message().lines, expected.message().lines);
  }
}

TEST(MessageReaderTest, echoBeginsAMessage) {
  scip::MessageReader reader;
  reader.expect("MD0000108001000");
  const std::string bytes = "MD0000108001000\n99b\nBI9YM\n0?X0MD0000108001000\n99b\n\n";
  EXPECT_EQ(reader.consume(bytes, 0), bytes.size());
  ASSERT_TRUE(reader.complete());
  EXPECT_EQ(reader.message().echo(), "MD0000108001000");
  EXPECT_EQ(reader.message().status(), "99");
  EXPECT_EQ(reader.broken(), 1u);

  scip::MessageReader stopped;
  stopped.expect("QT");
  const std::string cut = "0?X0O@7D`Q\nQT\n00P\n\n";
  stopped.consume(cut, 0);
  ASSERT_TRUE(stopped.complete());
  EXPECT_EQ(stopped.message().echo(), "QT");
}

TEST(MessageReaderTest, memoryIsBounded) {
  scip::MessageReader reader;
  for (int i = 0; i < 100; ++i) EXPECT_EQ(reader.consume(std::string(1000, 'x'), 0), 1000u);
  EXPECT_GE(reader.broken(), 100u);
  for (int i = 0; i < 100; ++i)
    reader.consume(std::string(70, 'x') + "\n" + std::string(1000, 'y') + "\n", 0);
  const std::string bytes = "\n\nQT\n00P\n\n";
  std::string_view rest = bytes;
  std::string echo;
  while (!rest.empty()) {
    rest.remove_prefix(reader.consume(rest, 0));
    if (reader.complete()) echo = reader.message().echo();
  }
  EXPECT_EQ(echo, "QT");
}

// ---- scans

HokuyoRequest request(int first, int last, bool intensity, bool multi_echo) {
  HokuyoRequest request;
  request.first = first;
  request.last = last;
  request.intensity = intensity;
  request.multi_echo = multi_echo;
  return request;
}

TEST(HokuyoScanTest, distancesAndIntensities) {
  const auto rows = scip::joinRows(split("0?X0LA0O@04\\001000T\n"), 0);
  ASSERT_EQ(rows.fault, scip::Rows::Fault::kNone);
  HokuyoScan scan;
  ASSERT_TRUE(decodeScan(rows.characters, request(540, 542, true, false), utm30(), scan));
  EXPECT_EQ(scan.first_echo, (std::vector<std::uint32_t>{0, 1, 2, 3}));
  EXPECT_FLOAT_EQ(scan.ranges[0], 1.0f);
  EXPECT_FLOAT_EQ(scan.ranges[1], 2.0f);
  EXPECT_EQ(scan.ranges[2], INFINITY);
  EXPECT_EQ(scan.intensities, (std::vector<float>{1809, 300, 0}));
}

TEST(HokuyoScanTest, distances) {
  const auto rows = scip::joinRows(split("0?X0O@7D`Q\n"), 0);
  HokuyoScan scan;
  ASSERT_TRUE(decodeScan(rows.characters, request(0, 2, false, false), utm30(), scan));
  EXPECT_EQ(scan.ranges, (std::vector<float>{1.0f, 2.0f, 30.0f}));
  EXPECT_TRUE(scan.intensities.empty());
  EXPECT_FALSE(decodeScan(rows.characters, request(0, 3, false, false), utm30(), scan));
  EXPECT_FALSE(decodeScan(rows.characters, request(0, 1, false, false), utm30(), scan));
}

TEST(HokuyoScanTest, multipleEchoes) {
  auto rows = scip::joinRows(split("0?X&0GL0O@_\n"), 0);
  ASSERT_EQ(rows.fault, scip::Rows::Fault::kNone);
  HokuyoScan scan;
  ASSERT_TRUE(decodeScan(rows.characters, request(0, 1, false, true), utm30(), scan));
  EXPECT_EQ(scan.first_echo, (std::vector<std::uint32_t>{0, 2, 3}));
  EXPECT_EQ(scan.ranges, (std::vector<float>{1.0f, 1.5f, 2.0f}));

  rows = scip::joinRows(split("0?X0:l&0GL05N0O@0>4J\n"), 0);
  ASSERT_EQ(rows.fault, scip::Rows::Fault::kNone);
  ASSERT_TRUE(decodeScan(rows.characters, request(0, 1, true, true), utm30(), scan));
  EXPECT_EQ(scan.intensities, (std::vector<float>{700, 350, 900}));

  std::vector<float> ranges, intensities;
  selectEchoes(scan, Echo::kFirst, ranges, intensities);
  EXPECT_EQ(ranges, (std::vector<float>{1.0f, 2.0f}));
  EXPECT_EQ(intensities, (std::vector<float>{700, 900}));
  selectEchoes(scan, Echo::kLast, ranges, intensities);
  EXPECT_EQ(ranges, (std::vector<float>{1.5f, 2.0f}));
  selectEchoes(scan, Echo::kMostIntense, ranges, intensities);
  EXPECT_EQ(ranges, (std::vector<float>{1.0f, 2.0f}));

  for (const char* bad : {"&0?X0GL", "0?X&0GL&0GL&0GL0O@", "0?X&", "0?X&&0GL0O@", "0?X", "0?X0?X0?X"}) {
    EXPECT_FALSE(decodeScan(bad, request(0, 1, false, true), utm30(), scan)) << bad;
  }
  EXPECT_FALSE(decodeScan("0?X&0GL0O@", request(0, 1, false, false), utm30(), scan));
}

TEST(HokuyoScanTest, valueSplitOverTwoRows) {
  std::string characters;
  for (int i = 0; i < 22; ++i) characters += "0?X";
  std::string message;
  for (std::size_t i = 0; i < characters.size(); i += 64) {
    const std::string row = characters.substr(i, 64);
    message += row + scip::sum(row) + "\n";
  }
  const auto rows = scip::joinRows(split(message), 0);
  ASSERT_EQ(rows.fault, scip::Rows::Fault::kNone);
  HokuyoScan scan;
  ASSERT_TRUE(decodeScan(rows.characters, request(0, 21, false, false), utm30(), scan));
  EXPECT_EQ(scan.ranges, std::vector<float>(22, 1.0f));
}

TEST(HokuyoScanTest, rowsOfWrongLength) {
  const std::string short_row = "0?X0O@7D`Q\n";
  EXPECT_EQ(scip::joinRows(split(short_row + short_row), 0).fault, scip::Rows::Fault::kLength);
  const std::string long_row(65, '0');
  EXPECT_EQ(scip::joinRows(split(long_row + scip::sum(long_row) + "\n"), 0).fault,
            scip::Rows::Fault::kLength);
  EXPECT_EQ(scip::joinRows(split("0\n"), 0).fault, scip::Rows::Fault::kLength);  // a sum of nothing
  EXPECT_EQ(scip::joinRows(split("0?X0O@7D`R\n"), 0).fault, scip::Rows::Fault::kSum);
}

TEST(HokuyoScanTest, distancesWithAMeaning) {
  const HokuyoGeometry utm = utm30();
  EXPECT_TRUE(std::isnan(toRange(0, utm)));
  EXPECT_EQ(toRange(1, utm), INFINITY);
  EXPECT_EQ(toRange(2, utm), -INFINITY);
  for (std::uint32_t code = 3; code < 23; ++code) EXPECT_TRUE(std::isnan(toRange(code, utm)));
  EXPECT_FLOAT_EQ(toRange(23, utm), 0.023f);
  EXPECT_FLOAT_EQ(toRange(60000, utm), 60.0f);
  EXPECT_EQ(toRange(60001, utm), INFINITY);
  EXPECT_EQ(toRange(65533, utm), INFINITY);
  HokuyoGeometry urg = utm;  // of other codes
  urg.min_distance = 20;
  urg.max_distance = 5600;
  for (std::uint32_t code = 0; code < 20; ++code) EXPECT_TRUE(std::isnan(toRange(code, urg)));
}

TEST(HokuyoRequestTest, commands) {
  const HokuyoSettings all;
  EXPECT_EQ(HokuyoRequest::make(all, utm30()).command(), "ME0000108001000");
  HokuyoSettings some;
  some.intensity = false;
  some.angle_min = 0.0;
  some.angle_max = 3.0 * M_PI / 720.0;
  EXPECT_EQ(HokuyoRequest::make(some, utm30()).command(), "MD0540054301000");
  some.multi_echo = true;
  some.skip = 9;
  some.cluster = 2;
  EXPECT_EQ(HokuyoRequest::make(some, utm30()).command(), "ND0540054302900");
  some.intensity = true;
  some.cluster = 3;  // four steps are one cluster of three
  const HokuyoRequest request = HokuyoRequest::make(some, utm30());
  EXPECT_EQ(request.command(), "NE0540054203900");
  EXPECT_EQ(request.rays(), 1);
  EXPECT_EQ(request.step(0), 541.0);
  some.cluster = 5;
  EXPECT_THROW(HokuyoRequest::make(some, utm30()), std::invalid_argument);
}

}  // namespace
}  // namespace hokuyo_sick_drivers
