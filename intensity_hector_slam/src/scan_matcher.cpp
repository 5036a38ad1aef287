// SPDX-License-Identifier: BSD-3-Clause
#include "intensity_hector_slam/scan_matcher.h"

#include <Eigen/Eigenvalues>
#include <algorithm>
#include <cmath>
#include <limits>

#include "interpolation.h"
#include "residuals.h"
#include "surface.h"

namespace intensity_hector_slam {
namespace {

using Eigen::Array4f;
using Eigen::Matrix3d;
using Eigen::Vector3d;

using EigenSolver = Eigen::SelfAdjointEigenSolver<Matrix3d>;

// With angles in units of length, so that eigenvalues compare.
Matrix3d scaled(const Matrix3d& hessian, double length) {
  const Vector3d unit(1.0, 1.0, 1.0 / length);
  return unit.asDiagonal() * hessian * unit.asDiagonal();
}

constexpr double kTouched = 1e-3;  // a scan that touches no known cell has eigenvalues of 0

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
      const double h = solver_.eigenvalues()[i], c = i == 3 - observable_ ? std::min(h, curvature) : h;
      const double prior = v.dot(prior_variances.cwiseQuotient(unit_.cwiseAbs2()).asDiagonal() * v);
      const bool observed = i >= 3 - observable_ && c > 0.0;
      const double variance = observed ? sigma_squared * h / (c * c) + floor_squared : prior;
      sum += std::min(prior, variance) * v * v.transpose();
    }
    return unit_.asDiagonal() * sum * unit_.asDiagonal();
  }

 private:
  static constexpr double kSingular = 1e-6;  // of the greatest eigenvalue: what was projected away

  Vector3d unit_;
  Matrix3d hessian_ = Matrix3d::Zero();
  Vector3d gradient_ = Vector3d::Zero();
  EigenSolver solver_;
  int observable_ = 0;
};

ScanMatcher::ScanMatcher(const MatcherOptions& options) : options_(options) {
  options_.validate();
}

void ScanMatcher::prepare(const Scan& scan) {
  const std::size_t n = scan.points.size(), padded = (n + kLanes - 1) / kLanes * kLanes;
  for (auto* values : {&beams_.x, &beams_.y, &beams_.reflectivity, &beams_.known, &beams_.valid}) {
    values->assign(padded, 0.0f);
  }
  double sum = 0.0;
  std::size_t known = 0;
  for (std::size_t i = 0; i < n; ++i) {
    beams_.x[i] = scan.points[i].x();
    beams_.y[i] = scan.points[i].y();
    beams_.valid[i] = 1.0f;
    if (!scan.reflectivities.empty() && std::isfinite(scan.reflectivities[i])) {
      beams_.reflectivity[i] = scan.reflectivities[i];
      beams_.known[i] = 1.0f;
      ++known;
    }
    sum += scan.points[i].norm();
  }
  beams_.count = n;
  beams_.mean_range = n > 0 ? std::max(0.1, sum / n) : 1.0;
  beams_.share_known = n > 0 ? static_cast<double>(known) / n : 0.0;
}

ScanMatcher::Linearization ScanMatcher::linearize(const GridMap& map, const Scan& scan, const Pose& pose,
                                                  Cost cost) {
  prepare(scan);
  return linearize(map, pose, cost);
}

// Of one kind of residuals in a cost.
float ScanMatcher::weightOf(Cost kind, Cost cost) const {
  if (cost != Cost::kCombined) return kind == cost ? 1.0f : 0.0f;
  return static_cast<float>(kind == Cost::kOccupancy ? options_.occupancy_weight
                                                     : options_.reflectivity_weight);
}

