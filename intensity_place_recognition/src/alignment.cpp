// SPDX-License-Identifier: BSD-3-Clause
#include "intensity_place_recognition/alignment.h"

#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>

#include "pieces.h"

namespace intensity_place_recognition {
namespace {

constexpr float kLastReach = 0.6f;               // m
constexpr float kResidual = 0.15f;               // m, from which on a patch counts less
constexpr float kMatched = 0.5f, kSame = 0.35f;  // m

// Of Fisher's transform.
double variance(const Correlation& correlation) {
  return correlation.deviation > 0.0 ? correlation.deviation * correlation.deviation
                                     : 1.0 / std::max(1, correlation.pieces - 3);
}

}  // namespace

double fisher(double correlation) {
  return std::atanh(std::clamp(correlation, -0.999, 0.999));
}

double PairSums::correlation() const {
  if (count < 3.0) return 0.0;
  const double spread = squares - first * first / count,
               other_spread = other_squares - second * second / count;
  if (!(spread > 1e-9 * count && other_spread > 1e-9 * count)) return 0.0;
  return (products - first * second / count) / std::sqrt(spread * other_spread);
}

double correlationOf(const std::vector<std::pair<float, float>>& pairs) {
  PairSums sums;
  for (const auto& [a, b] : pairs) sums.add(a, b);
  return sums.correlation();
}

double evidence(const Correlation& correlation, double above) {
  return (fisher(correlation.value) - fisher(above)) / std::sqrt(variance(correlation));
}

double evidence(const Correlation& correlation, const Correlation& above) {
  return (fisher(correlation.value) - fisher(above.value)) /
         std::sqrt(variance(correlation) + variance(above));
}

Alignment Aligner::operator()(const PackedShape& place, const Eigen::Isometry3d& guess,
                              const Effort& effort) const {
  // The last two stay 0: they fill registers.
  using Vector8 = Eigen::Matrix<float, 8, 1>;
  using Matrix8 = Eigen::Matrix<float, 8, 6>;
  Alignment result;
  result.pose = guess;
  Eigen::Isometry3f pose = guess.inverse().cast<float>();  // place's points to the query's sensor
  const auto groups = [&](std::size_t patches) {
    return std::clamp<std::size_t>(patches * PackedShape::kGroups / std::max<std::size_t>(1, place.size()), 1,
                                   PackedShape::kGroups);
  };
  const std::size_t aligned = groups(effort.aligned), judged = groups(effort.judged);
  const auto endOf = [&](std::size_t group) { return place.size() * group / PackedShape::kGroups; };
  // All are looked up before they are used, as the processor waits for memory once then.
  std::vector<Eigen::Vector3f> points(endOf(std::max(aligned, judged)) + 1);
  std::vector<const Patch*> found(points.size());
  const auto lookUp = [&](std::size_t first, std::size_t end) {
    for (std::size_t p = first; p < end; ++p) {
      points[p - first] = pose * place.point(p);
      found[p - first] = field_.nearest(points[p - first]);
    }
  };
  for (int i = 0; i < effort.iterations; ++i) {
    const float t = static_cast<float>(i) / static_cast<float>(effort.iterations - 1);
    const float reach = PatchField::kReach * std::pow(kLastReach / PatchField::kReach, t);
    Matrix8 information = Matrix8::Zero();
    Vector8 gradient = Vector8::Zero();
    float weights = 0.0f;
    // Other groups in each iteration, as far as there are.
    const std::size_t first = i * aligned % (PackedShape::kGroups / aligned * aligned);
    const std::size_t begin = endOf(first), end = endOf(first + aligned);
    lookUp(begin, end);
    for (std::size_t p = begin; p < end; ++p) {
      const Eigen::Vector3f& point = points[p - begin];
      const Patch* other = found[p - begin];
      if (!other || other->flatness < 0.3f) continue;
      const Eigen::Vector3f offset = point - other->point;
      if (offset.squaredNorm() > reach * reach) continue;
      const float alike = std::abs(other->normal.dot(pose.linear() * place.normal(p)));
      if (alike < 0.5f) continue;
      const float error = other->normal.dot(offset);
      const float weight = other->flatness * alike / (1.0f + error * error / (kResidual * kResidual));
      Vector8 jacobian;
      jacobian << other->normal, point.cross(other->normal), 0.0f, 0.0f;
      for (int k = 0; k < 6; ++k) information.col(k) += weight * jacobian[k] * jacobian;
      gradient += weight * error * jacobian;
      weights += weight;
    }
    if (weights < 10.0f) return result;
    information.diagonal().array() += 1e-4f * weights;
    const Eigen::Matrix<float, 6, 1> step = -information.topRows<6>().ldlt().solve(gradient.head<6>());
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
  PairSums intensities;
  const std::size_t count = endOf(judged);
  lookUp(0, count);
  Pieces pieces(count + 1);
  for (std::size_t p = 0; p < count; ++p) {
    upright += !place.isLevel(p);
    if (!found[p]) continue;
    const float squared = (found[p]->point - points[p]).squaredNorm();
    matched += !place.isLevel(p) && squared < kMatched * kMatched;
    if (squared >= kSame * kSame) continue;
    intensities.add(found[p]->intensity, place.intensity(p));
    pieces.add(place.point(p));
  }
  result.fit = upright > 0 ? static_cast<double>(matched) / static_cast<double>(upright) : 0.0;
  result.intensity = {intensities.correlation(), pieces.count()};
  return result;
}

}  // namespace intensity_place_recognition
