// SPDX-License-Identifier: BSD-3-Clause
//
// What stands where and how light it is, seen from above, to order places by before they are registered.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <vector>

#include "intensity_place_recognition/shape.h"

namespace intensity_place_recognition {

/// How much of the walls faces each direction. Where the sensor moves it hardly changes, where the sensor
/// turns it turns (angle histograms, Weiss et al. 1994).
class WallDirections {
 public:
  WallDirections() = default;
  explicit WallDirections(const Shape& shape);
  /// The yaw (rad, of the query's sensor seen from the place's) within `reach` of `likely` at which this
  /// one's walls are turned as those of `place`.
  double bestYaw(const WallDirections& place, double likely, double reach) const;

 private:
  static constexpr int kSteps = 180;         // of a whole turn
  std::array<std::uint8_t, kSteps> part_{};  // of the most
};

class PackedPlan;

/// A query's or a place's plan of 64 m x 64 m in cells of 1 m. Its spectrum makes the correlation at all
/// shifts a product.
class GroundPlan {
 public:
  GroundPlan() = default;
  /// @param yaw rad, that the sensor is turned by
  GroundPlan(const Shape& shape, double yaw);
  /// That of the same sensor turned by half a turn more.
  GroundPlan halfTurned() const;

  bool empty() const { return spectrum_.empty(); }

  struct Shift {
    float correlation = -1.0f;  ///< of what stands where and of how light it is together, -1 to 1
    float x = 0.0f, y = 0.0f;   ///< m, of the query's sensor seen from the place's
  };
  /// The best shift of at most `reach` (m) along each axis that moves this one's content onto that of
  /// `place`, to 2 m by the low frequencies alone.
  Shift roughShift(const PackedPlan& place, float reach) const;
  /// To a part of a metre the shifts that are the best around them, the best first.
  std::vector<Shift> bestShifts(const PackedPlan& place, float reach, std::size_t count) const;

 private:
  friend class PackedPlan;
  /// Of (2 shifts + 1) x (2 shifts + 1) shifts. @param step cells, 1 or 2 @param roughly by the lower half of
  ///   the frequencies
  std::vector<float> correlations(const PackedPlan& place, int step, int shifts, bool roughly) const;

  std::vector<std::int16_t> spectrum_;
  float step_ = 0.0f;  // that its values are multiples of
};

/// A plan as places keep it, in 17 kB.
class PackedPlan {
 public:
  PackedPlan(const GroundPlan& plan);
  /// That it takes in memory.
  std::size_t bytes() const;

 private:
  friend class GroundPlan;
  std::vector<std::int8_t> spectrum_;
  std::vector<float> steps_;  // that its values are multiples of, of each frequency along y
};

}  // namespace intensity_place_recognition
