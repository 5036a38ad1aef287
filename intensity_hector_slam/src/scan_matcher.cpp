// SPDX-License-Identifier: BSD-3-Clause
#include "intensity_hector_slam/scan_matcher.h"

#include <Eigen/Eigenvalues>
#include <algorithm>
#include <array>
#include <cmath>
#include <limits>

#include "interpolation.h"
#include "observability.h"
#include "residuals.h"
#include "window_search.h"

namespace intensity_hector_slam {
namespace {

using Eigen::Array4f;
using Eigen::Matrix3d;
using Eigen::Vector3d;

// Of kLanes cells, with the ones right of them: P, R, P and R of those right.
Eigen::Matrix4f gather(const std::array<const GridMap::Cell*, kLanes>& cells) {
  Eigen::Matrix4f values;
  for (int i = 0; i < kLanes; ++i) {
    values.col(i) = Eigen::Map<const Eigen::Vector4f>(&cells[i]->occupancy);
  }
  values.transposeInPlace();
  return values;
}

Eigen::Map<const Array4f> lanes(const std::vector<float>& values, std::size_t first) {
  return Eigen::Map<const Array4f>(&values[first]);
}

// With angles in units of length, so that eigenvalues compare.
Matrix3d scaled(const Matrix3d& hessian, double length) {
  const Vector3d unit(1.0, 1.0, 1.0 / length);
  return unit.asDiagonal() * hessian * unit.asDiagonal();
}

}  // namespace

// The sum of what both kinds of residuals tell.
class ScanMatcher::Solver {
 public:
  Solver(const Linearization& at, double length, const Observability& observability)
      : unit_(1.0, 1.0, 1.0 / length) {
    const auto add = [&](const NormalEquation& equation, const Matrix3d& projection) {
      hessian_ += projection * scaled(equation.hessian, length) * projection;
      gradient_ += projection * unit_.asDiagonal() * equation.gradient;
    };
    add(at.occupancy, observability.occupancy);
    add(at.reflectivity, observability.reflectivity);
    solver_.compute(hessian_);
    const Vector3d values = solver_.eigenvalues();
    observable_ = (values.array() >= std::max(kTouched, kSingular * values.z())).count();
  }
  int observable() const { return observable_; }

  /// H^-1 g.
  Vector3d step() const {
    Vector3d step = Vector3d::Zero();
    for (int i = 3 - observable_; i < 3; ++i) {
      const Vector3d v = solver_.eigenvectors().col(i);
      step += v * v.dot(gradient_) / solver_.eigenvalues()[i];
    }
    return unit_.asDiagonal() * step;
  }
  Matrix3d unobservablePart() const {
    Matrix3d part = Matrix3d::Zero();
    for (int i = 0; i < 3 - observable_; ++i) {
      const Vector3d v = solver_.eigenvectors().col(i);
      part += v * v.transpose();
    }
    return unit_.asDiagonal() * part * unit_.cwiseInverse().asDiagonal();
  }
  /// The observable direction of the least curvature, as a difference of poses with angles in units of
  /// length.
  Vector3d weakest() const { return solver_.eigenvectors().col(3 - observable_); }
  /// sigma^2 H^-1 and the floor, but nowhere less certain than the prior.
  /// @param curvature in the weakest direction, see ScanMatcher::curvatureAlong
  Matrix3d covariance(double sigma_squared, double curvature, double floor_squared,
                      const Vector3d& prior_variances) const {
    Matrix3d sum = Matrix3d::Zero();
    for (int i = 0; i < 3; ++i) {
      const Vector3d v = solver_.eigenvectors().col(i);
      const bool weakest = i == 3 - observable_;
      const double h = std::max(solver_.eigenvalues()[i], weakest ? kPlateau * curvature : 0.0);
      const double c = weakest ? std::min(h, curvature) : h;
      const double prior = v.dot(prior_variances.cwiseQuotient(unit_.cwiseAbs2()).asDiagonal() * v);
      const bool observed = i >= 3 - observable_ && c > 0.0;
      const double variance = observed ? sigma_squared * h / (c * c) + floor_squared : prior;
      sum += std::min(prior, variance) * v * v.transpose();
    }
    return unit_.asDiagonal() * sum * unit_.asDiagonal();
  }

 private:
  static constexpr double kSingular = 1e-6;  // of the greatest eigenvalue: what was projected away
  static constexpr double kPlateau = 1e-3;   // of the curvature: with less, H tells of a flat bit of the map

