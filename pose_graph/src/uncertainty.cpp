// SPDX-License-Identifier: BSD-3-Clause
#include "uncertainty.h"

#include <algorithm>
#include <stdexcept>
#include <utility>

#include "problem.h"

namespace pose_graph {

Uncertainty::Uncertainty(const Graph& graph) : graph_(graph), dimension_(graph.dimension()) {
  const std::vector<bool> anchored = anchors(graph);
  Eigen::Index size = 0;
  for (std::size_t i = 0; i < graph.nodes().size(); ++i) {
    const bool stays = anchored[i] && (i == 0 || graph.nodes()[i].fixed);
    columns_.push_back(stays ? -1 : size);
    if (!stays) size += dimension_;
  }
  std::vector<Eigen::Triplet<double>> entries;
  const auto add = [&](Eigen::Index row, Eigen::Index column, const Matrix6& block) {
    if (row < 0 || column < 0) return;
    for (int r = 0; r < dimension_; ++r)
      for (int c = 0; c < dimension_; ++c)
        if (row + r >= column + c) entries.emplace_back(row + r, column + c, block(r, c));
  };
  constexpr double kLeast = 1e-6;  // 1 / m^2, 1 / rad^2
  for (std::size_t i = 0; i < graph.nodes().size(); ++i)
    if (anchored[i]) add(columns_[i], columns_[i], kLeast * Matrix6::Identity());
  for (std::size_t e = 0; e < graph.edges().size(); ++e) {
    const Edge& edge = graph.edges()[e];
    if (!edge.active) continue;
    const LinearEdge linear = linearise(graph, e);
    const Eigen::Index from = columns_[edge.from], to = columns_[edge.to];
    add(from, from, linear.by_from.transpose() * linear.by_from);
    add(to, to, linear.by_to.transpose() * linear.by_to);
    const Matrix6 cross = linear.by_from.transpose() * linear.by_to;
    if (from > to)
      add(from, to, cross);
    else
      add(to, from, cross.transpose());
  }
  Matrix information(size, size);
  information.setFromTriplets(entries.begin(), entries.end());
  factor_.compute(information);
  if (factor_.info() != Eigen::Success) throw std::runtime_error("edges leave poses undetermined");
  rows_.setZero(size, dimension_);
  reached_.resize(static_cast<std::size_t>(size), false);
}

// With H = L L^T of the poses' information, J H^-1 J^T = Y^T Y, Y = L^-1 J^T: of each loop only the rows from
// its poses to the root of the elimination tree.
Uncertainty::Errors Uncertainty::errors(const std::vector<std::size_t>& loops) {
  const Matrix& lower = factor_.matrixL().nestedExpression();
  const auto& permutation = factor_.permutationP().indices();
  const auto n = static_cast<Eigen::Index>(loops.size()) * dimension_;
  Errors result{Eigen::VectorXd(n), Eigen::MatrixXd::Zero(n, n)};
  Eigen::MatrixXd spread;
  if (loops.size() > 1) spread.setZero(lower.rows(), n);
  std::vector<Eigen::Index> path;
  for (std::size_t i = 0; i < loops.size(); ++i) {
    const Edge& edge = graph_.edges()[loops[i]];
    const LinearEdge linear = linearise(graph_, loops[i]);
    const auto first = static_cast<Eigen::Index>(i) * dimension_;
    result.errors.segment(first, dimension_) = linear.residual.head(dimension_);
    path.clear();
    const auto begin = [&](Eigen::Index column, const Matrix6& by_pose) {
      for (int k = 0; column >= 0 && k < dimension_; ++k) {
        Eigen::Index row = permutation[column + k];
        rows_.row(row) = by_pose.col(k).head(dimension_).transpose();
        while (!reached_[static_cast<std::size_t>(row)]) {
          reached_[static_cast<std::size_t>(row)] = true;
          path.push_back(row);
          const auto next = lower.outerIndexPtr()[row] + 1;  // the first row below the diagonal is the parent
          if (next >= lower.outerIndexPtr()[row + 1]) break;
          row = lower.innerIndexPtr()[next];
        }
      }
    };
    begin(columns_[edge.from], linear.by_from);
    begin(columns_[edge.to], linear.by_to);
    std::sort(path.begin(), path.end());
    graph_.planar() ? eliminate<3>(path) : eliminate<6>(path);
    for (const Eigen::Index row : path) {
      if (loops.size() > 1)
        spread.row(row).segment(first, dimension_) = rows_.row(row);
      else
        result.covariance += rows_.row(row).transpose() * rows_.row(row);
      rows_.row(row).setZero();
      reached_[static_cast<std::size_t>(row)] = false;
    }
  }
  if (loops.size() > 1) result.covariance.noalias() = spread.transpose() * spread;
  if (!loops.empty() && graph_.edges()[loops.front()].active) result.covariance *= -1.0;
  result.covariance.diagonal().array() += 1.0;
  return result;
}

// Columns have the diagonal first, and then what is below, in order.
template <int N>
void Uncertainty::eliminate(const std::vector<Eigen::Index>& path) {
  using Row = Eigen::Map<Eigen::Matrix<double, 1, N>>;
  const Matrix& lower = factor_.matrixL().nestedExpression();
  const auto* begins = lower.outerIndexPtr();
  const auto* indices = lower.innerIndexPtr();
  const double* values = lower.valuePtr();
  for (const Eigen::Index column : path) {
    Row row(rows_.data() + N * column);
    row /= values[begins[column]];
    for (auto i = begins[column] + 1; i < begins[column + 1]; ++i)
      Row(rows_.data() + N * indices[i]) -= values[i] * row;
  }
}

}  // namespace pose_graph
