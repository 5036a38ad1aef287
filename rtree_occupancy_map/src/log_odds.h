// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cmath>

#include "rtree_occupancy_map/options.h"

namespace rtree_occupancy_map {

/// l(p) = log(p / (1 - p)), below Eq. 2.7. Single precision, as the cells hold it.
inline float logOdds(double probability) {
  return static_cast<float>(std::log(probability / (1.0 - probability)));
}

/// The update of Eq. 2.7 for one sensor: l(g|z_1:t) = l(g|z_1:t-1) + (l(g|z_t) - l_0), clamped.
struct LogOddsModel {
  float prior, hit, miss, min, max, occupied;

  explicit LogOddsModel(const Options& o)
      : prior(logOdds(o.prior)),
        hit(logOdds(o.prob_hit) - prior),
        miss(logOdds(o.prob_miss) - prior),
        min(logOdds(o.clamping_min)),
        max(logOdds(o.clamping_max)),
        occupied(logOdds(o.occupancy_threshold)) {}
};

}  // namespace rtree_occupancy_map