  Vector3d unit_;
  Matrix3d hessian_ = Matrix3d::Zero();
  Vector3d gradient_ = Vector3d::Zero();
  Eigen::SelfAdjointEigenSolver<Matrix3d> solver_;
  int observable_ = 0;
};

ScanMatcher::ScanMatcher(const MatcherOptions& options) : options_(mapping_common::validate(options)) {}

ScanMatcher::Linearization ScanMatcher::linearize(const GridMap& map, const Scan& scan, const Pose& pose,
                                                  Cost cost) {
  beams_.assign(scan);
  return linearize(map, beams_, pose, cost, beams_.count);
}

// Of one kind of residuals in a cost.
float ScanMatcher::weightOf(Cost kind, Cost cost) const {
  if (cost != Cost::kCombined) return kind == cost ? 1.0f : 0.0f;
  return static_cast<float>(kind == Cost::kOccupancy ? options_.occupancy_weight
                                                     : options_.reflectivity_weight);
}

Observability ScanMatcher::observe(const Scan& scan, const Touched& touched, const Pose& pose,
                                   Cost cost) const {
  return intensity_hector_slam::observe(scan, touched, pose, beams_.mean_range,
                                        weightOf(Cost::kOccupancy, cost) > 0.0f,
                                        weightOf(Cost::kReflectivity, cost) > 0.0f, options_);
}

// The first beams, kLanes at a time, with both channels of the map where they end.
// @param use called with the index of the first, the map's values and the derivatives of S_i by the angle, in
// cells
template <class Use>
void ScanMatcher::forBeams(const GridMap& map, const Beams& beams, const Pose& pose, std::size_t count,
                           const Use& use) const {
  // From the body's frame to coordinates in which cell (0, 0) has its centre at (0, 0): Eq. 3.7 in cells.
  const double cells = 1.0 / map.resolution();
  const float c = cells * std::cos(pose.z()), s = cells * std::sin(pose.z());
  const float u0 = cells * (pose.x() - map.origin().x()) - 0.5,
              v0 = cells * (pose.y() - map.origin().y()) - 0.5;
  const GridMap::Cell* const data = map.cells().data();
  static constexpr GridMap::Cell unknown[2];
  const int width = map.width();
  const unsigned columns = map.width() - 1, rows = map.height() - 1;  // that have another after them
  // So that conversion to int rounds down what is just outside; far outside stays outside.
  const Array4f max_u = Array4f::Constant(map.width() + 1.0f), max_v = Array4f::Constant(map.height() + 1.0f);
  for (std::size_t first = 0; first < count; first += kLanes) {
    const Eigen::Map<const Array4f> x(&beams.x[first]), y(&beams.y[first]);
    const Array4f dx_dtheta = -s * x - c * y, dy_dtheta = c * x - s * y;
    const Array4f u = dy_dtheta + u0, v = v0 - dx_dtheta;
    const Array4f u1 = (u + 1.0f).max(0.0f).min(max_u), v1 = (v + 1.0f).max(0.0f).min(max_v);
    const Eigen::Array4i column = u1.cast<int>() - 1, row = v1.cast<int>() - 1;  // rounded down from -1 on
    std::array<const GridMap::Cell*, kLanes> lower, upper;
    for (int i = 0; i < kLanes; ++i) {
      const bool inside = static_cast<unsigned>(column[i]) < columns && static_cast<unsigned>(row[i]) < rows;
      lower[i] = inside ? data + static_cast<std::size_t>(row[i]) * width + column[i] : unknown;
      upper[i] = inside ? lower[i] + width : unknown;
    }
    const Array4f fx = u - column.cast<float>(), fy = v - row.cast<float>();
    const Eigen::Matrix4f low = gather(lower), high = gather(upper);
    const auto interpolate = [&](int k) {
      return Bilinear<Array4f>(low.col(k), low.col(k + 2), high.col(k), high.col(k + 2), fx, fy);
    };
    use(first, interpolate(0), interpolate(1), dx_dtheta, dy_dtheta);
  }
}

// Eq. 3.9 and, with 1 - M(S_i) for the residual, Hector SLAM's.
ScanMatcher::Linearization ScanMatcher::linearize(const GridMap& map, const Beams& beams, const Pose& pose,
                                                  Cost cost, std::size_t count) const {
  const float occupancy_weight = weightOf(Cost::kOccupancy, cost),
              reflectivity_weight = weightOf(Cost::kReflectivity, cost);
  Sums occupancy(options_.robust_kernel, options_.robust_scale), reflectivity = occupancy;
  forBeams(map, beams, pose, count,
           [&](std::size_t first, const auto& m, const auto& r, const auto& dx, const auto& dy) {
             if (occupancy_weight > 0.0f) {
               occupancy.add(1.0f - m.value, m.dx, m.dy, m.dx * dx + m.dy * dy, lanes(beams.valid, first));
             }
             if (reflectivity_weight > 0.0f) {
               reflectivity.add(lanes(beams.reflectivity, first) - r.value, r.dx, r.dy, r.dx * dx + r.dy * dy,
                                lanes(beams.known, first));
             }
           });
  Linearization result;
  const double cells = 1.0 / map.resolution();
  result.occupancy = occupancy.addTo(result, occupancy_weight, cells);
  result.reflectivity = reflectivity.addTo(result, reflectivity_weight, cells);
  return result;
}

// Of both kinds of residuals.
Eigen::Vector2d ScanMatcher::costs(const GridMap& map, const Pose& pose, Cost cost) const {
  Sums occupancy(options_.robust_kernel, options_.robust_scale), reflectivity = occupancy;
  const Eigen::Vector2d weights(weightOf(Cost::kOccupancy, cost), weightOf(Cost::kReflectivity, cost));
  forBeams(map, beams_, pose, beams_.count,
           [&](std::size_t first, const auto& m, const auto& r, const auto&, const auto&) {
             if (weights[0] > 0.0) occupancy.add(1.0f - m.value, lanes(beams_.valid, first));
             if (weights[1] > 0.0)
               reflectivity.add(lanes(beams_.reflectivity, first) - r.value, lanes(beams_.known, first));
           });
  return {weights[0] * occupancy.cost(), weights[1] * reflectivity.cost()};
}

ScanMatcher::Linearization ScanMatcher::optimize(const GridMap& map, const Beams& beams, std::size_t count,
                                                 const Observability& observability, double min_distance,
                                                 double min_angle, Pose& pose, Match& match) const {
  // Where only one kind of residuals tells a direction, a step along it is the other's, too, in the cost,
  // which then doesn't tell whether it is good.
  const bool cost_tells =
      match.cost != Cost::kCombined || observability.occupancy == observability.reflectivity;
  const int max_halvings = cost_tells ? options_.max_halvings : 0;
  Linearization at = linearize(map, beams, pose, match.cost, count);
  for (int iteration = 0; iteration < options_.max_iterations; ++iteration) {
    ++match.iterations;
    Vector3d step = Solver(at, beams_.mean_range, observability).step();
    const double distance = step.head<2>().norm(), angle = std::abs(step.z());
    if (distance < min_distance && angle < min_angle) {
      pose += step;
      break;
    }
    step /= std::max({1.0, distance / options_.max_step_distance, angle / options_.max_step_angle});

    Pose next_pose = pose + step;
    Linearization next = linearize(map, beams, next_pose, match.cost, count);
    for (int i = 0; i < max_halvings && !(next.cost < at.cost); ++i) {
      step *= 0.5;
      next_pose = pose + step;
      next = linearize(map, beams, next_pose, match.cost, count);
    }
    if (max_halvings > 0 && !(next.cost < at.cost)) break;
    const bool last = max_halvings > 0 && at.cost - next.cost < options_.min_cost_change * at.cost;
    pose = next_pose;
    at = next;
    if (last) break;
  }
  return at;
}

// Coarse to fine.
ScanMatcher::Linearization ScanMatcher::descend(const MultiMap& map, const Beams& coarse, std::size_t least,
                                                const Observability& observability, Pose& pose,
                                                Match& match) const {
  for (int i = map.levels() - 1; i > 0; --i) {
    const double distance =
        std::max(options_.min_step_distance, options_.coarse_step * map.level(i).resolution());
    const std::size_t count = std::max(coarse.count >> i, std::min(coarse.count, least));
    optimize(map.level(i), coarse, count, observability, distance,
             std::max(options_.min_step_angle, distance / beams_.mean_range), pose, match);
  }
  return optimize(map.level(0), beams_, beams_.count, observability, options_.min_step_distance,
                  options_.min_step_angle, pose, match);
}

Match ScanMatcher::match(const MultiMap& map, const Scan& scan, const Pose& guess, bool search) {
  const GridMap& finest = map.level(0);
  beams_.assign(scan);
  thinned_.assignThinned(beams_, options_.coarse_spacing * finest.resolution(), map.levels(),
                         options_.coarse_points);
  const GridMap& coarsest = map.level(map.levels() - 1);
  Match match;
  match.cost = options_.cost == Cost::kAuto ? chooseCost(coarsest, scan, guess) : options_.cost;
  match.searched = search;
  const Pose start = search ? searchWindow(coarsest, beams_, guess, weightOf(Cost::kOccupancy, match.cost),
                                           weightOf(Cost::kReflectivity, match.cost), options_)
                            : guess;
  Pose pose = start;
  Linearization at = descend(map, thinned_, options_.coarse_points, {}, pose, match);
  Touched touched = touch(coarsest, beams_, pose);
  const Observability observability = observe(scan, touched, pose, match.cost);
  if (!observability.full) {
    const Vector3d unit(1.0, 1.0, 1.0 / beams_.mean_range);
    pose = start + unit.asDiagonal() * (observability.occupancy * (pose - start).cwiseQuotient(unit));
    // Where reflectivity alone tells, each beam counts.
    if (observability.reflectivity.isIdentity())
      at = descend(map, beams_, beams_.count, observability, pose, match);
    else
      at = optimize(finest, beams_, beams_.count, observability, options_.min_step_distance,
                    options_.min_step_angle, pose, match);
  }
  const Solver solver(at, beams_.mean_range, observability);
  match.hessian = at.occupancy.hessian + at.reflectivity.hessian;
  match.observable = solver.observable();
  match.unobservable_part = solver.unobservablePart();
  pose -= match.unobservable_part * (pose - start);
  match.pose = {pose.x(), pose.y(), wrapAngle(pose.z())};
  const double variance = at.squares / std::max(1.0, at.weights);
  match.residual = std::sqrt(variance);
  const double sigma_squared = options_.sigma > 0.0 ? options_.sigma * options_.sigma : variance;
  const double d = options_.unobservable_distance, a = options_.unobservable_angle;
  const double curvature =
      match.observable > 0 ? curvatureAlong(solver.weakest(), finest, match, at, observability) : 0.0;
  const double floor = options_.covariance_floor * finest.resolution();
  match.covariance = solver.covariance(options_.covariance_scale * sigma_squared, curvature, floor * floor,
                                       {d * d, d * d, a * a});
  if (!observability.full) touched = touch(coarsest, beams_, match.pose);
  match.contradiction = touched.share_free;
  match.overlap = touched.share_occupied;
  return match;
}

// Of the cost in a direction, from poses a cell away on both sides. H is what the map changes within a cell,
// its noise as well, as if that told something too. With H = C + noise, the pose that solves Eq. 3.9 has the
// variance sigma^2 C^-1 H C^-1.
double ScanMatcher::curvatureAlong(const Vector3d& v, const GridMap& map, const Match& match,
                                   const Linearization& at, const Observability& observability) const {
  const Vector3d shift = map.resolution() * Vector3d(v.x(), v.y(), v.z() / beams_.mean_range);
  const Eigen::Vector2d rise = costs(map, match.pose - shift, match.cost) +
                               costs(map, match.pose + shift, match.cost) -
                               2.0 * Eigen::Vector2d(at.occupancy.cost, at.reflectivity.cost);
  const Eigen::Vector2d share((observability.occupancy * v).squaredNorm(),
                              (observability.reflectivity * v).squaredNorm());
  return share.dot(rise) / (map.resolution() * map.resolution());
}

// Reflectivity needs normals, and so dense points (section 3.6).
Cost ScanMatcher::chooseCost(const GridMap& map, const Scan& scan, const Pose& guess) {
  if (beams_.share_known < options_.auto_min_known) return Cost::kOccupancy;
  std::vector<float> spacing;
  for (std::size_t i = 1; i < scan.points.size(); ++i) {
    spacing.push_back((scan.points[i] - scan.points[i - 1]).norm());
  }
  const auto middle = spacing.begin() + spacing.size() / 2;
  std::nth_element(spacing.begin(), middle, spacing.end());
  if (middle == spacing.end() || *middle <= options_.auto_max_spacing) return Cost::kCombined;
  const Touched touched = touch(map, beams_, guess);
  return observe(scan, touched, guess, Cost::kOccupancy).full ? Cost::kOccupancy : Cost::kCombined;
}

}  // namespace intensity_hector_slam
