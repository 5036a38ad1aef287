// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "intensity_hector_slam/beams.h"
#include "intensity_hector_slam/grid_map.h"

namespace intensity_hector_slam {

/// The best of all poses around a guess on a grid as fine as the cells, with the nearest cells instead of
/// interpolation.
/// @param options what starts with search_
Pose searchWindow(const GridMap& map, const Beams& beams, const Pose& guess, float occupancy_weight,
                  float reflectivity_weight, const MatcherOptions& options);

}  // namespace intensity_hector_slam
