// SPDX-License-Identifier: BSD-3-Clause
#include <gtest/gtest.h>

#include <algorithm>
#include <random>
#include <stdexcept>
#include <tuple>
#include <vector>

#include "graphs.h"
#include "pose_graph/initialisation.h"
#include "pose_graph/loop_check.h"

namespace pose_graph {
namespace {

using Parameters = std::tuple<bool, LoopCheck>;
class LoopChecks : public testing::TestWithParam<Parameters> {
 protected:
  // With 4 single false loops and a group of 5 that agree with each other.
  void SetUp() override {
    optimise(optimum_);
    graph_ = optimum_;
    std::mt19937 random(2);
    std::uniform_int_distribution<std::size_t> any(0, 150);
    const auto add = [&](std::size_t from, std::size_t to, const Pose& transform) {
      Edge edge = graph_.edges().back();
      edge.from = from, edge.to = to;
      edge.transform = transform;
      wrong_.push_back(graph_.addEdge(edge));
    };
    for (std::size_t k = 0; k < 4; ++k)
      add(10 + any(random) / 4, 110 + any(random) / 4, planarPose(0.5, 0.2 * k, 2.0));
    const Pose shift = planarPose(3.0, -2.0, 1.0);
    for (std::size_t k = 0; k < 5; ++k)
      add(20 + k, 100 + k, optimum_.nodes()[20 + k].pose.inverse() * shift * optimum_.nodes()[100 + k].pose);
    startFromOdometry(graph_);
    options_.method = std::get<1>(GetParam());
  }
  Graph optimum_ = rounds(std::get<0>(GetParam()), 160, 40, 0.01, 1), graph_;
  std::vector<std::size_t> wrong_;
  LoopCheckOptions options_;
};
INSTANTIATE_TEST_SUITE_P(All, LoopChecks,
                         testing::Combine(testing::Bool(),
                                          testing::Values(LoopCheck::kGrowth, LoopCheck::kPcm,
                                                          LoopCheck::kGnc, LoopCheck::kDcs)));

TEST_P(LoopChecks, FindWhatIsWrong) {
  const LoopCheckResult result = optimiseAndCheck(graph_, options_);
  for (const std::size_t e : wrong_) {
    EXPECT_FALSE(graph_.edges()[e].active) << e;
    EXPECT_EQ(1, std::count(result.revoked.begin(), result.revoked.end(), e));
  }
  EXPECT_LE(result.revoked.size(), wrong_.size() + 4) << "120 right loops, and 1 in 1000 is revoked";
  EXPECT_TRUE(result.accepted.empty());
  EXPECT_LT(meanDistance(optimum_, graph_), 0.02);
}

TEST_P(LoopChecks, WhatWasRevokedComesBackWhereItFits) {
  graph_ = optimum_;
  const std::size_t loop = graph_.edges().size() - 1;
  graph_.setActive(loop, false);
  graph_.setActive(loop - 1, false);
  const LoopCheckResult result = optimiseAndCheck(graph_, options_);
  EXPECT_EQ((std::vector<std::size_t>{loop - 1, loop}), result.accepted);
}

// One wrong loop alone fits, since nothing but loose odometry is against it; three that say otherwise tell.
// gnc and dcs stay with what they begin with here.
TEST(LoopCheck, IsRevokedByLaterEvidence) {
  for (const bool planar : {false, true}) {
    const Graph truth = rounds(planar, 60, 60, 0.01, 1);
    Graph graph(planar);
    for (const Node& node : truth.nodes()) graph.addNode(node);
    for (Edge loose : truth.edges()) {
      loose.information *= 1e-4;
      graph.addEdge(loose);
    }
    Edge wrong = truth.edges().back();
    wrong.type = EdgeType::kLoopClosure;
    wrong.from = 0, wrong.to = 50;
    wrong.transform = truth.nodes()[0].pose.inverse() * planarPose(1.0, -0.5, 0.1) * truth.nodes()[50].pose;
    const std::size_t index = graph.addEdge(wrong);
    EXPECT_TRUE(optimiseAndCheck(graph).revoked.empty());
    EXPECT_TRUE(graph.edges()[index].active);
    Edge right = wrong;
    right.transform = truth.nodes()[0].pose.inverse() * truth.nodes()[50].pose;
    for (int i = 0; i < 3; ++i) graph.addEdge(right);
    EXPECT_EQ((std::vector<std::size_t>{index}), optimiseAndCheck(graph).revoked);
    EXPECT_FALSE(graph.edges()[index].active);
  }
}

// Nothing is known of where one part lies to the other, but that a part of the loops agree.
TEST(LoopCheck, GrowthJoinsParts) {
  for (const bool planar : {false, true}) {
    const Graph truth = rounds(planar, 80, 40, 0.01, 1);
    Graph graph(planar);
    for (Node node : truth.nodes()) {
      if (node.id >= 40) node.pose = planarPose(1.0, 2.0, 0.1) * node.pose;
      graph.addNode(node);
    }
    std::vector<std::size_t> wrong;
    for (const Edge& edge : truth.edges())
      if (edge.from >= 40 || edge.to < 40 || edge.type != EdgeType::kConsecutive) graph.addEdge(edge);
    for (std::size_t k = 0; k < 5; ++k) {
      Edge edge = truth.edges().back();
      edge.type = EdgeType::kPlace;
      edge.from = 3 * k, edge.to = 79 - 2 * k;
      edge.transform = planarPose(0.3 * static_cast<double>(k), -1.0, 0.5);
      wrong.push_back(graph.addEdge(edge));
    }
    const LoopCheckResult result = optimiseAndCheck(graph);
    EXPECT_EQ(wrong, result.revoked) << (planar ? "planar" : "in space");
  }
}

TEST(LoopCheck, GrowthFindsHalfOfAllWrong) {
  for (const bool planar : {false, true}) {
    Graph optimum = rounds(planar, 200, 40, 0.01, 4);
    optimise(optimum);
    Graph graph = optimum;
    std::mt19937 random(5);
    std::uniform_int_distribution<std::size_t> any(0, 199), right(200, optimum.edges().size() - 1);
    std::vector<std::size_t> wrong;
    while (wrong.size() < 160) {
      Edge edge = optimum.edges()[right(random)];
      edge.from = any(random), edge.to = any(random);
      if (edge.from == edge.to) continue;
      const Vector6 error =
          errorOf(edge, optimum.nodes()[edge.from].pose, optimum.nodes()[edge.to].pose, planar);
      if (error.dot(edge.information * error) > 1000.0) wrong.push_back(graph.addEdge(edge));
    }
    startFromOdometry(graph);
    const LoopCheckResult result = optimiseAndCheck(graph);
    for (const std::size_t e : wrong) EXPECT_FALSE(graph.edges()[e].active) << e << (planar ? " planar" : "");
    EXPECT_LE(result.revoked.size(), wrong.size() + 8) << "160 right loops, and 1 in 100 is revoked";
    EXPECT_LT(meanDistance(optimum, graph), 0.01);
  }
}

TEST(LoopCheck, TakesGraphsWithoutLoops) {
  Graph graph(true);
  EXPECT_NO_THROW(optimiseAndCheck(graph));
  graph.addNode({0, 0, {}, false});
  EXPECT_TRUE(optimiseAndCheck(graph).revoked.empty());
}

TEST(LoopCheck, ThresholdsAreThoseOfChiSquare) {
  LoopCheckOptions options;
  options.confidence = 0.95;
  EXPECT_NEAR(7.815, options.threshold(3), 1e-3);
  EXPECT_NEAR(12.592, options.threshold(6), 1e-3);
}

TEST(LoopCheck, PcmNeedsOdometry) {
  Graph graph(true);
  for (int i = 0; i < 3; ++i) graph.addNode({i, 0, {}, false});
  Edge edge;
  edge.type = EdgeType::kLoopClosure;
  edge.to = 2;
  graph.addEdge(edge);
  LoopCheckOptions options;
  options.method = LoopCheck::kPcm;
  EXPECT_THROW(optimiseAndCheck(graph, options), std::runtime_error);
}

}  // namespace
}  // namespace pose_graph
