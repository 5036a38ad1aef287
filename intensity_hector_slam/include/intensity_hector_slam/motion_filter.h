// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>

#include "intensity_hector_slam/pose.h"

namespace intensity_hector_slam {

/// m/s^2, rad/s^2.
struct Acceleration {
  double linear, angular;
};

/// A change of a velocity in `elapsed` (s), no faster than a body can: that of a pose that jumps would lead
/// away from the map.
Eigen::Vector3d limited(Eigen::Vector3d change, const Acceleration& most, double elapsed);

/// The velocity of a body, and how sure it and the last pose are: a Kalman filter of a body that accelerates
/// at random (Y. Bar-Shalom et al., "Estimation with Applications to Tracking and Navigation", 6.2.2: white
/// noise acceleration). Where a scan tells little of some direction, its match there is of the map's noise
/// rather than of the pose, and what the body did before tells more.
class MotionFilter {
 public:
  struct Noise {
    Acceleration change{0.5, 2.0};   ///< standard deviations of the change of the velocity in a second
    Acceleration limits{5.0, 15.0};  ///< of a known velocity
  };

  /// @param turns whether the velocity turns with the body, as on wheels, or is that of something carried
  explicit MotionFilter(bool turns) : turns_(turns) {}

  /// The pose is known; the velocity is one that is known, or off by standard deviations.
  void start(const Eigen::Vector3d& velocity, double speed, double turn_rate);

  /// The velocity is no longer believed in some directions. @param part of velocities (frame of the body)
  void stop(const Eigen::Matrix3d& part) { velocity_ -= part * velocity_; }

  /// In `elapsed` (s), in the frame of the body before.
  Pose motion(double elapsed) const;

  /// @param from the last pose, map frame
  /// @param measured the pose by a scan `elapsed` (s) later, with its covariance (map frame: m^2, m rad,
  /// rad^2)
  /// @return the pose
  Pose update(const Noise& noise, const Pose& from, const Pose& measured, const Eigen::Matrix3d& covariance,
              double elapsed);

  /// Of the body in its own frame: m/s, m/s, rad/s.
  const Eigen::Vector3d& velocity() const { return velocity_; }
  /// How well it told the last poses, as the logarithm of a likelihood.
  double score() const { return score_; }

 private:
  using Matrix6d = Eigen::Matrix<double, 6, 6>;
  bool turns_, known_ = false;
  Eigen::Vector3d velocity_ = Eigen::Vector3d::Zero();
  Matrix6d covariance_ = Matrix6d::Zero();  // of the pose in the map frame and the velocity in the body's
  double score_ = 0.0;
};

}  // namespace intensity_hector_slam
