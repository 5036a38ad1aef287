// SPDX-License-Identifier: BSD-3-Clause
//
// What was measured while the body moved, seen from where it was at one time.
#pragma once

#include <intensity_hector_slam/slam.h>
#include <rtree_occupancy_map/sensor_path.h>

#include <cstdint>
#include <optional>

#include "pose_graph/trajectory.h"

namespace pose_graph {

/// A scan as the body sees it from where it was at the scan's stamp. Its points are all of that time then, so
/// that nobody moves them again.
/// @param stamp of the scan, ns
/// @param options `deskew`, and the speeds that a body can have: beyond, the front end has jumped
/// @return the scan as it was where the front end doesn't know the motion
intensity_hector_slam::Scan undistorted(const intensity_hector_slam::Scan& scan, std::int64_t stamp,
                                        const Trajectory& front_end,
                                        const intensity_hector_slam::SlamOptions& options);

/// Where a sensor was during a sweep, seen from the body at the stamp.
/// @param stamp ns
/// @param sensor its pose on the body
/// @param first, last s, from the stamp on
/// @return none where the front end doesn't know all of the way
std::optional<rtree_occupancy_map::SensorPath> sensorPath(const Trajectory& front_end, std::int64_t stamp,
                                                          const Pose& sensor, double first, double last);

}  // namespace pose_graph
