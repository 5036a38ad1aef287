// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <vector>

#include "pose_graph/optimisation.h"

namespace pose_graph {

/// Optimises again after edges became active or inactive. Only poses on cycles with these can change among
/// each other: the rest of the graph, which hangs on them by single edges, moves as rigid bodies. All of it
/// has to be optimal but for these edges.
/// @param changed edges that have become active or inactive
/// @return chi2 of the edges of those cycles alone
/// @throws as optimise
OptimisationResult optimiseAround(Graph& graph, const std::vector<std::size_t>& changed,
                                  const OptimisationOptions& options, const Progress& progress);

}  // namespace pose_graph
