// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <algorithm>
#include <cmath>

namespace intensity_place_recognition {

/// atan2 of finite numbers to some 1e-6 rad, in a third of the time (Abramowitz and Stegun 1964, 4.4.49).
inline float fastAtan2(float y, float x) {
  const float across = std::abs(x), up = std::abs(y);
  const float t = std::min(across, up) / std::max(std::max(across, up), 1e-30f), s = t * t;
  float angle =
      t + t * s *
              (-0.3333314528f +
               s * (0.1999355085f +
                    s * (-0.1420889944f +
                         s * (0.1065626393f +
                              s * (-0.0752896400f +
                                   s * (0.0429096138f + s * (-0.0161657367f + s * 0.0028662257f)))))));
  // No branches, so that several are computed at once.
  const float steep = static_cast<float>(M_PI_2) - angle;
  angle = up > across ? steep : angle;
  const float behind = static_cast<float>(M_PI) - angle;
  angle = x < 0.0f ? behind : angle;
  return std::copysign(angle, y);
}

}  // namespace intensity_place_recognition
