// SPDX-License-Identifier: BSD-3-Clause
//
// A graph as a problem for Ceres.
#pragma once

#include <ceres/ceres.h>

#include <array>
#include <functional>
#include <memory>
#include <vector>

#include "pose_graph/graph.h"

namespace pose_graph {

/// Of edges that aren't consecutive, for Problem.
struct Robustness {
  /// Dynamic covariance scaling with this Phi; 0: plain squares.
  double phi = 0.0;
  /// For each edge of the graph, what its chi2 is multiplied by; empty: 1. Those of 0 are left out.
  std::vector<double> weights;
};

/// An edge's error at where the poses are, and its derivatives by what its poses change by: x y yaw in the
/// plane, else a translation in the map and a rotation vector in the body. All are whitened: multiplied by a
/// root of the information. The first graph.dimension() rows and columns count.
struct LinearEdge {
  Vector6 residual = Vector6::Zero();
  Matrix6 by_from = Matrix6::Zero(), by_to = Matrix6::Zero();
};
LinearEdge linearise(const Graph& graph, std::size_t edge);

class Problem {
 public:
  /// @param moves for each node whether its pose may change; empty: all but the anchors. Edges between nodes
  /// that stay are left out.
  explicit Problem(const Graph& graph, const Robustness& robustness = {},
                   const std::vector<bool>& moves = {});

  /// @param progress gets chi2 after each iteration, and ends it by false
  ceres::Solver::Summary solve(int max_iterations, double tolerance,
                               const std::function<bool(int, double)>& progress = {});
  /// Writes the poses that may have changed.
  void store(Graph& graph) const;

 private:
  bool planar_;
  std::vector<std::array<double, 7>> poses_;
  std::vector<bool> moves_;
  ceres::Problem problem_;
};

}  // namespace pose_graph
