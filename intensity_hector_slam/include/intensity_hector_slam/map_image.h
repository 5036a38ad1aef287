// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <mapping_common/map_image.h>

#include "intensity_hector_slam/grid_map.h"

namespace intensity_hector_slam {

/// The cells that an image of a map shows: all that are known; one without any.
Eigen::AlignedBox2i shownCells(const GridMap& map);

/// Occupancy, for map_server.
mapping_common::MapImage imageOf(const GridMap& map);

}  // namespace intensity_hector_slam
