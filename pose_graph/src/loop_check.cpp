// SPDX-License-Identifier: BSD-3-Clause
#include "pose_graph/loop_check.h"

#include <algorithm>
#include <cmath>
#include <stdexcept>
#include <utility>

#include "consistency.h"
#include "growth.h"
#include "problem.h"

namespace pose_graph {
namespace {

// Solves to about where the next weights are known, not to the end.
void solveRoughly(Graph& graph, const Robustness& robustness, int iterations, const Progress& progress) {
  Problem problem(graph, robustness);
  problem.solve(iterations, 1e-3, progress);
  problem.store(graph);
}

std::vector<std::size_t> loopsOf(const Graph& graph) {
  std::vector<std::size_t> loops;
  for (std::size_t e = 0; e < graph.edges().size(); ++e)
    if (graph.edges()[e].type != EdgeType::kConsecutive) loops.push_back(e);
  return loops;
}

class Check {
 public:
  Check(Graph& graph, const LoopCheckOptions& options, const Progress& progress)
      : graph_(graph),
        options_(options),
        progress_(progress),
        c2_(options.threshold(graph.dimension())),
        loops_(loopsOf(graph)) {}

  void graduatedNonConvexity() {
    activateAll();
    double worst = 0.0;
    for (const std::size_t e : loops_) worst = std::max(worst, graph_.chi2(e));
    if (2.0 * worst <= c2_) return;
    Robustness robustness;
    robustness.weights.assign(graph_.edges().size(), 1.0);
    // The surrogate of mu is convex up to the worst residual at first, and the truncated square at
    // last.
    for (double mu = c2_ / (2.0 * worst - c2_); mu < 1e3; mu *= kGrowth) {
      bool binary = true;
      for (const std::size_t e : loops_) {
        const double chi2 = graph_.chi2(e);
        double& weight = robustness.weights[e];
        if (chi2 >= (mu + 1.0) / mu * c2_) {
          weight = 0.0;
        } else if (chi2 <= mu / (mu + 1.0) * c2_) {
          weight = 1.0;
        } else {
          weight = std::sqrt(c2_ * mu * (mu + 1.0) / chi2) - mu;
          binary = false;
        }
      }
      if (binary) return;
      solveRoughly(graph_, robustness, 2, progress_);
    }
  }

  void pairwiseConsistency() {
    for (const std::size_t e : loops_) graph_.setActive(e, false);
    for (const std::size_t e : consistentLoops(graph_, loops_, c2_)) graph_.setActive(e, true);
    solve();
  }

  void dynamicCovarianceScaling() {
    activateAll();
    Robustness robustness;
    robustness.phi = c2_;
    Problem problem(graph_, robustness);
    problem.solve(options_.optimisation.max_iterations, 1e-6, progress_);
    problem.store(graph_);
  }

  // What fits is accepted, what doesn't is not, until no more change.
  OptimisationResult settle() {
    OptimisationResult result;
    for (int round = 0; round < 10; ++round) {
      bool changed = false;
      for (const std::size_t e : loops_) {
        const bool fits = graph_.chi2(e) <= c2_;
        changed |= fits != graph_.edges()[e].active;
        graph_.setActive(e, fits);
      }
      if (round > 0 && !changed) break;
      result = solve();
    }
    return result;
  }

  // Groups of wrong loops that agree with each other may fit, and bend the odometry between. What truncated
  // least squares are without a group tells: those with the largest residuals are tried.
  OptimisationResult doubt(OptimisationResult result) {
    double cost = truncatedCost(graph_);
    bool better = true;
    int doubts = 0;
    while (better && doubts < options_.max_doubts) {
      better = false;
      for (const std::vector<std::size_t>& group : groups()) {
        const double removed = c2_ * static_cast<double>(group.size());
        if (result.chi2 < removed) continue;  // more than there is to be gained
        if (++doubts > options_.max_doubts) break;
        Graph tried = graph_;
        for (const std::size_t e : group) tried.setActive(e, false);
        optimise(tried, options_.optimisation, progress_);
        const double tried_cost = truncatedCost(tried);
        if (tried_cost > cost - 0.01 * c2_) continue;
        graph_ = std::move(tried);
        result = settle();
        cost = truncatedCost(graph_);
        better = true;
        break;
      }
    }
    return result;
  }

