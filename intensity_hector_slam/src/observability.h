// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>

#include "intensity_hector_slam/beams.h"
#include "intensity_hector_slam/grid_map.h"

namespace intensity_hector_slam {

/// Least eigenvalue of an information matrix that tells anything: those of a scan with no point on an
/// occupied cell are near 0.
constexpr double kLeastInformation = 1e-3;

/// Shares of a scan's points in cells known as occupied and as free.
struct Overlap {
  double occupied = 0.0, free = 0.0;
};
Overlap overlapOf(const GridMap& map, const Beams& beams, const Pose& pose);

/// Projections of poses, with angles in units of the scan's mean range, on what the residuals of each channel
/// tell.
struct Observability {
  Eigen::Matrix3d occupancy = Eigen::Matrix3d::Identity(), reflectivity = Eigen::Matrix3d::Identity();
  /// Covariance of a pose by points whose noise along the normals is 1 m, with normals as uneven: large where
  /// few normals tell.
  Eigen::Matrix3d uncertainty = Eigen::Matrix3d::Zero();
  bool full = true;
  double share = 0.0;  ///< of the surfaces' points on those that the map has
};

/// What a scan can tell at most depends on its surfaces alone, by Fisher's information (A. Censi, "On
/// achievable accuracy for range-finder localization", ICRA 2007): sum of J^T J with J = n^T dS/dzeta for the
/// occupancy, n the normal. Along the surfaces, only their reflectivity tells. Surfaces that the map doesn't
/// have tell nothing.
/// @param mean_range m, of the scan
Observability observe(const Scan& scan, const GridMap& map, const Pose& pose, double mean_range,
                      bool uses_occupancy, bool uses_reflectivity, const MatcherOptions& options);

}  // namespace intensity_hector_slam
