// SPDX-License-Identifier: BSD-3-Clause
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <stdexcept>
#include <string>
#include <vector>

#include "graphs.h"
#include "pose_graph/online_graph.h"

namespace pose_graph {
namespace {

using Added = OnlineGraph::Added;
using Kind = GraphEvent::Kind;

constexpr std::int64_t kSecond = 1'000'000'000;

// A drive of several rounds, a key pose each second.
class OnlineGraphs : public testing::TestWithParam<bool> {
 protected:
  static constexpr int kPoses = 160, kPerRound = 40;
  static constexpr double kNoise = 0.002;
  OnlineGraphs() {
    options_.planar = GetParam();
    reset();
  }
  void reset() { graph_ = OnlineGraph(options_); }

  static std::int64_t stamp(double node) { return std::llround((100.0 + node) * kSecond); }
  Measurement measurement(const Edge& edge) const {
    return {stamp(edge.from), stamp(edge.to),  edge.type, edge.transform,
            edge.information, name(edge.type), false};
  }
  static std::string name(EdgeType type) { return type == EdgeType::kConsecutive ? "edges" : "loops"; }
  // That of the drive that begins with the pose before, or the loop that ends there.
  const Edge& edgeTo(std::size_t node, EdgeType type) const {
    return *std::find_if(drive_.edges().begin(), drive_.edges().end(),
                         [&](const Edge& e) { return e.to == node && e.type == type; });
  }
  Measurement step(std::size_t node) const { return measurement(edgeTo(node, EdgeType::kConsecutive)); }
  Measurement loop(std::size_t node) const { return measurement(edgeTo(node, EdgeType::kLoopClosure)); }
  void drive(std::size_t from, std::size_t to) {
    for (std::size_t i = from + 1; i <= to; ++i) EXPECT_EQ(Added::kNow, graph_.add(step(i)));
  }
  // That `to` was where `from` was, but for a shift.
  Measurement wrongLoop(std::size_t from, std::size_t to,
                        const Pose& shift = planarPose(2.0, -1.0, 0.5)) const {
    Edge edge = edgeTo(kPerRound, EdgeType::kLoopClosure);
    edge.from = from, edge.to = to;
    edge.transform = drive_.nodes()[from].pose.inverse() * shift * drive_.nodes()[to].pose;
    return measurement(edge);
  }
  void optimise(bool all = false) {
    auto task = graph_.begin(all);
    if (!task) return;
    task->run();
    graph_.finish(std::move(*task));
  }
  std::size_t count(Kind kind) {
    std::size_t sum = 0;
    for (const GraphEvent& event : graph_.takeEvents()) sum += event.kind == kind ? 1 : 0;
    return sum;
  }
  std::size_t edges(EdgeState state) const { return graph_.countsOfLoops()[static_cast<std::size_t>(state)]; }
  // From the truth, by what the poses are to the first.
  double worstError() const {
    double worst = 0.0;
    const Pose shift = drive_.nodes()[0].pose * graph_.graph().nodes()[0].pose.inverse();
    for (const Node& node : graph_.graph().nodes()) {
      const double seconds = static_cast<double>(node.stamp - stamp(0)) / kSecond;
      const Pose& truth = drive_.nodes()[std::lround(seconds)].pose;
      worst = std::max(worst, ((shift * node.pose).translation - truth.translation).norm());
    }
    return worst;
  }

