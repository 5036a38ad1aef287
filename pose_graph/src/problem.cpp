// SPDX-License-Identifier: BSD-3-Clause
#include "problem.h"

#include <Eigen/Cholesky>
#include <Eigen/Eigenvalues>
#include <cmath>

namespace pose_graph {
namespace {

// A pose in space is a block x y z, qx qy qz qw. It changes by a translation in the map and a rotation vector
// in the body. Costs write their derivatives by these six straight into the first columns of Ceres's blocks
// of seven, so that the derivative of the block itself is the identity.
bool plus(const double* x, const double* delta, double* x_plus_delta) {
  const Eigen::Map<const Eigen::Vector3d> t(x), dt(delta), angle(delta + 3);
  const Eigen::Map<const Eigen::Quaterniond> q(x + 3);
  const double half = 0.5 * angle.norm();
  const double scale = half < 1e-8 ? 0.5 : 0.5 * std::sin(half) / half;
  const Eigen::Quaterniond step(std::cos(half), scale * angle.x(), scale * angle.y(), scale * angle.z());
  Eigen::Map<Eigen::Vector3d> moved(x_plus_delta);
  Eigen::Map<Eigen::Quaterniond> turned(x_plus_delta + 3);
  moved = t + dt;
  turned = (q * step).normalized();
  return true;
}
bool plusJacobian(double* jacobian) {
  Eigen::Map<Eigen::Matrix<double, 7, 6, Eigen::RowMajor>> j(jacobian);
  j.setIdentity();
  return true;
}

// Ceres 2.1 calls Manifold what was LocalParameterization.
#if CERES_VERSION_MAJOR > 2 || (CERES_VERSION_MAJOR == 2 && CERES_VERSION_MINOR >= 1)
class PoseBlock : public ceres::Manifold {
 public:
  int AmbientSize() const override { return 7; }
  int TangentSize() const override { return 6; }
  bool Plus(const double* x, const double* delta, double* sum) const override { return plus(x, delta, sum); }
  bool PlusJacobian(const double*, double* jacobian) const override { return plusJacobian(jacobian); }
  // Only for what the solver here doesn't use.
  bool Minus(const double*, const double*, double*) const override { return false; }
  bool MinusJacobian(const double*, double*) const override { return false; }
};
void setPoseBlock(ceres::Problem& problem, double* block) {
  problem.SetManifold(block, new PoseBlock);
}
#else
class PoseBlock : public ceres::LocalParameterization {
 public:
  int GlobalSize() const override { return 7; }
  int LocalSize() const override { return 6; }
  bool Plus(const double* x, const double* delta, double* sum) const override { return plus(x, delta, sum); }
  bool ComputeJacobian(const double*, double* jacobian) const override { return plusJacobian(jacobian); }
};
void setPoseBlock(ceres::Problem& problem, double* block) {
  problem.SetParameterization(block, new PoseBlock);
}
#endif

// W with W^T W = information.
template <int N>
Eigen::Matrix<double, N, N> rootOf(const Eigen::Matrix<double, N, N>& information) {
  const Eigen::LLT<Eigen::Matrix<double, N, N>> llt(information);
  if (llt.info() == Eigen::Success) return llt.matrixU();
  const Eigen::SelfAdjointEigenSolver<Eigen::Matrix<double, N, N>> solver(information);  // singular
  return solver.eigenvalues().cwiseMax(0.0).cwiseSqrt().asDiagonal() * solver.eigenvectors().transpose();
}

Eigen::Matrix3d cross(const Eigen::Vector3d& v) {
  Eigen::Matrix3d m;
  m << 0.0, -v.z(), v.y(), v.z(), 0.0, -v.x(), -v.y(), v.x(), 0.0;
  return m;
}

class EdgeInSpace : public ceres::SizedCostFunction<6, 7, 7> {
 public:
  EdgeInSpace(const Edge& edge, double weight)
      : t_(edge.transform.translation),
        q_(edge.transform.rotation),
        root_(std::sqrt(weight) * rootOf<6>(edge.information)) {}

