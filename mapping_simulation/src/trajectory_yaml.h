// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <mapping_simulation/trajectory.h>
#include <mapping_simulation/yaml_map.h>

namespace mapping_simulation {

/// Trajectory of a mapping with `poses` or `waypoints`, see loadTrajectory().
Trajectory readTrajectory(const YamlMap& map);

}  // namespace mapping_simulation
