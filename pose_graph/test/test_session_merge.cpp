// SPDX-License-Identifier: BSD-3-Clause
#include <gtest/gtest.h>
#include <mapping_common/files.h>
#include <mapping_common/testing/temp_dir.h>

#include <filesystem>

#include "graphs.h"
#include "pose_graph/session_merge.h"

namespace pose_graph {
namespace {

using mapping_common::errorOf;
using mapping_common::mentions;

// A straight drive from a place on, in a frame of its own.
struct Drive {
  std::int64_t start;  // ns
  Pose frame;          // of the world, in which poses are i steps along x, seen from the session's frame
  int poses = 6;

  Pose at(int i) const { return planarPose(i, 0.1 * i * i, 0.05 * i); }
  std::int64_t stamp(int i) const { return start + 1'000'000'000LL * i; }
};

class SessionMergeTest : public testing::TestWithParam<bool> {
 protected:
  void write(const std::string& name, const Drive& drive, const std::vector<ForeignEdge>& places = {}) {
    SessionWriter writer(dir_.path(name), GetParam());
    const std::int64_t run = writer.beginRun(drive.start, name);
    for (int i = 0; i < drive.poses; ++i) {
      const Pose pose = drive.frame * drive.at(i);
      writer.put(KeyPose{10 + i, run, drive.stamp(i), pose, pose, false});
      writer.put(
          KeyData{10 + i, DataKind::kWords, drive.stamp(i), "camera", {}, 1, name + std::to_string(i)});
      if (i == 0) continue;
      SessionEdge edge;
      edge.id = i;
      edge.from = 9 + i, edge.to = 10 + i;
      edge.transform = drive.at(i - 1).inverse() * drive.at(i);
      writer.put(edge);
    }
    for (const ForeignEdge& place : places) writer.put(place);
    writer.setSetting(name, "set");
  }
  static ForeignEdge place(const Drive& a, int i, const Drive& b, int k, const Pose& error = {}) {
    ForeignEdge edge;
    edge.from_stamp = a.stamp(i), edge.to_stamp = b.stamp(k) + 400'000;
    edge.transform = a.at(i).inverse() * b.at(k) * error;
    edge.source = "places";
    return edge;
  }
  mapping_common::TempDir dir_;
  const std::string out_ = dir_.path("merged");
  const Drive a_{1'000'000'000'000, {}}, b_{2'000'000'000'000, planarPose(30, -20, 2.0)},
      c_{3'000'000'000'000, planarPose(-7, 3, -1.0)};
};
INSTANTIATE_TEST_SUITE_P(PlaneAndSpace, SessionMergeTest, testing::Bool());

TEST_P(SessionMergeTest, PlaceEdgesBringThemIntoOneFrame) {
  write("a", a_);
  // One of them is wrong.
  write("b", b_, {place(a_, 1, b_, 2), place(a_, 2, b_, 2, planarPose(9, 4, 2)), place(a_, 4, b_, 5)});
  write("c", c_, {place(b_, 3, c_, 0), place(Drive{9, {}}, 0, c_, 1)});
  const auto merge = mergeSessions({dir_.path("a"), dir_.path("b"), dir_.path("c")}, out_);
  ASSERT_TRUE(merge);
  EXPECT_EQ(18U, merge->key_poses);
  EXPECT_EQ(4U, merge->place_edges);
  EXPECT_EQ(1U, merge->revoked);
  EXPECT_TRUE(merge->unconnected.empty());

  const Session session(out_);
  EXPECT_EQ(GetParam(), session.planar());
  const SessionGraph read = readGraph(session);
  ASSERT_EQ(18U, read.graph.nodes().size());
  for (int i = 0; i < 18; ++i) {
    const Pose expected = a_.at(i % 6);
    EXPECT_LT((read.graph.nodes()[i].pose.translation - expected.translation).norm(), 1e-9) << i;
    EXPECT_NEAR(expected.yaw(), read.graph.nodes()[i].pose.yaw(), 1e-9) << i;
  }
  EXPECT_EQ(19U, read.graph.edges().size());
  EXPECT_LT(read.graph.chi2(), 1e-9) << "the wrong one has no effect";
  EXPECT_EQ(3U, session.runs().size());
  EXPECT_EQ("b", session.runs()[1].name);
  EXPECT_EQ(1U, session.foreignEdges().size()) << "of which one pose is in none of them";
  EXPECT_EQ("set", session.settings()["c"]);
  const auto data = session.dataAt(read.graph.nodes()[8].id, DataKind::kWords);
  ASSERT_EQ(1U, data.size());
  EXPECT_EQ("b2", data[0].data);
}

TEST_P(SessionMergeTest, WhatNothingConnectsStaysInItsFrame) {
  write("a", a_);
  write("b", b_);
  const auto merge = mergeSessions({dir_.path("a"), dir_.path("b")}, out_);
  ASSERT_TRUE(merge);
  ASSERT_EQ(1U, merge->unconnected.size());
  EXPECT_EQ(dir_.path("b"), merge->unconnected[0]);
  const auto nodes = readGraph(Session(out_)).graph.nodes();
  EXPECT_LT((nodes[6].pose.translation - b_.frame.translation).norm(), 1e-12);
}

TEST_P(SessionMergeTest, AMergeThatFailsLeavesNothing) {
  write("a", a_);
  write("b", b_);
  const std::vector<std::string> both = {dir_.path("a"), dir_.path("b")};
  EXPECT_FALSE(mergeSessions(both, out_, [](double) { return false; }));
  EXPECT_TRUE(mentions(errorOf([&] { mergeSessions({dir_.path("a"), dir_.path("none")}, out_); }), {"none"}));
  { SessionWriter other(dir_.path("other"), !GetParam()); }
  EXPECT_THROW(mergeSessions({dir_.path("a"), dir_.path("other")}, out_), std::invalid_argument);
  EXPECT_THROW(mergeSessions(both, dir_.path("a")), std::invalid_argument);
  std::size_t files = 0;
  for (const auto& entry : std::filesystem::directory_iterator(dir_.path()))
    files += entry.path().filename().string()[0] == 'm';
  EXPECT_EQ(0U, files);
}

}  // namespace
}  // namespace pose_graph
