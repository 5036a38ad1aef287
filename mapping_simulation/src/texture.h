// SPDX-License-Identifier: BSD-3-Clause
//
// Random fields over a plane, the same wherever and whenever they are asked.
#pragma once

#include <Eigen/Core>
#include <cmath>
#include <cstdint>

#include "mapping_simulation/world.h"

namespace mapping_simulation {

/// A random number in [0, 1) for each cell of a grid.
inline double cellValue(std::int64_t x, std::int64_t y, std::uint32_t seed) {
  std::uint64_t h = static_cast<std::uint64_t>(x) * 0x9E3779B97F4A7C15u ^
                    static_cast<std::uint64_t>(y) * 0xC2B2AE3D27D4EB4Fu ^ (seed + 1ull) * 0x165667B19E3779F9u;
  h = (h ^ (h >> 31)) * 0xBF58476D1CE4E5B9u;
  h = (h ^ (h >> 29)) * 0x94D049BB133111EBu;
  return static_cast<double>((h ^ (h >> 32)) >> 11) * 0x1p-53;
}

/// Cell values as they are at the corners of cells of width 1, with smooth steps between.
inline double smoothNoise(double x, double y, std::uint32_t seed) {
  const double u = std::floor(x), v = std::floor(y);
  const auto i = static_cast<std::int64_t>(u), j = static_cast<std::int64_t>(v);
  const auto smooth = [](double s) { return s * s * (3.0 - 2.0 * s); };
  const double s = smooth(x - u), t = smooth(y - v);
  return (1.0 - t) * ((1.0 - s) * cellValue(i, j, seed) + s * cellValue(i + 1, j, seed)) +
         t * ((1.0 - s) * cellValue(i, j + 1, seed) + s * cellValue(i + 1, j + 1, seed));
}

/// The front of a house at a point of it, without detail. @param texture of type kFacade
Appearance facadeAt(const Texture& texture, const Eigen::Vector2d& uv);

}  // namespace mapping_simulation
