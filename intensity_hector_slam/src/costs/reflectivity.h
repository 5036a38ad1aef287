// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "../cost_of.h"

namespace intensity_hector_slam {

/// rho_i - R(S_i): beams end where the map is as reflective as what they hit (Eq. 3.6).
struct Reflectivity {
  static constexpr Channel kChannel = Channel::kReflectivity;
  static double weight(const MatcherOptions& options) { return options.reflectivity_weight; }

  template <class T>
  static T residual(const BeamEnd<T>& end) {
    return end.reflectivity - end.map;
  }
  template <class T>
  static float slope(const BeamEnd<T>&) {
    return 1.0f;
  }
  template <class T>
  static T counts(const BeamEnd<T>& end) {
    return end.known;
  }
};

}  // namespace intensity_hector_slam
