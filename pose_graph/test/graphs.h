// SPDX-License-Identifier: BSD-3-Clause
//
// Graphs whose truth is known.
#pragma once

#include <cmath>
#include <random>
#include <vector>

#include "pose_graph/graph.h"

namespace pose_graph {

/// Of a robot that drives rounds on a circle and, in space, climbs and rolls; each pose after the first round
/// is measured against that a round before. Poses are the truth.
/// @param noise standard deviation of the measurements, m and rad; that of the information isn't 0
inline Graph rounds(bool planar, int poses, int per_round, double noise, unsigned seed) {
  Graph graph(planar);
  for (int i = 0; i < poses; ++i) {
    const double angle = 2.0 * M_PI * i / per_round;
    Pose pose = planarPose(5.0 * std::cos(angle), 5.0 * std::sin(angle), angle + M_PI / 2.0);
    if (!planar) {
      pose.translation.z() = 0.01 * i;
      pose.rotation = pose.rotation * Eigen::AngleAxisd(0.5 * std::sin(angle), Eigen::Vector3d::UnitX());
    }
    graph.addNode({i, 0, pose, false});
  }
  std::mt19937 random(seed);
  std::normal_distribution<double> normal(0.0, noise);
  const auto measure = [&](int from, int to) {
    Edge edge;
    edge.from = from, edge.to = to;
    edge.type = to - from == 1 ? EdgeType::kConsecutive : EdgeType::kLoopClosure;
    Pose error = planarPose(normal(random), normal(random), normal(random));
    if (!planar) {
      error.translation.z() = normal(random);
      error.rotation = error.rotation * Eigen::AngleAxisd(normal(random), Eigen::Vector3d::UnitX()) *
                       Eigen::AngleAxisd(normal(random), Eigen::Vector3d::UnitY());
    }
    edge.transform = graph.nodes()[from].pose.inverse() * graph.nodes()[to].pose * error;
    edge.information /= std::pow(std::max(noise, 1e-3), 2);
    graph.addEdge(edge);
  };
  for (int i = 1; i < poses; ++i) measure(i - 1, i);
  for (int i = per_round; i < poses; ++i) measure(i - per_round, i);
  return graph;
}

/// Of the positions (m).
inline double meanDistance(const Graph& a, const Graph& b) {
  double sum = 0.0;
  for (std::size_t i = 0; i < a.nodes().size(); ++i)
    sum += (a.nodes()[i].pose.translation - b.nodes()[i].pose.translation).norm();
  return sum / a.nodes().size();
}

}  // namespace pose_graph
