// SPDX-License-Identifier: BSD-3-Clause
#include "intensity_hector_slam/scan_matcher.h"

#include <Eigen/Eigenvalues>
#include <algorithm>
#include <array>
#include <cmath>
#include <limits>

#include "interpolation.h"

namespace intensity_hector_slam {
namespace {

using Eigen::Array4f;
using Eigen::Matrix3d;
using Eigen::Vector3d;

constexpr int kLanes = 4;  // beams at a time

// Of kLanes cells, with the ones right of them: P, R, P and R of those right.
Eigen::Matrix4f gather(const std::array<const GridMap::Cell*, kLanes>& cells) {
  Eigen::Matrix4f values;
  for (int i = 0; i < kLanes; ++i) {
    values.col(i) = Eigen::Map<const Eigen::Vector4f>(&cells[i]->occupancy);
  }
  values.transposeInPlace();
  return values;
}

// Sums over beams of one kind of residual.
class Sums {
 public:
  Sums(RobustKernel kernel, float scale)
      : kernel_(kernel), scale_(scale), inverse_square_(1.0f / (scale * scale)) {}

  // e: residual; dx, dy, dt: derivatives of the map's value by the pose; mask: 0 for beams that don't count
  void add(Array4f e, const Array4f& dx, const Array4f& dy, const Array4f& dt, const Array4f& mask) {
    e *= mask;
    const Array4f w = mask * weigh(e);
    const Array4f wx = w * dx, wy = w * dy, wt = w * dt;
    xx_ += wx * dx;
    xy_ += wx * dy;
    xt_ += wx * dt;
    yy_ += wy * dy;
    yt_ += wy * dt;
    tt_ += wt * dt;
    xe_ += wx * e;
    ye_ += wy * e;
    te_ += wt * e;
    squares_ += w * e.square();
    weights_ += w;
  }

  // From cells to metres: derivatives by the angle are per radian already.
  ScanMatcher::NormalEquation addTo(ScanMatcher::Linearization& total, double weight,
                                    double cells_per_metre) {
    total.cost += weight * (cost_ + scale_ * scale_ * product_.log()).sum();
    total.squares += weight * squares_.sum();
    total.weights += weight * weights_.sum();
    const double m = weight * cells_per_metre, mm = m * cells_per_metre;
    ScanMatcher::NormalEquation equation;
    equation.hessian << mm * xx_.sum(), mm * xy_.sum(), m * xt_.sum(),  //
        mm * xy_.sum(), mm * yy_.sum(), m * yt_.sum(),                  //
        m * xt_.sum(), m * yt_.sum(), weight * tt_.sum();
    equation.gradient << m * xe_.sum(), m * ye_.sum(), weight * te_.sum();
    return equation;
  }

 private:
  // The weights of residuals, whose robust costs are added up.
  Array4f weigh(const Array4f& e) {
    const Array4f square = e.square(), relative = square * inverse_square_;
    switch (kernel_) {
      case RobustKernel::kHuber: {
        const Array4f weight = scale_ / e.abs().max(scale_);
        cost_ += square * weight * (2.0f - weight);
        return weight;
      }
      case RobustKernel::kCauchy: {
        // s^2 log(1 + (e / s)^2); the logarithm of a product is quicker than one for each residual.
        const Array4f factor = 1.0f + relative.min(1e9f);
        product_ *= factor;
        if (++factors_ % 4 == 0) {  // before it overflows
          cost_ += scale_ * scale_ * product_.log();
          product_.setOnes();
        }
        return factor.inverse();
      }
      case RobustKernel::kTukey: {
        const Array4f inside = (1.0f - relative).max(0.0f);
        cost_ += scale_ * scale_ / 3.0f * (1.0f - inside.cube());
        return inside.square();
      }
      case RobustKernel::kNone:
        break;
    }
    cost_ += square;
    return Array4f::Ones();
  }

  RobustKernel kernel_;
  float scale_, inverse_square_;
  Array4f xx_ = Array4f::Zero(), xy_ = xx_, xt_ = xx_, yy_ = xx_, yt_ = xx_, tt_ = xx_, xe_ = xx_, ye_ = xx_,
          te_ = xx_;
  Array4f squares_ = xx_, weights_ = xx_, cost_ = xx_, product_ = Array4f::Ones();
  int factors_ = 0;
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

