// SPDX-License-Identifier: BSD-3-Clause
#include "blocks.h"

#include <algorithm>
#include <limits>
#include <optional>
#include <stdexcept>

#include "problem.h"

namespace pose_graph {
namespace {

constexpr std::size_t kNone = std::numeric_limits<std::size_t>::max();

// The nodes as trees, from the first one of each connected part on, and which of them no single edge
// separates (Tarjan 1974).
struct Blocks {
  std::vector<std::size_t> order;        // nodes, parents before children
  std::vector<std::size_t> parent_edge;  // by node; kNone: the first of its part
  std::vector<std::size_t> block;  // by node: the first node of its block, whose parent edge is a bridge

  explicit Blocks(const Graph& graph) {
    const std::size_t n = graph.nodes().size();
    std::vector<std::size_t> begin(n + 1, 0), at;
    for (const Edge& e : graph.edges())
      if (e.active) ++begin[e.from], ++begin[e.to];
    for (std::size_t i = 0, sum = 0; i <= n; ++i) {
      sum += begin[i];
      begin[i] = sum;  // the end, counted down below
    }
    at.resize(begin[n]);
    for (std::size_t e = graph.edges().size(); e-- > 0;) {
      if (!graph.edges()[e].active) continue;
      at[--begin[graph.edges()[e].from]] = e;
      at[--begin[graph.edges()[e].to]] = e;
    }
    std::vector<std::size_t> number(n, kNone), low(n), next(begin.begin(), begin.end() - 1), path;
    parent_edge.assign(n, kNone);
    order.reserve(n);
    const auto visit = [&](std::size_t node, std::size_t edge) {
      parent_edge[node] = edge;
      number[node] = low[node] = order.size();
      order.push_back(node);
      path.push_back(node);
    };
    for (std::size_t first = 0; first < n; ++first) {
      if (number[first] != kNone) continue;
      visit(first, kNone);
      while (!path.empty()) {
        const std::size_t node = path.back();
        if (next[node] < begin[node + 1]) {
          const std::size_t e = at[next[node]++];
          if (e == parent_edge[node]) continue;
          const std::size_t other = otherEnd(graph.edges()[e], node);
          if (number[other] == kNone)
            visit(other, e);
          else
            low[node] = std::min(low[node], number[other]);
        } else {
          path.pop_back();
          if (!path.empty()) low[path.back()] = std::min(low[path.back()], low[node]);
        }
      }
    }
    block.resize(n);
    for (const std::size_t node : order) {
      const bool is_first = low[node] == number[node];
      block[node] = is_first ? node : block[otherEnd(graph.edges()[parent_edge[node]], node)];
    }
  }

  static std::size_t otherEnd(const Edge& edge, std::size_t node) {
    return edge.from == node ? edge.to : edge.from;
  }
};

bool isIdentity(const Pose& pose) {
  return pose.translation.squaredNorm() < 1e-24 && pose.rotation.vec().squaredNorm() < 1e-24;
}

// Moves what hangs on single edges to where these have it.
void placeBlocks(Graph& graph, const Blocks& blocks) {
  std::vector<std::optional<Pose>> motion(graph.nodes().size());  // of blocks, by their first node
  for (const std::size_t node : blocks.order) {
    const Pose& pose = graph.nodes()[node].pose;
    if (blocks.block[node] == node && blocks.parent_edge[node] != kNone) {
      const Edge& edge = graph.edges()[blocks.parent_edge[node]];
      const Pose& parent = graph.nodes()[Blocks::otherEnd(edge, node)].pose;
      const Pose there = parent * (edge.to == node ? edge.transform : edge.transform.inverse());
      if (!isIdentity(pose.inverse() * there)) motion[node] = there * pose.inverse();
    }
    if (const auto& moved = motion[blocks.block[node]]) graph.setPose(node, *moved * pose);
  }
}

}  // namespace

OptimisationResult optimiseAround(Graph& graph, const std::vector<std::size_t>& changed,
                                  const OptimisationOptions& options, const Progress& progress) {
  const auto is_fixed = [](const Node& node) { return node.fixed; };
  // Several that are fixed make cycles, too.
  if (std::any_of(graph.nodes().begin(), graph.nodes().end(), is_fixed))
    return optimise(graph, options, progress);
  const Blocks blocks(graph);
  std::vector<bool> marked(graph.nodes().size(), false), moves(graph.nodes().size(), false);
  for (const std::size_t e : changed) {
    const Edge& edge = graph.edges()[e];
    const std::size_t a = blocks.block[edge.from], b = blocks.block[edge.to];
    if (edge.active && a != b) continue;  // it joins two parts
    marked[a] = marked[b] = true;
  }
  bool any = false;
  for (std::size_t i = 0; i < moves.size(); ++i) {
    moves[i] = marked[blocks.block[i]] && blocks.block[i] != i;
    any |= moves[i];
  }
  OptimisationResult result;
  result.converged = true;
  if (any) {
    // Single edges are followed below.
    Robustness robustness;
    for (const Edge& edge : graph.edges())
      robustness.weights.push_back(blocks.block[edge.from] == blocks.block[edge.to] ? 1.0 : 0.0);
    Problem problem(graph, robustness, moves);
    const ceres::Solver::Summary summary = problem.solve(options.max_iterations, options.tolerance, progress);
    if (!summary.IsSolutionUsable()) throw std::runtime_error("the optimisation failed: " + summary.message);
    problem.store(graph);
    result.initial_chi2 = 2.0 * summary.initial_cost;
    result.chi2 = 2.0 * summary.final_cost;
    result.iterations = summary.num_successful_steps + summary.num_unsuccessful_steps - 1;
    result.converged = summary.termination_type == ceres::CONVERGENCE;
  }
  placeBlocks(graph, blocks);
  return result;
}

}  // namespace pose_graph
