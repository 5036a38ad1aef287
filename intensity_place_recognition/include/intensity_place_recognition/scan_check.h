// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "intensity_place_recognition/panorama.h"

namespace intensity_place_recognition {

/// @throws std::invalid_argument that says why places can't be recognised in a cloud: it is empty, has no
/// finite
///   point in reach, its intensities are all equal, all is in one ring, or its origin isn't where the sensor
///   was
void checkScan(const Cloud& cloud, const PanoramaOptions& options);

/// The part of the directions that several surfaces are seen in, one behind the other, 0 to 1: little where
/// the sensor is at the origin, as it sees the nearest surface only.
double transparency(const Cloud& cloud, const PanoramaOptions& options);

}  // namespace intensity_place_recognition
