// SPDX-License-Identifier: BSD-3-Clause
#include "consistency.h"

#include <algorithm>
#include <cstdint>
#include <numeric>
#include <optional>
#include <stdexcept>
#include <string>

#include "chain.h"

namespace pose_graph {
namespace {

// Of each pose. Consecutive edges have to connect it with the one before.
std::vector<ChainPose> odometryOf(const Graph& graph) {
  const std::size_t n = graph.nodes().size();
  std::vector<std::optional<Edge>> steps(n);
  for (const Edge& edge : graph.edges()) {
    if (edge.type != EdgeType::kConsecutive) continue;
    if (edge.from + 1 == edge.to)
      steps[edge.to] = edge;
    else if (edge.to + 1 == edge.from)
      steps[edge.from] = turned(edge);
  }
  std::vector<ChainPose> poses(1);
  for (std::size_t i = 1; i < n; ++i) {
    if (!steps[i])
      throw std::runtime_error("pcm needs an edge between poses " + std::to_string(graph.nodes()[i - 1].id) +
                               " and " + std::to_string(graph.nodes()[i].id));
    poses.push_back(poses.back().then(*steps[i], graph.planar()));
  }
  return poses;
}

using Set = std::vector<std::uint64_t>;
std::size_t sizeOf(const Set& set) {
  std::size_t sum = 0;
  for (const std::uint64_t word : set) sum += static_cast<std::size_t>(__builtin_popcountll(word));
  return sum;
}
std::size_t sizeOfBoth(const Set& a, const Set& b) {
  std::size_t sum = 0;
  for (std::size_t w = 0; w < a.size(); ++w)
    sum += static_cast<std::size_t>(__builtin_popcountll(a[w] & b[w]));
  return sum;
}

// A clique that grows by the candidate that leaves most candidates, from each of the nodes with most
// neighbours.
std::vector<std::size_t> largeClique(const std::vector<Set>& neighbours) {
  const std::size_t n = neighbours.size();
  std::vector<std::size_t> degree(n), order(n), best;
  for (std::size_t i = 0; i < n; ++i) degree[i] = sizeOf(neighbours[i]);
  std::iota(order.begin(), order.end(), 0);
  std::stable_sort(order.begin(), order.end(),
                   [&](std::size_t a, std::size_t b) { return degree[a] > degree[b]; });
  constexpr std::size_t kSeeds = 3;
  for (std::size_t s = 0; s < std::min(n, kSeeds); ++s) {
    std::vector<std::size_t> clique = {order[s]};
    Set candidates = neighbours[order[s]];
    std::vector<std::size_t> left;
    for (const std::size_t i : order)
      if ((candidates[i / 64] >> (i % 64) & 1) != 0) left.push_back(i);
    while (!left.empty()) {
      std::size_t next = left.front(), most = 0;
      for (const std::size_t i : left) {
        const std::size_t size = sizeOfBoth(candidates, neighbours[i]);
        if (size > most) next = i, most = size;
        if (most + 1 >= left.size()) break;  // a neighbour of all
      }
      clique.push_back(next);
      for (std::size_t w = 0; w < candidates.size(); ++w) candidates[w] &= neighbours[next][w];
      left.erase(std::remove_if(left.begin(), left.end(),
                                [&](std::size_t i) { return (candidates[i / 64] >> (i % 64) & 1) == 0; }),
                 left.end());
    }
    if (clique.size() > best.size()) best = clique;
  }
  return best;
}

// Which loops agree with which.
std::vector<Set> agreements(const Graph& graph, const std::vector<std::size_t>& loops, double threshold) {
  const std::vector<ChainPose> odometry = odometryOf(graph);
  std::vector<Shift> shifts;
  for (const std::size_t e : loops) {
    const Edge& edge = graph.edges()[e];
    shifts.emplace_back(edge, odometry[edge.from], odometry[edge.to], graph.planar());
  }
  const std::size_t n = shifts.size();
  std::vector<Set> neighbours(n, Set((n + 63) / 64));
  for (std::size_t i = 0; i < n; ++i)
    for (std::size_t j = 0; j < i; ++j) {
      if (shifts[i].disagreement(shifts[j]) > threshold) continue;
      neighbours[i][j / 64] |= std::uint64_t{1} << (j % 64);
      neighbours[j][i / 64] |= std::uint64_t{1} << (i % 64);
    }
  return neighbours;
}

}  // namespace

std::vector<std::size_t> consistentLoops(const Graph& graph, const std::vector<std::size_t>& loops,
                                         double threshold) {
  std::vector<std::size_t> kept;
  for (const std::size_t i : largeClique(agreements(graph, loops, threshold))) kept.push_back(loops[i]);
  return kept;
}

}  // namespace pose_graph