  Sums occupancy(options_.robust_kernel, options_.robust_scale), reflectivity = occupancy;
  for (std::size_t first = 0; first < beams_.x.size(); first += kLanes) {
    const Eigen::Map<const Array4f> x(&beams_.x[first]), y(&beams_.y[first]);
    const Array4f dx_dtheta = -s * x - c * y, dy_dtheta = c * x - s * y;  // of S_i, in cells
    const Array4f u = dy_dtheta + u0, v = v0 - dx_dtheta;
    const Array4f u1 = (u + 1.0f).max(0.0f).min(max_u), v1 = (v + 1.0f).max(0.0f).min(max_v);
    Eigen::Array4i column, row;  // rounded down from -1 on
    for (int i = 0; i < kLanes; ++i) column[i] = static_cast<int>(u1[i]) - 1;
    for (int i = 0; i < kLanes; ++i) row[i] = static_cast<int>(v1[i]) - 1;
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
    if (occupancy_weight > 0.0f) {
      const Bilinear<Array4f> m = interpolate(0);
      const Array4f e = 1.0f - m.value;
      occupancy.add(e, m.dx, m.dy, m.dx * dx_dtheta + m.dy * dy_dtheta,
                    Eigen::Map<const Array4f>(&beams_.valid[first]));
    }
    if (reflectivity_weight > 0.0f) {
      const Bilinear<Array4f> r = interpolate(1);
      const Array4f e = Eigen::Map<const Array4f>(&beams_.reflectivity[first]) - r.value;
      reflectivity.add(e, r.dx, r.dy, r.dx * dx_dtheta + r.dy * dy_dtheta,
                       Eigen::Map<const Array4f>(&beams_.known[first]));
    }
  }

  Linearization result;
  result.occupancy = occupancy.addTo(result, occupancy_weight, cells);
  result.reflectivity = reflectivity.addTo(result, reflectivity_weight, cells);
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
ScanMatcher::Observability ScanMatcher::observe(const GridMap& map, const Pose& pose,
                                                const Linearization& at) const {
  const Matrix3d occupancy = scaled(at.occupancy.hessian, beams_.mean_range);
  const Matrix3d reflectivity = scaled(at.reflectivity.hessian, beams_.mean_range);
  const Matrix3d directions = EigenSolver(occupancy + reflectivity).eigenvectors();
  Observability result;
  result.occupancy = project(map, pose, Cost::kOccupancy, occupancy, directions);
  result.reflectivity = project(map, pose, Cost::kReflectivity, reflectivity, directions);
  result.full = result.occupancy.isIdentity() && result.reflectivity.isIdentity();
  return result;
}

ScanMatcher::Linearization ScanMatcher::optimize(const GridMap& map, const Observability& observability,
                                                 double min_distance, double min_angle, Pose& pose,
                                                 Match& match) const {
  // What is projected away still is in the cost, which then doesn't tell whether a step is good.
  const int max_halvings = observability.full ? options_.max_halvings : 0;
  Linearization at = linearize(map, pose, match.cost);
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
    Linearization next = linearize(map, next_pose, match.cost);
    for (int i = 0; i < max_halvings && !(next.cost < at.cost); ++i) {
      step *= 0.5;
      next_pose = pose + step;
      next = linearize(map, next_pose, match.cost);
    }
    if (max_halvings > 0 && !(next.cost < at.cost)) break;
    pose = next_pose;
    at = next;
  }
  return at;
}

// Coarse to fine.
ScanMatcher::Linearization ScanMatcher::descend(const MultiMap& map, const Observability& observability,
                                                Pose& pose, Match& match) const {
  for (int i = map.levels() - 1; i > 0; --i) {
    const double distance =
        std::max(options_.min_step_distance, options_.coarse_step * map.level(i).resolution());
    optimize(map.level(i), observability, distance,
             std::max(options_.min_step_angle, distance / beams_.mean_range), pose, match);
  }
  return optimize(map.level(0), observability, options_.min_step_distance, options_.min_step_angle, pose,
                  match);
}

Match ScanMatcher::match(const MultiMap& map, const Scan& scan, const Pose& guess, bool search) {
  prepare(scan);
  Match match;
  match.cost = options_.cost == Cost::kAuto ? chooseCost(map.level(0), scan, guess) : options_.cost;
  match.searched = search;
  const GridMap& finest = map.level(0);
  const GridMap& coarsest = map.level(map.levels() - 1);
  const Pose start = search ? searchWindow(coarsest, guess, match.cost) : guess;
  Pose pose = start;
  Linearization at = descend(map, {}, pose, match);
  const Observability observability = observe(finest, pose, at);
  if (!observability.full) {
    pose = start;
    at = descend(map, observability, pose, match);
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
  match.covariance = solver.covariance(options_.covariance_scale * sigma_squared, {d * d, d * d, a * a});
  assess(coarsest, match);
  return match;
}

// On the coarsest level, whose cells are larger than the noise.
void ScanMatcher::assess(const GridMap& map, Match& match) const {
  const Eigen::Isometry2d to_map =
      Eigen::Translation2d(match.pose.head<2>()) * Eigen::Rotation2Dd(match.pose.z());
  std::size_t free = 0, occupied = 0;
  for (std::size_t i = 0; i < beams_.count; ++i) {
    const GridMap::Cell* cell = map.find(to_map * Eigen::Vector2d(beams_.x[i], beams_.y[i]));
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
  const Linearization at = linearize(map, guess, Cost::kOccupancy);
  return observe(map, guess, at).full ? Cost::kOccupancy : Cost::kCombined;
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
