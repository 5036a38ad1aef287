// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "../cost_of.h"

namespace intensity_hector_slam {

/// 1 - M(S_i): beams end where the map is occupied (S. Kohlbrecher et al., "A flexible and scalable SLAM
/// system with full 3D motion estimation", SSRR 2011, Eq. 7).
struct Occupancy {
  static constexpr Channel kChannel = Channel::kOccupancy;
  static double weight(const MatcherOptions& options) { return options.occupancy_weight; }

  template <class T>
  static T residual(const BeamEnd<T>& end) {
    return 1.0f - end.map;
  }
  template <class T>
  static float slope(const BeamEnd<T>&) {
    return 1.0f;
  }
  template <class T>
  static T counts(const BeamEnd<T>& end) {
    return end.valid;
  }
};

}  // namespace intensity_hector_slam
