// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <algorithm>
#include <cmath>

#include "../cost_of.h"

namespace intensity_hector_slam {

/// rho_i - R(S_i) of Eq. 3.6, where cells without a hit are black: beams end where something was hit that is
/// about as reflective.
struct Hits {
  explicit Hits(const MatcherOptions& options)
      : weight(options.occupancy_weight), scale(options.robust_scale) {}

  static constexpr Channel kChannel = Channel::kOccupancy;
  static constexpr bool kReflectivities = true;
  float weight, scale;

  static Residual at(const BeamEnds& ends, const Layers& layers) {
    const auto& r = layers.black;
    return {ends.reflectivity - r.value, r.dx, r.dy, ends.known};
  }
  static float square(const GridMap::Cell& cell, float reflectivity, float known) {
    return known * (reflectivity - cell.reflectivity) * (reflectivity - cell.reflectivity);
  }
};

/// The same with R between cells that have a reflectivity: beams end where along the surfaces the map is as
/// reflective as what they hit. Cells without a hit tell nothing of that: the share K of each beam counts.
struct Reflectivity {
  explicit Reflectivity(const MatcherOptions& options)
      : weight(options.reflectivity_weight),
        scale(options.robust_scale_reflectivity),
        search_weight(std::pow(options.robust_scale / options.robust_scale_reflectivity, 2)) {}

  static constexpr Channel kChannel = Channel::kReflectivity;
  static constexpr bool kReflectivities = true;
  float weight, scale, search_weight;

  static Residual at(const BeamEnds& ends, const Layers& layers) {
    const auto& r = layers.reflectivity;
    return {ends.reflectivity - r.value, r.dx, r.dy, ends.known * layers.coverage.value};
  }
  /// What differs much, and cells without a hit, count as the robust scale.
  float square(const GridMap::Cell& cell, float reflectivity, float known) const {
    const float e = reflectivity - cell.reflectivity, most = scale * scale;
    return known * search_weight * (GridMap::hasReflectivity(cell) ? std::min(e * e, most) : most);
  }
};

}  // namespace intensity_hector_slam
