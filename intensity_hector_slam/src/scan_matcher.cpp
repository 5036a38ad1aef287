// SPDX-License-Identifier: BSD-3-Clause
#include "intensity_hector_slam/scan_matcher.h"

#include <Eigen/Eigenvalues>
#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <optional>

#include "cost.h"
#include "observability.h"

namespace intensity_hector_slam {
namespace {

using Eigen::Matrix3d;
using Eigen::Vector3d;

// Of the surfaces' points on those that the map has, with less of which at the first guess it is too far from
// the pose to tell what is observable.
constexpr double kSureShare = 0.5;

// The same, with which the finest level is enough where the first guess is near: people who walk pull it
// away.
constexpr double kNearShare = 0.8;
// The variance for who takes the errors of successive matches for independent: they are alike.
constexpr double kAlike = 3.0;
// Beams whose errors are alike, and about how many tell the curvature.
constexpr std::size_t kPiece = 16, kCurvatureBeams = 128;
// Cells: least standard deviation, as few pieces of a scan don't tell all directions.
constexpr double kLeastError = 0.004;
// Cells: of the map of a single scan, which noise of its points decides; the more scans, the less.
constexpr double kFirstError = 0.1;
// Fewer points than these tell no pose.
constexpr std::size_t kLeastPoints = 30;

// The points on whose beams the map knows what is `margin` (m) before them.
void leaveOutNew(const GridMap& map, const Scan& scan, const Pose& pose, double margin, Scan& known) {
  using Eigen::Array4f;
  known.stamp = scan.stamp;
  known.origin = scan.origin;
  known.points.clear();
  known.reflectivities.clear();
  const double cells = 1.0 / map.resolution();
  const float c = cells * std::cos(pose.z()), s = cells * std::sin(pose.z());
  const float u0 = cells * pose.x(), v0 = cells * pose.y();
  std::array<Eigen::Vector2f, kLanes> points;
  for (std::size_t first = 0; first < scan.points.size(); first += kLanes) {
    const std::size_t n = std::min<std::size_t>(kLanes, scan.points.size() - first);
    std::fill(std::copy_n(&scan.points[first], n, points.begin()), points.end(), scan.origin);
    const Eigen::Map<const Eigen::Array<float, 2, kLanes>> ends(points.front().data());
    const Array4f dx = ends.row(0) - scan.origin.x(), dy = ends.row(1) - scan.origin.y();
    const Array4f length = (dx.square() + dy.square()).sqrt();
    const Array4f before = (1.0f - static_cast<float>(margin) / length.max(1e-6f)).max(0.0f);
    const Array4f x = scan.origin.x() + before * dx, y = scan.origin.y() + before * dy;
    const auto there = map.cellsAt(c * x - s * y + u0, s * x + c * y + v0);
    for (std::size_t i = 0; i < n; ++i) {
      if (!GridMap::isKnown(*there[i])) continue;
      known.points.push_back(points[i]);
      if (!scan.reflectivities.empty()) known.reflectivities.push_back(scan.reflectivities[first + i]);
    }
  }
}

// 0 to 1: how much of a scan's surfaces is along the lines of the grid. There, what cells make of exact
// points is the same for all points of a surface; elsewhere it averages out, and so it does where noise blurs
// the surface over a cell. Where points are in cells of the grid tells: the mean of exp(2 pi i (u - u')) over
// pairs of pieces in a block of neighbouring ones, u in cells, with v as well.
double alongGrid(const Beams& beams, const GridMap& map, const Pose& pose) {
  using Eigen::Array4f;
  using Phases = Eigen::Array4d;  // real and imaginary, of u and v
  constexpr std::size_t kBlock = 16 * kPiece;
  const float turn = static_cast<float>(2.0 * M_PI / map.resolution());
  const float c = std::cos(pose.z()), s = std::sin(pose.z());
  double products = 0.0, pairs = 0.0;
  for (std::size_t block = 0; block < beams.count; block += kBlock) {
    Phases sum = Phases::Zero(), squares = sum;
    double pieces = 0.0;
    for (std::size_t i = block; i < std::min(beams.count, block + kBlock); i += kPiece) {
      const Eigen::Map<const Array4f> x(&beams.x[i]), y(&beams.y[i]), valid(&beams.valid[i]);
      const Array4f u = turn * (c * x - s * y + static_cast<float>(pose.x()));
      const Array4f v = turn * (s * x + c * y + static_cast<float>(pose.y()));
      const Phases phases = Phases((valid * u.cos()).sum(), (valid * u.sin()).sum(), (valid * v.cos()).sum(),
                                   (valid * v.sin()).sum()) /
                            kLanes;
      sum += phases;
      squares += phases.square();
      pieces += 1.0;
    }
    products += (sum.square() - squares).sum();
    pairs += pieces * (pieces - 1.0);
  }
  return std::sqrt(std::clamp(products / std::max(1.0, pairs), 0.0, 1.0));
}

}  // namespace

// The sum of what the residuals of both channels tell.
class ScanMatcher::Solver {
 public:
  /// @param gain see Linearization::gain
  Solver(const Linearization& at, double gain, double length, const Observability& observability)
      : unit_(1.0, 1.0, 1.0 / length),
        occupancy_(observability.occupancy * unit_.asDiagonal()),
        reflectivity_(observability.reflectivity * unit_.asDiagonal()),
        gain_(gain),
        gradient_(gradient(at)) {
    solver_.compute(hessian(at));
    const Vector3d values = solver_.eigenvalues();
    observable_ = (values.array() >= std::max(kLeastInformation, kSingular * values.z())).count();
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
  /// Of what tells the pose, by which poses have angles in units of length.
  Vector3d gradient(const Linearization& at) const {
    return occupancy_ * at.occupancy.gradient + gain_ * reflectivity_ * at.reflectivity.gradient;
  }
  Matrix3d hessian(const Linearization& at) const {
    return occupancy_ * at.occupancy.hessian * occupancy_.transpose() +
           gain_ * reflectivity_ * at.reflectivity.hessian * reflectivity_.transpose();
  }
  /// C^-1 S C^-1 and the floor, but nowhere less certain than the prior. In no direction is C much less than
  /// H.
  /// @param scatter S, of gradient(), and curvature C
  Matrix3d covariance(const Matrix3d& scatter, const Matrix3d& curvature, double floor_squared,
                      const Vector3d& prior_variances) const {
    Matrix3d root = Matrix3d::Zero(), sum = floor_squared * Matrix3d::Identity();  // H^-1/2
    const Vector3d prior = prior_variances.cwiseQuotient(unit_.cwiseAbs2());
    for (int i = 0; i < 3; ++i) {
      const Vector3d v = solver_.eigenvectors().col(i);
      if (i < 3 - observable_) {
        sum += kUnknown * prior.maxCoeff() * v * v.transpose();
      } else {
        root += v * v.transpose() / std::sqrt(solver_.eigenvalues()[i]);
      }
    }
    const Eigen::SelfAdjointEigenSolver<Matrix3d> relative(0.5 * root * (curvature + curvature.transpose()) *
                                                           root);
    const Matrix3d whitened = root * relative.eigenvectors();
    const Matrix3d inverse = whitened *
                             relative.eigenvalues().cwiseMax(kLeastCurvature).cwiseInverse().asDiagonal() *
                             whitened.transpose();
    sum += inverse * scatter * inverse;
    const Matrix3d p = prior.asDiagonal();
    const Matrix3d k = p - p * (sum + p).llt().solve(p);  // (sum^-1 + p^-1)^-1
    return unit_.asDiagonal() * (0.5 * (k + k.transpose())) * unit_.asDiagonal();
  }

 private:
  static constexpr double kSingular = 1e-6;       // of the greatest eigenvalue: what was projected away
  static constexpr double kLeastCurvature = 0.3;  // of H
  static constexpr double kUnknown = 1e3;         // times the prior: nothing is known

  Vector3d unit_;
  Matrix3d occupancy_, reflectivity_;  // take gradients to those of what each channel tells
  double gain_;
  Vector3d gradient_;
  Eigen::SelfAdjointEigenSolver<Matrix3d> solver_;
  int observable_ = 0;
};

double Linearization::gain() const {
  constexpr double kLeastVariance = 1e-4;  // no reflectivity is more exact
  if (!(occupancy.weights > 0.0 && reflectivity.weights > 0.0)) return 1.0;
  return occupancy.variance() / std::max(kLeastVariance, reflectivity.variance());
}

double Linearization::costOf(const Linearization& there) const {
  constexpr double kLeastBeams = 0.25;  // of those here
  const double beams = reflectivity.beams;
  if (there.reflectivity.beams < kLeastBeams * beams) return std::numeric_limits<double>::infinity();
  const double ratio = beams > 0.0 ? beams / there.reflectivity.beams : 0.0;
  return there.occupancy.cost + gain() * ratio * there.reflectivity.cost;
}

ScanMatcher::ScanMatcher(const MatcherOptions& options)
    : options_(mapping_common::validate(options)), cost_(makeCost(options.cost, options)) {}

Linearization ScanMatcher::linearize(const GridMap& map, const Scan& scan, const Pose& pose) {
  beams_.assign(scan);
  return cost_->linearize(map, beams_, pose, beams_.count);
}

Observability ScanMatcher::observe(const GridMap& map, const Scan& scan, const Pose& pose,
                                   const Cost& cost) const {
  return intensity_hector_slam::observe(scan, map, pose, beams_.mean_range, cost.uses(Channel::kOccupancy),
                                        cost.uses(Channel::kReflectivity), options_);
}

Linearization ScanMatcher::optimize(const GridMap& map, const Cost& cost, const Beams& beams,
                                    std::size_t count, const Observability& observability,
                                    double min_distance, double min_angle, Pose& pose,
                                    int& iterations) const {
  // Where the residuals of one channel alone tell a direction, the step along it is theirs. The others count
  // in the cost nevertheless, where it may rise by them: it doesn't tell then whether a step is good. One
  // that goes back tells that those before were too long.
  const bool both = cost.uses(Channel::kOccupancy) && cost.uses(Channel::kReflectivity);
  const bool cost_tells = !both || observability.occupancy == observability.reflectivity;
  const int max_halvings = cost_tells ? options_.max_halvings : 0;
  Linearization at = cost.linearize(map, beams, pose, count);
  const Linearization first = at;
  const double gain = first.gain();
  double cost_here = first.costOf(at), damping = 1.0;
  const Vector3d unit(1.0, 1.0, beams_.mean_range);
  Vector3d last_step = Vector3d::Zero();
  for (int iteration = 0; iteration < options_.max_iterations; ++iteration) {
    ++iterations;
    Vector3d step = Solver(at, gain, beams_.mean_range, observability).step();
    const double distance = step.head<2>().norm(), angle = std::abs(step.z());
    if (distance < min_distance && angle < min_angle) {
      pose += step;
      break;
    }
    step /= std::max({1.0, distance / options_.max_step_distance, angle / options_.max_step_angle});
    if (!cost_tells) {
      if (step.cwiseProduct(unit).dot(last_step.cwiseProduct(unit)) < 0.0) damping *= 0.5;
      last_step = step *= damping;
    }

    Pose next_pose = pose + step;
    Linearization next = cost.linearize(map, beams, next_pose, count);
    double cost_there = first.costOf(next);
    for (int i = 0; i < max_halvings && !(cost_there < cost_here); ++i) {
      step *= 0.5;
      next_pose = pose + step;
      next = cost.linearize(map, beams, next_pose, count);
      cost_there = first.costOf(next);
    }
    if (max_halvings > 0 && !(cost_there < cost_here)) break;
    const bool last = max_halvings > 0 && cost_here - cost_there < options_.min_cost_change * cost_here;
    cost_here = cost_there;
    pose = next_pose;
    at = next;
    if (last) break;
  }
  return at;
}

// Coarse to fine.
Linearization ScanMatcher::descend(const MultiMap& map, const Cost& cost, const Beams& coarse,
                                   std::size_t least, const Observability& observability, Pose& pose,
                                   int& iterations) const {
  for (int i = map.levels() - 1; i > 0; --i) {
    const double distance =
        std::max(options_.min_step_distance, options_.coarse_step * map.level(i).resolution());
    const std::size_t count = std::max(coarse.count >> i, std::min(coarse.count, least));
    optimize(map.level(i), observability.full ? cost.geometry() : cost, coarse, count, observability,
             distance, std::max(options_.min_step_angle, distance / beams_.mean_range), pose, iterations);
  }
  return optimize(map.level(0), cost, beams_, beams_.count, observability, options_.min_step_distance,
                  options_.min_step_angle, pose, iterations);
}

void ScanMatcher::thin(const MultiMap& map) {
  thinned_.assignThinned(beams_, options_.coarse_spacing * map.level(0).resolution(), map.levels(),
                         options_.coarse_points);
}

Match ScanMatcher::match(const MultiMap& map, const Scan& scan, const Pose& guess, bool search,
                         FirstGuess is) {
  const bool near = is != FirstGuess::kFar;
  if (is == FirstGuess::kSure && options_.new_margin > 0.0) {
    leaveOutNew(map.level(std::min(1, map.levels() - 1)), scan, guess, options_.new_margin, seen_before_);
    if (seen_before_.points.size() >= kLeastPoints)
      return matchPoints(map, seen_before_, guess, search, near);
  }
  return matchPoints(map, scan, guess, search, near);
}

Match ScanMatcher::matchPoints(const MultiMap& map, const Scan& scan, const Pose& guess, bool search,
                               bool near) {
  const GridMap& finest = map.level(0);
  beams_.assign(scan);
  const GridMap& coarsest = map.level(map.levels() - 1);
  Match match;
  const Cost& cost = cost_->choose(coarsest, scan, beams_, guess);
  match.cost = cost.name();
  match.searched = search;
  const Pose start = search ? cost.search(coarsest, beams_, guess) : guess;
  Pose pose = start;
  Observability observability = observe(near ? finest : coarsest, scan, start, cost);
  if (!observability.full && observability.share < kSureShare) {
    thin(map);
    descend(map, cost, thinned_, options_.coarse_points, {}, pose, match.iterations);
    observability = observe(near ? finest : coarsest, scan, pose, cost);
    const Vector3d unit(1.0, 1.0, 1.0 / beams_.mean_range);
    pose = start + unit.asDiagonal() * (observability.occupancy * (pose - start).cwiseQuotient(unit));
  }
  // Where reflectivity alone tells, each beam counts.
  const bool all = observability.reflectivity != observability.occupancy;
  std::optional<Linearization> fine;
  if (near && !search && observability.full && observability.share >= kNearShare) {
    Pose there = pose;
    fine = optimize(finest, cost, beams_, beams_.count, observability, options_.min_step_distance,
                    options_.min_step_angle, there, match.iterations);
    if ((there - start).head<2>().norm() < options_.near_distance) {
      pose = there;
    } else {
      fine.reset();
    }
  }
  if (!fine && !all) thin(map);
  const Linearization at =
      fine ? *fine
           : descend(map, cost, all ? beams_ : thinned_, all ? beams_.count : options_.coarse_points,
                     observability, pose, match.iterations);
  const double gain = at.gain();
  const Solver solver(at, gain, beams_.mean_range, observability);
  match.observable = solver.observable();
  match.unobservable_part = solver.unobservablePart();
  pose -= match.unobservable_part * (pose - start);
  match.pose = {pose.x(), pose.y(), wrapAngle(pose.z())};
  match.residual = std::sqrt((at.occupancy.squares + gain * at.reflectivity.squares) /
                             std::max(1.0, at.occupancy.weights + at.reflectivity.weights));
  match.covariance = covarianceAt(match.pose, finest, map.updates(), cost, solver);
  const Vector3d unit(1.0, 1.0, 1.0 / beams_.mean_range);
  match.uncertainty =
      kAlike * match.covariance + options_.surface_noise * options_.surface_noise *
                                      (unit.asDiagonal() * observability.uncertainty * unit.asDiagonal());
  const Overlap overlap = overlapOf(coarsest, beams_, match.pose);
  match.contradiction = overlap.free;
  match.overlap = overlap.occupied;
  return match;
}

// As of ICP (A. Censi, "An accurate closed-form estimate of ICP's covariance", ICRA 2007): the pose moves by
// C^-1 times what the gradient changes by, C the curvature of the cost. H isn't it: H is what the map changes
// within a cell, its noise as well. C is the difference of gradients half a cell apart on both sides. By how
// much the gradient changes from scan to scan, the pieces of one scan tell, as their gradients add up to
// nothing.
Matrix3d ScanMatcher::covarianceAt(const Pose& pose, const GridMap& map, std::size_t updates,
                                   const Cost& cost, const Solver& solver) {
  Matrix3d scatter = Matrix3d::Zero();
  for (std::size_t begin = 0; begin < beams_.count; begin += kPiece) {
    const Vector3d gradient =
        solver.gradient(cost.linearize(map, beams_, pose, std::min(beams_.count, begin + kPiece), begin));
    scatter += gradient * gradient.transpose();
  }
  sparse_.assignSparse(beams_, kCurvatureBeams);
  const double step = 0.5 * map.resolution();
  Matrix3d curvature;
  for (int i = 0; i < 3; ++i) {
    const Vector3d shift = (i < 2 ? step : step / beams_.mean_range) * Vector3d::Unit(i);
    const auto gradientAt = [&](const Pose& there) {
      return solver.gradient(cost.linearize(map, sparse_, there, sparse_.count));
    };
    curvature.col(i) = (gradientAt(pose - shift) - gradientAt(pose + shift)) / (2.0 * step);
  }
  curvature *= static_cast<double>(beams_.x.size()) / std::max<std::size_t>(1, sparse_.count);
  const double grid_error =
      map.resolution() * std::max({kLeastError, options_.covariance_floor * alongGrid(beams_, map, pose),
                                   kFirstError / std::max<std::size_t>(1, updates)});
  const double d = options_.unobservable_distance, a = options_.unobservable_angle;
  return solver.covariance(options_.covariance_scale * scatter, curvature, grid_error * grid_error,
                           {d * d, d * d, a * a});
}

}  // namespace intensity_hector_slam