  const Graph drive_ = rounds(GetParam(), kPoses, kPerRound, kNoise, 1);
  OnlineOptions options_;
  OnlineGraph graph_;
};
INSTANTIATE_TEST_SUITE_P(SpaceAndPlane, OnlineGraphs, testing::Bool());

TEST_P(OnlineGraphs, GrowsByOdometry) {
  drive(0, 50);
  ASSERT_EQ(51u, graph_.graph().nodes().size());
  EXPECT_FALSE(graph_.hasWork());
  Pose pose;
  for (int i = 1; i <= 50; ++i) pose = pose * edgeTo(i, EdgeType::kConsecutive).transform;
  EXPECT_LT((pose.inverse() * graph_.graph().nodes()[50].pose).translation.norm(), 1e-9);
  EXPECT_EQ(50u, graph_.find(stamp(50) - 100'000)) << "0.1 ms beside";
  EXPECT_FALSE(graph_.find(stamp(50.5)));
}

TEST_P(OnlineGraphs, BeginsWhereTheFrontEndIs) {
  const Pose there = planarPose(3.0, 4.0, 1.0);
  for (const bool late : {false, true}) {
    reset();
    if (!late) graph_.addFrontEndPose(stamp(0), there);
    drive(0, 3);
    if (late) graph_.addFrontEndPose(stamp(0), there);
    EXPECT_LT((there.inverse() * graph_.graph().nodes()[0].pose).translation.norm(), 1e-9);
    EXPECT_GT((there.inverse() * graph_.graph().nodes()[3].pose).translation.norm(), 0.5);
    Pose pose = there;
    for (int i = 1; i <= 3; ++i) pose = pose * edgeTo(i, EdgeType::kConsecutive).transform;
    EXPECT_LT((pose.inverse() * graph_.graph().nodes()[3].pose).translation.norm(), 1e-9);
  }
}

TEST_P(OnlineGraphs, LoopsLeadToTheOptimum) {
  std::size_t accepted = 0;
  for (std::size_t i = 1; i < kPoses; ++i) {
    drive(i - 1, i);
    if (i < kPerRound) continue;
    EXPECT_EQ(Added::kNow, graph_.add(loop(i)));
    if (i % 5 == 0) optimise();
    accepted += count(Kind::kAccepted);
  }
  optimise();
  accepted += count(Kind::kAccepted);
  EXPECT_GE(accepted, 119u) << "of 120, and 1 in 1000 is refused";
  Graph optimum = graph_.graph();
  pose_graph::optimise(optimum);
  EXPECT_LT(meanDistance(optimum, graph_.graph()), 1e-4);
  EXPECT_LT(worstError(), 0.1);
}

TEST_P(OnlineGraphs, WrongLoopsAreRefused) {
  drive(0, 100);
  for (int i = kPerRound; i <= 100; i += 3) graph_.add(loop(i));
  optimise();
  graph_.takeEvents();
  const double before = worstError();
  const std::size_t accepted = edges(EdgeState::kAccepted);
  graph_.add(wrongLoop(10, 90));
  for (int k = 0; k < 5; ++k) graph_.add(wrongLoop(20 + k, 70 + k));
  optimise();
  EXPECT_EQ(6u, count(Kind::kRefused));
  EXPECT_EQ(6u, edges(EdgeState::kPending));
  EXPECT_EQ(accepted, edges(EdgeState::kAccepted));
  EXPECT_NEAR(before, worstError(), 1e-6);
}

// One wrong loop alone fits where odometry is loose; others tell.
TEST_P(OnlineGraphs, WhatWasAcceptedIsRevokedByLaterEvidence) {
  options_.odometry_scale = 500.0;
  reset();
  drive(0, 100);
  graph_.add(wrongLoop(0, 80, planarPose(1.0, -0.5, 0.1)));
  optimise();
  EXPECT_EQ(1u, edges(EdgeState::kAccepted));
  EXPECT_GT(worstError(), 0.5);
  graph_.takeEvents();
  for (int k = 0; k < 3; ++k) {
    Measurement right = wrongLoop(0, 80, {});
    right.source = "loops " + std::to_string(k);
    graph_.add(right);
    optimise();
  }
  EXPECT_EQ(1u, edges(EdgeState::kRevoked));
  EXPECT_EQ(3u, edges(EdgeState::kAccepted));
  EXPECT_EQ(1u, count(Kind::kRevoked));
}

// Odometry is wrong here: one loop that says so is refused, several are believed.
TEST_P(OnlineGraphs, WhatWasRefusedIsAcceptedLater) {
  for (std::size_t i = 1; i <= 100; ++i) {
    Measurement m = step(i);
    if (i == 60) m.transform = m.transform * planarPose(0.2, 0.0, 0.0);  // it slips
    graph_.add(m);
  }
  graph_.add(wrongLoop(45, 70, {}));
  optimise();
  EXPECT_EQ(1u, edges(EdgeState::kPending));
  graph_.takeEvents();
  for (int k = 1; k < 12; ++k) {
    graph_.add(wrongLoop(45 + k, 70 + k, {}));
    optimise();
  }
  EXPECT_EQ(12u, edges(EdgeState::kAccepted));
  EXPECT_EQ(12u, count(Kind::kAccepted));
  EXPECT_LT(worstError(), 0.5);
}

TEST_P(OnlineGraphs, LateAndUnorderedEdgesAreTaken) {
  options_.wait = 1000.0;
  reset();
  std::vector<Measurement> steps;
  for (int i = 1; i <= 80; ++i) steps.push_back(step(i));
  std::mt19937 random(3);
  std::shuffle(steps.begin(), steps.end(), random);
  for (int i = 45; i <= 80; i += 5) EXPECT_EQ(Added::kWaits, graph_.add(loop(i)));
  for (const Measurement& m : steps) EXPECT_EQ(Added::kNow, graph_.add(m));
  EXPECT_EQ(81u, graph_.graph().nodes().size());
  EXPECT_EQ(1u, graph_.parts());
  EXPECT_EQ(0u, graph_.waiting());
  Pose pose;
  for (int i = 1; i <= 80; ++i) pose = pose * edgeTo(i, EdgeType::kConsecutive).transform;
  const auto& nodes = graph_.graph().nodes();
  const Pose there = nodes[*graph_.find(stamp(0))].pose.inverse() * nodes[*graph_.find(stamp(80))].pose;
  EXPECT_LT((pose.inverse() * there).translation.norm(), 1e-9);
  graph_.add(wrongLoop(10, 30));
  optimise();
  EXPECT_EQ(8u, edges(EdgeState::kAccepted));
  EXPECT_EQ(1u, edges(EdgeState::kPending)) << "the wrong one";
}

TEST_P(OnlineGraphs, NothingIsDoubled) {
  drive(0, 50);
  Measurement again = step(30);
  again.from_stamp += 200;  // as it comes from seconds in double precision
  EXPECT_EQ(Added::kDoubled, graph_.add(again));
  EXPECT_EQ(Added::kNow, graph_.add(loop(45)));
  EXPECT_EQ(Added::kDoubled, graph_.add(loop(45)));
  Measurement waits = loop(70);
  EXPECT_EQ(Added::kWaits, graph_.add(waits));
  EXPECT_EQ(Added::kDoubled, graph_.add(waits));
  waits.source = "another";
  EXPECT_EQ(Added::kWaits, graph_.add(waits));
  EXPECT_EQ(51u, graph_.graph().edges().size());
}

TEST_P(OnlineGraphs, UnknownStampsWaitForABoundedTime) {
  options_.most_waiting = 3;
  reset();
  drive(0, 50);
  for (int i = 0; i < 4; ++i) graph_.add(loop(150 + i));
  EXPECT_EQ(1u, count(Kind::kCrowded));
  EXPECT_EQ(3u, graph_.waiting());
  drive(50, 59);
  EXPECT_EQ(3u, graph_.waiting());
  drive(59, 62);
  EXPECT_EQ(0u, graph_.waiting());
  EXPECT_EQ(3u, count(Kind::kExpired));
}

TEST_P(OnlineGraphs, MalformedEdgesAreRefusedByMessage) {
  drive(0, 50);
  const auto rejected = [&](const auto& spoil) {
    Measurement m = loop(45);
    spoil(m);
    EXPECT_THROW(graph_.add(m), std::invalid_argument);
  };
  constexpr double kNaN = std::numeric_limits<double>::quiet_NaN();
  rejected([](Measurement& m) { m.from_stamp = 0; });
  rejected([](Measurement& m) { m.to_stamp = -5; });
  rejected([](Measurement& m) { m.to_stamp = m.from_stamp; });
  rejected([](Measurement& m) { m.transform.translation.x() = kNaN; });
  rejected([](Measurement& m) { m.transform.rotation.coeffs() *= 2.0; });
  rejected([](Measurement& m) { m.transform.rotation.coeffs().setZero(); });
  rejected([](Measurement& m) { m.information(0, 1) = 5.0; });
  rejected([](Measurement& m) { m.information(0, 0) = -1.0; });
  rejected([](Measurement& m) { m.information(5, 5) = std::numeric_limits<double>::infinity(); });
  rejected([](Measurement& m) { m.information.setZero(); });
  EXPECT_EQ(50u, graph_.graph().edges().size());
  EXPECT_EQ(Added::kNow, graph_.add(loop(45))) << "a malformed one isn't remembered";
  Measurement far = loop(46);
  far.to_stamp = 4'294'967'295 * kSecond;
  EXPECT_EQ(Added::kWaits, graph_.add(far));
}

// A camera's images lie between key poses.
TEST_P(OnlineGraphs, LoopsBetweenKeyPosesAreAttachedByTheFrontEnd) {
  const Pose start = drive_.nodes()[0].pose;
  const auto truth = [&](double node) {
    const int i = static_cast<int>(node);
    return interpolate(drive_.nodes()[i].pose, drive_.nodes()[i + 1].pose, node - i);
  };
  for (const bool front_end : {true, false}) {
    reset();
    for (int i = 1; i <= 110; ++i) {
      // It slows down in between, which a line doesn't know.
      if (front_end)
        for (double part = 0.1; part < 1.05; part += 0.1)
          graph_.addFrontEndPose(stamp(i - 1 + part), start.inverse() * truth(i - 1 + part * part - 1e-9));
      graph_.add(step(i));
    }
    Measurement camera = loop(45);
    camera.from_stamp = stamp(10.5);
    camera.to_stamp = stamp(90.5);
    camera.transform = truth(10.25).inverse() * truth(90.25);
    camera.information = 1e8 * Matrix6::Identity();
    ASSERT_EQ(Added::kNow, graph_.add(camera));
    const Edge& edge = graph_.graph().edges().back();
    EXPECT_EQ(10u, edge.from);
    EXPECT_EQ(90u, edge.to);
    const Pose error =
        edge.transform.inverse() * (drive_.nodes()[edge.from].pose.inverse() * drive_.nodes()[edge.to].pose);
    EXPECT_LT(error.translation.norm(), front_end ? 0.02 : 0.3);
    const double sigma = 1.0 / std::sqrt(edge.information(0, 0));
    EXPECT_GT(sigma, front_end ? kNoise : 0.2) << "two steps, as sure as these are";
    EXPECT_LT(sigma, front_end ? 2.0 * kNoise : 0.5);
    optimise();
    EXPECT_EQ(1u, edges(EdgeState::kAccepted));
    const auto pose = graph_.poseAt(stamp(90.5));
    ASSERT_TRUE(pose);
    EXPECT_LT(((start * *pose).translation - truth(front_end ? 90.25 : 90.5).translation).norm(), 0.5);
  }
}

// The front end was lost, and began anew.
TEST_P(OnlineGraphs, PartsAreJoinedByLoops) {
  drive(0, 50);
  for (std::size_t i = 52; i <= 100; ++i) graph_.add(step(i));
  EXPECT_EQ(2u, graph_.parts());
  EXPECT_EQ(1u, count(Kind::kNewPart));
  graph_.add(loop(85));
  optimise();
  EXPECT_EQ(1u, graph_.parts());
  EXPECT_LT(worstError(), 0.3);
  // Loops of the same parts tell on each other.
  graph_.add(wrongLoop(30, 60));
  optimise();
  EXPECT_EQ(1u, edges(EdgeState::kPending));
  EXPECT_EQ(1u, edges(EdgeState::kAccepted));
  drive(50, 51);
  EXPECT_EQ(1u, graph_.parts());
  EXPECT_TRUE(graph_.hasWork()) << "a cycle of trusted edges and the loop";
  optimise();
  EXPECT_LT(worstError(), 0.3);
}

// Stop, scan, go: nothing is known but by loops, which come together.
TEST_P(OnlineGraphs, KeyPosesWithoutAFrontEndArePlacedByLoops) {
  const auto between = [&](std::size_t from, std::size_t to, const Pose& shift = {}) {
    Edge edge = edgeTo(kPerRound, EdgeType::kLoopClosure);
    edge.from = from, edge.to = to;
    edge.transform = drive_.nodes()[from].pose.inverse() * drive_.nodes()[to].pose * shift;
    edge.information = 1e4 * Matrix6::Identity();
    return measurement(edge);
  };
  // Each is turned by much against those before.
  const std::vector<std::size_t> scans = {0, 13, 21, 28, 37, 60};
  for (std::size_t i = 0; i < scans.size(); ++i) {
    if (i == 2) {
      EXPECT_EQ(Added::kWaits, graph_.add(between(scans[0], scans[2])));
    }
    graph_.addKeyPose(stamp(scans[i]));
    for (std::size_t k = i < 3 ? 0 : i - 2; k < i && i < 5; ++k) {
      EXPECT_EQ(i == 2 && k == 0 ? Added::kDoubled : Added::kNow, graph_.add(between(scans[k], scans[i])));
    }
    if (i == 4) graph_.add(between(scans[0], scans[4], planarPose(3.0, 1.0, 1.0)));  // a wrong one
    optimise();
  }
  EXPECT_EQ(2u, graph_.parts()) << "nothing shows the last one";
  EXPECT_EQ(6u, graph_.graph().nodes().size());
  EXPECT_EQ(1u, edges(EdgeState::kPending));
  EXPECT_EQ(7u, edges(EdgeState::kAccepted));
  const Graph known = largestPart(graph_.graph());
  ASSERT_EQ(5u, known.nodes().size());
  EXPECT_EQ(8u, known.edges().size());
  const Pose shift = drive_.nodes()[0].pose * known.nodes()[0].pose.inverse();
  for (std::size_t i = 0; i < known.nodes().size(); ++i) {
    EXPECT_EQ(stamp(scans[i]), known.nodes()[i].stamp);
    EXPECT_LT(
        ((shift * known.nodes()[i].pose).translation - drive_.nodes()[scans[i]].pose.translation).norm(),
        1e-6);
  }
}

TEST_P(OnlineGraphs, AFalsePlaceOfAPartIsRevoked) {
  drive(0, 50);
  for (std::size_t i = 52; i <= 100; ++i) graph_.add(step(i));
  graph_.add(wrongLoop(30, 60));
  optimise();
  EXPECT_EQ(1u, edges(EdgeState::kAccepted)) << "nothing is against it";
  for (int k = 0; k < 2; ++k) graph_.add(loop(80 + k));
  optimise();
  EXPECT_EQ(1u, edges(EdgeState::kRevoked));
  EXPECT_EQ(2u, edges(EdgeState::kAccepted));
  EXPECT_LT(worstError(), 0.3);
}

TEST_P(OnlineGraphs, WhatComesDuringAnOptimisationIsPutOnTop) {
  drive(0, 90);
  for (int i = 45; i <= 90; i += 5) graph_.add(loop(i));
  auto task = graph_.begin();
  ASSERT_TRUE(task);
  EXPECT_FALSE(graph_.begin()) << "one at a time";
  drive(90, 110);
  graph_.add(loop(105));
  EXPECT_EQ(1u, graph_.erase(stamp(10), stamp(50)));
  task->run();
  graph_.finish(std::move(*task));
  const auto& nodes = graph_.graph().nodes();
  Pose pose = nodes[90].pose;
  for (int i = 91; i <= 110; ++i) pose = pose * edgeTo(i, EdgeType::kConsecutive).transform;
  EXPECT_LT((pose.inverse() * nodes[110].pose).translation.norm(), 1e-9);
  EXPECT_EQ(1u, edges(EdgeState::kDeleted));
  EXPECT_EQ(9u, edges(EdgeState::kAccepted));
  EXPECT_TRUE(graph_.hasWork()) << "the later loop, and the one that went";
  optimise();
  EXPECT_EQ(10u, edges(EdgeState::kAccepted));
  Graph optimum = graph_.graph();
  pose_graph::optimise(optimum);
  EXPECT_LT(meanDistance(optimum, graph_.graph()), 1e-4);
}

TEST_P(OnlineGraphs, AFailedOptimisationIsTriedAgain) {
  drive(0, 50);
  graph_.add(loop(45));
  graph_.abandon(std::move(*graph_.begin()));
  EXPECT_TRUE(graph_.hasWork());
  optimise();
  EXPECT_EQ(1u, edges(EdgeState::kAccepted));
}

TEST_P(OnlineGraphs, PeopleRepairMaps) {
  drive(0, 100);
  for (int i = kPerRound; i <= 100; i += 3) graph_.add(loop(i));
  Measurement by_hand = wrongLoop(10, 90);
  by_hand.trusted = true;
  EXPECT_EQ(Added::kNow, graph_.add(by_hand));
  optimise();
  EXPECT_GT(worstError(), 0.2) << "it isn't questioned";
  EXPECT_EQ(1u, graph_.erase(by_hand.from_stamp, by_hand.to_stamp));
  EXPECT_EQ(0u, graph_.erase(by_hand.from_stamp, by_hand.to_stamp));
  optimise(true);
  EXPECT_LT(worstError(), 0.1);
  EXPECT_EQ(21u, edges(EdgeState::kAccepted)) << "they came back";
  EXPECT_EQ(Added::kNow, graph_.add(by_hand));
  EXPECT_EQ(1u, graph_.erase(by_hand.from_stamp, by_hand.to_stamp));
  // The chain is cut, and holds together by loops.
  EXPECT_EQ(1u, graph_.erase(stamp(50), stamp(51)));
  optimise();
  EXPECT_EQ(1u, graph_.parts());
  EXPECT_LT(worstError(), 0.1);
  graph_.add(wrongLoop(33, 70));
  optimise();
  EXPECT_EQ(1u, edges(EdgeState::kPending));
}

TEST_P(OnlineGraphs, TimeJumpsBack) {
  drive(0, 50);
  graph_.add(loop(70));
  EXPECT_EQ(1u, graph_.beginNewRun());
  drive(0, 50);
  EXPECT_EQ(102u, graph_.graph().nodes().size());
  EXPECT_EQ(2u, graph_.parts());
  EXPECT_EQ(Added::kNow, graph_.add(loop(45)));
  EXPECT_EQ(51u + 45u, graph_.graph().edges().back().to);
}

TEST_P(OnlineGraphs, SensorsBesideTheBodySeeTheSame) {
  const Pose sensor = {{0.3, -0.2, 0.5}, Eigen::Quaterniond(0.5, -0.5, 0.5, -0.5)};  // a camera's axes
  drive(0, 50);
  Measurement m = loop(45);
  const Pose of_body = m.transform;
  m.transform = sensor.inverse() * of_body * sensor;
  m.information = (Vector6() << 400, 300, 200, 90000, 80000, 70000).finished().asDiagonal();
  const Measurement back = ofBody(m, sensor);
  EXPECT_LT((of_body.inverse() * back.transform).translation.norm(), 1e-9);
  // The same small motion costs the same.
  const Pose small = {{0.001, 0.002, -0.001}, Eigen::Quaterniond(1.0, 0.0005, 0.001, -0.0003).normalized()};
  const auto chi2 = [](const Measurement& a, const Pose& end) {
    const Edge edge{0, 1, a.type, a.transform, a.information, true};
    const Vector6 error = errorOf(edge, {}, end, false);
    return error.dot(a.information * error);
  };
  const double of_sensor = chi2(m, m.transform * small);
  EXPECT_GT(of_sensor, 0.1);
  EXPECT_NEAR(of_sensor, chi2(back, sensor * m.transform * small * sensor.inverse()), 1e-6 * of_sensor);
  EXPECT_EQ(Added::kNow, graph_.add(back));
}

}  // namespace
}  // namespace pose_graph
