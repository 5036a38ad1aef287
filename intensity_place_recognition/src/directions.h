// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <algorithm>
#include <cstddef>

#include "intensity_place_recognition/panorama.h"

namespace intensity_place_recognition {

/// Where some points are seen, all at once, which is several times as fast as one by one.
struct Directions {
  static constexpr int kMost = 256;
  float azimuth[kMost], elevation[kMost];  ///< rad
  float flat[kMost], squared[kMost];       ///< m from the vertical axis; m2 from the sensor, 0: not measured
};

/// @param count at most Directions::kMost
void toDirections(const pcl::PointXYZI* points, int count, Directions& out);

/// Calls use(point, directions, index in them) for all points.
template <class Use>
void forEachDirection(const pcl::PointXYZI* points, std::size_t count, const Use& use) {
  Directions directions;
  for (std::size_t first = 0; first < count; first += Directions::kMost) {
    const int some = static_cast<int>(std::min<std::size_t>(Directions::kMost, count - first));
    toDirections(points + first, some, directions);
    for (int i = 0; i < some; ++i) use(points[first + i], directions, i);
  }
}

}  // namespace intensity_place_recognition
