// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>
#include <vector>

#include "intensity_hector_slam/scan.h"

namespace intensity_hector_slam {

/// Neighbouring points of a scan, and the line through them. What a scan tells about the pose depends on such
/// lines: across them on where they are, along them on how their reflectivity changes.
struct SurfacePiece {
  std::size_t begin = 0, end = 0;  ///< of the scan's points
  Eigen::Vector2d centre;          ///< m, frame of the body
  Eigen::Vector2d normal;          ///< unit vector
  double normal_variance = 0.0;    ///< rad^2, of the normal's direction by the noise of the points
};

/// Cuts a scan into pieces, and leaves out single points.
/// @param length m, about; pieces of sparse scans are longer, as they have three points at least
std::vector<SurfacePiece> surfacePieces(const Scan& scan, double length);

/// Square of the reflectivity's slope along a piece, over what noise alone gives on the average: about 1
/// without any texture. NaN: not known.
double texture(const Scan& scan, const SurfacePiece& piece);

}  // namespace intensity_hector_slam
