// SPDX-License-Identifier: BSD-3-Clause
#include "intensity_hector_slam/scan_matcher.h"

#include <Eigen/Eigenvalues>
#include <algorithm>
#include <cmath>
#include <limits>

#include "interpolation.h"

namespace intensity_hector_slam {
namespace {

using Eigen::Array4f;
using Eigen::Matrix3d;
using Eigen::Vector3d;

constexpr int kLanes = 4;  // beams at a time

struct Robust {
  Array4f weight, cost;
};

Robust robust(RobustKernel kernel, float scale, const Array4f& e) {
  const Array4f square = e.square(), relative = square / (scale * scale);
  switch (kernel) {
    case RobustKernel::kHuber: {
      const Array4f weight = (scale / e.abs().max(scale)).eval();
      return {weight, square * weight * (2.0f - weight)};
    }
    case RobustKernel::kCauchy:
      return {1.0f / (1.0f + relative), scale * scale * (1.0f + relative).log()};
    case RobustKernel::kTukey: {
      const Array4f inside = (1.0f - relative).max(0.0f);
      return {inside.square(), scale * scale / 3.0f * (1.0f - inside.cube())};
    }
    case RobustKernel::kNone:
      break;
  }
  return {Array4f::Ones(), square};
}

// Sums over beams of one kind of residual.
struct Sums {
  Array4f xx = Array4f::Zero(), xy = xx, xt = xx, yy = xx, yt = xx, tt = xx, xe = xx, ye = xx, te = xx;
  Array4f cost = xx, squares = xx, weights = xx;

  // From cells to metres: derivatives by the angle are per radian already.
  ScanMatcher::NormalEquation equation(double cells_per_metre) const {
    const double m = cells_per_metre, mm = m * m;
    ScanMatcher::NormalEquation equation;
    equation.hessian << mm * xx.sum(), mm * xy.sum(), m * xt.sum(),  //
        mm * xy.sum(), mm * yy.sum(), m * yt.sum(),                  //
        m * xt.sum(), m * yt.sum(), tt.sum();
    equation.gradient << m * xe.sum(), m * ye.sum(), te.sum();
    return equation;
  }