 private:
  static constexpr double kGrowth = 2.0;  // of mu

  // From the poses as they are, and from the chordal start, which some graphs need.
  OptimisationResult solve() {
    Graph other = graph_;
    const OptimisationResult result = optimise(graph_, options_.optimisation, progress_);
    const OptimisationResult chordal = optimiseFrom(Start::kChordal, other, options_.optimisation, progress_);
    if (chordal.chi2 >= result.chi2) return result;
    graph_ = std::move(other);
    return chordal;
  }
  double truncatedCost(const Graph& graph) const {
    double cost = 0.0;
    for (std::size_t e = 0; e < graph.edges().size(); ++e)
      cost += graph.edges()[e].type == EdgeType::kConsecutive ? graph.chi2(e) : std::min(c2_, graph.chi2(e));
    return cost;
  }

  // Active loops whose ends are neighbours, those with the largest sums of chi2 first.
  std::vector<std::vector<std::size_t>> groups() const {
    constexpr std::size_t kMost = 20;
    std::vector<std::size_t> active;
    for (const std::size_t e : loops_)
      if (graph_.edges()[e].active) active.push_back(e);
    std::vector<std::vector<std::size_t>> all = groupsOf(graph_, active);
    const auto sum = [&](const std::vector<std::size_t>& group) {
      double chi2 = 0.0;
      for (const std::size_t e : group) chi2 += graph_.chi2(e);
      return chi2;
    };
    std::stable_sort(all.begin(), all.end(), [&](const auto& a, const auto& b) { return sum(a) > sum(b); });
    if (all.size() > kMost) all.resize(kMost);
    return all;
  }

  void activateAll() {
    for (const std::size_t e : loops_) graph_.setActive(e, true);
  }
  Graph& graph_;
  const LoopCheckOptions& options_;
  const Progress& progress_;
  double c2_;
  std::vector<std::size_t> loops_;
};

}  // namespace

void LoopCheckOptions::describe(mapping_common::OptionList& o) {
  o("loop_check", method, "", "how wrong loops are found");
  o("confidence", confidence, "", "share of right loops that is accepted, if their information is right")
      .above(0.5)
      .below(1.0);
  o("max_doubts", max_doubts, "", "optimisations without some group of accepted loops").within(0, 1000000);
  optimisation.describe(o);
}

double LoopCheckOptions::threshold(int dimension) const {
  return quantileOfChi2(dimension, confidence);
}

LoopCheckResult optimiseAndCheck(Graph& graph, const LoopCheckOptions& options, const Progress& progress) {
  mapping_common::validate(options);
  std::vector<bool> before;
  for (const Edge& edge : graph.edges()) before.push_back(edge.active);
  LoopCheckResult result;
  if (options.method == LoopCheck::kNone) {
    result.optimisation = optimise(graph, options.optimisation, progress);
  } else if (options.method == LoopCheck::kGrowth) {
    result.optimisation = grow(graph, loopsOf(graph), options, progress);
  } else {
    Check check(graph, options, progress);
    if (options.method == LoopCheck::kGnc) check.graduatedNonConvexity();
    if (options.method == LoopCheck::kPcm) check.pairwiseConsistency();
    if (options.method == LoopCheck::kDcs) check.dynamicCovarianceScaling();
    result.optimisation = check.doubt(check.settle());
  }
  for (std::size_t e = 0; e < before.size(); ++e)
    if (graph.edges()[e].active != before[e]) (before[e] ? result.revoked : result.accepted).push_back(e);
  return result;
}

}  // namespace pose_graph
