// SPDX-License-Identifier: BSD-3-Clause
#include "intensity_hector_slam/key_poses.h"

#include <Eigen/LU>
#include <cmath>
#include <stdexcept>
#include <string>

namespace intensity_hector_slam {

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
    // The uncertainty of a pose in the map, seen from the pose that it is measured from.
    Eigen::Matrix3d rotation = Eigen::Matrix3d::Identity();
    rotation.topLeftCorner<2, 2>() = Eigen::Rotation2Dd(-last_->pose.z()).toRotationMatrix();
    const Eigen::Matrix3d covariance = rotation * result.covariance * rotation.transpose();
    edge = Edge{*last_, {next_id_, stamp, result.pose}, transform, covariance.inverse()};
  }
  last_ = KeyPose{next_id_++, stamp, result.pose};
  return edge;
}

}  // namespace intensity_hector_slam
