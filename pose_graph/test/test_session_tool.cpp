// SPDX-License-Identifier: BSD-3-Clause
//
// The program on sessions, from end to end.
#include <gtest/gtest.h>
#include <mapping_common/files.h>
#include <mapping_common/testing/tool_test.h>

#include <filesystem>
#include <string>

#include "pose_graph/g2o_file.h"
#include "recorded_room.h"

namespace pose_graph {
namespace {

using mapping_common::mentions;
using mapping_common::readFile;

class SessionTool : public mapping_common::ToolTest {
 protected:
  SessionTool() : ToolTest(POSE_GRAPH) {}
  void SetUp() override {
    SessionWriter writer(path_, true);
    writeRun(writer, room_, planarPose(0.02, 0.01, 0.01));
    MapBuildOptions options;
    options.slam.map.resolution = 0.05;
    options.occupancy.resolution = 0.1;
    keepOptions(options, writer);
  }
  void putWrongLoop() {
    SessionWriter writer(path_, true);
    SessionEdge wrong;
    wrong.id = writer.nextEdge();
    wrong.from = 2, wrong.to = 8;
    wrong.type = EdgeType::kLoopClosure;
    wrong.transform = planarPose(0.1, 0.0, 0.0);
    wrong.information *= 10000.0;
    writer.put(wrong);
  }
  // m, of the drift that is left
  double error(const Graph& graph) const {
    const Pose motion = room_[0] * graph.nodes()[0].pose.inverse();
    double greatest = 0.0;
    for (std::size_t i = 0; i < room_.size(); ++i)
      greatest =
          std::max(greatest, ((motion * graph.nodes()[i].pose).translation - room_[i].translation).norm());
    return greatest;
  }

