// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <algorithm>
#include <vector>

#include "../observability.h"
#include "occupancy.h"
#include "reflectivity.h"

namespace intensity_hector_slam {

/// Both kinds of residuals, or the occupancy's alone: reflectivity needs normals, and so dense points
/// (section 3.6).
class AutoCost : public CostOf<Occupancy, Reflectivity> {
 public:
  explicit AutoCost(const MatcherOptions& options)
      : CostOf(options),
        occupancy_(makeCost("occupancy", options)),
        combined_(makeCost("combined", options)) {}

  const Cost& choose(const GridMap& map, const Scan& scan, const Beams& beams,
                     const Pose& guess) const override {
    if (beams.share_known < options_.auto_min_known) return *occupancy_;
    std::vector<float> spacing;
    for (std::size_t i = 1; i < scan.points.size(); ++i) {
      spacing.push_back((scan.points[i] - scan.points[i - 1]).norm());
    }
    const auto middle = spacing.begin() + spacing.size() / 2;
    std::nth_element(spacing.begin(), middle, spacing.end());
    if (middle == spacing.end() || *middle <= options_.auto_max_spacing) return *combined_;
    const bool enough = observe(scan, map, guess, beams.mean_range, true, false, options_).full;
    return enough ? *occupancy_ : *combined_;
  }

 private:
  std::shared_ptr<const Cost> occupancy_, combined_;
};

}  // namespace intensity_hector_slam
