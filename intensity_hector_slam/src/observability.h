// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <vector>

#include "intensity_hector_slam/beams.h"
#include "intensity_hector_slam/grid_map.h"

namespace intensity_hector_slam {

/// Least eigenvalue of an information matrix that tells anything: those of a scan with no point on an
/// occupied cell are near 0.
constexpr double kLeastInformation = 1e-3;

/// Where the points of a scan are on a map.
struct Overlap {
  std::vector<std::uint8_t> occupied;  ///< of each point, 1 where the cell is known as occupied
  double share_occupied = 0.0, share_free = 0.0;
};
Overlap overlapOf(const GridMap& map, const Beams& beams, const Pose& pose);

/// Projections of poses, with angles in units of the scan's mean range, on what the residuals of each channel
/// tell.
struct Observability {
  Eigen::Matrix3d occupancy = Eigen::Matrix3d::Identity(), reflectivity = Eigen::Matrix3d::Identity();
  bool full = true;
};

/// What a scan can tell at most depends on its surfaces alone, by Fisher's information (A. Censi, "On
/// achievable accuracy for range-finder localization", ICRA 2007): sum of J^T J with J = n^T dS/dzeta for the
/// occupancy, n the normal. Along the surfaces, only their reflectivity tells. Surfaces that the map doesn't
/// have tell nothing.
/// @param mean_range m, of the scan
Observability observe(const Scan& scan, const Overlap& overlap, const Pose& pose, double mean_range,
                      bool uses_occupancy, bool uses_reflectivity, const MatcherOptions& options);

}  // namespace intensity_hector_slam
