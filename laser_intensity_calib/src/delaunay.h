// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>
#include <array>
#include <vector>

namespace laser_intensity_calib {

using Triangle = std::array<int, 3>;

/// Delaunay triangulation of points in the plane: columns that each triangle's corners are in.
/// @throws std::invalid_argument if there are fewer than 3 points or all are on a line
std::vector<Triangle> triangulate(const Eigen::Matrix2Xd& points);

}  // namespace laser_intensity_calib
