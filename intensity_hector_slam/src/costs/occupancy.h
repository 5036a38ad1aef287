// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "../cost_of.h"

namespace intensity_hector_slam {

/// 1 - M(S_i): beams end where the map is occupied (S. Kohlbrecher et al., "A flexible and scalable SLAM
/// system with full 3D motion estimation", SSRR 2011, Eq. 7).
struct Occupancy {
  explicit Occupancy(const MatcherOptions& options)
      : weight(options.occupancy_weight), scale(options.robust_scale) {}

  static constexpr Channel kChannel = Channel::kOccupancy;
  static constexpr bool kReflectivities = false;
  float weight, scale;

  static Residual at(const BeamEnds& ends, const Layers& layers) {
    const auto& m = layers.occupancy;
    return {1.0f - m.value, m.dx, m.dy, ends.valid};
  }
  static float square(const GridMap::Cell& cell, float, float) {
    return (1.0f - cell.occupancy) * (1.0f - cell.occupancy);
  }
};

}  // namespace intensity_hector_slam