  bool Evaluate(double const* const* blocks, double* residuals, double** jacobians) const override {
    const Eigen::Map<const Eigen::Vector3d> ti(blocks[0]), tj(blocks[1]);
    const Eigen::Map<const Eigen::Quaterniond> qi(blocks[0] + 3), qj(blocks[1] + 3);
    const Eigen::Vector3d seen = qi.conjugate() * (tj - ti);
    const Eigen::Quaterniond z = q_.conjugate();
    Eigen::Quaterniond q = z * qi.conjugate() * qj;
    if (q.w() < 0.0) q.coeffs() = -q.coeffs();
    Vector6 error;
    error << z * (seen - t_), 2.0 * q.vec();
    Eigen::Map<Vector6> out(residuals);
    out.noalias() = root_ * error;
    if (jacobians == nullptr) return true;

    const Eigen::Matrix3d rz = z.toRotationMatrix(), to_error = rz * qi.conjugate().toRotationMatrix();
    const Eigen::Matrix3d w = q.w() * Eigen::Matrix3d::Identity(), v = cross(q.vec());
    const auto write = [&](double* block, const Matrix6& j) {
      Eigen::Map<Eigen::Matrix<double, 6, 7, Eigen::RowMajor>> derivatives(block);
      derivatives.leftCols<6>().noalias() = root_ * j;
      derivatives.col(6).setZero();
    };
    Matrix6 j = Matrix6::Zero();
    if (jacobians[0] != nullptr) {
      j.topLeftCorner<3, 3>() = -to_error;
      j.topRightCorner<3, 3>() = rz * cross(seen);
      j.bottomRightCorner<3, 3>() = -(w - v) * rz;
      write(jacobians[0], j);
    }
    if (jacobians[1] != nullptr) {
      j.topLeftCorner<3, 3>() = to_error;
      j.topRightCorner<3, 3>().setZero();
      j.bottomRightCorner<3, 3>() = w + v;
      write(jacobians[1], j);
    }
    return true;
  }

 private:
  Eigen::Vector3d t_;
  Eigen::Quaterniond q_;
  Matrix6 root_;
};

// Blocks x y yaw.
class EdgeInPlane : public ceres::SizedCostFunction<3, 3, 3> {
 public:
  EdgeInPlane(const Edge& edge, double weight)
      : t_(edge.transform.translation.head<2>()), yaw_(edge.transform.yaw()), to_measured_(rotation(-yaw_)) {
    static const int kRows[] = {0, 1, 5};
    Eigen::Matrix3d information;
    for (int r = 0; r < 3; ++r)
      for (int c = 0; c < 3; ++c) information(r, c) = edge.information(kRows[r], kRows[c]);
    root_ = std::sqrt(weight) * rootOf<3>(information);
  }

  bool Evaluate(double const* const* blocks, double* residuals, double** jacobians) const override {
    const Eigen::Map<const Eigen::Vector2d> ti(blocks[0]), tj(blocks[1]);
    const Eigen::Matrix2d to_from = rotation(-blocks[0][2]), to_error = to_measured_ * to_from;
    Eigen::Vector3d error;
    error << to_measured_ * (to_from * (tj - ti) - t_),
        std::remainder(blocks[1][2] - blocks[0][2] - yaw_, 2.0 * M_PI);
    Eigen::Map<Eigen::Vector3d> out(residuals);
    out = root_ * error;
    if (jacobians == nullptr) return true;
    Eigen::Matrix3d j = Eigen::Matrix3d::Zero();
    const auto write = [&](double* block) {
      Eigen::Map<Eigen::Matrix<double, 3, 3, Eigen::RowMajor>> derivatives(block);
      derivatives = root_ * j;
    };
    j.topLeftCorner<2, 2>() = to_error;
    j(2, 2) = 1.0;
    if (jacobians[1] != nullptr) write(jacobians[1]);
    if (jacobians[0] != nullptr) {
      const Eigen::Vector2d seen = to_error * (tj - ti);
      j.topLeftCorner<2, 2>() = -to_error;
      j.col(2) << seen.y(), -seen.x(), -1.0;
      write(jacobians[0]);
    }
    return true;
  }

 private:
  static Eigen::Matrix2d rotation(double yaw) {
    const double c = std::cos(yaw), s = std::sin(yaw);
    return (Eigen::Matrix2d() << c, -s, s, c).finished();
  }
  Eigen::Vector2d t_;
  double yaw_;
  Eigen::Matrix2d to_measured_;
  Eigen::Matrix3d root_;
};

// Agarwal et al., "Robust Map Optimization using Dynamic Covariance Scaling", ICRA 2013: what is left of s^2
// chi2 + Phi (1 - s)^2 with the switch s = min(1, 2 Phi / (Phi + chi2)), up to its derivative s^2.
class DynamicCovarianceScaling : public ceres::LossFunction {
 public:
  explicit DynamicCovarianceScaling(double phi) : phi_(phi) {}
  void Evaluate(double chi2, double rho[3]) const override {
    const double sum = phi_ + chi2;
    if (chi2 <= phi_) {
      rho[0] = chi2, rho[1] = 1.0, rho[2] = 0.0;
    } else {
      rho[0] = phi_ * (3.0 * chi2 - phi_) / sum;
      rho[1] = 4.0 * phi_ * phi_ / (sum * sum);
      rho[2] = -2.0 * rho[1] / sum;
    }
  }

 private:
  double phi_;
};

class Progress : public ceres::IterationCallback {
 public:
  explicit Progress(const std::function<bool(int, double)>& call) : call_(call) {}
  ceres::CallbackReturnType operator()(const ceres::IterationSummary& s) override {
    return call_(s.iteration, 2.0 * s.cost) ? ceres::SOLVER_CONTINUE : ceres::SOLVER_TERMINATE_SUCCESSFULLY;
  }

