// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Cholesky>
#include <Eigen/Core>
#include <Eigen/Geometry>
#include <cmath>

namespace intensity_hector_slam {

/// zeta = [t_x, t_y, theta] (thesis, section 3.4.2): m, m, rad.
using Pose = Eigen::Vector3d;

/// To [-pi, pi).
inline double wrapAngle(double angle) {
  return angle - 2.0 * M_PI * std::floor((angle + M_PI) / (2.0 * M_PI));
}

/// A pose in b's frame, where b is a pose in a's frame, in a's frame.
inline Pose compose(const Pose& a, const Pose& b) {
  const double c = std::cos(a.z()), s = std::sin(a.z());
  return {a.x() + c * b.x() - s * b.y(), a.y() + s * b.x() + c * b.y(), wrapAngle(a.z() + b.z())};
}

/// The pose `to`, seen from the pose `from`.
inline Pose between(const Pose& from, const Pose& to) {
  const double c = std::cos(from.z()), s = std::sin(from.z());
  const Eigen::Vector2d d = to.head<2>() - from.head<2>();
  return {c * d.x() + s * d.y(), -s * d.x() + c * d.y(), wrapAngle(to.z() - from.z())};
}

/// Turns a velocity, or another difference of poses, by an angle.
inline Eigen::Matrix3d turnBy(double angle) {
  Eigen::Matrix3d turn = Eigen::Matrix3d::Identity();
  turn.topLeftCorner<2, 2>() = Eigen::Rotation2Dd(angle).toRotationMatrix();
  return turn;
}

/// Of a covariance or an information matrix, by Cholesky's decomposition: Eigen's inverse() takes cofactors
/// for 3 x 3, which lose twice as many digits where standard deviations differ much, as along and across a
/// wall.
inline Eigen::Matrix3d inverseOf(const Eigen::Matrix3d& positive_definite) {
  return positive_definite.llt().solve(Eigen::Matrix3d::Identity());
}

/// S_i, Eq. 3.7: times a point.
inline Eigen::Isometry2d isometry(const Pose& pose) {
  return Eigen::Translation2d(pose.head<2>()) * Eigen::Rotation2Dd(pose.z());
}
/// The same for a single point.
inline Eigen::Vector2d transform(const Pose& pose, const Eigen::Vector2d& point) {
  return isometry(pose) * point;
}

}  // namespace intensity_hector_slam
