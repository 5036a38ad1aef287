// SPDX-License-Identifier: BSD-3-Clause
#include "pose_graph/initialisation.h"

#include <Eigen/SVD>
#include <Eigen/SparseCholesky>
#include <deque>
#include <stdexcept>
#include <vector>

namespace pose_graph {
namespace {

// Linear least squares for a 3 x m block for each node that doesn't stay.
class BlockSystem {
 public:
  explicit BlockSystem(const std::vector<bool>& stays, int columns) : columns_(columns) {
    for (const bool s : stays) rows_.push_back(s ? -1 : size_++);
    b_.setZero(3 * size_, columns);
  }
  // Adds |X_to - A X_from - c|^2, weighted.
  template <class Known>
  void add(const Edge& e, const Eigen::Matrix3d& a, const Eigen::MatrixXd& c, const Eigen::Matrix3d& weight,
           const Known& known) {
    const int i = rows_[e.from], j = rows_[e.to];
    Eigen::MatrixXd rest = c;
    if (i < 0) rest += a * known(e.from);
    if (j < 0) rest -= known(e.to);
    if (j >= 0) {
      block(j, j, weight);
      b_.middleRows(3 * j, 3) += weight * rest;
    }
    if (i >= 0) {
      block(i, i, a.transpose() * weight * a);
      b_.middleRows(3 * i, 3) -= a.transpose() * weight * rest;
    }
    if (i >= 0 && j >= 0) {
      block(i, j, -a.transpose() * weight);
      block(j, i, -weight * a);
    }
  }
  template <class Use>
  void solve(const Use& use) const {
    if (size_ == 0) return;
    Eigen::SparseMatrix<double> h(3 * size_, 3 * size_);
    h.setFromTriplets(triplets_.begin(), triplets_.end());
    const Eigen::SimplicialLDLT<Eigen::SparseMatrix<double>> solver(h);
    const Eigen::MatrixXd x = solver.solve(b_);
    if (solver.info() != Eigen::Success || !x.allFinite())
      throw std::runtime_error("the edges leave poses undetermined");
    for (std::size_t i = 0; i < rows_.size(); ++i)
      if (rows_[i] >= 0) use(i, x.middleRows(3 * rows_[i], 3));
  }

 private:
  void block(int i, int j, const Eigen::Matrix3d& m) {
    for (int r = 0; r < 3; ++r)
      for (int c = 0; c < 3; ++c) triplets_.emplace_back(3 * i + r, 3 * j + c, m(r, c));
  }
  int columns_, size_ = 0;
  std::vector<int> rows_;
  std::vector<Eigen::Triplet<double>> triplets_;
  Eigen::MatrixXd b_;
};

}  // namespace

void startFromOdometry(Graph& graph) {
  const std::vector<bool> stays = anchors(graph);
  std::vector<std::vector<std::size_t>> edges_of(graph.nodes().size());
  for (std::size_t e = 0; e < graph.edges().size(); ++e) {
    const Edge& edge = graph.edges()[e];
    if (!edge.active) continue;
    edges_of[edge.from].push_back(e);
    edges_of[edge.to].push_back(e);
  }
  std::vector<bool> done = stays;
  // Those at the front are reached by consecutive edges alone from where a loop has led.
  std::deque<std::size_t> nodes, others;
  const auto follow = [&](std::size_t n, bool consecutive) {
    for (const std::size_t e : edges_of[n]) {
      const Edge& edge = graph.edges()[e];
      const std::size_t other = edge.from == n ? edge.to : edge.from;
      if (done[other] || (edge.type == EdgeType::kConsecutive) != consecutive) continue;
      graph.setPose(other,
                    graph.nodes()[n].pose * (edge.from == n ? edge.transform : edge.transform.inverse()));
      done[other] = true;
      nodes.push_back(other);
    }
  };
  for (std::size_t n = 0; n < stays.size(); ++n)
    if (stays[n]) nodes.push_back(n);
  while (!nodes.empty() || !others.empty()) {
    if (!nodes.empty()) {
      others.push_back(nodes.front());
      nodes.pop_front();
      follow(others.back(), true);
    } else {
      const std::size_t n = others.front();
      others.pop_front();
      follow(n, false);
    }
  }
}

void startFromChords(Graph& graph) {
  const std::vector<bool> stays = anchors(graph);
  const auto rotation = [&](std::size_t i) -> Eigen::Matrix3d {
    return graph.nodes()[i].pose.rotation.toRotationMatrix();
  };
  // R_to = R_from Z, transposed, so that the columns are independent of each other.
  BlockSystem rotations(stays, 3);
  for (const Edge& e : graph.edges()) {
    if (!e.active) continue;
    const Matrix6& w = e.information;
    const double weight = graph.planar() ? w(5, 5) : w.diagonal().tail<3>().mean();
    rotations.add(e, e.transform.rotation.conjugate().toRotationMatrix(), Eigen::Matrix3d::Zero(),
                  weight * Eigen::Matrix3d::Identity(),
                  [&](std::size_t i) -> Eigen::Matrix3d { return rotation(i).transpose(); });
  }
  std::vector<Pose> poses;
  for (const Node& node : graph.nodes()) poses.push_back(node.pose);
  rotations.solve([&](std::size_t i, const Eigen::MatrixXd& transposed) {
    const Eigen::JacobiSVD<Eigen::Matrix3d> svd(transposed.transpose(),
                                                Eigen::ComputeFullU | Eigen::ComputeFullV);
    Eigen::Matrix3d sign = Eigen::Matrix3d::Identity();
    sign(2, 2) = (svd.matrixU() * svd.matrixV().transpose()).determinant() < 0.0 ? -1.0 : 1.0;
    poses[i].rotation = Eigen::Quaterniond(svd.matrixU() * sign * svd.matrixV().transpose()).normalized();
    if (graph.planar()) {
      poses[i].rotation.x() = poses[i].rotation.y() = 0.0;
      poses[i].rotation.normalize();
    }
  });
  BlockSystem translations(stays, 1);
  for (const Edge& e : graph.edges()) {
    if (!e.active) continue;
    Eigen::Matrix3d information = e.information.topLeftCorner<3, 3>();
    if (graph.planar()) information(2, 2) = 1.0;
    const Eigen::Matrix3d to_map = (poses[e.from].rotation * e.transform.rotation).toRotationMatrix();
    translations.add(e, Eigen::Matrix3d::Identity(), poses[e.from].rotation * e.transform.translation,
                     to_map * information * to_map.transpose(),
                     [&](std::size_t i) -> Eigen::Vector3d { return poses[i].translation; });
  }
  translations.solve([&](std::size_t i, const Eigen::MatrixXd& t) {
    poses[i].translation = t;
    if (graph.planar()) poses[i].translation.z() = 0.0;
  });
  for (std::size_t i = 0; i < poses.size(); ++i) graph.setPose(i, poses[i]);
}

}  // namespace pose_graph
