// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <mapping_common/options.h>

#include <functional>

#include "pose_graph/graph.h"

namespace pose_graph {

struct OptimisationOptions {
  int max_iterations = 200;
  double tolerance = 1e-10;

  void describe(mapping_common::OptionList& o);
};

struct OptimisationResult {
  double initial_chi2 = 0.0, chi2 = 0.0;  ///< of all active edges
  int iterations = 0;
  bool converged = false;
};

/// Gets the number of an iteration and chi2 after it; false ends the optimisation.
using Progress = std::function<bool(int iteration, double chi2)>;

/// Moves the poses to where chi2 of the active edges is least, near where they are: Levenberg and Marquardt's
/// method by Ceres, with sparse Cholesky factors. Fixed nodes stay, and in a connected part without any, its
/// first.
/// @throws std::invalid_argument for options; std::runtime_error where Ceres fails, poses being as they were
OptimisationResult optimise(Graph& graph, const OptimisationOptions& options = {},
                            const Progress& progress = {});

/// Where an optimisation begins.
enum class Start { kBest, kPoses, kOdometry, kChordal };
constexpr auto choicesOf(Start) {
  return mapping_common::choices<Start>(
      {{"best", Start::kBest, "all of these; the least chi2 is kept"},
       {"poses", Start::kPoses, "the poses that the graph has"},
       {"odometry", Start::kOdometry, "a chain of consecutive edges"},
       {"chordal", Start::kChordal, "linear least squares, without any guess"}});
}

/// The same from another start.
/// @param progress is asked for each start; the number of the iteration begins anew
OptimisationResult optimiseFrom(Start start, Graph& graph, const OptimisationOptions& options = {},
                                const Progress& progress = {});

}  // namespace pose_graph
