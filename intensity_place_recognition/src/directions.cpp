// SPDX-License-Identifier: BSD-3-Clause
#include "directions.h"

#include <cmath>

#include "fast_atan2.h"
#include "vectorised.h"

namespace intensity_place_recognition {

INTENSITY_PLACE_RECOGNITION_VECTORISED
void toDirections(const pcl::PointXYZI* points, int count, Directions& out) {
  float x[Directions::kMost], y[Directions::kMost], z[Directions::kMost];
  for (int i = 0; i < count; ++i) {
    x[i] = points[i].x;
    y[i] = points[i].y;
    z[i] = points[i].z;
  }
  for (int i = 0; i < count; ++i) {
    const float flat = x[i] * x[i] + y[i] * y[i];
    out.squared[i] = flat + z[i] * z[i];
    out.flat[i] = std::sqrt(flat);
  }
  for (int i = 0; i < count; ++i) out.azimuth[i] = fastAtan2(y[i], x[i]);
  for (int i = 0; i < count; ++i) out.elevation[i] = fastAtan2(z[i], out.flat[i]);
  for (int i = 0; i < count; ++i)
    if (!isMeasured(points[i])) out.squared[i] = 0.0f;
}

}  // namespace intensity_place_recognition
