// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <intensity_hector_slam/loop_finder.h>
#include <intensity_hector_slam/place_finder.h>
#include <mapping_common/options.h>

#include <string>

#include "pose_graph/graph.h"
#include "pose_graph/session.h"

namespace pose_graph {

struct AppearanceOptions {
  double distance = 4.0;
  double angle = 1.0;
  int scans = 20;

  void describe(mapping_common::OptionList& o);
};

/// The pose that a place known by appearance alone gets by its laser scans.
struct ScanMatch {
  bool sure = false;
  std::string why;  ///< it isn't sure
  Pose transform;   ///< of the key pose `to`, seen from `from`
  Matrix6 information = Matrix6::Identity();
};

/// Seeks the scan of one key pose in a small map of the scans around another, and the other way round.
/// Refuses what doesn't fit, or fits to several places about as well, or where the two ways differ by more
/// than they are sure of.
/// @param from, to ids of key poses
/// @param graph for the poses around `from`, and, where `drift` is known, for where to seek
/// @param drift covariance of odometry from one to the other, see OnlineGraph::drift
/// @param slam the options of the map and of the search
/// @param loop for what a map of key scans is off by
/// @throws std::runtime_error where the session can't be read
ScanMatch matchScans(const Session& session, const Graph& graph, std::int64_t from, std::int64_t to,
                     const std::optional<Matrix6>& drift, const intensity_hector_slam::SlamOptions& slam,
                     const intensity_hector_slam::LoopOptions& loop, const AppearanceOptions& options);

}  // namespace pose_graph
