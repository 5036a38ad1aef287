// SPDX-License-Identifier: BSD-3-Clause
#include "intensity_hector_slam/motion_filter.h"

#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>

namespace intensity_hector_slam {
namespace {

// Of squared innovations, over their number: more is a motion that noise doesn't explain.
constexpr double kGate = 4.0;
constexpr double kMemory = 0.97;  // by which the score forgets with each scan

}  // namespace

Eigen::Vector3d limited(Eigen::Vector3d change, const Acceleration& most, double elapsed) {
  const double distance = most.linear * elapsed, angle = most.angular * elapsed;
  change.head<2>() *= distance / std::max(distance, change.head<2>().norm());
  change.z() = std::clamp(change.z(), -angle, angle);
  return change;
}

void MotionFilter::start(const Eigen::Vector3d& velocity, double speed, double turn_rate) {
  velocity_ = velocity;
  covariance_.setZero();
  covariance_.diagonal().tail<3>() << speed * speed, speed * speed, turn_rate * turn_rate;
  score_ = 0.0;
  known_ = false;
}

Pose MotionFilter::motion(double elapsed) const {
  return turnBy(turns_ ? 0.5 * velocity_.z() * elapsed : 0.0) * velocity_ * elapsed;
}

Pose MotionFilter::update(const Noise& noise, const Pose& from, const Pose& measured,
                          const Eigen::Matrix3d& covariance, double elapsed) {
  const Pose guess = compose(from, motion(elapsed));
  const double turn = velocity_.z() * elapsed;
  const Eigen::Matrix3d to_map = turnBy(from.z() + (turns_ ? 0.5 * turn : 0.0));
  const Eigen::Vector2d way = guess.head<2>() - from.head<2>();
  Matrix6d f = Matrix6d::Identity();
  f.topRightCorner<3, 3>() = elapsed * to_map;
  f.block<2, 1>(0, 2) << -way.y(), way.x();
  if (!turns_) {
    f.bottomRightCorner<3, 3>() = turnBy(-turn);
    velocity_ = turnBy(-turn) * velocity_;
  }
  const double a = noise.change.linear * noise.change.linear, w = noise.change.angular * noise.change.angular;
  const Eigen::Matrix3d q = Eigen::Vector3d(a, a, w).asDiagonal();
  Matrix6d process;
  process.topLeftCorner<3, 3>() = q * (elapsed * elapsed * elapsed / 3.0);
  process.topRightCorner<3, 3>() = to_map * q * (elapsed * elapsed / 2.0);
  process.bottomLeftCorner<3, 3>() = process.topRightCorner<3, 3>().transpose();
  process.bottomRightCorner<3, 3>() = q * elapsed;
  covariance_ = f * covariance_ * f.transpose() + process;

  Eigen::Vector3d innovation = measured - guess;
  innovation.z() = wrapAngle(innovation.z());
  // A motion beyond what the noise explains: the body was pushed, and what was known of it counts less.
  Eigen::Matrix3d s = covariance_.topLeftCorner<3, 3>() + covariance;
  double distance = innovation.dot(s.ldlt().solve(innovation));
  score_ = kMemory * score_ - 0.5 * (distance + std::log(s.determinant()));
  if (distance > 3.0 * kGate) covariance_ *= std::pow(distance / (3.0 * kGate), 2);
  s = covariance_.topLeftCorner<3, 3>() + covariance;
  const Eigen::Matrix<double, 6, 3> gain = s.ldlt().solve(covariance_.topRows<3>()).transpose();
  const Eigen::Matrix<double, 6, 1> change = gain * innovation;
  covariance_ -= gain * covariance_.topRows<3>();
  covariance_ = (0.5 * (covariance_ + covariance_.transpose())).eval();
  velocity_ += known_ ? limited(change.tail<3>(), noise.limits, elapsed) : Eigen::Vector3d(change.tail<3>());
  known_ = true;
  return {guess.x() + change.x(), guess.y() + change.y(), wrapAngle(guess.z() + change.z())};
}

}  // namespace intensity_hector_slam
