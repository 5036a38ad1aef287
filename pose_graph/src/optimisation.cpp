// SPDX-License-Identifier: BSD-3-Clause
#include "pose_graph/optimisation.h"

#include <optional>
#include <stdexcept>
#include <utility>

#include "pose_graph/initialisation.h"
#include "problem.h"

namespace pose_graph {

void OptimisationOptions::describe(mapping_common::OptionList& o) {
  o("max_iterations", max_iterations, "", "the most iterations of an optimisation").within(1, 100000);
  o("tolerance", tolerance, "", "an optimisation ends when an iteration lessens chi2 by less than this share")
      .within(0.0, 1.0);
}

OptimisationResult optimise(Graph& graph, const OptimisationOptions& options, const Progress& progress) {
  mapping_common::validate(options);
  OptimisationResult result;
  result.initial_chi2 = graph.chi2();
  Problem problem(graph);
  const ceres::Solver::Summary summary = problem.solve(options.max_iterations, options.tolerance, progress);
  if (!summary.IsSolutionUsable()) throw std::runtime_error("the optimisation failed: " + summary.message);
  problem.store(graph);
  result.chi2 = graph.chi2();
  result.iterations = summary.num_successful_steps + summary.num_unsuccessful_steps - 1;
  result.converged = summary.termination_type == ceres::CONVERGENCE;
  return result;
}

OptimisationResult optimiseFrom(Start start, Graph& graph, const OptimisationOptions& options,
                                const Progress& progress) {
  if (start == Start::kOdometry) startFromOdometry(graph);
  if (start == Start::kChordal) startFromChords(graph);
  if (start != Start::kBest) return optimise(graph, options, progress);
  std::optional<OptimisationResult> best;
  Graph kept;
  for (const Start each : {Start::kChordal, Start::kPoses, Start::kOdometry}) {
    Graph tried = graph;
    // What is far from the best after some iterations won't be better, and may take many more.
    const Progress watch = [&](int iteration, double chi2) {
      const bool hopeless = best && iteration >= 10 && chi2 > 2.0 * best->chi2;
      return !hopeless && (!progress || progress(iteration, chi2));
    };
    const OptimisationResult result = optimiseFrom(each, tried, options, watch);
    if (best && result.chi2 >= best->chi2) continue;
    best = result;
    kept = std::move(tried);
  }
  graph = std::move(kept);
  return *best;
}

}  // namespace pose_graph
