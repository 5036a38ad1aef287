// SPDX-License-Identifier: BSD-3-Clause
#include "point_text.h"

#include <algorithm>
#include <cmath>

namespace hokuyo_sick_drivers {

void IntensityGuess::add(double value) {
  if (!std::isfinite(value)) return;
  min_ = std::min(min_, value);
  max_ = std::max(max_, value);
  whole_ = whole_ && value == std::floor(value);
}

std::optional<Limits> IntensityGuess::limits() const {
  if (min_ > max_) return {};
  if (min_ < 0.0)
    return min_ >= -2048.0 && max_ <= 2049.0 ? std::optional(Limits{-2048.0, 2047.0}) : std::nullopt;
  if (max_ <= 1.0) return Limits{0.0, 1.0};
  if (max_ <= 255.0 && whole_) return Limits{0.0, 255.0};
  return {};
}

std::optional<std::uint64_t> asCount(std::string_view line) {
  std::int64_t count = 0;
  if (!parseWhole(line, count) || count < 0) return {};
  return static_cast<std::uint64_t>(count);
}

}  // namespace hokuyo_sick_drivers
