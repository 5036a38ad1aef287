// SPDX-License-Identifier: BSD-3-Clause
#include "chain.h"

#include <Eigen/Cholesky>
#include <Eigen/Eigenvalues>
#include <algorithm>
#include <tuple>
#include <utility>

namespace pose_graph {
namespace {

constexpr double kLeastInformation = 1e-12;

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

// Of a symmetric matrix; eigenvalues near 0 and below are taken for a small share of the largest.
template <int N>
Eigen::Matrix<double, N, N> invert(const Eigen::Matrix<double, N, N>& m) {
  using Matrix = Eigen::Matrix<double, N, N>;
  const Eigen::LLT<Matrix> llt(m);
  if (llt.info() == Eigen::Success && llt.rcond() > kLeastInformation) return llt.solve(Matrix::Identity());
  const Eigen::SelfAdjointEigenSolver<Matrix> solver(m);
  const double least = std::max(kLeastInformation * solver.eigenvalues().maxCoeff(), kLeastInformation);
  return solver.eigenvectors() * solver.eigenvalues().cwiseMax(least).cwiseInverse().asDiagonal() *
         solver.eigenvectors().transpose();
}

}  // namespace

Matrix6 adjoint(const Pose& pose) {
  const Eigen::Matrix3d r = pose.rotation.toRotationMatrix();
  const Eigen::Vector3d& t = pose.translation;
  Matrix6 a = Matrix6::Zero();
  a.topLeftCorner<3, 3>() = a.bottomRightCorner<3, 3>() = r;
  for (int c = 0; c < 3; ++c) a.topRightCorner<3, 3>().col(c) = t.cross(r.col(c));
  return a;
}

Matrix6 inverseOf(const Matrix6& m, bool planar) {
  if (!planar) return invert<6>(m);
  const Eigen::Matrix3d part = invert<3>(partOf<3>(m));
  Matrix6 inverse = Matrix6::Zero();
  static const int kRows[] = {0, 1, 5};
  for (int r = 0; r < 3; ++r)
    for (int c = 0; c < 3; ++c) inverse(kRows[r], kRows[c]) = part(r, c);
  return inverse;
}

Edge turned(const Edge& edge) {
  Edge other = edge;
  std::swap(other.from, other.to);
  other.transform = edge.transform.inverse();
  // Of the error, seen from the other end.
  const Matrix6 a = adjoint(other.transform);
  other.information = a.transpose() * edge.information * a;
  return other;
}

ChainPose ChainPose::then(const Edge& step, bool planar) const {
  ChainPose next = *this;
  ++next.position;
  next.pose = pose * step.transform;
  const Matrix6 a = adjoint(next.pose);
  next.covariance += a * inverseOf(step.information, planar) * a.transpose();
  return next;
}

Shift::Shift(const Edge& loop, const ChainPose& from, const ChainPose& to, bool planar)
    : planar_(planar), from_(from), to_(to) {
  const bool backward =
      std::tie(from.chain, from.position) > std::tie(to.chain, to.position);  // all in one direction
  if (backward) std::swap(from_, to_);
  const Pose measured = from_.pose * (backward ? loop.transform.inverse() : loop.transform);
  shift_ = measured * to_.pose.inverse();
  inverse_ = shift_.inverse();
  // The error is seen from the measured pose of the edge's own `to`.
  const Matrix6 a = adjoint(backward ? from_.pose : measured);
  covariance_ = a * inverseOf(loop.information, planar) * a.transpose();
  adjoint_ = adjoint(shift_);
}

template <int N>
double Shift::disagreement(const Shift& other) const {
  using Covariance = Eigen::Matrix<double, N, N>;
  const Pose difference = shift_ * other.inverse_;
  const Eigen::Vector3d turn = (difference.rotation.w() < 0.0 ? -2.0 : 2.0) * difference.rotation.vec();
  Eigen::Matrix<double, N, 1> error;
  if constexpr (N == 3)
    error << difference.translation.x(), difference.translation.y(), turn.z();
  else
    error << difference.translation, turn;
  const auto between = [](const ChainPose& a, const ChainPose& b) -> Covariance {
    return partOf<N>(a.position > b.position ? Matrix6(a.covariance - b.covariance)
                                             : Matrix6(b.covariance - a.covariance));
  };
  const Covariance a = partOf<N>(adjoint_);
  const Covariance covariance = partOf<N>(covariance_) + partOf<N>(other.covariance_) +
                                between(from_, other.from_) + a * between(to_, other.to_) * a.transpose();
  return error.dot(covariance.llt().solve(error));
}

double Shift::disagreement(const Shift& other) const {
  return planar_ ? disagreement<3>(other) : disagreement<6>(other);
}

}  // namespace pose_graph
