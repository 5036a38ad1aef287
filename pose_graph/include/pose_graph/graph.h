// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <mapping_common/options.h>

#include <Eigen/Core>
#include <Eigen/Geometry>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <string>
#include <unordered_map>
#include <vector>

namespace pose_graph {

using Vector6 = Eigen::Matrix<double, 6, 1>;
using Matrix6 = Eigen::Matrix<double, 6, 6>;

/// A rigid motion, or where a body is, seen from another frame (m).
struct Pose {
  Eigen::Vector3d translation = Eigen::Vector3d::Zero();
  Eigen::Quaterniond rotation = Eigen::Quaterniond::Identity();  ///< of length 1

  Pose operator*(const Pose& other) const {
    return {translation + rotation * other.translation, (rotation * other.rotation).normalized()};
  }
  Pose inverse() const { return {-(rotation.conjugate() * translation), rotation.conjugate()}; }
  /// rad, about z, -pi to pi
  double yaw() const;
};
Pose planarPose(double x, double y, double yaw);

/// A key pose of a body, seen from the map.
struct Node {
  std::int64_t id = 0;
  std::int64_t stamp = 0;  ///< ns since the epoch; 0: unknown
  Pose pose;
  bool fixed = false;  ///< isn't moved
};

/// What an edge is of, as in mapping_msgs/EdgeConstraint.
enum class EdgeType { kConsecutive, kLoopClosure, kPlace };
constexpr auto choicesOf(EdgeType) {
  return mapping_common::choices<EdgeType>({{"consecutive", EdgeType::kConsecutive},
                                            {"loop_closure", EdgeType::kLoopClosure},
                                            {"place", EdgeType::kPlace}});
}

enum class EdgeState { kAccepted, kPending, kRevoked, kDeleted };
constexpr auto choicesOf(EdgeState) {
  return mapping_common::choices<EdgeState>(
      {{"accepted", EdgeState::kAccepted, "has its effect"},
       {"pending", EdgeState::kPending, "nothing is known yet that tells whether it is right"},
       {"revoked", EdgeState::kRevoked, "held for wrong"},
       {"deleted", EdgeState::kDeleted, "taken out by hand"}});
}

/// A measurement of a pose as seen from another.
struct Edge {
  std::size_t from = 0, to = 0;  ///< indices of nodes
  EdgeType type = EdgeType::kConsecutive;
  Pose transform;  ///< of `to`, seen from `from`
  /// Inverse covariance of the error (see errorOf): x y z (m), then rotation about x y z (rad). In a planar
  /// graph only the rows and columns of x, y and the rotation about z mean something.
  Matrix6 information = Matrix6::Identity();
  bool active = true;  ///< false: held for wrong, and without effect
};

/// Of two poses against an edge's transform: the pose of `to` as seen from where the edge has it, as g2o
/// defines it. Its translation (m), and twice the vector part of its quaternion, which for small errors is
/// the rotation vector (rad); in a planar graph the angle itself. g2o's EDGE_SE3:QUAT has the vector part
/// once, and an information that belongs to it.
Vector6 errorOf(const Edge& edge, const Pose& from, const Pose& to, bool planar);

/// @param name of what they belong to
/// @throws std::invalid_argument if the information isn't finite, symmetric and positive semidefinite
void checkInformation(const Matrix6& information, const std::string& name);
/// @throws std::invalid_argument if the transform isn't finite, or its quaternion not of length 1
void checkTransform(const Pose& transform, const std::string& name);

/// Key poses and what was measured between them, in space or in the plane z = 0. Nodes and edges keep their
/// indices.
class Graph {
 public:
  explicit Graph(bool planar = false) : planar_(planar) {}

  bool planar() const { return planar_; }
  /// Of an error: 3 in the plane, else 6.
  int dimension() const { return planar_ ? 3 : 6; }

  /// @return its index. @throws std::invalid_argument if the id is taken, or the pose isn't finite or, in a
  /// planar graph, not in the plane
  std::size_t addNode(const Node& node);
  /// @return its index. @throws std::invalid_argument if there are no such nodes, or they are one, or the
  /// transform isn't finite, or not in the plane, or the information not finite, symmetric and positive
  /// semidefinite
  std::size_t addEdge(const Edge& edge);

  const std::vector<Node>& nodes() const { return nodes_; }
  const std::vector<Edge>& edges() const { return edges_; }
  /// The index of a node.
  std::optional<std::size_t> find(std::int64_t id) const;

  /// In a planar graph, to the pose's part in the plane.
  void setPose(std::size_t node, const Pose& pose);
  void setFixed(std::size_t node, bool fixed) { nodes_[node].fixed = fixed; }
  void setActive(std::size_t edge, bool active) { edges_[edge].active = active; }

  /// Squared Mahalanobis length of an edge's error.
  double chi2(std::size_t edge) const;
  /// The sum over all active edges.
  double chi2() const;

 private:
  bool planar_;
  std::vector<Node> nodes_;
  std::vector<Edge> edges_;
  std::unordered_map<std::int64_t, std::size_t> indices_;
};

/// For each node the first one that active edges connect it to: as many different ones as there are parts.
std::vector<std::size_t> connectedParts(const Graph& graph);

/// The nodes of the largest part, of equal ones the first, and their edges.
Graph largestPart(const Graph& graph);

/// Which nodes stay where they are, so that all others are determined: the fixed ones, and of each connected
/// part that has none, the first.
std::vector<bool> anchors(const Graph& graph);

}  // namespace pose_graph
