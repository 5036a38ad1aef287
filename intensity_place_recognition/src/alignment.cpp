// SPDX-License-Identifier: BSD-3-Clause
#include "intensity_place_recognition/alignment.h"

#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>

#include "pieces.h"

namespace intensity_place_recognition {
namespace {

constexpr int kIterations = 10;
constexpr std::size_t kAligned = 500, kJudged = 1750;  // patches at most
constexpr float kLastReach = 0.6f;                     // m
constexpr float kResidual = 0.15f;                     // m, from which on a patch counts less
constexpr float kMatched = 0.5f, kSame = 0.35f;        // m

double fisher(double correlation) {
  return std::atanh(std::clamp(correlation, -0.999, 0.999));
}

// Of Fisher's transform.
double variance(const Correlation& correlation) {
  return 1.0 / std::max(1, correlation.pieces - 3);
}

}  // namespace

double correlationOf(const std::vector<std::pair<float, float>>& pairs) {
  if (pairs.size() < 3) return 0.0;
  double first = 0.0, second = 0.0, squares = 0.0, other_squares = 0.0, products = 0.0;
  for (const auto& [a, b] : pairs) {
    first += a;
    second += b;
    squares += a * a;
    other_squares += b * b;
    products += a * b;
  }
  const auto count = static_cast<double>(pairs.size());
  const double spread = squares - first * first / count,
               other_spread = other_squares - second * second / count;
  if (!(spread > 1e-9 * count && other_spread > 1e-9 * count)) return 0.0;
  return (products - first * second / count) / std::sqrt(spread * other_spread);
}

double evidence(const Correlation& correlation, double above) {
  return (fisher(correlation.value) - fisher(above)) / std::sqrt(variance(correlation));
}

double evidence(const Correlation& correlation, const Correlation& above) {
  return (fisher(correlation.value) - fisher(above.value)) /
         std::sqrt(variance(correlation) + variance(above));
}

Alignment Aligner::operator()(const Shape& place, const Eigen::Isometry3d& guess) const {
  using Vector6 = Eigen::Matrix<float, 6, 1>;
  using Matrix6f = Eigen::Matrix<float, 6, 6>;
  Alignment result;
  result.pose = guess;
  Eigen::Isometry3f pose = guess.inverse().cast<float>();  // place's points to the query's sensor
  const std::vector<Patch>& patches = place.patches();
  const std::size_t stride = patches.size() / kAligned + 1;
  for (int i = 0; i < kIterations; ++i) {
    const float t = static_cast<float>(i) / static_cast<float>(kIterations - 1);
    const float reach = PatchField::kReach * std::pow(kLastReach / PatchField::kReach, t);
    Matrix6f information = Matrix6f::Zero();
    Vector6 gradient = Vector6::Zero();
    float weights = 0.0f;
    for (std::size_t p = i % stride; p < patches.size(); p += stride) {
      const Eigen::Vector3f point = pose * patches[p].point;
      const Patch* other = field_.nearest(point);
      if (!other || other->flatness < 0.3f) continue;
      const Eigen::Vector3f offset = point - other->point;
      const float alike = std::abs(other->normal.dot(pose.linear() * patches[p].normal));
      if (offset.squaredNorm() > reach * reach || alike < 0.5f) continue;
      const float error = other->normal.dot(offset);
      const float weight = other->flatness * alike / (1.0f + error * error / (kResidual * kResidual));
      Vector6 jacobian;
      jacobian << other->normal, point.cross(other->normal);
      information.noalias() += weight * jacobian * jacobian.transpose();
      gradient += weight * error * jacobian;
      weights += weight;
    }
    if (weights < 10.0f) return result;
    information.diagonal().array() += 1e-4f * weights;
    const Vector6 step = -information.ldlt().solve(gradient);
    Eigen::Isometry3f change = Eigen::Isometry3f::Identity();
    const Eigen::Vector3f turn = step.tail<3>();
    if (turn.norm() > 1e-9f)
      change.linear() = Eigen::AngleAxisf(turn.norm(), turn.normalized()).toRotationMatrix();
    change.translation() = step.head<3>();
    pose = change * pose;
  }
  if (!pose.matrix().allFinite()) return result;
  result.pose = pose.inverse().cast<double>();

  std::size_t upright = 0, matched = 0;
  std::vector<std::pair<float, float>> intensities;
  Pieces pieces;
  const std::size_t step = patches.size() / kJudged + 1;
  for (std::size_t p = 0; p < patches.size(); p += step) {
    const Eigen::Vector3f point = pose * patches[p].point;
    const Patch* found = field_.nearest(point);
    upright += !patches[p].isLevel();
    if (!found) continue;
    const float squared = (found->point - point).squaredNorm();
    matched += !patches[p].isLevel() && squared < kMatched * kMatched;
    if (squared >= kSame * kSame) continue;
    intensities.emplace_back(found->intensity, patches[p].intensity);
    pieces.add(patches[p].point);
  }
  result.fit = upright > 0 ? static_cast<double>(matched) / static_cast<double>(upright) : 0.0;
  result.intensity = {correlationOf(intensities), pieces.count()};
  return result;
}

}  // namespace intensity_place_recognition