// Eq. 3.9 and, with 1 - M(S_i) for the residual, Hector SLAM's.
ScanMatcher::Linearization ScanMatcher::linearize(const GridMap& map, const Pose& pose, Cost cost) const {
  const float occupancy_weight = weightOf(Cost::kOccupancy, cost),
              reflectivity_weight = weightOf(Cost::kReflectivity, cost);
  const float scale = options_.robust_scale;
  // From the body's frame to coordinates in which cell (0, 0) has its centre at (0, 0): Eq. 3.7 in cells.
  const double cells = 1.0 / map.resolution();
  const float c = cells * std::cos(pose.z()), s = cells * std::sin(pose.z());
  const float u0 = cells * (pose.x() - map.origin().x()) - 0.5,
              v0 = cells * (pose.y() - map.origin().y()) - 0.5;
  const float max_u = map.width() - 1, max_v = map.height() - 1;
  const GridMap::Cell* const data = map.cells().data();
  const int width = map.width();

  Sums occupancy, reflectivity;
  for (std::size_t first = 0; first < beams_.x.size(); first += kLanes) {
    const Eigen::Map<const Array4f> x(&beams_.x[first]), y(&beams_.y[first]);
    const Array4f dx_dtheta = -s * x - c * y, dy_dtheta = c * x - s * y;  // of S_i, in cells
    const Array4f u = dy_dtheta + u0, v = v0 - dx_dtheta;

    Array4f value[2], dx[2], dy[2];
    for (int i = 0; i < kLanes; ++i) {
      GridMap::Interpolation at{{0.5f, 0.0f}, {0.0f, 0.0f}, {0.0f, 0.0f}};
      if (u[i] >= 0.0f && v[i] >= 0.0f && u[i] < max_u && v[i] < max_v) {
        const int column = static_cast<int>(u[i]), row = static_cast<int>(v[i]);
        const GridMap::Cell* const cell = data + static_cast<std::size_t>(row) * width + column;
        at = interpolateCells(cell, cell + width, u[i] - column, v[i] - row);
      }
      for (int k = 0; k < 2; ++k) {
        value[k][i] = at.value[k];
        dx[k][i] = at.dx[k];
        dy[k][i] = at.dy[k];
      }
    }
    if (occupancy_weight > 0.0f) {
      const Array4f e = 1.0f - value[0];
      occupancy.add(e, dx[0], dy[0], dx[0] * dx_dtheta + dy[0] * dy_dtheta,
                    occupancy_weight * Eigen::Map<const Array4f>(&beams_.valid[first]),
                    robust(options_.robust_kernel, scale, e));
    }
    if (reflectivity_weight > 0.0f) {
      const Array4f e = Eigen::Map<const Array4f>(&beams_.reflectivity[first]) - value[1];
      reflectivity.add(e, dx[1], dy[1], dx[1] * dx_dtheta + dy[1] * dy_dtheta,
                       reflectivity_weight * Eigen::Map<const Array4f>(&beams_.known[first]),
                       robust(options_.robust_kernel, scale, e));
    }
  }

  Linearization result;
  result.occupancy = occupancy.equation(cells);
  result.reflectivity = reflectivity.equation(cells);
  result.cost = result.occupancy.cost + result.reflectivity.cost;
  result.squares = occupancy.squares.sum() + reflectivity.squares.sum();
  result.weights = occupancy.weights.sum() + reflectivity.weights.sum();
  return result;
}

// Where the points are on the map, on its coarsest level, whose cells are larger than the noise.
void ScanMatcher::touch(const GridMap& map, const Pose& pose) {
  beams_.on_free = 0;
  beams_.on_occupied.assign(beams_.count, false);
  for (std::size_t i = 0; i < beams_.count; ++i) {
    const GridMap::Cell* cell = map.find(transform(pose, {beams_.x[i], beams_.y[i]}));
    if (!cell) continue;
    beams_.on_free += GridMap::isFree(*cell);
    beams_.on_occupied[i] = GridMap::isOccupied(*cell);
  }
}

