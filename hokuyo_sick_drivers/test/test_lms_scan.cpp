// SPDX-License-Identifier: BSD-3-Clause
//
// Values, angles and times of scans.
#include <gtest/gtest.h>

#include <random>

#include "fake_lms.h"

namespace hokuyo_sick_drivers::lms {
namespace {

constexpr double kTurn = 1.0 / 75.0;

ScanFormat rangesOf(const Variant& variant, int measuring_mode = 0) {
  ScanFormat format;
  format.variant = variant;
  format.last = variant.values();
  format.baud_rate = 500000;
  format.range_word = *RangeWord::ofMode(measuring_mode);
  return format;
}
ScanFormat intensitiesOf(int first, int last, const RangeWord& word, int baud_rate = 500000) {
  ScanFormat format = rangesOf({180, 100});
  format.code = kIntensities;
  format.first = first;
  format.last = last;
  format.range_word = word;
  format.baud_rate = baud_rate;
  return format;
}
Telegram rangesTelegram(std::vector<int> values, std::size_t count, int head = 0) {
  values.resize(count);
  Telegram telegram{kRanges, word(static_cast<int>(count) | head), 0x10};
  for (int v : values) telegram.data += word(v);
  return telegram;
}
Telegram intensitiesTelegram(const std::vector<int>& ranges, int first, int head = 0) {
  const int count = static_cast<int>(ranges.size());
  Telegram telegram{kIntensities, word(1) + word(first) + word(first + count - 1) + word(count | head), 0x10};
  for (int r : ranges) telegram.data += word(r) + word(r / 2);
  return telegram;
}
Scan decodeOnce(const ScanFormat& format, const Telegram& telegram) {
  return ScanDecoder(format).decode(telegram, kSecond);
}
Defect defectOf(const ScanFormat& format, const Telegram& telegram) {
  try {
    decodeOnce(format, telegram);
  } catch (const DecodeError& e) {
    return e.defect;
  }
  ADD_FAILURE() << "accepted";
  return Defect::kSize;
}

// --------------------------------------------------------------------------------------------------------
// sizes and periods

TEST(LmsScanFormat, SizesAreThoseOnTheLine) {
  EXPECT_EQ(372u, rangesOf({180, 100}).bytes());
  EXPECT_EQ(732u, rangesOf({180, 50}).bytes());
  EXPECT_EQ(812u, rangesOf({100, 25}).bytes());
  EXPECT_EQ(500u, intensitiesOf(1, 121, {}).bytes());
  EXPECT_EQ(740u, intensitiesOf(1, 181, {}).bytes());
  EXPECT_EQ(812u, intensitiesOf(1, 199, {}).bytes());
  EXPECT_EQ(740u, intensitiesTelegram(std::vector<int>(181), 1).size());
  EXPECT_EQ(372u, rangesTelegram({}, 181).size());
}

TEST(LmsScanFormat, TransferTimesAreThoseOfTenBitsAByte) {
  EXPECT_NEAR(0.0969, transferTime(372, 38400), 1e-4);
  EXPECT_NEAR(0.00744, transferTime(372, 500000), 1e-5);
  EXPECT_NEAR(0.1906, transferTime(732, 38400), 1e-4);
  EXPECT_NEAR(0.211, transferTime(812, 38400), 1e-3);
  EXPECT_NEAR(0.0148, transferTime(740, 500000), 1e-4);
}

TEST(LmsScanFormat, PeriodIsOfTurnsUnlessTheLineIsSlow) {
  EXPECT_NEAR(kTurn, rangesOf({180, 100}).period(), 1e-9);
  EXPECT_NEAR(2 * kTurn, rangesOf({180, 50}).period(), 1e-9);
  EXPECT_NEAR(4 * kTurn, rangesOf({100, 25}).period(), 1e-9);
  EXPECT_NEAR(kTurn, intensitiesOf(1, 162, {}).period(), 1e-9);
  EXPECT_NEAR(2 * kTurn, intensitiesOf(1, 181, {}).period(), 1e-9);
  EXPECT_NEAR(15 * kTurn, intensitiesOf(1, 181, {}, 38400).period(), 1e-9);
}

// --------------------------------------------------------------------------------------------------------
// values

TEST(LmsScan, OverflowsAreNoRanges) {
  struct Mode {
    int mode, top, flag_bits;
  };
  for (const Mode& m : {Mode{0, 0x1FFF, 3}, Mode{1, 0x1FFF, 3}, Mode{3, 0x3FFF, 2}, Mode{5, 0x7FFF, 1},
                        Mode{0x0F, 0xFFFF, 0}}) {
    const int flags = m.flag_bits > 0 ? 0x8000 : 0;
    const Scan scan =
        decodeOnce(rangesOf({180, 100}, m.mode),
                   rangesTelegram({(m.top - 9) | flags, (m.top - 8) | flags, m.top - 7, m.top, 100}, 181));
    EXPECT_NEAR((m.top - 9) * 0.01, scan.ranges[0], 1e-3);
    EXPECT_NEAR((m.top - 9) * 0.01, scan.range_max, 1e-9);
    EXPECT_EQ(std::numeric_limits<float>::infinity(), scan.ranges[1]);
    EXPECT_TRUE(std::isnan(scan.ranges[2]) && std::isnan(scan.ranges[3]));
    EXPECT_FLOAT_EQ(1.0f, scan.ranges[4]);
    EXPECT_EQ(flags >> (16 - m.flag_bits), scan.flags[0]);
    EXPECT_EQ(0, scan.flags[4]);
    EXPECT_EQ(0u, scan.beyond_top);
  }
  for (int mode : {0x0D, 0x0E, 0x3F, 7, -1}) EXPECT_FALSE(RangeWord::ofMode(mode));
}

TEST(LmsScan, UnitsAreThoseOfTheTelegram) {
  EXPECT_FLOAT_EQ(1.0f, decodeOnce(rangesOf({180, 100}), rangesTelegram({100}, 181)).ranges[0]);
  EXPECT_FLOAT_EQ(0.1f, decodeOnce(rangesOf({180, 100}), rangesTelegram({100}, 181, 0x4000)).ranges[0]);
  EXPECT_FLOAT_EQ(10.0f, decodeOnce(rangesOf({180, 100}), rangesTelegram({100}, 181, 0x8000)).ranges[0]);
  EXPECT_NEAR(8.182, decodeOnce(rangesOf({180, 100}), rangesTelegram({}, 181, 0x4000)).range_max, 1e-9);
}

TEST(LmsScan, WordsOfRangesWithIntensitiesAreReadAsAsked) {
  const Telegram telegram = intensitiesTelegram({8182, 8183, 8191, 0x2064, 0xFFF6, 0xFFF7, 0xFFFF}, 11);
  const Scan plain = decodeOnce(intensitiesOf(11, 17, {16, 0x1FFF}), telegram);
  EXPECT_NEAR(81.82, plain.ranges[0], 1e-4);
  EXPECT_TRUE(std::isinf(plain.ranges[1]));
  for (int i = 2; i < 7; ++i) EXPECT_TRUE(std::isnan(plain.ranges[i]));
  EXPECT_EQ(4u, plain.beyond_top);
  EXPECT_FLOAT_EQ(4091.0f, plain.intensities[1]);  // whatever the range

  const Scan flags = decodeOnce(intensitiesOf(11, 17, {13, 0x1FFF}), telegram);
  EXPECT_FLOAT_EQ(1.0f, flags.ranges[3]);
  EXPECT_EQ(1, flags.flags[3]);
  EXPECT_TRUE(std::isinf(flags.ranges[5]));
  EXPECT_EQ(0u, flags.beyond_top);

  const Scan sixteen = decodeOnce(intensitiesOf(11, 17, {16, 0xFFFF}), telegram);
  EXPECT_NEAR(81.91, sixteen.ranges[2], 1e-4);
  EXPECT_NEAR(655.26, sixteen.ranges[4], 1e-3);
  EXPECT_TRUE(std::isinf(sixteen.ranges[5]));
  EXPECT_TRUE(std::isnan(sixteen.ranges[6]));
}

TEST(LmsScan, OtherVariantsAreRejected) {
  const ScanFormat ranges = rangesOf({180, 100}), intensities = intensitiesOf(1, 5, {});
  EXPECT_EQ(Defect::kOtherVariant, defectOf(ranges, rangesTelegram({}, 180)));
  EXPECT_EQ(Defect::kOtherVariant, defectOf(ranges, rangesTelegram({}, 361)));
  EXPECT_EQ(Defect::kOtherVariant, defectOf(ranges, rangesTelegram({}, 181, 0x2000)));
  EXPECT_EQ(Defect::kOtherVariant, defectOf(ranges, intensitiesTelegram({1, 2, 3, 4, 5}, 1)));
  EXPECT_EQ(Defect::kOtherVariant, defectOf(intensities, intensitiesTelegram({1, 2, 3, 4}, 1)));
  EXPECT_EQ(Defect::kOtherVariant, defectOf(intensities, intensitiesTelegram({1, 2, 3, 4, 5}, 2)));
  EXPECT_EQ(Defect::kOtherVariant, defectOf(intensities, rangesTelegram({}, 181)));
  ScanFormat interlaced = rangesOf({180, 50});
  interlaced.interlaced = true;
  EXPECT_EQ(Defect::kOtherVariant, defectOf(interlaced, rangesTelegram({}, 181)));
  EXPECT_EQ(Defect::kOtherVariant, defectOf(interlaced, rangesTelegram({}, 180, 0x2000)));
  EXPECT_EQ(Defect::kOtherVariant, defectOf(interlaced, rangesTelegram({}, 180, 0x2800)));
  EXPECT_EQ(180u, decodeOnce(interlaced, rangesTelegram({}, 180, 0x3000)).ranges.size());
  EXPECT_EQ(181u, decodeOnce(interlaced, rangesTelegram({}, 181, 0x3000)).ranges.size());
}

// --------------------------------------------------------------------------------------------------------
// time

struct StampTest {
  int angle, resolution, baud_rate;
  bool intensities, index;
};
std::ostream& operator<<(std::ostream& out, const StampTest& t) {
  return out << t.angle << " by " << t.resolution << " at " << t.baud_rate << (t.intensities ? " I" : "")
             << (t.index ? " index" : "");
}
class LmsStamps : public ::testing::TestWithParam<StampTest> {};

TEST_P(LmsStamps, AreRightUnderJitterAndDrift) {
  LmsOptions options;
  options.variant = Variant{GetParam().angle, GetParam().resolution};
  options.baud_rate = GetParam().baud_rate;
  if (GetParam().intensities) options.intensity = LmsOptions::Intensity::kNormalised;
  options.real_time_index = GetParam().index;
  Bench bench(options);
  bench.device.turn *= 1.003;
  std::mt19937 random(7);
  std::exponential_distribution<double> delay(1.0 / 0.0015);
  bench.jitter = [&] { return std::llround(1e9 * std::min(0.005, delay(random))); };
  bench.connect();
  bench.run(60.0);
  ASSERT_EQ(bench.true_starts.size(), bench.scans.size());
  ASSERT_GT(bench.scans.size(), 100u);
  for (std::size_t i = 0; i < bench.scans.size(); ++i) {
    const double error = 1e-9 * (bench.scans[i].stamp - bench.true_starts[i]);
    ASSERT_NEAR(0.0, error, bench.true_starts[i] - bench.true_starts[0] > 20 * kSecond ? 1e-3 : 2e-2) << i;
    if (i > 0) {
      ASSERT_GT(bench.scans[i].stamp, bench.scans[i - 1].stamp);
    }
  }
  EXPECT_EQ(0u, bench.lms.report().lost);
}
INSTANTIATE_TEST_SUITE_P(
    All, LmsStamps,
    ::testing::Values(StampTest{180, 100, 500000, true, true}, StampTest{180, 100, 500000, true, false},
                      StampTest{180, 100, 38400, true, true}, StampTest{180, 100, 500000, false, true},
                      StampTest{180, 100, 500000, false, false}, StampTest{180, 50, 500000, false, true},
                      StampTest{180, 50, 38400, false, false}, StampTest{100, 25, 500000, false, true}));

TEST(MirrorClock, CountsTurnsOverSilence) {
  for (double silence : {0.1, 1.7, 3.4, 3.5, 60.0}) {
    MirrorClock clock;
    std::int64_t turn = 1000;
    const auto time = [&] { return static_cast<Nanoseconds>(std::llround(turn * kTurn * 1e9)); };
    for (; turn < 3000; ++turn) clock.add(turn % 256, time(), 1);
    const int turns = static_cast<int>(silence / kTurn);
    turn += turns - 1;
    const auto result = *clock.add(turn % 256, time() + 3 * kMillisecond, 1);
    EXPECT_EQ(turns, result.turns);
    EXPECT_NEAR(0.0, 1e-9 * (result.stamp - time()), silence < 30.0 ? 1e-3 : 3.1e-3) << silence;
  }
}

// A checksum of 16 bits lets one of 65536 damaged telegrams pass.
TEST(MirrorClock, AWrongIndexSpoilsNoStamp) {
  for (int wrong = 1; wrong < 254; wrong += 6) {  // with 254 it isn't ahead, but a scan held up
    MirrorClock clock;
    std::int64_t turn = 1000;
    const auto time = [&] { return static_cast<Nanoseconds>(std::llround(turn * kTurn * 1e9)); };
    for (; turn < 3000; turn += 2) clock.add(turn % 256, time() + turn % 7 * kMillisecond, 2);
    EXPECT_FALSE(clock.add((turn + wrong) % 256, time() + kMillisecond, 2)) << wrong;
    for (turn += 2; turn < 4000; turn += 2) {
      const auto result = *clock.add(turn % 256, time() + turn % 7 * kMillisecond, 2);
      ASSERT_NEAR(0.0, 1e-9 * (result.stamp - time()), 1e-3) << wrong;
    }
  }
}

TEST(MirrorClock, BelievesAnIndexTheSecondTime) {
  MirrorClock clock;
  Nanoseconds now = kSecond;
  for (int i = 0; i < 1000; ++i) clock.add(i % 256, now += kSecond / 75, 1);
  EXPECT_FALSE(clock.add(50, now += kSecond / 75, 1));
  for (int i = 51; i < 200; ++i) {
    now += kSecond / 75;
    EXPECT_NEAR(now, clock.add(i, now, 1)->stamp, 100);
  }
}

TEST(MirrorClock, StartsAnewWhenTheMirrorTurnsOtherwise) {
  MirrorClock clock;
  Nanoseconds now = kSecond, stamp = 0;
  for (int i = 0; i < 1000; ++i) stamp = clock.add(i % 256, now += kSecond / 75, 1)->stamp;
  for (int i = 1000; i < 1100; ++i) stamp = clock.add(i % 256, now += kSecond / 40, 1)->stamp;
  EXPECT_NEAR(0.0, 1e-9 * (stamp - now), 0.3);
}

TEST(LmsScan, LostOnesAreCounted) {
  ScanDecoder decoder(rangesOf({180, 100}));
  Nanoseconds now = kSecond;
  std::size_t lost = 0;
  const auto next = [&](int turns, int index) {
    Telegram telegram = rangesTelegram({}, 181);
    telegram.data += static_cast<char>(index);
    now += turns * kSecond / 75;
    lost += decoder.decode(telegram, now).lost;
  };
  for (int i = 0; i < 300; ++i) next(1, i);
  EXPECT_EQ(0u, lost);
  next(4, 303);
  EXPECT_EQ(3u, lost);
  next(257, 560);
  EXPECT_EQ(259u, lost);
}

}  // namespace
}  // namespace hokuyo_sick_drivers::lms
