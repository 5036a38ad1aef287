// SPDX-License-Identifier: BSD-3-Clause
#include "surface.h"

#include <algorithm>
#include <cmath>
#include <limits>

namespace intensity_hector_slam {
namespace {

constexpr double kUnknown = std::numeric_limits<double>::quiet_NaN();
constexpr std::size_t kMinPoints = 3;
constexpr std::size_t kMedianStride = 8;  // of the angles that the median is of
constexpr float kInfinity = std::numeric_limits<float>::infinity();
constexpr float kMaxTurn = 3.0f;  // between neighbours, over the angle between beams
constexpr float kMinTexturePoints = 5.0f;
constexpr float kMaxTexture = 100.0f;         // so that one step with hardly any noise doesn't decide
constexpr double kMinIncidenceCosine = 0.15;  // reflectivities at more grazing angles aren't exact

SurfacePiece fit(const Scan& scan, std::size_t begin, std::size_t end) {
  SurfacePiece piece;
  piece.begin = begin;
  piece.end = end;
  const double n = static_cast<double>(end - begin);
  Eigen::Vector2f sum = Eigen::Vector2f::Zero();
  for (std::size_t i = begin; i < end; ++i) sum += scan.points[i];
  const Eigen::Vector2f centre = sum / n;
  float xx = 0.0f, xy = 0.0f, yy = 0.0f;
  for (std::size_t i = begin; i < end; ++i) {
    const Eigen::Vector2f d = scan.points[i] - centre;
    xx += d.x() * d.x();
    xy += d.x() * d.y();
    yy += d.y() * d.y();
  }
  // The eigenvalues and the first eigenvector of [xx xy; xy yy].
  const Eigen::Vector2d difference(0.5 * (xx - yy), xy);
  const double mean = 0.5 * (xx + yy), half = difference.norm();
  const double along = mean + half, across = std::max(0.0, mean - half);
  Eigen::Vector2d tangent(half + difference.x(), difference.y());
  if (difference.x() < 0.0) tangent = {difference.y(), half - difference.x()};
  tangent = half > 0.0 ? tangent.normalized() : Eigen::Vector2d::UnitX();
  piece.centre = centre.cast<double>();
  piece.normal = {-tangent.y(), tangent.x()};
  piece.normal_variance = along > 0.0 ? across / ((n - 2.0) * along) : 1.0;
  return piece;
}

}  // namespace

double texture(const Scan& scan, const SurfacePiece& piece) {
  const Eigen::Vector2f centre = piece.centre.cast<float>();
  const Eigen::Vector2f tangent(piece.normal.y(), -piece.normal.x());
  const Eigen::Vector2f beam = (centre - scan.origin).normalized();
  const double incidence_cosine = std::abs(piece.normal.dot(beam.cast<double>()));
  if (scan.reflectivities.empty() || incidence_cosine < kMinIncidenceCosine) return kUnknown;
  float m = 0.0f, s = 0.0f, ss = 0.0f, r = 0.0f, sr = 0.0f, differences = 0.0f, pairs = 0.0f;
  for (std::size_t i = piece.begin; i < piece.end; ++i) {
    const float value = scan.reflectivities[i];
    if (!std::isfinite(value)) continue;
    const float at = tangent.dot(scan.points[i] - centre);
    m += 1.0f;
    s += at;
    ss += at * at;
    r += value;
    sr += at * value;
    if (i + 1 < piece.end && std::isfinite(scan.reflectivities[i + 1])) {
      const float difference = scan.reflectivities[i + 1] - value;
      differences += difference * difference;
      pairs += 1.0f;
    }
  }
  if (m < kMinTexturePoints || pairs < 0.5f * m) return kUnknown;
  const float variance = ss - s * s / m, covariance = sr - s * r / m;
  const float noise = 0.5f * differences / pairs;  // of successive differences, that texture is hardly in
  return std::min(kMaxTexture, covariance * covariance / std::max(1e-9f, variance * noise));
}

std::vector<SurfacePiece> surfacePieces(const Scan& scan, double length) {
  std::vector<SurfacePiece> pieces;
  const std::size_t n = scan.points.size();
  if (n < kMinPoints) return pieces;
  // Where beams between two points have no return, nothing is known of what is there.
  std::vector<float> turns(n - 1);  // tangents of the angles
  for (std::size_t i = 0; i + 1 < n; ++i) {
    const Eigen::Vector2f a = scan.points[i] - scan.origin, b = scan.points[i + 1] - scan.origin;
    const float cosine = a.dot(b);
    turns[i] = cosine > 0.0f ? std::abs(a.x() * b.y() - a.y() * b.x()) / cosine : kInfinity;
  }
  std::vector<float> sorted;
  for (std::size_t i = 0; i < turns.size(); i += kMedianStride) sorted.push_back(turns[i]);
  std::nth_element(sorted.begin(), sorted.begin() + sorted.size() / 2, sorted.end());
  const float max_turn = kMaxTurn * sorted[sorted.size() / 2];

  const float square = static_cast<float>(length * length);
  std::size_t begin = 0;
  for (std::size_t i = 1; i <= n; ++i) {
    const bool ends = i == n || turns[i - 1] > max_turn;
    if (!ends && (i - begin < kMinPoints || (scan.points[i] - scan.points[begin]).squaredNorm() < square))
      continue;
    if (i - begin >= kMinPoints) pieces.push_back(fit(scan, begin, i));
    begin = i;
  }
  return pieces;
}

}  // namespace intensity_hector_slam
