// SPDX-License-Identifier: BSD-3-Clause
#include <gtest/gtest.h>

#include <cmath>
#include <stdexcept>
#include <string>

#include "pose_graph/graph.h"

namespace pose_graph {
namespace {

template <class Call>
std::string refusal(const Call& call) {
  try {
    call();
  } catch (const std::invalid_argument& e) {
    return e.what();
  }
  return "";
}

Pose inSpace(double x, double y, double z, double angle, const Eigen::Vector3d& axis) {
  return {{x, y, z}, Eigen::Quaterniond(Eigen::AngleAxisd(angle, axis.normalized()))};
}

TEST(Pose, IsComposedAndInverted) {
  const Pose a = inSpace(1, 2, 3, 0.7, {1, 2, 3}), b = inSpace(-4, 1, 0.5, 2.0, {0, 1, -1});
  const Pose same = a.inverse() * (a * b);
  EXPECT_TRUE(same.translation.isApprox(b.translation, 1e-12));
  EXPECT_NEAR(0.0, same.rotation.angularDistance(b.rotation), 1e-7);
  EXPECT_NEAR(-3.0, planarPose(0, 0, -3.0).yaw(), 1e-12);
}

// A small turn by 0.01 rad about z and 0.1 m aside, seen from where the edge has the pose: it looks along y.
TEST(Error, IsSeenFromTheMeasuredPose) {
  Edge edge;
  edge.transform = planarPose(1.0, 0.0, M_PI / 2);
  const Pose to = planarPose(1.0, 0.1, M_PI / 2 + 0.01);
  for (const bool planar : {false, true}) {
    const Vector6 error = errorOf(edge, {}, to, planar);
    EXPECT_NEAR(0.1, error[0], 1e-12);
    EXPECT_NEAR(0.0, error[1], 1e-12);
    EXPECT_NEAR(0.01, error[5], 1e-6);
  }
}

// g2o's error has the vector part of the quaternion, sin(angle / 2); in the plane the angle itself.
TEST(Error, OfALargeTurnIsG2os) {
  const Edge edge;
  EXPECT_NEAR(2.0 * std::sin(1.0), errorOf(edge, {}, planarPose(0, 0, 2.0), false)[5], 1e-12);
  EXPECT_NEAR(2.0, errorOf(edge, {}, planarPose(0, 0, 2.0), true)[5], 1e-12);
  // The shorter way round.
  EXPECT_NEAR(-2.0 * std::sin(1.0), errorOf(edge, {}, planarPose(0, 0, 2 * M_PI - 2.0), false)[5], 1e-12);
}

// What moves whole parts rounds, so that a part that is far away leaves the plane.
TEST(Graph, StaysInItsPlane) {
  const Pose moved = inSpace(3e6, -2e6, 0.4, 0.7, {1e-5, 0, 1});
  for (const bool planar : {false, true}) {
    Graph graph(planar);
    graph.addNode({7, 0, {}, false});
    graph.setPose(0, moved);
    const Pose& pose = graph.nodes()[0].pose;
    EXPECT_EQ(planar ? 0.0 : 0.4, pose.translation.z());
    EXPECT_EQ(planar, pose.rotation.x() == 0.0);
    EXPECT_EQ(3e6, pose.translation.x());
    EXPECT_EQ(-2e6, pose.translation.y());
    EXPECT_NEAR(0.7, pose.yaw(), 1e-6);
    Graph copy(planar);
    EXPECT_EQ("", refusal([&] { copy.addNode(graph.nodes()[0]); }));
  }
}

TEST(Graph, SumsTheSquaresOfActiveEdges) {
  Graph graph(true);
  graph.addNode({7, 0, {}, false});
  graph.addNode({9, 0, planarPose(1, 0, 0), false});
  Edge edge;
  edge.to = 1;
  edge.information = 4.0 * Matrix6::Identity();
  graph.addEdge(edge);
  edge.transform = planarPose(1, 1, 0);
  const std::size_t second = graph.addEdge(edge);
  EXPECT_DOUBLE_EQ(4.0, graph.chi2(0));
  EXPECT_DOUBLE_EQ(8.0, graph.chi2());
  graph.setActive(second, false);
  EXPECT_DOUBLE_EQ(4.0, graph.chi2());
  EXPECT_EQ(1u, *graph.find(9));
  EXPECT_FALSE(graph.find(8));
}

TEST(Graph, RefusesWhatCantBe) {
  Graph graph(true);
  graph.addNode({1, 0, {}, false});
  graph.addNode({2, 0, {}, false});
  EXPECT_EQ("there is a node 2 already", refusal([&] { graph.addNode({2, 0, {}, false}); }));
  EXPECT_EQ("the pose of node 3 isn't in the plane", refusal([&] {
              graph.addNode({3, 0, inSpace(0, 0, 1, 0, {0, 0, 1}), false});
            }));
  EXPECT_EQ("the pose of node 3 isn't finite", refusal([&] {
              graph.addNode({3, 0, planarPose(NAN, 0, 0), false});
            }));
  Edge edge;
  EXPECT_EQ("edge 1 -> 1 has one node only", refusal([&] { graph.addEdge(edge); }));
  edge.to = 5;
  EXPECT_EQ("an edge of nodes that aren't there", refusal([&] { graph.addEdge(edge); }));
  edge.to = 1;
  edge.information(0, 1) = 0.5;
  EXPECT_EQ("the information of edge 1 -> 2 isn't symmetric", refusal([&] { graph.addEdge(edge); }));
  edge.information(1, 0) = 0.5;
  EXPECT_EQ("", refusal([&] { graph.addEdge(edge); }));
  edge.information(0, 0) = 0.1;
  EXPECT_EQ("the information of edge 1 -> 2 isn't positive semidefinite",
            refusal([&] { graph.addEdge(edge); }));
  EXPECT_EQ(2u, graph.nodes().size());
  EXPECT_EQ(1u, graph.edges().size());
}

TEST(Graph, TellsItsParts) {
  Graph graph(true);
  for (int i = 0; i < 5; ++i) graph.addNode({i, 0, {}, i == 4});
  Edge edge;
  for (const auto& [from, to] : {std::pair(1, 0), std::pair(4, 2), std::pair(1, 2)}) {
    edge.from = from, edge.to = to;
    graph.addEdge(edge);
  }
  graph.setActive(2, false);
  EXPECT_EQ((std::vector<std::size_t>{0, 0, 2, 3, 2}), connectedParts(graph));
  EXPECT_EQ((std::vector<bool>{true, false, false, true, true}), anchors(graph));
}

}  // namespace
}  // namespace pose_graph
