// SPDX-License-Identifier: BSD-3-Clause
//
// What stands where and how light it is, seen from above in coarse cells, to order places by before they are
// registered.
#pragma once

#include <vector>

#include "intensity_place_recognition/shape.h"

namespace intensity_place_recognition {

/// A query's or a place's plan. Its spectrum makes the correlation at all shifts a product.
class GroundPlan {
 public:
  GroundPlan() = default;
  /// @param yaw rad, that the sensor is turned by
  GroundPlan(const Shape& shape, double yaw);

  bool empty() const { return real_.empty(); }

  struct Shift {
    float correlation = -1.0f;  ///< of what stands where and of how light it is together, -1 to 1
    float x = 0.0f, y = 0.0f;   ///< m, of the query's sensor seen from the place's
  };
  /// The best shift of at most `reach` (m) that moves this one's content onto that of `place`.
  Shift bestShift(const GroundPlan& place, float reach) const;

 private:
  std::vector<float> real_, imaginary_;  // channels x frequencies
};

}  // namespace intensity_place_recognition