 private:
  const std::function<bool(int, double)>& call_;
};

std::array<double, 7> blockOf(const Pose& pose, bool planar) {
  if (planar) return {pose.translation.x(), pose.translation.y(), pose.yaw()};
  return {pose.translation.x(), pose.translation.y(), pose.translation.z(), pose.rotation.x(),
          pose.rotation.y(),    pose.rotation.z(),    pose.rotation.w()};
}

template <int N, int Block, typename Cost>
LinearEdge lineariseAs(const Graph& graph, const Edge& edge) {
  const auto from = blockOf(graph.nodes()[edge.from].pose, N == 3);
  const auto to = blockOf(graph.nodes()[edge.to].pose, N == 3);
  const double* blocks[] = {from.data(), to.data()};
  Eigen::Matrix<double, N, 1> residual;
  Eigen::Matrix<double, N, Block, Eigen::RowMajor> by_from, by_to;
  double* jacobians[] = {by_from.data(), by_to.data()};
  Cost(edge, 1.0).Evaluate(blocks, residual.data(), jacobians);
  LinearEdge linear;
  linear.residual.template head<N>() = residual;
  linear.by_from.template topLeftCorner<N, N>() = by_from.template leftCols<N>();
  linear.by_to.template topLeftCorner<N, N>() = by_to.template leftCols<N>();
  return linear;
}

}  // namespace

LinearEdge linearise(const Graph& graph, std::size_t edge) {
  const Edge& e = graph.edges()[edge];
  return graph.planar() ? lineariseAs<3, 3, EdgeInPlane>(graph, e) : lineariseAs<6, 7, EdgeInSpace>(graph, e);
}

Problem::Problem(const Graph& graph, const Robustness& robustness, const std::vector<bool>& moves)
    : planar_(graph.planar()), poses_(graph.nodes().size()), moves_(moves) {
  if (moves_.empty()) {
    moves_ = anchors(graph);
    moves_.flip();
  }
  for (std::size_t i = 0; i < poses_.size(); ++i) poses_[i] = blockOf(graph.nodes()[i].pose, planar_);
  std::vector<bool> used(poses_.size(), false);
  for (std::size_t e = 0; e < graph.edges().size(); ++e) {
    const Edge& edge = graph.edges()[e];
    const double weight = robustness.weights.empty() ? 1.0 : robustness.weights[e];
    if (!edge.active || weight <= 0.0 || (!moves_[edge.from] && !moves_[edge.to])) continue;
    ceres::CostFunction* cost = nullptr;
    if (planar_)
      cost = new EdgeInPlane(edge, weight);
    else
      cost = new EdgeInSpace(edge, weight);
    ceres::LossFunction* loss = nullptr;
    if (robustness.phi > 0.0 && edge.type != EdgeType::kConsecutive)
      loss = new DynamicCovarianceScaling(robustness.phi);
    problem_.AddResidualBlock(cost, loss, poses_[edge.from].data(), poses_[edge.to].data());
    used[edge.from] = used[edge.to] = true;
  }
  for (std::size_t i = 0; i < poses_.size(); ++i) {
    if (!used[i]) continue;
    if (!planar_) setPoseBlock(problem_, poses_[i].data());
    if (!moves_[i]) problem_.SetParameterBlockConstant(poses_[i].data());
  }
}

ceres::Solver::Summary Problem::solve(int max_iterations, double tolerance,
                                      const std::function<bool(int, double)>& progress) {
  ceres::Solver::Options options;
  options.linear_solver_type = ceres::SPARSE_NORMAL_CHOLESKY;
  options.sparse_linear_algebra_library_type =
      ceres::IsSparseLinearAlgebraLibraryTypeAvailable(ceres::SUITE_SPARSE) ? ceres::SUITE_SPARSE
                                                                            : ceres::EIGEN_SPARSE;
  options.max_num_iterations = max_iterations;
  options.function_tolerance = tolerance;
  options.gradient_tolerance = options.parameter_tolerance = 0.0;
  // Nearly Gauss-Newton: damping hinders the long, soft bends of a trajectory most.
  options.initial_trust_region_radius = 1e10;
  options.max_trust_region_radius = 1e20;
  options.logging_type = ceres::SILENT;
  Progress callback(progress);
  if (progress) options.callbacks.push_back(&callback);
  ceres::Solver::Summary summary;
  ceres::Solve(options, &problem_, &summary);
  return summary;
}

void Problem::store(Graph& graph) const {
  for (std::size_t i = 0; i < poses_.size(); ++i) {
    if (!moves_[i]) continue;
    const double* p = poses_[i].data();
    if (planar_)
      graph.setPose(i, planarPose(p[0], p[1], p[2]));
    else
      graph.setPose(i, {Eigen::Vector3d(p), Eigen::Quaterniond(p + 3)});
  }
}

}  // namespace pose_graph
