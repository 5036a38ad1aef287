// SPDX-License-Identifier: BSD-3-Clause
#include "intensity_hector_slam/key_poses.h"

#include <Eigen/Geometry>
#include <Eigen/LU>
#include <cmath>
#include <stdexcept>
#include <string>
#include <utility>

#include "pose_covariance.h"

namespace intensity_hector_slam {
namespace {

// While the body turns quickly, poses are less exact than their match tells, as the velocity changes within a
// sweep: key poses wait for it to end, as long as scans still have much in common.
constexpr double kQuickTurn = 1.5;                            // rad/s
constexpr double kLongestDistance = 2.0, kLongestTurn = 3.0;  // of the distance and angle between key poses

constexpr double kJump = 16.3;  // squared deviation that one step in a thousand has, of three dimensions

// A covariance of x, y, theta in axes that are turned.
Eigen::Matrix3d turned(const Eigen::Matrix3d& covariance, double angle) {
  Eigen::Matrix3d turn = Eigen::Matrix3d::Identity();
  turn.topLeftCorner<2, 2>() = Eigen::Rotation2Dd(angle).toRotationMatrix();
  return turn * covariance * turn.transpose();
}

}  // namespace

Pose correctionOf(const Edge& loop) {
  return compose(compose(loop.from.pose, loop.transform), between(loop.to.pose, Pose::Zero()));
}

bool isJump(const Edge& loop) {
  constexpr double kDistance = 0.2, kAngle = 0.05;  // m, rad
  const Pose error = between(between(loop.from.pose, loop.to.pose), loop.transform);
  return error.head<2>().norm() > kDistance || std::abs(error.z()) > kAngle;
}

Eigen::Matrix3d informationAtEnd(const Edge& edge) {
  const Eigen::Matrix3d information = turned(edge.information, -edge.transform.z());
  return 0.5 * (information + information.transpose());
}

// Of a motion, m and rad.
Eigen::Matrix3d KeyPoses::driftOf(double way, double turn) const {
  const double distance = way * drift_.distance * drift_.distance;
  return Eigen::Vector3d(distance, distance,
                         way * drift_.angle * drift_.angle + turn * drift_.turn * drift_.turn)
      .asDiagonal();
}

KeyPoses::KeyPoses(double distance, double angle, const Drift& drift)
    : distance_(distance), angle_(angle), drift_(drift) {
  for (const auto& [name, value] :
       {std::pair("key_pose_distance", distance), std::pair("key_pose_angle", angle)}) {
    if (value > 0.0) continue;
    throw std::invalid_argument(std::string(name) + " is " + std::to_string(value) +
                                ", allowed is more than 0");
  }
}

// What the match moves the guess by, if that is more than both poses' errors and what odometry may drift by.
void KeyPoses::noteJump(const SlamResult& result, const Eigen::Matrix3d& previous_covariance) {
  if (!previous_ || !result.guess_is_odometry) return;
  const Pose step = between(previous_->pose, result.pose);
  Pose innovation = result.pose - result.guess;
  innovation.z() = std::remainder(innovation.z(), 2.0 * M_PI);
  const Eigen::Matrix3d covariance =
      previous_covariance + result.covariance + driftOf(step.head<2>().norm(), std::abs(step.z()));
  if (innovation.dot(covariance.ldlt().solve(innovation)) > kJump) jump_ += innovation;
}

std::optional<Edge> KeyPoses::add(double stamp, const SlamResult& result) {
  if (result.status == Status::kRejected || result.status == Status::kEmpty) return {};
  // The pose that the map starts at is exact, but the map isn't: of one scan, it is off as a match is.
  for (Eigen::Matrix3d* covariance : {&previous_covariance_, &last_covariance_})
    if (covariance->isZero(0.0)) *covariance = result.covariance;
  noteJump(result, std::exchange(previous_covariance_, result.covariance));
  const std::optional<KeyPose> previous = std::exchange(previous_, KeyPose{next_id_, stamp, result.pose});
  std::optional<Edge> edge;
  if (last_) {
    const Pose transform = between(last_->pose, result.pose);
    const auto isWithin = [&transform, this](double distances, double angles) {
      return transform.head<2>().norm() < distances * distance_ && std::abs(transform.z()) < angles * angle_;
    };
    if (isWithin(1.0, 1.0)) return {};
    const double turn_rate =
        previous && stamp > previous->stamp
            ? std::abs(between(previous->pose, result.pose).z()) / (stamp - previous->stamp)
            : 0.0;
    if (turn_rate > kQuickTurn && isWithin(kLongestDistance, kLongestTurn)) return {};
    // Both poses were matched against the map, each with an error of its own.
    Eigen::Matrix3d covariance =
        covarianceBetween(last_->pose, last_covariance_, result.pose, result.covariance);
    covariance += driftOf(transform.head<2>().norm(), std::abs(transform.z())) +
                  turned(jump_ * jump_.transpose(), -last_->pose.z());
    edge = Edge{*last_, {next_id_, stamp, result.pose}, transform, inverseOf(covariance)};
  }
  last_ = KeyPose{next_id_++, stamp, result.pose};
  last_covariance_ = result.covariance;
  jump_.setZero();
  return edge;
}

void KeyPoses::correct(const Pose& correction) {
  if (previous_) previous_->pose = compose(correction, previous_->pose);
  if (!last_) return;
  last_->pose = compose(correction, last_->pose);
  for (Eigen::Matrix3d* covariance : {&previous_covariance_, &last_covariance_})
    *covariance = turned(*covariance, correction.z());
  jump_.head<2>() = Eigen::Rotation2Dd(correction.z()) * jump_.head<2>();
}

}  // namespace intensity_hector_slam
