// SPDX-License-Identifier: BSD-3-Clause
#include "intensity_hector_slam/key_poses.h"

#include <Eigen/LU>
#include <cmath>
#include <stdexcept>
#include <string>

namespace intensity_hector_slam {
namespace {

// Both poses were matched against the map, each with an error of its own.
Eigen::Matrix3d covarianceBetween(const Pose& from, const Eigen::Matrix3d& from_covariance, const Pose& to,
                                  const Eigen::Matrix3d& to_covariance) {
  Eigen::Matrix3d by_to = Eigen::Matrix3d::Identity();  // derivative of the transform by the pose `to`
  by_to.topLeftCorner<2, 2>() = Eigen::Rotation2Dd(-from.z()).toRotationMatrix();
  const Eigen::Vector2d way = between(from, to).head<2>();
  Eigen::Matrix3d by_from = -by_to;
  by_from.topRightCorner<2, 1>() << way.y(), -way.x();
  return by_from * from_covariance * by_from.transpose() + by_to * to_covariance * by_to.transpose();
}

}  // namespace

KeyPoses::KeyPoses(double distance, double angle) : distance_(distance), angle_(angle) {
  for (const auto& [name, value] :
       {std::pair("key_pose_distance", distance), std::pair("key_pose_angle", angle)}) {
    if (value > 0.0) continue;
    throw std::invalid_argument(std::string(name) + " is " + std::to_string(value) +
                                ", allowed is more than 0");
  }
}

std::optional<Edge> KeyPoses::add(double stamp, const SlamResult& result) {
  if (result.status == Status::kRejected || result.status == Status::kEmpty) return {};
  std::optional<Edge> edge;
  if (last_) {
    const Pose transform = between(last_->pose, result.pose);
    if (transform.head<2>().norm() < distance_ && std::abs(transform.z()) < angle_) return {};
    edge = Edge{*last_,
                {next_id_, stamp, result.pose},
                transform,
                covarianceBetween(last_->pose, last_covariance_, result.pose, result.covariance).inverse()};
  }
  last_ = KeyPose{next_id_++, stamp, result.pose};
  last_covariance_ = result.covariance;
  return edge;
}

}  // namespace intensity_hector_slam