  const std::string path_ = dir_.path("room");  // the ending doesn't tell
  const std::vector<Pose> room_ = circle();
};

TEST_F(SessionTool, TellsWhatIsInASession) {
  EXPECT_EQ(0, run("info " + path_)) << output();
  EXPECT_TRUE(
      mentions(output(), {"session of 12 poses in the plane, in 1 connected parts", "run 0 room: 12 poses",
                          "11.0 s", "edges, consecutive: 11 accepted", "edges, loop_closure: 1 accepted",
                          "scans: 12, ", "clouds: 12, ", "slam/map_resolution: 0.05"}));
}

TEST_F(SessionTool, OptimisesInPlaceOrToAnotherFile) {
  EXPECT_GT(error(readGraph(Session(path_)).graph), 0.2);
  EXPECT_EQ(0, run("optimise " + path_ + ' ' + dir_.path("better"))) << output();
  EXPECT_GT(error(readGraph(Session(path_)).graph), 0.2) << "the first is as it was";
  EXPECT_LT(error(readGraph(Session(dir_.path("better"))).graph), 1e-3);
  EXPECT_EQ(24U, Session(dir_.path("better")).amounts()[DataKind::kScan].count +
                     Session(dir_.path("better")).amounts()[DataKind::kCloud].count);
  EXPECT_EQ(0, run("optimise " + path_ + ' ' + dir_.path("out.g2o"))) << output();
  EXPECT_LT(error(readG2o(dir_.path("out.g2o")).graph), 1e-3);
  EXPECT_EQ(0, run("optimise " + path_)) << output();
  EXPECT_TRUE(mentions(output(), {"chi2 ", " iterations"}));
  EXPECT_LT(error(readGraph(Session(path_)).graph), 1e-3);
}

TEST_F(SessionTool, RevokesWrongLoops) {
  putWrongLoop();
  EXPECT_EQ(0, run("optimise " + path_ + " --loop-check pcm")) << output();
  EXPECT_TRUE(mentions(output(), {"wrong: 2 -> 8"}));
  const Session session(path_);
  EXPECT_EQ(EdgeState::kRevoked, session.edges().back().state);
  EXPECT_LT(error(readGraph(session).graph), 1e-3);
  EXPECT_EQ(0, run("info " + path_));
  EXPECT_TRUE(mentions(output(), {"loop_closure: 1 accepted, 1 revoked"}));
}

TEST_F(SessionTool, ExportsGraphAndMaps) {
  ASSERT_EQ(0, run("optimise " + path_));
  for (const char* name : {"a.g2o", "a.tum", "a.pgm", "a.pcd", "a.map", "a.db"})
    EXPECT_EQ(0, run("export " + path_ + ' ' + dir_.path(name))) << output();
  EXPECT_EQ(12U, readG2o(dir_.path("a.g2o")).graph.nodes().size());
  EXPECT_TRUE(mentions(readFile(dir_.path("a.tum")), {"100.000000000 ", "\n111.000000000 "}));
  EXPECT_TRUE(mentions(readFile(dir_.path("a.yaml")), {"resolution: 0.05", "image: a.pgm"}));
  EXPECT_TRUE(mentions(readFile(dir_.path("a.pcd")), {"POINTS 12960"}));
  for (const char* name : {"a.map", "a.db"}) {
    const auto map = rtree_occupancy_map::OccupancyMap::load(dir_.path(name));
    EXPECT_EQ(0.1, map.options().resolution);
    EXPECT_GT(map.statistics().occupied_cells, 100U);
  }
  EXPECT_EQ(0, run("export " + path_ + ' ' + dir_.path("b.pcd") + " --voxel 0.5"));
  EXPECT_LT(std::filesystem::file_size(dir_.path("b.pcd")), 10000U);
  EXPECT_EQ(0, run("export " + path_ + ' ' + dir_.path("b.yaml") + " --resolution 0.1"));
  EXPECT_TRUE(mentions(readFile(dir_.path("b.yaml")), {"resolution: 0.1"}));
}

TEST_F(SessionTool, ExportsTheWayWithoutLoops) {
  putWrongLoop();
  ASSERT_EQ(0, run("optimise " + path_));
  EXPECT_EQ(0, run("export " + path_ + ' ' + dir_.path("a.g2o")));
  EXPECT_GT(error(readG2o(dir_.path("a.g2o")).graph), 0.2);
  EXPECT_EQ(0, run("export " + path_ + ' ' + dir_.path("b.g2o") + " --without-loops"));
  EXPECT_LT(error(readG2o(dir_.path("b.g2o")).graph), 1e-6);
}

TEST_F(SessionTool, MergesSessions) {
  const std::string other = dir_.path("other"), out = dir_.path("merged");
  std::vector<Pose> moved;
  for (const Pose& pose : room_) moved.push_back(planarPose(50, 20, 1) * pose);
  {
    SessionWriter writer(other, true);
    writeRun(writer, room_, {}, 500.0);
    std::map<std::int64_t, Pose> poses;
    for (std::size_t i = 0; i < moved.size(); ++i) poses[static_cast<std::int64_t>(i)] = moved[i];
    writer.setPoses(poses);
  }
  EXPECT_EQ(0, run("merge " + path_ + ' ' + other + " -o " + out)) << output();
  EXPECT_TRUE(mentions(output(), {"0 PLACE edges", "no PLACE edge connects it with"}));
  {
    SessionWriter writer(other, true);
    for (const int i : {1, 5, 9}) {
      ForeignEdge edge;
      edge.from_stamp = (100 + i) * 1'000'000'000LL, edge.to_stamp = (500 + i) * 1'000'000'000LL;
      edge.information *= 10000.0;
      writer.put(edge);
    }
  }
  EXPECT_EQ(0, run("merge " + path_ + ' ' + other + " -o " + out)) << output();
  EXPECT_TRUE(mentions(output(), {"3 PLACE edges", "24 poses -> "}));
  const Graph graph = readGraph(Session(out)).graph;
  EXPECT_LT(error(graph), 1e-3);
  for (std::size_t i = 0; i < room_.size(); ++i)
    EXPECT_LT((graph.nodes()[i].pose.translation - graph.nodes()[i + 12].pose.translation).norm(), 1e-3);
  EXPECT_EQ(0, run("info " + out));
  EXPECT_TRUE(
      mentions(output(), {"24 poses", "1 connected parts", "run 1 room", "edges, place: 3 accepted"}));
}

TEST_F(SessionTool, SaysWhatIsWrong) {
  EXPECT_EQ(2, run("merge " + path_));
  EXPECT_TRUE(mentions(output(), {"merge needs a file to write"}));
  EXPECT_EQ(2, run("export " + path_ + " out.xyz"));
  EXPECT_TRUE(mentions(output(), {"ends in .g2o, .tum, .pgm"}));
  EXPECT_EQ(2, run("export " + path_ + " out.pcd --voxel -1"));
  EXPECT_EQ(1, run("merge " + path_ + ' ' + dir_.path("none") + " -o " + dir_.path("out")));
  EXPECT_TRUE(mentions(output(), {"none"}));
  const std::string empty = dir_.path("empty");
  {
    SessionWriter writer(empty, true);
    writer.put(KeyPose{0, writer.beginRun(0, ""), 0, {}, {}, false});
  }
  EXPECT_EQ(1, run("export " + empty + ' ' + dir_.path("a.pgm")));
  EXPECT_TRUE(mentions(output(), {"holds no scans or clouds"}));
  SessionWriter writer(empty, true);
  EXPECT_EQ(0, run("info " + empty)) << "while somebody writes to it";
  EXPECT_EQ(1, run("optimise " + empty));
  EXPECT_TRUE(mentions(output(), {"being written to by another"}));
}

}  // namespace
}  // namespace pose_graph