// What a scan can tell at most depends on its surfaces alone, by Fisher's information (A. Censi, "On
// achievable accuracy for range-finder localization", ICRA 2007): sum of J^T J with J = n^T dS/dzeta for the
// occupancy, n the normal. Along the surfaces, only their reflectivity tells. Surfaces that the map doesn't
// have tell nothing.
ScanMatcher::Observability ScanMatcher::observe(const Scan& scan, const Pose& pose, Cost cost) const {
  struct Known {
    Vector3d across, along;  // J, with angles in units of length
    double points, texture;
  };
  std::vector<Known> surface;
  Matrix3d information = Matrix3d::Zero();
  const Eigen::Rotation2Dd rotation(pose.z());
  for (const SurfacePiece& piece : surfacePieces(scan, options_.surface_length)) {
    const auto occupied = beams_.on_occupied.begin();
    const double points = std::count(occupied + piece.begin, occupied + piece.end, true);
    const auto jacobian = [&](const Eigen::Vector2d& direction) {
      const double by_angle = direction.y() * piece.centre.x() - direction.x() * piece.centre.y();
      Vector3d j;
      j << rotation * direction, by_angle / beams_.mean_range;
      return j;
    };
    const Known known{jacobian(piece.normal), jacobian({piece.normal.y(), -piece.normal.x()}), points,
                      piece.texture};
    // Noise turns normals, which looks like information along the surface.
    information += points * (known.across * known.across.transpose() -
                             piece.normal_variance * known.along * known.along.transpose());
    surface.push_back(known);
  }
  const EigenSolver solver(information);
  const auto textureAlong = [&](const Vector3d& v) {
    double sum = 0.0, weights = 0.0;
    for (const Known& known : surface) {
      if (std::isnan(known.texture)) continue;
      const double part = known.along.dot(v), weight = known.points * part * part;
      sum += weight * known.texture;
      weights += weight;
    }
    return weights > 0.0 ? sum / weights : 0.0;
  };
  Observability result;
  const bool uses_reflectivity = weightOf(Cost::kReflectivity, cost) > 0.0f;
  for (int i = 0; i < 3; ++i) {
    const double share =
        std::max(0.0, solver.eigenvalues()[i]) / std::max(kTouched, solver.eigenvalues().z());
    if (share >= std::max(options_.min_observability, options_.min_geometry)) continue;
    const Vector3d v = solver.eigenvectors().col(i);
    const bool textured = uses_reflectivity && textureAlong(v) >= options_.min_texture;
    if (share >= options_.min_observability && !textured) continue;
    result.full = false;
    result.occupancy -= v * v.transpose();
    if (!textured) result.reflectivity -= v * v.transpose();
  }
  if (weightOf(Cost::kOccupancy, cost) == 0.0f) result.full = result.reflectivity.isIdentity();
  return result;
}

int ScanMatcher::optimize(const GridMap& map, Cost cost, const Observability& observability,
                          Pose& pose) const {
  // What is projected away still is in the cost, which then doesn't tell whether a step is good.
  const int max_halvings = observability.full ? options_.max_halvings : 0;
  Linearization at = linearize(map, pose, cost);
  int iterations = 0;
  while (iterations < options_.max_iterations) {
    ++iterations;
    Vector3d step = Solver(at, beams_.mean_range, observability).step();
    const double distance = step.head<2>().norm(), angle = std::abs(step.z());
    step /= std::max({1.0, distance / options_.max_step_distance, angle / options_.max_step_angle});

    Pose next_pose = pose + step;
    Linearization next = linearize(map, next_pose, cost);
    for (int i = 0; i < max_halvings && !(next.cost < at.cost); ++i) {
      step *= 0.5;
      next_pose = pose + step;
      next = linearize(map, next_pose, cost);
    }
    if (max_halvings > 0 && !(next.cost < at.cost)) break;
    pose = next_pose;
    at = next;
    if (step.head<2>().norm() < options_.min_step_distance && std::abs(step.z()) < options_.min_step_angle)
      break;
  }
  return iterations;
}

// Coarse to fine.
Pose ScanMatcher::descend(const MultiMap& map, const Pose& start, const Observability& observability,
                          Match& match) const {
  Pose pose = start;
  for (int i = map.levels() - 1; i >= 0; --i) {
    match.iterations += optimize(map.level(i), match.cost, observability, pose);
  }
  return pose;
}

Match ScanMatcher::match(const MultiMap& map, const Scan& scan, const Pose& guess, bool search) {
  prepare(scan);
  const GridMap& finest = map.level(0);
  const GridMap& coarsest = map.level(map.levels() - 1);
  Match match;
  match.cost = options_.cost == Cost::kAuto ? chooseCost(coarsest, scan, guess) : options_.cost;
  match.searched = search;
  const Pose start = search ? searchWindow(coarsest, guess, match.cost) : guess;
  Pose pose = descend(map, start, {}, match);
  touch(coarsest, pose);
  const Observability observability = observe(scan, pose, match.cost);
  if (!observability.full) {
    const Vector3d unit(1.0, 1.0, 1.0 / beams_.mean_range);
    pose = start + unit.asDiagonal() * (observability.occupancy * (pose - start).cwiseQuotient(unit));
    if (observability.reflectivity.isIdentity())
      pose = descend(map, pose, observability, match);
    else
      match.iterations += optimize(finest, match.cost, observability, pose);
  }

  const Linearization at = linearize(finest, pose, match.cost);
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
  if (!observability.full) touch(coarsest, match.pose);
  const double n = std::max<std::size_t>(1, beams_.count);
  match.contradiction = beams_.on_free / n;
  match.overlap = std::count(beams_.on_occupied.begin(), beams_.on_occupied.end(), true) / n;
  return match;
}

