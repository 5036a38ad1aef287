// SPDX-License-Identifier: BSD-3-Clause
//
// How sure a graph is of what a loop measures.
#pragma once

#include <Eigen/Core>
#include <Eigen/SparseCholesky>
#include <vector>

#include "pose_graph/graph.h"

namespace pose_graph {

/// The joint covariance of all poses at where they are, by the active edges, as a sparse Cholesky factor.
class Uncertainty {
 public:
  /// Parts that no active edge connects with the first or with a fixed pose are taken to lie anywhere within
  /// some kilometres. @throws std::runtime_error where information leaves poses undetermined
  explicit Uncertainty(const Graph& graph);

  /// Of loops that all are active, or all aren't: their errors and the covariance of these, both whitened by
  /// the loops' information. With Y Y^T that of the poses alone, it is I + Y Y^T of loops that aren't in the
  /// graph, and I - Y Y^T of those that are, which have drawn the poses to them. Squared errors over it are
  /// what the loops add to chi2, or have added.
  struct Errors {
    Eigen::VectorXd errors;      ///< graph.dimension() for each loop
    Eigen::MatrixXd covariance;  ///< of all these
  };
  Errors errors(const std::vector<std::size_t>& loops);

 private:
  using Matrix = Eigen::SparseMatrix<double>;
  template <int N>
  void eliminate(const std::vector<Eigen::Index>& path);
  const Graph& graph_;
  int dimension_;
  std::vector<Eigen::Index> columns_;  // of each node, before the factor permutes them; -1: it stays
  Eigen::SimplicialLLT<Matrix> factor_;
  // All zero and false between calls.
  Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor> rows_;
  std::vector<bool> reached_;
};

}  // namespace pose_graph
