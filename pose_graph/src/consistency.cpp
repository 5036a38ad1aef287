// SPDX-License-Identifier: BSD-3-Clause
#include "consistency.h"

#include <Eigen/Cholesky>
#include <algorithm>
#include <cstdint>
#include <numeric>
#include <optional>
#include <stdexcept>
#include <string>

namespace pose_graph {
namespace {

Matrix6 adjoint(const Pose& pose) {
  const Eigen::Matrix3d r = pose.rotation.toRotationMatrix();
  const Eigen::Vector3d& t = pose.translation;
  Matrix6 a = Matrix6::Zero();
  a.topLeftCorner<3, 3>() = a.bottomRightCorner<3, 3>() = r;
  for (int c = 0; c < 3; ++c) a.topRightCorner<3, 3>().col(c) = t.cross(r.col(c));
  return a;
}

// Of the error of an edge.
Matrix6 covarianceOf(const Edge& edge, bool planar) {
  Matrix6 information = edge.information;
  if (planar) information.diagonal().segment<3>(2).setOnes();  // of what is 0 anyway
  information.diagonal() *= 1.0 + 1e-12;
  return information.llt().solve(Matrix6::Identity());
}

// Odometry's poses, and the sum of all covariances up to each, seen from the map, so that the difference of
// two is what lies between them.
struct Odometry {
  std::vector<Pose> poses;
  std::vector<Matrix6> covariances;
};
Odometry odometryOf(const Graph& graph) {
  const std::size_t n = graph.nodes().size();
  std::vector<std::optional<Edge>> steps(n);
  for (const Edge& edge : graph.edges()) {
    if (edge.type != EdgeType::kConsecutive) continue;
    if (edge.from + 1 == edge.to) {
      steps[edge.to] = edge;
    } else if (edge.to + 1 == edge.from) {
      Edge turned = edge;
      const Matrix6 a = adjoint(edge.transform.inverse());  // of the error, seen from the other end
      turned.transform = edge.transform.inverse();
      turned.information = a.transpose() * edge.information * a;
      steps[edge.from] = turned;
    }
  }
  Odometry odometry{{{}}, {Matrix6::Zero()}};
  for (std::size_t i = 1; i < n; ++i) {
    if (!steps[i])
      throw std::runtime_error("pcm needs an edge between poses " + std::to_string(graph.nodes()[i - 1].id) +
                               " and " + std::to_string(graph.nodes()[i].id));
    odometry.poses.push_back(odometry.poses.back() * steps[i]->transform);
    const Matrix6 a = adjoint(odometry.poses.back());
    odometry.covariances.emplace_back(odometry.covariances.back() +
                                      a * covarianceOf(*steps[i], graph.planar()) * a.transpose());
  }
  return odometry;
}

// Rows and columns of x, y and the turn about z in the plane, of all in space.
template <int N>
Eigen::Matrix<double, N, N> partOf(const Matrix6& m) {
  if constexpr (N == 6) {
    return m;
  } else {
    static const int kRows[] = {0, 1, 5};
    Eigen::Matrix3d part;
    for (int r = 0; r < 3; ++r)
      for (int c = 0; c < 3; ++c) part(r, c) = m(kRows[r], kRows[c]);
    return part;
  }
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

// Whether loops agree: how far each moves the map that odometry makes, and how sure it is. Two of them agree
// where they move it alike, but for the drift between them.
template <int N>
std::vector<Set> agreements(const Graph& graph, const std::vector<std::size_t>& loops, double threshold) {
  using Covariance = Eigen::Matrix<double, N, N>;
  struct Shift {
    Pose pose, inverse;
    std::size_t from, to;
    Covariance covariance, adjoint;
  };
  const Odometry odometry = odometryOf(graph);
  std::vector<Covariance> drift;
  for (const Matrix6& covariance : odometry.covariances) drift.push_back(partOf<N>(covariance));
  std::vector<Shift> shifts;
  for (const std::size_t e : loops) {
    const Edge& edge = graph.edges()[e];
    const bool turned = edge.from > edge.to;
    const std::size_t from = std::min(edge.from, edge.to), to = std::max(edge.from, edge.to);
    const Pose measured = odometry.poses[from] * (turned ? edge.transform.inverse() : edge.transform);
    const Pose shift = measured * odometry.poses[to].inverse();
    // The error is seen from the measured pose of the edge's own `to`.
    const Matrix6 a = adjoint(turned ? odometry.poses[from] : measured);
    shifts.push_back({shift, shift.inverse(), from, to,
                      partOf<N>(a * covarianceOf(edge, graph.planar()) * a.transpose()),
                      partOf<N>(adjoint(shift))});
  }
  const auto between = [&](std::size_t a, std::size_t b) -> Covariance {
    return drift[std::max(a, b)] - drift[std::min(a, b)];
  };
  const std::size_t n = shifts.size();
  std::vector<Set> neighbours(n, Set((n + 63) / 64));
  for (std::size_t i = 0; i < n; ++i)
    for (std::size_t j = 0; j < i; ++j) {
      const Shift &a = shifts[i], &b = shifts[j];
      const Pose difference = a.pose * b.inverse;
      const Eigen::Vector3d turn = (difference.rotation.w() < 0.0 ? -2.0 : 2.0) * difference.rotation.vec();
      Eigen::Matrix<double, N, 1> error;
      if constexpr (N == 3)
        error << difference.translation.x(), difference.translation.y(), turn.z();
      else
        error << difference.translation, turn;
      const Covariance covariance = a.covariance + b.covariance + between(a.from, b.from) +
                                    a.adjoint * between(a.to, b.to) * a.adjoint.transpose();
      if (error.dot(covariance.llt().solve(error)) > threshold) continue;
      neighbours[i][j / 64] |= std::uint64_t{1} << (j % 64);
      neighbours[j][i / 64] |= std::uint64_t{1} << (i % 64);
    }
  return neighbours;
}

}  // namespace

std::vector<std::size_t> consistentLoops(const Graph& graph, const std::vector<std::size_t>& loops,
                                         double threshold) {
  std::vector<std::size_t> kept;
  const auto neighbours =
      graph.planar() ? agreements<3>(graph, loops, threshold) : agreements<6>(graph, loops, threshold);
  for (const std::size_t i : largeClique(neighbours)) kept.push_back(loops[i]);
  return kept;
}

}  // namespace pose_graph
