// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstdint>
#include <vector>

#include "pose_graph/graph.h"

namespace pose_graph {

/// Which of some things agree: for each a bit for each, in words of 64.
class Agreement {
 public:
  explicit Agreement(std::size_t count) : neighbours_(count, Set((count + 63) / 64)) {}
  void set(std::size_t i, std::size_t j) {
    neighbours_[i][j / 64] |= std::uint64_t{1} << (j % 64);
    neighbours_[j][i / 64] |= std::uint64_t{1} << (i % 64);
  }
  /// A large set of which all agree with all: it grows by the candidate that leaves most candidates, from
  /// each of those that agree with most.
  std::vector<std::size_t> largeClique() const;

 private:
  using Set = std::vector<std::uint64_t>;
  std::vector<Set> neighbours_;
};

/// The chi2 of so many dimensions that a share in (0, 1) of all stays below.
double quantileOfChi2(int dimensions, double share);

/// Loops, in groups of those whose ends are neighbours: these are likely right or wrong together.
std::vector<std::vector<std::size_t>> groupsOf(const Graph& graph, const std::vector<std::size_t>& loops);

/// A large set of loops of which any two agree: the cycle over both and the odometry between their ends
/// closes, to a chi2 of `threshold`.
/// @param loops edges of the graph
/// @throws std::runtime_error where consecutive edges don't connect each node with the next
std::vector<std::size_t> consistentLoops(const Graph& graph, const std::vector<std::size_t>& loops,
                                         double threshold);

}  // namespace pose_graph
