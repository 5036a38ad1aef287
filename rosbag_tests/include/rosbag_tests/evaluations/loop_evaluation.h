// SPDX-License-Identifier: BSD-3-Clause
//
// What SLAM's loops are worth: key poses, edges and loops of a run through a pose graph, as a back end would.
#pragma once

#include <intensity_hector_slam/ros/bag_runner.h>
#include <mapping_simulation/trajectory.h>
#include <pose_graph/loop_check.h>

#include <cstddef>
#include <utility>
#include <vector>

namespace rosbag_tests {

/// The poses of a run, corrected by its loops.
struct CorrectedRun {
  std::vector<mapping_simulation::TimedPose> front_end;  ///< of the scans that have a pose, as SLAM told them
  std::vector<mapping_simulation::TimedPose> corrected;  ///< the same by the graph
  std::vector<intensity_hector_slam::Edge> loops;
  std::vector<bool> accepted;  ///< for each loop, by the graph
  std::size_t parts = 1;       ///< of the graph, that nothing connects
};

/// Optimises the graph of a run, leaving out loops that don't fit, and moves each scan's pose with the key
/// pose before it. Of a graph in parts, each is optimised by itself.
CorrectedRun correct(const intensity_hector_slam::BagResult& run,
                     const pose_graph::LoopCheckOptions& options = {});

/// How many loops are wrong: their transform differs from that of the reference by more than `distance` (m)
/// or `angle` (rad). Those without a pose of the reference aren't counted.
/// @return wrong ones among those the graph accepted, and among all
std::pair<std::size_t, std::size_t> wrongLoops(const CorrectedRun& run,
                                               const mapping_simulation::Trajectory& reference,
                                               double distance, double angle);

}  // namespace rosbag_tests
