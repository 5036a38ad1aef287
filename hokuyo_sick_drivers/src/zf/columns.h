// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <array>
#include <cstddef>
#include <optional>
#include <string>
#include <string_view>

#include "readers.h"

namespace hokuyo_sick_drivers {

/// What the numbers of a line of PTS or ASC are.
class Columns {
 public:
  static constexpr std::size_t kMost = 32;

  /// @param words one for each column: x y z, i for the intensity, r g b from 0 to 255 or rf gf bf from 0 to
  /// 1, _ for
  ///   others; with - before x y z to turn their sign
  /// @throws std::runtime_error that says what is wrong with them
  explicit Columns(const std::string& words);
  /// By how many there are; nothing where that can't be guessed.
  static std::optional<Columns> usual(std::size_t count);
  /// As a line above the points names them, e.g. CloudCompare's //X;Y;Z;Rf;Gf;Bf;Intensity;Nx;Ny;Nz. Nothing
  /// where it doesn't name x, y and z.
  static std::optional<Columns> named(std::string_view header);

  std::size_t count() const { return count_; }
  bool hasIntensity() const { return has(kIntensity); }
  bool hasColour() const { return has(kRed); }
  double intensity(const double* fields) const { return value(fields, kIntensity); }
  /// @param fields as many as there are columns
  void read(const double* fields, const IntensityMap& intensity, ScanPoint& point) const;

 private:
  enum Name { kX, kY, kZ, kIntensity, kRed, kGreen, kBlue, kNames };

  bool has(Name name) const { return position_[name] >= 0; }
  double value(const double* fields, Name name) const { return factor_[name] * fields[position_[name]]; }

  std::array<int, kNames> position_;  // -1: there is none
  std::array<double, kNames> factor_;
  std::size_t count_ = 0;
};

}  // namespace hokuyo_sick_drivers
