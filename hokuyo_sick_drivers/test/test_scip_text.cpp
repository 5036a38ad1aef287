// SPDX-License-Identifier: BSD-3-Clause
//
// Byte strings of recorded sessions and of Hokuyo's specification.
#include <gtest/gtest.h>

#include "hokuyo_scan.h"
#include "scip_text.h"

namespace device_emulators {
namespace {

TEST(ScipText, SumsOfStatuses) {
  for (const char* line :
       {"00P", "01Q", "02R", "03S", "04T", "05U", "06V", "07W", "10Q", "21S", "50U", "97`", "98a",
        "99b", "0Aa", "0Bb", "0Cc", "0Dd", "0Ee", "0Ff", "0Gg", "0Hh", "0Ii", "0Ll", "0Mm"}) {
    const std::string text(line);
    EXPECT_EQ(scipSum(text.substr(0, 2)), text[2]) << text;
    EXPECT_EQ(scipLine(text.substr(0, 2)), text + "\n");
  }
}

TEST(ScipText, SumsOfRecordedLines) {
  for (const char* line :
       {"DMIN:23;7", "DMAX:60000;J", "ARES:1440;^", "AMIN:0;?", "AMAX:1080;Z", "AFRT:540;0", "SCAN:2400;U",
        "PROT:SCIP 2.0;N", "VEND:Hokuyo Automatic Co.,Ltd.;[", "LASR:ON;9",
        "SCSP:Initial(2400[rpm])<-Default setting by user;1", "MESM:CLASSIC;^", "SBPS:USB Full Speed;P",
        "TIME:4991D0;d", "STAT:Sensor works well.;8"}) {
    const std::string text(line);
    const std::string value = text.substr(5, text.size() - 7);
    EXPECT_EQ(scipKeyLine(text.substr(0, 4), value, false), text + "\n");
  }
  // The semicolon is 3Bh.
  EXPECT_EQ(scipKeyLine("AMIN", "0", true),
            std::string("AMIN:0;") + char(0x30 + ((0x0f + 0x3b) & 0x3f)) + "\n");
}

TEST(ScipText, Numbers) {
  EXPECT_EQ(scipEncode(1234, 2), "CB");
  EXPECT_EQ(scipEncode(5432, 3), "1Dh");
  EXPECT_EQ(scipEncode(23, 3), "00G");
  EXPECT_EQ(scipEncode(22, 3), "00F");
  EXPECT_EQ(scipEncode(60000, 3), ">YP");
  EXPECT_EQ(scipEncode(0, 3), "000");
  EXPECT_EQ(scipEncode(1, 3), "001");
  EXPECT_EQ(scipEncode(16000000, 4), "m2@0");
  EXPECT_EQ(scipEncode(16777215, 4), "oooo");
  EXPECT_EQ(scipEncode(4821609, 4), "BI9Y");
  EXPECT_EQ(scipEncode(3292603, 4), "<Sfk");
}

TEST(ScipText, RowsOf64) {
  EXPECT_EQ(scipRows(""), "");
  const std::string full(64, '0');
  EXPECT_EQ(scipRows(full), full + scipSum(full) + "\n");
  EXPECT_EQ(scipRows(full + "1"), full + scipSum(full) + "\n1a\n");
}

SentScan scanOf(std::vector<std::uint32_t> ranges, std::vector<std::uint32_t> intensities,
                std::vector<std::uint8_t> echoes = {}) {
  SentScan scan;
  scan.ranges = std::move(ranges);
  scan.intensities = std::move(intensities);
  scan.echoes = std::move(echoes);
  return scan;
}

TEST(ScipText, DataOfWorkedExamples) {
  HokuyoRequest request;
  EXPECT_EQ(scipRows(encodeScan(scanOf({1000, 2000, 30000}, {}), request)), "0?X0O@7D`Q\n");
  EXPECT_EQ(encodeScan(scanOf({1000, 1500, 2000}, {}, {2, 1}), request), "0?X&0GL0O@");
  EXPECT_EQ(scipRows("0?X&0GL0O@"), "0?X&0GL0O@_\n");
  request.intensity = true;
  EXPECT_EQ(scipRows(encodeScan(scanOf({1000, 2000, 1}, {1809, 300, 0}), request)), "0?X0LA0O@04\\001000T\n");
  EXPECT_EQ(scipRows(encodeScan(scanOf({1000, 1500, 2000}, {700, 350, 900}, {2, 1}), request)),
            "0?X0:l&0GL05N0O@0>4J\n");
}

}  // namespace
}  // namespace device_emulators
