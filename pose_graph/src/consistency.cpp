// SPDX-License-Identifier: BSD-3-Clause
#include "consistency.h"

#include <algorithm>
#include <boost/math/distributions/chi_squared.hpp>
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

// Which loops agree with which.
Agreement agreements(const Graph& graph, const std::vector<std::size_t>& loops, double threshold) {
  const std::vector<ChainPose> odometry = odometryOf(graph);
  std::vector<Shift> shifts;
  for (const std::size_t e : loops) {
    const Edge& edge = graph.edges()[e];
    shifts.emplace_back(edge, odometry[edge.from], odometry[edge.to], graph.planar());
  }
  const std::size_t n = shifts.size();
  Agreement agreement(n);
  for (std::size_t i = 0; i < n; ++i)
    for (std::size_t j = 0; j < i; ++j)
      if (shifts[i].disagreement(shifts[j]) <= threshold) agreement.set(i, j);
  return agreement;
}

}  // namespace

std::vector<std::size_t> Agreement::largeClique() const {
  const std::size_t n = neighbours_.size();
  std::vector<std::size_t> degree(n), order(n), best;
  for (std::size_t i = 0; i < n; ++i) degree[i] = sizeOf(neighbours_[i]);
  std::iota(order.begin(), order.end(), 0);
  std::stable_sort(order.begin(), order.end(),
                   [&](std::size_t a, std::size_t b) { return degree[a] > degree[b]; });
  constexpr std::size_t kSeeds = 3;
  for (std::size_t s = 0; s < std::min(n, kSeeds); ++s) {
    std::vector<std::size_t> clique = {order[s]};
    Set candidates = neighbours_[order[s]];
    std::vector<std::size_t> left;
    for (const std::size_t i : order)
      if ((candidates[i / 64] >> (i % 64) & 1) != 0) left.push_back(i);
    while (!left.empty()) {
      std::size_t next = left.front(), most = 0;
      for (const std::size_t i : left) {
        const std::size_t size = sizeOfBoth(candidates, neighbours_[i]);
        if (size > most) next = i, most = size;
        if (most + 1 >= left.size()) break;  // a neighbour of all
      }
      clique.push_back(next);
      for (std::size_t w = 0; w < candidates.size(); ++w) candidates[w] &= neighbours_[next][w];
      left.erase(std::remove_if(left.begin(), left.end(),
                                [&](std::size_t i) { return (candidates[i / 64] >> (i % 64) & 1) == 0; }),
                 left.end());
    }
    if (clique.size() > best.size()) best = clique;
  }
  return best;
}

double quantileOfChi2(int dimensions, double share) {
  return boost::math::quantile(boost::math::chi_squared(dimensions), share);
}

std::vector<std::vector<std::size_t>> groupsOf(const Graph& graph, const std::vector<std::size_t>& loops) {
  constexpr std::size_t kReach = 5;  // poses
  std::vector<std::vector<std::size_t>> groups;
  const auto near = [](std::size_t a, std::size_t b) { return a < b + kReach && b < a + kReach; };
  for (const std::size_t e : loops) {
    const Edge& edge = graph.edges()[e];
    const auto group = std::find_if(groups.begin(), groups.end(), [&](const auto& g) {
      const Edge& last = graph.edges()[g.back()];
      return near(last.from, edge.from) && near(last.to, edge.to);
    });
    if (group == groups.end())
      groups.push_back({e});
    else
      group->push_back(e);
  }
  return groups;
}

std::vector<std::size_t> consistentLoops(const Graph& graph, const std::vector<std::size_t>& loops,
                                         double threshold) {
  std::vector<std::size_t> kept;
  for (const std::size_t i : agreements(graph, loops, threshold).largeClique()) kept.push_back(loops[i]);
  return kept;
}

}  // namespace pose_graph
