// SPDX-License-Identifier: BSD-3-Clause
//
// What PTX, PTS and ASC share: lines of numbers.
#pragma once

#include <limits>
#include <optional>

#include "line_reader.h"
#include "numbers.h"
#include "readers.h"

namespace hokuyo_sick_drivers {

/// Which convention the intensities of a text follow; more values tell it better.
class IntensityGuess {
 public:
  void add(double value);
  /// -2048..2047 with negative values, 0..1, whole numbers 0..255; none: raw values of a device.
  std::optional<Limits> limits() const;

 private:
  double min_ = std::numeric_limits<double>::infinity(), max_ = -min_;
  bool whole_ = true;
};

/// Lets ReadOptions::opening know how far it is; to be called once per line.
class OpeningProgress {
 public:
  OpeningProgress(const ReadOptions& options, const LineReader& lines) : options_(options), lines_(lines) {}
  /// @throws ReadStopped
  void lineRead() {
    if (++count_ % 65536 == 0 && options_.opening && !options_.opening(lines_.progress()))
      throw ReadStopped();
  }

 private:
  const ReadOptions& options_;
  const LineReader& lines_;
  std::uint64_t count_ = 0;
};

/// The first lines of PTS and ASC tell how they are meant.
constexpr std::uint64_t kIntensitySample = 100000;

/// Whether a line is one whole number, no less than 0.
std::optional<std::uint64_t> asCount(std::string_view line);

inline std::string plural(std::uint64_t count, const std::string& noun) {
  return std::to_string(count) + ' ' + noun + (count == 1 ? "" : "s");
}

}  // namespace hokuyo_sick_drivers
