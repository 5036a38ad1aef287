// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <optional>

#include "intensity_hector_slam/slam.h"

namespace intensity_hector_slam {

struct KeyPose {
  std::uint32_t id = 0;
  double stamp = 0.0;  ///< s
  Pose pose = Pose::Zero();
};

enum class EdgeType { kConsecutive, kLoopClosure };

/// Between two key poses, for the back end of a graph SLAM.
struct Edge {
  KeyPose from, to;
  Pose transform = Pose::Zero();  ///< of `to`, seen from `from`
  Eigen::Matrix3d information =
      Eigen::Matrix3d::Identity();  ///< K^-1 of the transform: 1/m^2, 1/(m rad), 1/rad^2
  EdgeType type = EdgeType::kConsecutive;
  double similarity = 1.0;  ///< of what was seen from both, 0 to 1
};

/// Where the later pose of a loop is in the map, as the loop has it from the earlier, times the inverse of
/// where it was taken to be: moves all poses since to where they are in what the map had of the place before.
Pose correctionOf(const Edge& loop);
/// Whether that is more than a match could be off, so that SLAM is in another place than the loop has it.
bool isJump(const Edge& loop);

/// What edges don't know of: standard deviations that grow with the square root of the way.
struct Drift {
  double distance = 0.0;  ///< m after one metre
  double angle = 0.0;     ///< rad after one metre
  double turn = 0.0;      ///< rad after a turn of one rad
};

/// An edge's information in the axes of `to`, as EdgeConstraint and g2o have it.
Eigen::Matrix3d informationAtEnd(const Edge& edge);

/// Picks key poses from the poses of a SLAM, and tells the edges between them.
class KeyPoses {
 public:
  /// @param distance, angle from the last key pose on, m and rad
  /// @throws std::invalid_argument that names the option, its value and what is allowed
  explicit KeyPoses(double distance = 0.5, double angle = 0.5, const Drift& drift = {});

  /// A pose amid a quick turn is no key pose, unless the last is far away. Where the pose jumps, as a scan is
  /// matched to another part of the map than those before, and odometry doesn't, the body has moved by the
  /// one or by the other, and the edge is as unsure.
  /// @return the edge that a pose makes, where it is a key pose but for the first
  std::optional<Edge> add(double stamp, const SlamResult& result);
  /// The last key pose; none where the chain is broken.
  const std::optional<KeyPose>& last() const { return last_; }
  /// The next pose is the first of a new chain; it isn't connected to the last.
  void breakChain() {
    last_.reset();
    previous_.reset();
    jump_.setZero();
  }
  /// The poses to come are in another map, which `correction` moves the last one to.
  void correct(const Pose& correction);

 private:
  Eigen::Matrix3d driftOf(double way, double turn) const;
  void noteJump(const SlamResult& result, const Eigen::Matrix3d& previous_covariance);

  double distance_, angle_;
  Drift drift_;
  std::uint32_t next_id_ = 0;
  std::optional<KeyPose> last_, previous_;  // the latter: of whatever pose came before
  Eigen::Matrix3d last_covariance_ = Eigen::Matrix3d::Zero(), previous_covariance_ = last_covariance_;
  Eigen::Vector3d jump_ =
      Eigen::Vector3d::Zero();  // of the poses since `last_`, map frame: one that comes back is none
};

}  // namespace intensity_hector_slam
