// SPDX-License-Identifier: BSD-3-Clause
//
// What becomes of the covariances of poses (x, y, theta: m^2, m rad, rad^2) that are put together.
#pragma once

#include <Eigen/Core>
#include <Eigen/Geometry>

#include "intensity_hector_slam/pose.h"

namespace intensity_hector_slam {

/// Of compose(a, b).
inline Eigen::Matrix3d composedCovariance(const Pose& a, const Eigen::Matrix3d& a_covariance, const Pose& b,
                                          const Eigen::Matrix3d& b_covariance) {
  const Eigen::Matrix2d rotation = Eigen::Rotation2Dd(a.z()).toRotationMatrix();
  const Eigen::Vector2d way = rotation * b.head<2>();
  Eigen::Matrix3d by_a = Eigen::Matrix3d::Identity(), by_b = Eigen::Matrix3d::Identity();
  by_a.topRightCorner<2, 1>() << -way.y(), way.x();
  by_b.topLeftCorner<2, 2>() = rotation;
  return by_a * a_covariance * by_a.transpose() + by_b * b_covariance * by_b.transpose();
}

/// Of between(from, to), each with an error of its own.
inline Eigen::Matrix3d covarianceBetween(const Pose& from, const Eigen::Matrix3d& from_covariance,
                                         const Pose& to, const Eigen::Matrix3d& to_covariance) {
  Eigen::Matrix3d by_to = Eigen::Matrix3d::Identity();
  by_to.topLeftCorner<2, 2>() = Eigen::Rotation2Dd(-from.z()).toRotationMatrix();
  const Eigen::Vector2d way = between(from, to).head<2>();
  Eigen::Matrix3d by_from = -by_to;
  by_from.topRightCorner<2, 1>() << way.y(), -way.x();
  return by_from * from_covariance * by_from.transpose() + by_to * to_covariance * by_to.transpose();
}

}  // namespace intensity_hector_slam