// Of the cost in a direction, from poses a cell away on both sides. H is what the map changes within a cell,
// its noise as well, as if that told something too. With H = C + noise, the pose that solves Eq. 3.9 has the
// variance sigma^2 C^-1 H C^-1.
double ScanMatcher::curvatureAlong(const Vector3d& v, const GridMap& map, const Match& match,
                                   const Linearization& at, const Observability& observability) const {
  const Vector3d shift = map.resolution() * Vector3d(v.x(), v.y(), v.z() / beams_.mean_range);
  const Linearization before = linearize(map, match.pose - shift, match.cost),
                      after = linearize(map, match.pose + shift, match.cost);
  const auto rise = [&](const NormalEquation Linearization::*kind, const Matrix3d& projection) {
    return (projection * v).squaredNorm() *
           ((before.*kind).cost + (after.*kind).cost - 2.0 * (at.*kind).cost);
  };
  return (rise(&Linearization::occupancy, observability.occupancy) +
          rise(&Linearization::reflectivity, observability.reflectivity)) /
         (map.resolution() * map.resolution());
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
  touch(map, guess);
  return observe(scan, guess, Cost::kOccupancy).full ? Cost::kOccupancy : Cost::kCombined;
}

// All poses of a grid of poses as fine as the cells, with the nearest cells instead of interpolation.
Pose ScanMatcher::searchWindow(const GridMap& map, const Pose& guess, Cost cost) const {
  const double cells = 1.0 / map.resolution();
  const float occupancy_weight = weightOf(Cost::kOccupancy, cost),
              reflectivity_weight = weightOf(Cost::kReflectivity, cost);
  const std::size_t stride = (beams_.count + options_.search_points - 1) / options_.search_points;
  const double angle_step = map.resolution() / beams_.mean_range;
  const int steps = static_cast<int>(options_.search_distance * cells);
  const int turns = static_cast<int>(options_.search_angle / angle_step);

  std::vector<Eigen::Vector2i> ends(beams_.count);
  const auto costAt = [&](int dx, int dy, float limit) {
    float sum = 0.0f;
    for (std::size_t i = 0; i < beams_.count && sum < limit; i += stride) {
      const int x = ends[i].x() + dx, y = ends[i].y() + dy;
      const bool inside = x >= 0 && y >= 0 && x < map.width() && y < map.height();
      const GridMap::Cell cell = inside ? map.cell(x, y) : GridMap::Cell{};
      const float occupancy = 1.0f - cell.occupancy,
                  reflectivity = beams_.reflectivity[i] - cell.reflectivity;
      sum += occupancy_weight * occupancy * occupancy +
             reflectivity_weight * beams_.known[i] * reflectivity * reflectivity;
    }
    return sum;
  };
  const auto turnTo = [&](double angle) {
    const Pose pose(guess.x(), guess.y(), angle);
    for (std::size_t i = 0; i < beams_.count; i += stride) {
      const Eigen::Vector2d end = (transform(pose, {beams_.x[i], beams_.y[i]}) - map.origin()) * cells;
      ends[i] = end.array().floor().min(1e9).max(-1e9).cast<int>();
    }
  };
  turnTo(guess.z());
  Pose best = guess;
  float least = costAt(0, 0, std::numeric_limits<float>::infinity());
  for (int t = -turns; t <= turns; ++t) {
    turnTo(guess.z() + t * angle_step);
    for (int y = -steps; y <= steps; ++y) {
      for (int x = -steps; x <= steps; ++x) {
        const float here = costAt(x, y, least);
        if (!(here < least)) continue;
        least = here;
        best = guess + Pose(x / cells, y / cells, t * angle_step);
      }
    }
  }
  return best;
}

}  // namespace intensity_hector_slam
