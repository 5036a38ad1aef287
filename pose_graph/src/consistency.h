// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <vector>

#include "pose_graph/graph.h"

namespace pose_graph {

/// A large set of loops of which any two agree: the cycle over both and the odometry between their ends
/// closes, to a chi2 of `threshold`.
/// @param loops edges of the graph
/// @throws std::runtime_error where consecutive edges don't connect each node with the next
std::vector<std::size_t> consistentLoops(const Graph& graph, const std::vector<std::size_t>& loops,
                                         double threshold);

}  // namespace pose_graph
