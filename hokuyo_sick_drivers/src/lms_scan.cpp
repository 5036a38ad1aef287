// SPDX-License-Identifier: BSD-3-Clause
#include "hokuyo_sick_drivers/lms_scan.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>

namespace hokuyo_sick_drivers::lms {
namespace {

constexpr double kTurn = 1.0 / kTurnsPerSecond;  // s
constexpr double kRadians = M_PI / 180.0;
constexpr int kLargerThanMaximum = 8;  // of the overflow codes, counted down from the greatest value
constexpr int kIndices = 256;
// The clock starts anew if the mirror is late by this much, for so many scans in a row.
constexpr double kLate = 0.25;  // s
constexpr int kLateScans = 10;
constexpr Nanoseconds kWindow = 60 * kSecond;  // of scans that tell how fast the mirror turns

[[noreturn]] void rejectVariant(const char* what) {
  throw DecodeError(Defect::kOtherVariant, what);
}

double seconds(Nanoseconds time) {
  return static_cast<double>(time) / kSecond;
}
Nanoseconds nanoseconds(double seconds) {
  return std::llround(seconds * kSecond);
}
Nanoseconds mirrorTime(std::int64_t turn) {
  return nanoseconds(static_cast<double>(turn) * kTurn);
}

}  // namespace

double transferTime(std::size_t bytes, int baud_rate) {
  return 10.0 * static_cast<double>(bytes) / baud_rate;
}

std::optional<RangeWord> RangeWord::ofMode(int measuring_mode) {
  switch (measuring_mode) {
    case 0x00:
    case 0x01:
    case 0x02:
      return RangeWord{13, 0x1FFF};
    case 0x03:
    case 0x04:
      return RangeWord{14, 0x3FFF};
    case 0x05:
    case 0x06:
      return RangeWord{15, 0x7FFF};
    case 0x0F:
      return RangeWord{16, 0xFFFF};
    default:
      return std::nullopt;
  }
}

int ScanFormat::turns() const {
  return interlaced || variant.angle == 90 ? 1 : 100 / variant.resolution;
}

std::size_t ScanFormat::bytes() const {
  const std::size_t values = last - first + 1;
  const std::size_t all = interlaced ? variant.angle + 1 : variant.values();
  switch (code) {
    case kIntensities:
      return kOverhead + 10 + 4 * values;
    case kReflectivities:
      return kOverhead + 10 + 2 * all + values;
    default:
      return kOverhead + 4 + 2 * all;
  }
}

double ScanFormat::period() const {
  const double least = turns() * kTurn;
  return least * std::max(1.0, std::ceil(transferTime(bytes(), baud_rate) / least));
}

// --------------------------------------------------------------------------------------------------------
// time

MirrorClock::MirrorClock() {
  DeviceClock::Options options;
  options.max_drift = 0.02;  // a motor, not a quartz
  options.max_slew = 0.005;
  options.window = kWindow;
  options.warm_up = kWindow / 6;
  clock_ = DeviceClock(options);
  restart();
}

void MirrorClock::restart() {
  clock_.restart(0);
  turn_ = 0;
  late_ = 0;
}

// Turns of the mirror since the last scan, 0 if there was none to compare with.
int MirrorClock::turnsSince(std::optional<std::uint8_t> index, Nanoseconds start, int step) const {
  if (!last_start_ || index.has_value() != index_.has_value()) return 0;
  if (index) {
    // It comes round every 3.4 s; the time says how often it did.
    const double expected = seconds(start - *last_start_) / kTurn;
    const int turns = (*index - *index_ + kIndices) % kIndices;
    return turns + kIndices * static_cast<int>(std::max(0.0, std::round((expected - turns) / kIndices)));
  }
  // Late telegrams are no lost ones, unless they are later than most of a turn.
  constexpr double kLateTurns = 0.75;
  const double since_last = seconds(start - *last_start_) / (step * kTurn);
  const double since_stamp = seconds(start - last_stamp_) / (step * kTurn);
  const double scans = std::min({std::round(since_last), std::floor(since_stamp + 1.0 - kLateTurns), 1e6});
  return step * std::max(1, static_cast<int>(scans));
}

// The checksum lets one of 65536 damaged telegrams pass, and a wrong index would spoil the stamps of many
// scans: the mirror can't be ahead of its time by most of a turn, nor stand still.
std::optional<MirrorClock::Time> MirrorClock::add(std::optional<std::uint8_t> index, Nanoseconds start,
                                                  int step) {
  const int turns = turnsSince(index, start, step);
  bool follows =
      last_start_ && index.has_value() == index_.has_value() && start - *last_start_ <= kWindow / 2;
  if (follows) {
    const double late = seconds(start - clock_.estimate(mirrorTime(turn_ + turns)));
    const bool contradicts = turns == 0 || late < -kTurn / 2.0;
    if (contradicts && index && !std::exchange(doubted_, true)) return std::nullopt;
    late_ = late > kLate ? late_ + 1 : 0;
    follows = !contradicts && late_ < kLateScans;
  }
  doubted_ = false;
  if (follows) {
    turn_ += turns;
  } else {
    restart();
  }
  clock_.addArrival(mirrorTime(turn_), start);
  Nanoseconds stamp = clock_.toHost(mirrorTime(turn_));
  if (last_start_) stamp = std::max(stamp, last_stamp_ + 1);
  index_ = index;
  last_start_ = start;
  last_stamp_ = stamp;
  return Time{stamp, turns};
}

// --------------------------------------------------------------------------------------------------------
// values

Scan ScanDecoder::decode(const Telegram& telegram, Nanoseconds arrival) {
  if (telegram.code != format_.code) rejectVariant("a scan is of another kind than asked for");
  const Values values = decodeValues(telegram);

  const double degrees =
      format_.interlaced || format_.variant.resolution == 100 ? 1.0 : format_.variant.resolution / 100.0;
  const double start = -0.5 * format_.variant.angle + 0.25 * values.partial_scan.value_or(0);
  Scan scan;
  scan.angle_min = (start + (values.start - 1) * degrees) * kRadians;
  scan.angle_increment = degrees * kRadians;
  scan.time_increment = kTurn * degrees / 360.0;
  scan.scan_time = format_.period();
  convertRanges(values, scan);
  scan.intensities.assign(values.intensities.begin(), values.intensities.end());

  // The last value is measured in the last turn, then all is sent.
  const double sector = (static_cast<double>(scan.ranges.size()) - 1.0) * scan.time_increment;
  const double before =
      transferTime(telegram.size(), format_.baud_rate) + (format_.turns() - 1) * kTurn + sector;
  const auto time = clock_.add(values.real_time_index, arrival - nanoseconds(before), format_.turns());
  if (!time) throw DecodeError(Defect::kIndex, "the real-time index of a scan contradicts its time");
  scan.stamp = time->stamp;
  scan.status = telegram.status;
  scan.unit = values.unit;
  scan.real_time_index = values.real_time_index.has_value();
  if (scan.real_time_index) {
    scan.lost = std::max(1L, std::lround(time->turns / (scan.scan_time * kTurnsPerSecond))) - 1;
  }
  return scan;
}

Values ScanDecoder::decodeValues(const Telegram& telegram) const {
  const int expected = format_.last - format_.first + 1;
  switch (format_.code) {
    case kIntensities: {
      std::vector<Values> groups = decodeIntensities(telegram);
      if (groups.size() != 1 || groups[0].start != format_.first || groups[0].stop != format_.last) {
        rejectVariant("a scan has other indices than asked for");
      }
      return groups[0];
    }
    case kReflectivities: {
      Values values = decodeReflectivities(telegram);
      const bool complete = values.total == expected || values.total == format_.variant.values();
      if (!complete || values.start != format_.first || values.stop != format_.last) {
        rejectVariant("a scan has other indices than asked for");
      }
      return values;
    }
    default: {
      Values values = decodeRanges(telegram);
      if (values.partial_scan.has_value() != format_.interlaced) rejectVariant("a scan is partial or not");
      if (format_.interlaced) {
        checkPartialScan(values);
      } else if (values.total != format_.variant.values()) {
        rejectVariant("a scan has another number of values than the variant");
      }
      return values;
    }
  }
}

// Partial scans other than the first may lack the value at the left end, which is beyond the sector.
void ScanDecoder::checkPartialScan(const Values& values) const {
  const int quarters = *values.partial_scan, whole = format_.variant.angle + 1;
  if (quarters * 25 % format_.variant.resolution != 0)
    rejectVariant("a partial scan is of another resolution");
  if (values.total != whole && (quarters == 0 || values.total != whole - 1)) {
    rejectVariant("a partial scan has another number of values than the variant");
  }
}

void ScanDecoder::convertRanges(const Values& values, Scan& scan) const {
  const RangeWord& word = format_.range_word;
  const double unit = toMetres(values.unit);
  const int mask = (1 << word.bits) - 1, no_range = word.top - kLargerThanMaximum;
  scan.range_min = unit;
  scan.range_max = (no_range - 1) * unit;
  scan.ranges.reserve(values.ranges.size());
  scan.flags.reserve(values.ranges.size());
  for (const int w : values.ranges) {
    const int range = w & mask;
    if (range > word.top) ++scan.beyond_top;
    scan.ranges.push_back(range < no_range    ? static_cast<float>(range * unit)
                          : range == no_range ? std::numeric_limits<float>::infinity()
                                              : std::numeric_limits<float>::quiet_NaN());
    scan.flags.push_back(static_cast<std::uint8_t>(w >> word.bits));
  }
}

}  // namespace hokuyo_sick_drivers::lms
