// SPDX-License-Identifier: BSD-3-Clause
#include "intensity_place_recognition/registration.h"

#include <Eigen/Cholesky>
#include <Eigen/Eigenvalues>
#include <Eigen/LU>
#include <algorithm>
#include <cmath>
#include <cstdint>
#include <numeric>
#include <unordered_map>
#include <vector>

#include "intensity_place_recognition/alignment.h"
#include "pieces.h"

namespace intensity_place_recognition {
namespace {

constexpr float kReach = 0.5f;        // m, of the nearest patches
constexpr double kResidual = 0.1;     // m, from which on a patch counts less
constexpr double kLeastError = 1e-3;  // m, of a patch: no scan is better, even where two are the same
constexpr float kCube = 8.0f;         // m, whose patches err alike
constexpr double kNormal = 0.05;      // rad, that normals err by: what they say of other directions isn't so
constexpr double kUnknown = 1e-6;     // of the weights, information of a direction that nothing tells
constexpr float kMatched = 0.5f;      // m between patches that are the same
constexpr float kSame = 0.35f;        // m between patches whose intensities are compared
constexpr float kBlock = 8.0f;        // m, of cubes whose intensities change alike
constexpr float kMargin = 1.0f;       // m behind a point that says it isn't there
constexpr std::size_t kFewestPairs = 50;
constexpr std::size_t kRefined = 1750;  // patches at most that the pose is measured by

using Vector6 = Eigen::Matrix<double, 6, 1>;

// What ICP's last step sums up.
struct Sums {
  Matrix6 information = Matrix6::Zero(), slopes = Matrix6::Zero();
  double weights = 0.0, distances = 0.0;  // these squared, m2
  std::size_t pairs = 0;
  std::unordered_map<std::uint64_t, Vector6> gradients;  // of each cube
};

// Of an M-estimator (Huber 1981, 6.3), in which the patches of a cube count as one, since they err alike
// (Liang and Zeger 1986); of their gradients' covariance the size alone is told by so few cubes. What errs
// much says less than its weight: `slopes` are the gradient's.
Matrix6 covarianceOf(const Sums& sums) {
  const auto cubes = static_cast<double>(sums.gradients.size());
  const Matrix6 damped = sums.information + kUnknown * sums.weights * Matrix6::Identity();
  const Eigen::LDLT<Matrix6> decomposed(damped);
  double variance = 0.0;  // m2
  for (const auto& [cube, gradient] : sums.gradients)
    variance += gradient.dot(decomposed.solve(gradient)) / 6.0;
  variance = std::max(variance * cubes / std::max(1.0, cubes - 6.0),
                      static_cast<double>(sums.pairs) / cubes * kLeastError * kLeastError);
  const Matrix6 spread = variance * damped;
  // Turns as what they move, in m.
  Vector6 scale = Vector6::Ones();
  scale.tail<3>() /= std::sqrt(std::max(1.0, sums.distances / sums.weights));
  const Eigen::SelfAdjointEigenSolver<Matrix6> solver(scale.asDiagonal() * sums.slopes * scale.asDiagonal());
  const Vector6 known =
      (solver.eigenvalues().array() - kNormal * kNormal * sums.weights).max(kUnknown * sums.weights);
  const Matrix6 inverse = scale.asDiagonal() * solver.eigenvectors() * known.cwiseInverse().asDiagonal() *
                          solver.eigenvectors().transpose() * scale.asDiagonal();
  const Matrix6 covariance = inverse * spread * inverse;
  return 0.5 * (covariance + covariance.transpose());
}

// Iterative closest points, point to plane.
bool refine(const Shape& query, const PatchGrid& match, int iterations, Registration& result) {
  Sums sums;
  const std::size_t stride = query.patches().size() / kRefined + 1;
  for (int i = 0; i < iterations; ++i) {
    sums = Sums();
    Vector6 gradient = Vector6::Zero();
    const Eigen::Isometry3f pose = result.pose.cast<float>();
    for (std::size_t p = 0; p < query.patches().size(); p += stride) {
      const Patch& patch = query.patches()[p];
      const Eigen::Vector3f point = pose * patch.point;
      const Patch* other = match.nearest(point, kReach);
      if (!other) continue;
      const float alike = std::abs(other->normal.dot(pose.linear() * patch.normal));
      if (other->flatness < 0.3f || alike < 0.5f) continue;
      const Eigen::Vector3d normal = other->normal.cast<double>();
      const double error = normal.dot((point - other->point).cast<double>());
      const double squared = error * error / (kResidual * kResidual);
      const double weight = other->flatness * alike / (1.0 + squared);
      Vector6 jacobian;
      jacobian << normal, (point.cast<double>()).cross(normal);
      sums.information += weight * jacobian * jacobian.transpose();
      sums.slopes +=
          weight * std::max(0.0, (1.0 - squared) / (1.0 + squared)) * jacobian * jacobian.transpose();
      const Vector6 pull = weight * error * jacobian;
      gradient += pull;
      sums.gradients.try_emplace(cubeOf(point, kCube), Vector6::Zero()).first->second += pull;
      sums.weights += weight;
      sums.distances += weight * point.cast<double>().squaredNorm();
      ++sums.pairs;
    }
    if (sums.pairs < kFewestPairs) return false;
    const Matrix6 damped = sums.information + 1e-6 * sums.weights * Matrix6::Identity();
    const Vector6 step = -damped.ldlt().solve(gradient);
    Eigen::Isometry3d change = Eigen::Isometry3d::Identity();
    const Eigen::Vector3d turn = step.tail<3>();
    if (turn.norm() > 1e-12)
      change.linear() = Eigen::AngleAxisd(turn.norm(), turn.normalized()).toRotationMatrix();
    change.translation() = step.head<3>();
    result.pose = change * result.pose;
    if (step.head<3>().norm() < 1e-3 && turn.norm() < 1e-4) break;
  }
  result.covariance = covarianceOf(sums);
  return true;
}

// Standard, of Fisher's transform: the greater of that of independent pieces, and that by leaving out one
// block after the other (the jackknife, Efron and Stein 1981), as what is near each other changes alike.
double deviationOf(const PairSums& all, const std::unordered_map<std::uint64_t, PairSums>& blocks,
                   int pieces) {
  std::vector<double> values;
  for (const auto& [number, block] : blocks) values.push_back(fisher(all.without(block).correlation()));
  const auto count = static_cast<double>(std::max<std::size_t>(1, values.size()));
  const double mean = std::accumulate(values.begin(), values.end(), 0.0) / count;
  double squares = 0.0;
  for (const double value : values) squares += (value - mean) * (value - mean);
  return std::sqrt(std::max((count - 1.0) / count * squares, 1.0 / std::max(1, pieces - 3)));
}

// Both scans must see what either sees.
void judge(const Shape& query, const PatchGrid& query_grid, const Shape& match, const PatchGrid& match_grid,
           Registration& result) {
  std::size_t matched = 0, missing = 0, all = 0;
  PairSums intensities;
  std::unordered_map<std::uint64_t, PairSums> blocks;
  Pieces pieces(query.patches().size());
  const auto look = [&](const Shape& from, const Shape& to, const PatchGrid& grid,
                        const Eigen::Isometry3f& pose) {
    for (const Patch& patch : from.patches()) {
      const Eigen::Vector3f point = pose * patch.point;
      const Patch* found = grid.nearest(point, kMatched);
      if (found && (found->point - point).squaredNorm() < kSame * kSame) {
        intensities.add(patch.intensity, found->intensity);
        const Eigen::Vector3f& at = &from == &query ? point : patch.point;
        blocks[cubeOf(at, kBlock)].add(patch.intensity, found->intensity);
        if (&from == &query) pieces.add(point);
      }
      if (patch.isLevel()) continue;
      ++all;
      if (found)
        ++matched;
      else if (to.seesThrough(point, kMargin))
        ++missing;
    }
  };
  look(query, match, match_grid, result.pose.cast<float>());
  look(match, query, query_grid, result.pose.inverse().cast<float>());
  result.agreement =
      matched > 0 ? static_cast<double>(matched) / static_cast<double>(matched + missing) : 0.0;
  result.common = all > 0 ? static_cast<double>(matched + missing) / static_cast<double>(all) : 0.0;
  result.intensity = {intensities.correlation(), pieces.count(),
                      deviationOf(intensities, blocks, pieces.count())};
}

}  // namespace

Matrix6 informationAtQuery(const Registration& registration) {
  // With T the pose, exp(a) T = T exp(b) where a = Ad(T) b.
  const Eigen::Matrix3d r = registration.pose.rotation();
  const Eigen::Vector3d t = registration.pose.translation();
  Eigen::Matrix3d cross;
  cross << 0, -t.z(), t.y(), t.z(), 0, -t.x(), -t.y(), t.x(), 0;
  Matrix6 adjoint = Matrix6::Zero();
  adjoint << r, cross * r, Eigen::Matrix3d::Zero(), r;
  const Matrix6 information = adjoint.transpose() * registration.covariance.inverse() * adjoint;
  return 0.5 * (information + information.transpose());
}

Registrar::Registrar(const Shape& query, const RegistrationOptions& options)
    : query_(query), options_(options), grid_(query) {}

Registration Registrar::operator()(const Shape& match, const Eigen::Isometry3d& guess) const {
  Registration result;
  result.pose = guess;
  if (query_.patches().size() < kFewestPairs || match.patches().size() < kFewestPairs) return result;
  const PatchGrid grid(match);
  if (!refine(query_, grid, options_.iterations, result)) return result;
  judge(query_, grid_, match, grid, result);
  result.score = result.agreement * result.common;
  result.evidence = evidence(result.intensity, options_.min_intensity);
  result.accepted = result.score >= options_.min_score && result.evidence >= options_.min_evidence &&
                    result.intensity.pieces >= options_.min_pieces &&
                    result.pose.translation().norm() <= options_.max_distance;
  return result;
}

}  // namespace intensity_place_recognition
