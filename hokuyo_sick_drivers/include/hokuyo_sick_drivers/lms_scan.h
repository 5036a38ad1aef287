// SPDX-License-Identifier: BSD-3-Clause
//
// From the telegrams of a SICK LMS 2xx to metres, radians and host time.
#pragma once

#include <cstdint>
#include <optional>
#include <vector>

#include "hokuyo_sick_drivers/device_clock.h"
#include "hokuyo_sick_drivers/lms_telegram.h"

namespace hokuyo_sick_drivers::lms {

/// The mirror turns at 75 Hz.
constexpr double kTurnsPerSecond = 75.0;

/// What sending that many bytes takes, at 10 bits each. s
double transferTime(std::size_t bytes, int baud_rate);

/// Counterclockwise, seen from above.
struct Scan {
  Nanoseconds stamp = 0;                          ///< when the mirror was at the first value
  double angle_min = 0.0, angle_increment = 0.0;  ///< rad
  /// s. Neighbouring values of a scan of 0.5 or 0.25 degrees are from different turns of the mirror, up to 1
  /// / 75 or 3 / 75 s later than this says. Not so those of partial scans and of fast (-S14) types.
  double time_increment = 0.0;
  double scan_time = 0.0;                   ///< s, from scan to scan
  double range_min = 0.0, range_max = 0.0;  ///< m
  std::vector<float> ranges;       ///< m; REP 117: inf where there is nothing up to range_max, NaN for errors
  std::vector<float> intensities;  ///< as sent, one for each range or none
  std::vector<std::uint8_t> flags;  ///< upper bits of the ranges' words: reflector, field, dazzled
  std::uint8_t status = 0;          ///< see Status
  Unit unit = Unit::kCentimetre;
  bool real_time_index = false;  ///< whether it came with one
  std::size_t lost = 0;          ///< scans before this one, by their real-time indices
  std::size_t beyond_top = 0;    ///< ranges greater than there can be
};

/// How the word of a range is used: the lower bits are the range, the greatest nine of these values are no
/// range.
struct RangeWord {
  int bits = 13;               ///< of the range; what is above is flags
  std::uint16_t top = 0x1FFF;  ///< greatest value

  /// For the measuring modes of the listing. @return none for those without ranges, and unknown ones
  static std::optional<RangeWord> ofMode(int measuring_mode);
};

/// What an LMS was told to send.
struct ScanFormat {
  Code code = kRanges;
  Variant variant;          ///< angle 90 for fast types
  bool interlaced = false;  ///< telegrams are partial scans, of one turn and whole degrees each
  int first = 1, last = 0;  ///< indices of its values
  RangeWord range_word;
  int baud_rate = 9600;

  int turns() const;          ///< of the mirror, for a telegram
  std::size_t bytes() const;  ///< of a telegram
  /// From scan to scan: whole turns, of which a slow line makes the LMS leave some out. s
  double period() const;
};

/// Tells when the mirror was where, from when telegrams arrive.
class MirrorClock {
 public:
  struct Time {
    Nanoseconds stamp;
    int turns = 0;  ///< since the last scan; 0 if unknown
  };

  MirrorClock();
  /// @param index turns modulo 256; without, they follow from the time
  /// @param start the start of the scan by when it arrived: too late at times, hardly ever too early
  /// @param step turns that a scan takes
  /// @return none if the index contradicts the time; the next one that does will be believed
  std::optional<Time> add(std::optional<std::uint8_t> index, Nanoseconds start, int step);

 private:
  void restart();
  int turnsSince(std::optional<std::uint8_t> index, Nanoseconds start, int step) const;

  DeviceClock clock_;
  std::optional<std::uint8_t> index_;
  std::optional<Nanoseconds> last_start_;
  Nanoseconds last_stamp_ = 0;
  std::int64_t turn_ = 0;
  int late_ = 0;  // scans in a row
  bool doubted_ = false;
};

/// Makes scans of telegrams, all of one format.
class ScanDecoder {
 public:
  explicit ScanDecoder(const ScanFormat& format) : format_(format) {}
  const ScanFormat& format() const { return format_; }

  /// @param arrival of the last byte
  /// @throws DecodeError if the telegram is not as the format says
  Scan decode(const Telegram& telegram, Nanoseconds arrival);

 private:
  Values decodeValues(const Telegram& telegram) const;
  void checkPartialScan(const Values& values) const;
  void convertRanges(const Values& values, Scan& scan) const;

  const ScanFormat format_;
  MirrorClock clock_;
};

}  // namespace hokuyo_sick_drivers::lms
