// SPDX-License-Identifier: BSD-3-Clause
#include "intensity_place_recognition/registration.h"

#include <Eigen/Cholesky>
#include <Eigen/LU>
#include <algorithm>
#include <cmath>
#include <utility>
#include <vector>

#include "intensity_place_recognition/alignment.h"
#include "pieces.h"

namespace intensity_place_recognition {
namespace {

constexpr float kReach = 0.5f;        // m, of the nearest patches
constexpr double kResidual = 0.1;     // m, from which on a patch counts less
constexpr double kLeastError = 1e-3;  // m, of a patch: no scan is better, even where two are the same
constexpr float kMatched = 0.5f;      // m between patches that are the same
constexpr float kSame = 0.35f;        // m between patches whose intensities are compared
constexpr float kMargin = 1.0f;       // m behind a point that says it isn't there
constexpr std::size_t kFewestPairs = 50;
constexpr std::size_t kRefined = 1750;  // patches at most that the pose is measured by

// Iterative closest points, point to plane.
bool refine(const Shape& query, const PatchGrid& match, int iterations, Registration& result) {
  Matrix6 information = Matrix6::Zero();
  const std::size_t stride = query.patches().size() / kRefined + 1;
  for (int i = 0; i < iterations; ++i) {
    information.setZero();
    Eigen::Matrix<double, 6, 1> gradient = Eigen::Matrix<double, 6, 1>::Zero();
    std::size_t pairs = 0;
    double weights = 0.0, errors = 0.0;
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
      const double weight = other->flatness * alike / (1.0 + error * error / (kResidual * kResidual));
      Eigen::Matrix<double, 6, 1> jacobian;
      jacobian << normal, (point.cast<double>()).cross(normal);
      information.selfadjointView<Eigen::Lower>().rankUpdate(jacobian, weight);
      gradient += weight * error * jacobian;
      weights += weight;
      errors += weight * error * error;
      ++pairs;
    }
    if (pairs < kFewestPairs) return false;
    information = Matrix6(information.selfadjointView<Eigen::Lower>());
    const Matrix6 damped = information + 1e-6 * weights * Matrix6::Identity();
    const Eigen::Matrix<double, 6, 1> step = -damped.ldlt().solve(gradient);
    Eigen::Isometry3d change = Eigen::Isometry3d::Identity();
    const Eigen::Vector3d turn = step.tail<3>();
    if (turn.norm() > 1e-12)
      change.linear() = Eigen::AngleAxisd(turn.norm(), turn.normalized()).toRotationMatrix();
    change.translation() = step.head<3>();
    result.pose = change * result.pose;
    // Patches next to each other err alike, so that they count as a tenth as many.
    result.covariance = 10.0 * std::max(errors / weights, kLeastError * kLeastError) * damped.inverse();
    if (step.head<3>().norm() < 1e-3 && turn.norm() < 1e-4) break;
  }
  return true;
}

// Both scans must see what either sees.
void judge(const Shape& query, const PatchGrid& query_grid, const Shape& match, const PatchGrid& match_grid,
           Registration& result) {
  std::size_t matched = 0, missing = 0, all = 0;
  std::vector<std::pair<float, float>> intensities;
  Pieces pieces;
  const auto look = [&](const Shape& from, const Shape& to, const PatchGrid& grid,
                        const Eigen::Isometry3f& pose) {
    for (const Patch& patch : from.patches()) {
      const Eigen::Vector3f point = pose * patch.point;
      const Patch* found = grid.nearest(point, kMatched);
      if (found && (found->point - point).squaredNorm() < kSame * kSame) {
        intensities.emplace_back(patch.intensity, found->intensity);
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
  result.intensity = {correlationOf(intensities), pieces.count()};
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
