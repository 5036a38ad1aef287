// SPDX-License-Identifier: BSD-3-Clause
#include "pose_graph/graph.h"

#include <Eigen/Cholesky>
#include <Eigen/Eigenvalues>
#include <algorithm>
#include <cmath>
#include <numeric>
#include <stdexcept>
#include <string>

namespace pose_graph {
namespace {

void check(Pose pose, bool planar, const std::string& what) {
  if (!pose.translation.allFinite() || !pose.rotation.coeffs().allFinite())
    throw std::invalid_argument(what + " isn't finite");
  if (std::abs(pose.rotation.norm() - 1.0) > 1e-3)
    throw std::invalid_argument(what + " has a quaternion of length " + std::to_string(pose.rotation.norm()));
  if (planar && (std::abs(pose.translation.z()) > 1e-6 || pose.rotation.vec().head<2>().norm() > 1e-6))
    throw std::invalid_argument(what + " isn't in the plane");
}

// Of a symmetric matrix, to rounding.
bool positiveSemidefinite(const Matrix6& m) {
  if (m.llt().info() == Eigen::Success) return true;
  const Eigen::SelfAdjointEigenSolver<Matrix6> solver(m, Eigen::EigenvaluesOnly);
  return solver.eigenvalues().minCoeff() >= -1e-9 * solver.eigenvalues().cwiseAbs().maxCoeff();
}

}  // namespace

double Pose::yaw() const {
  return std::atan2(2.0 * (rotation.w() * rotation.z() + rotation.x() * rotation.y()),
                    1.0 - 2.0 * (rotation.y() * rotation.y() + rotation.z() * rotation.z()));
}

Pose planarPose(double x, double y, double yaw) {
  return {{x, y, 0.0}, {std::cos(0.5 * yaw), 0.0, 0.0, std::sin(0.5 * yaw)}};
}

Vector6 errorOf(const Edge& edge, const Pose& from, const Pose& to, bool planar) {
  const Pose delta = edge.transform.inverse() * (from.inverse() * to);
  Vector6 error;
  if (planar)
    error << delta.translation.head<2>(), 0.0, 0.0, 0.0, delta.yaw();
  else
    error << delta.translation, (delta.rotation.w() < 0.0 ? -2.0 : 2.0) * delta.rotation.vec();
  return error;
}

void checkInformation(const Matrix6& information, const std::string& name) {
  if (!information.allFinite()) throw std::invalid_argument("the information of " + name + " isn't finite");
  if ((information - information.transpose()).cwiseAbs().maxCoeff() >
      1e-6 * information.cwiseAbs().maxCoeff())
    throw std::invalid_argument("the information of " + name + " isn't symmetric");
  if (!positiveSemidefinite(information))
    throw std::invalid_argument("the information of " + name + " isn't positive semidefinite");
}
void checkTransform(const Pose& transform, const std::string& name) {
  check(transform, false, "the transform of " + name);
}

std::size_t Graph::addNode(const Node& node) {
  check(node.pose, planar_, "the pose of node " + std::to_string(node.id));
  if (!indices_.emplace(node.id, nodes_.size()).second)
    throw std::invalid_argument("there is a node " + std::to_string(node.id) + " already");
  nodes_.push_back(node);
  nodes_.back().pose.rotation.normalize();
  return nodes_.size() - 1;
}

std::size_t Graph::addEdge(const Edge& edge) {
  if (edge.from >= nodes_.size() || edge.to >= nodes_.size())
    throw std::invalid_argument("an edge of nodes that aren't there");
  const std::string name =
      "edge " + std::to_string(nodes_[edge.from].id) + " -> " + std::to_string(nodes_[edge.to].id);
  if (edge.from == edge.to) throw std::invalid_argument(name + " has one node only");
  check(edge.transform, planar_, "the transform of " + name);
  checkInformation(edge.information, name);
  edges_.push_back(edge);
  edges_.back().transform.rotation.normalize();
  return edges_.size() - 1;
}

std::optional<std::size_t> Graph::find(std::int64_t id) const {
  const auto found = indices_.find(id);
  return found == indices_.end() ? std::nullopt : std::make_optional(found->second);
}

double Graph::chi2(std::size_t i) const {
  const Edge& edge = edges_[i];
  const Vector6 error = errorOf(edge, nodes_[edge.from].pose, nodes_[edge.to].pose, planar_);
  return error.dot(edge.information * error);
}

double Graph::chi2() const {
  double sum = 0.0;
  for (std::size_t i = 0; i < edges_.size(); ++i)
    if (edges_[i].active) sum += chi2(i);
  return sum;
}

// What moves whole parts of a planar graph rounds, and what is moved far, far.
void Graph::setPose(std::size_t node, const Pose& pose) {
  const bool in_plane = pose.translation.z() == 0.0 && pose.rotation.vec().head<2>().isZero(0.0);
  nodes_[node].pose =
      planar_ && !in_plane ? planarPose(pose.translation.x(), pose.translation.y(), pose.yaw()) : pose;
}

std::vector<std::size_t> connectedParts(const Graph& graph) {
  std::vector<std::size_t> part(graph.nodes().size());
  std::iota(part.begin(), part.end(), 0);
  const auto root = [&](std::size_t i) {
    while (part[i] != i) i = part[i] = part[part[i]];
    return i;
  };
  for (const Edge& edge : graph.edges()) {
    if (!edge.active) continue;
    const std::size_t a = root(edge.from), b = root(edge.to);
    part[std::max(a, b)] = std::min(a, b);
  }
  for (std::size_t i = 0; i < part.size(); ++i) part[i] = root(i);
  return part;
}

Graph largestPart(const Graph& graph) {
  const std::vector<std::size_t> part = connectedParts(graph);
  std::vector<std::size_t> sizes(part.size(), 0), index(part.size());
  for (const std::size_t p : part) ++sizes[p];
  const auto largest = static_cast<std::size_t>(std::max_element(sizes.begin(), sizes.end()) - sizes.begin());
  Graph result(graph.planar());
  for (std::size_t i = 0; i < part.size(); ++i)
    if (part[i] == largest) index[i] = result.addNode(graph.nodes()[i]);
  for (Edge edge : graph.edges()) {
    if (part[edge.from] != largest || part[edge.to] != largest) continue;
    edge.from = index[edge.from];
    edge.to = index[edge.to];
    result.addEdge(edge);
  }
  return result;
}

std::vector<bool> anchors(const Graph& graph) {
  const std::vector<std::size_t> part = connectedParts(graph);
  std::vector<bool> anchored(part.size(), false), stays(part.size(), false);
  for (std::size_t i = 0; i < part.size(); ++i)
    if (graph.nodes()[i].fixed) stays[i] = anchored[part[i]] = true;
  for (std::size_t i = 0; i < part.size(); ++i)
    if (part[i] == i && !anchored[i]) stays[i] = true;
  return stays;
}

}  // namespace pose_graph
