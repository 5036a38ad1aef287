// SPDX-License-Identifier: BSD-3-Clause
#include <gtest/gtest.h>
#include <mapping_common/testing/recordings.h>

#include <random>
#include <string>

#include "graphs.h"
#include "pose_graph/g2o_file.h"
#include "pose_graph/initialisation.h"
#include "pose_graph/optimisation.h"

namespace pose_graph {
namespace {

class Optimisation : public testing::TestWithParam<bool> {
 protected:
  static Graph forgotten(Graph graph) {
    for (std::size_t i = 1; i < graph.nodes().size(); ++i) graph.setPose(i, {});
    return graph;
  }
};
INSTANTIATE_TEST_SUITE_P(PlaneAndSpace, Optimisation, testing::Bool());

TEST_P(Optimisation, StartsWithoutNoiseAreTheTruth) {
  const Graph truth = rounds(GetParam(), 100, 30, 0.0, 1);
  Graph odometry = forgotten(truth), chordal = forgotten(truth);
  startFromOdometry(odometry);
  startFromChords(chordal);
  EXPECT_LT(meanDistance(truth, odometry), 1e-9);
  EXPECT_LT(meanDistance(truth, chordal), 1e-9);
  EXPECT_LT(chordal.chi2(), 1e-9);
}

TEST_P(Optimisation, AllStartsEndAtTheSameLeastChi2) {
  const Graph truth = rounds(GetParam(), 200, 40, 0.01, 2);
  double chi2 = 0.0;
  for (const Start start : {Start::kOdometry, Start::kChordal, Start::kPoses, Start::kBest}) {
    Graph graph = start == Start::kPoses ? truth : forgotten(truth);
    const OptimisationResult result = optimiseFrom(start, graph);
    EXPECT_TRUE(result.converged);
    EXPECT_DOUBLE_EQ(result.chi2, graph.chi2());
    // Derivatives that weren't right would take many.
    EXPECT_LE(result.iterations, 8);
    if (chi2 == 0.0) chi2 = result.chi2;
    EXPECT_NEAR(chi2, result.chi2, 1e-6 * chi2);
    // As many degrees of freedom as there are measurements more than needed, give or take 5 sigma.
    const double freedom = truth.dimension() * 160.0;
    EXPECT_NEAR(freedom, result.chi2, 5.0 * std::sqrt(2.0 * freedom));
    EXPECT_LT(meanDistance(truth, graph), 0.1);
  }
}

TEST_P(Optimisation, NoNeighbourOfTheOptimumIsBetter) {
  Graph graph = rounds(GetParam(), 60, 20, 0.02, 3);
  optimise(graph);
  const double least = graph.chi2();
  std::mt19937 random(4);
  std::normal_distribution<double> normal(0.0, 1e-4);
  for (std::size_t i = 1; i < graph.nodes().size(); ++i) {
    const Pose pose = graph.nodes()[i].pose;
    graph.setPose(i, pose * planarPose(normal(random), normal(random), normal(random)));
    EXPECT_GT(graph.chi2(), least);
    graph.setPose(i, pose);
  }
}

TEST_P(Optimisation, FixedNodesStay) {
  Graph graph = rounds(GetParam(), 60, 20, 0.05, 5);
  const Pose moved = planarPose(1.0, 2.0, 0.3) * graph.nodes()[30].pose;
  graph.setPose(30, moved);
  graph.setFixed(30, true);
  optimiseFrom(Start::kChordal, graph);
  EXPECT_EQ(moved.translation, graph.nodes()[30].pose.translation);
  EXPECT_GT(graph.nodes()[0].pose.translation.y(), 1.0) << "all others have gone with it";
}

TEST_P(Optimisation, InactiveEdgesHaveNoEffect) {
  Graph graph = rounds(GetParam(), 60, 20, 0.01, 6);
  optimise(graph);
  const double chi2 = graph.chi2();
  Edge wrong;
  wrong.from = 3, wrong.to = 40;
  wrong.type = EdgeType::kLoopClosure;
  wrong.information *= 1e4;
  wrong.active = false;
  const std::size_t index = graph.addEdge(wrong);
  EXPECT_NEAR(chi2, optimise(graph).chi2, 1e-6);
  graph.setActive(index, true);
  EXPECT_GT(optimise(graph).chi2, 2.0 * chi2);
}

// Information about what a bearing-only sensor doesn't tell is 0.
TEST_P(Optimisation, InformationMayBeSingular) {
  Graph graph = rounds(GetParam(), 60, 20, 0.01, 7);
  Edge edge = graph.edges()[0];
  edge.from = 0, edge.to = 59;
  edge.transform = graph.nodes()[0].pose.inverse() * graph.nodes()[59].pose;
  edge.information = Matrix6::Zero();
  edge.information(0, 0) = 1e4;
  graph.addEdge(edge);
  EXPECT_TRUE(optimise(graph).converged);
}

TEST(Optimisation, CanBeEnded) {
  Graph graph = rounds(false, 60, 20, 0.05, 8);
  startFromOdometry(graph);
  int calls = 0;
  const auto result = optimise(graph, {}, [&](int, double) { return ++calls < 2; });
  EXPECT_EQ(2, calls);
  EXPECT_EQ(1, result.iterations);
  EXPECT_FALSE(result.converged);
}

// The least chi2 that any start has reached (docs/measurements.md).
class KnownGraph : public testing::TestWithParam<std::pair<const char*, double>> {};
INSTANTIATE_TEST_SUITE_P(
    Optima, KnownGraph,
    testing::Values(std::pair("CSAIL", 40.40751495), std::pair("input_INTEL_g2o", 215.830235),
                    std::pair("input_M3500_g2o", 137.9129509), std::pair("manhattanOlson3500", 146.0766129),
                    std::pair("parking-garage", 1.23869058), std::pair("smallGrid3D", 458.1537843),
                    std::pair("sphere2500", 727.1496672), std::pair("torus3D", 14574.74644)));
TEST_P(KnownGraph, IsOptimised) {
  const std::string name = std::string("pose_graphs/") + GetParam().first + ".g2o";
  const std::string path = mapping_common::findRecording(name);
  if (path.empty()) GTEST_SKIP() << mapping_common::withoutRecording(name);
  Graph graph = readG2o(path).graph;
  EXPECT_LT(optimiseFrom(Start::kChordal, graph).chi2, GetParam().second * (1.0 + 1e-6));
}

}  // namespace
}  // namespace pose_graph
