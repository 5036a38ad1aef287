// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "pose_graph/graph.h"
#include "pose_graph/loop_check.h"

namespace pose_graph {

/// LoopCheck::kGrowth, see optimiseAndCheck.
/// @param loops the edges that aren't trusted
/// @return the last optimisation. @throws std::runtime_error where Ceres fails
OptimisationResult grow(Graph& graph, const std::vector<std::size_t>& loops, const LoopCheckOptions& options,
                        const Progress& progress);

}  // namespace pose_graph