  // e: residual; dx, dy, dt: derivatives of the map's value by the pose
  void add(const Array4f& e, const Array4f& dx, const Array4f& dy, const Array4f& dt, const Array4f& factor,
           const Robust& robust) {
    const Array4f w = factor * robust.weight;
    const Array4f wx = w * dx, wy = w * dy, wt = w * dt;
    xx += wx * dx;
    xy += wx * dy;
    xt += wx * dt;
    yy += wy * dy;
    yt += wy * dt;
    tt += wt * dt;
    xe += wx * e;
    ye += wy * e;
    te += wt * e;
    cost += factor * robust.cost;
    squares += w * e.square();
    weights += w;
  }
};

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
  /// sigma^2 H^-1, but nowhere less certain than the prior.
  Matrix3d covariance(double sigma_squared, const Vector3d& prior_variances) const {
    Matrix3d sum = Matrix3d::Zero();
    for (int i = 0; i < 3; ++i) {
      const Vector3d v = solver_.eigenvectors().col(i);
      const double prior = v.dot(prior_variances.cwiseQuotient(unit_.cwiseAbs2()).asDiagonal() * v);
      const double variance =
          i < 3 - observable_ ? prior : std::min(prior, sigma_squared / solver_.eigenvalues()[i]);
      sum += variance * v * v.transpose();
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
  result.cost = occupancy.cost.sum() + reflectivity.cost.sum();
  result.squares = occupancy.squares.sum() + reflectivity.squares.sum();
  result.weights = occupancy.weights.sum() + reflectivity.weights.sum();
  return result;
}

// In which directions one kind of residuals is trusted, see MatcherOptions::min_eigenvalue_ratio.
Matrix3d ScanMatcher::project(const GridMap& map, const Pose& pose, Cost kind, const Matrix3d& hessian,
                              const Matrix3d& directions) const {
  Matrix3d projection = Matrix3d::Identity();
  const Vector3d curvatures = (directions.transpose() * hessian * directions).diagonal();
  const double least = options_.min_eigenvalue_ratio * curvatures.z();
  if (curvatures.z() < kTouched || curvatures.head<2>().minCoeff() >= least) return projection;

  const double here = linearize(map, pose, kind).cost;
  const auto rise = [&](int direction) {
    const Vector3d v = directions.col(direction);
    const Pose shift = options_.probe_distance * Vector3d(v.x(), v.y(), v.z() / beams_.mean_range);
    return 0.5 * (linearize(map, pose + shift, kind).cost + linearize(map, pose - shift, kind).cost) - here;
  };
  const double greatest = rise(2);
  for (int i = 0; i < 2; ++i) {
    const Vector3d v = directions.col(i);
    if (curvatures[i] < least && rise(i) < options_.min_observability * greatest)
      projection -= v * v.transpose();
  }
  return projection;
}

// Both kinds are looked at in the same directions, so that what neither tells is left over by their sum, too.
ScanMatcher::Observability ScanMatcher::observe(const GridMap& map, const Pose& pose, Cost cost) const {
  const Linearization at = linearize(map, pose, cost);
  const Matrix3d occupancy = scaled(at.occupancy.hessian, beams_.mean_range);
  const Matrix3d reflectivity = scaled(at.reflectivity.hessian, beams_.mean_range);
  const Matrix3d directions = EigenSolver(occupancy + reflectivity).eigenvectors();
  Observability result;
  result.occupancy = project(map, pose, Cost::kOccupancy, occupancy, directions);
  result.reflectivity = project(map, pose, Cost::kReflectivity, reflectivity, directions);
  result.full = result.occupancy.isIdentity() && result.reflectivity.isIdentity();
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
  Match match;
  match.cost = options_.cost == Cost::kAuto ? chooseCost(map.level(0), scan, guess) : options_.cost;
  match.searched = search;
  const GridMap& finest = map.level(0);
  const GridMap& coarsest = map.level(map.levels() - 1);
  const Pose start = search ? searchWindow(coarsest, guess, match.cost) : guess;
  Pose pose = descend(map, start, {}, match);
  const Observability observability = observe(finest, pose, match.cost);
  if (!observability.full) pose = descend(map, start, observability, match);

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
  match.covariance = solver.covariance(options_.covariance_scale * sigma_squared, {d * d, d * d, a * a});
  assess(coarsest, match);
  return match;
}

// On the coarsest level, whose cells are larger than the noise.
void ScanMatcher::assess(const GridMap& map, Match& match) const {
  std::size_t free = 0, occupied = 0;
  for (std::size_t i = 0; i < beams_.count; ++i) {
    const GridMap::Cell* cell = map.find(transform(match.pose, {beams_.x[i], beams_.y[i]}));
    if (!cell) continue;
    free += GridMap::isFree(*cell);
    occupied += GridMap::isOccupied(*cell);
  }
  const double n = std::max<std::size_t>(1, beams_.count);
  match.contradiction = free / n;
  match.overlap = occupied / n;
}

// Reflectivity needs normals, and so dense points (section 3.6).
Cost ScanMatcher::chooseCost(const GridMap& map, const Scan& scan, const Pose& guess) const {
  if (beams_.share_known < options_.auto_min_known) return Cost::kOccupancy;
  std::vector<float> spacing;
  for (std::size_t i = 1; i < scan.points.size(); ++i) {
    spacing.push_back((scan.points[i] - scan.points[i - 1]).norm());
  }
  const auto middle = spacing.begin() + spacing.size() / 2;
  std::nth_element(spacing.begin(), middle, spacing.end());
  if (middle == spacing.end() || *middle <= options_.auto_max_spacing) return Cost::kCombined;
  return observe(map, guess, Cost::kOccupancy).full ? Cost::kOccupancy : Cost::kCombined;
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
