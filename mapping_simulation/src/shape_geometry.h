// SPDX-License-Identifier: BSD-3-Clause
// Rays against shapes, all in the frame of the shape.
#pragma once

#include <mapping_simulation/world.h>

namespace mapping_simulation {

/// Distance in units of `direction` to the first point of the surface in front of `origin`; infinite: none.
double intersect(const Shape& shape, const Eigen::Vector3d& origin, const Eigen::Vector3d& direction);

struct FacePoint {
  Eigen::Vector3d normal;  ///< unit length
  Eigen::Vector2d uv;      ///< texture coordinates, m
  int face = 0;            ///< over which they are continuous
};

/// The surface at a point on it.
FacePoint surfaceAt(const Shape& shape, const Eigen::Vector3d& point);

}  // namespace mapping_simulation
