// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <rosbag_tests/trajectory.h>

#include "yaml_map.h"

namespace rosbag_tests {

/// Trajectory of a mapping with `poses` or `waypoints`, see loadTrajectory().
Trajectory readTrajectory(const YamlMap& map);

}  // namespace rosbag_tests
