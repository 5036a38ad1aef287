// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>
#include <algorithm>
#include <memory>
#include <string>

#include "intensity_hector_slam/beams.h"
#include "intensity_hector_slam/multi_map.h"

namespace intensity_hector_slam {

struct Observability;

/// What a residual tells: where surfaces are, or where along them.
enum class Channel { kOccupancy, kReflectivity };

/// Of the residuals of one channel.
struct NormalEquation {
  Eigen::Matrix3d hessian = Eigen::Matrix3d::Zero();   ///< sum of w J^T J
  Eigen::Vector3d gradient = Eigen::Vector3d::Zero();  ///< sum of w J^T e: the step is H^-1 times this
  double cost = 0.0;                                   ///< sum of the robust costs of the residuals
  double squares = 0.0;                                ///< sum of w e^2, without the weight of the options
  double weights = 0.0;                                ///< sum of w, the same
  double beams = 0.0;                                  ///< that count, or their shares

  /// Of the residuals, as they are.
  double variance() const { return squares / std::max(1.0, weights); }
};

/// A cost, linearised at a pose on one level.
struct Linearization {
  NormalEquation occupancy, reflectivity;  ///< zero where the cost hasn't residuals of that channel

  NormalEquation& of(Channel channel) { return channel == Channel::kOccupancy ? occupancy : reflectivity; }
  /// By which the squares of the reflectivity count as much as those of the occupancy for what they tell: the
  /// ratio of their variances.
  double gain() const;
  /// At another pose, with the gain here. Of the reflectivity by the beams that count, as many as here: a
  /// pose gains nothing by losing some.
  double costOf(const Linearization& there) const;
};

struct Match {
  Pose pose = Pose::Zero();
  Eigen::Matrix3d covariance = Eigen::Matrix3d::Zero();  ///< K of x, y, theta, map frame: m^2, m rad, rad^2
  /// The same, larger as successive scans are off alike, and where surfaces tell so little of the pose that
  /// their unevenness pulls it along: for who takes the errors of scans for independent.
  Eigen::Matrix3d uncertainty = Eigen::Matrix3d::Zero();
  /// Takes a difference of poses (map frame) to its part in directions that weren't observable.
  Eigen::Matrix3d unobservable_part = Eigen::Matrix3d::Zero();
  std::string cost;            ///< what was minimised, never auto
  int iterations = 0;          ///< over all levels
  int observable = 3;          ///< directions in which the pose was observable, 0 to 3
  double residual = 0.0;       ///< root mean square of the weighted residuals at the pose
  double contradiction = 0.0;  ///< share of the points that were matched in cells known as free
  double overlap = 0.0;        ///< the same in those known as occupied
  bool searched = false;       ///< whether a window around the first guess was searched

  /// How well the scan agrees with the map, -1 to 1.
  double score() const { return overlap - contradiction; }
};

/// How near the pose a first guess is.
enum class FirstGuess {
  kFar,   ///< nobody knows
  kNear,  ///< of odometry from just before: MatcherOptions::near_distance holds
  kSure,  ///< of a known velocity, or a match: new_margin holds, too, as what is behind the map's walls is
          ///< new
};

/// Finds the pose from which a scan fits to a map: Gauss-Newton (Eq. 3.9) on one level after the other,
/// coarse to fine.
class ScanMatcher {
 public:
  explicit ScanMatcher(const MatcherOptions& options = {});

  const MatcherOptions& options() const { return options_; }

  /// @param guess first guess, map frame
  /// @param search whether to search the window around the guess before
  /// @param is how near it is
  Match match(const MultiMap& map, const Scan& scan, const Pose& guess, bool search = false,
              FirstGuess is = FirstGuess::kFar);

  /// The cost of the options at a pose.
  Linearization linearize(const GridMap& map, const Scan& scan, const Pose& pose);

 private:
  class Solver;

  Observability observe(const GridMap& map, const Scan& scan, const Pose& pose, const Cost& cost) const;
  Eigen::Matrix3d covarianceAt(const Pose& pose, const GridMap& map, std::size_t updates, const Cost& cost,
                               const Solver& solver);
  void thin(const MultiMap& map);
  Match matchPoints(const MultiMap& map, const Scan& scan, const Pose& guess, bool search, bool near);
  /// Both move the pose, add to the iterations, and return the cost where the last step starts, on the
  /// finest level.
  /// @param coarse what all other levels use: the level k the first 1 / 2^k of it, but no fewer than `least`
  Linearization descend(const MultiMap& map, const Cost& cost, const Beams& coarse, std::size_t least,
                        const Observability& observability, Pose& pose, int& iterations) const;
  /// @param count of the first beams, that are used
  /// @param min_distance m, and min_angle, rad: a step below both is the last
  Linearization optimize(const GridMap& map, const Cost& cost, const Beams& beams, std::size_t count,
                         const Observability& observability, double min_distance, double min_angle,
                         Pose& pose, int& iterations) const;

  MatcherOptions options_;
  std::shared_ptr<const Cost> cost_;
  Scan seen_before_;                // the points of a scan that haven't just come into view
  Beams beams_, thinned_, sparse_;  // all, for the coarser levels, and for the curvature
};

}  // namespace intensity_hector_slam
