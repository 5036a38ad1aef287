// SPDX-License-Identifier: BSD-3-Clause
#include <gtest/gtest.h>
#include <mapping_common/files.h>
#include <mapping_common/testing/temp_dir.h>

#include <cmath>

#include "pose_graph/g2o_file.h"
#include "pose_graph/trajectory_file.h"

namespace pose_graph {
namespace {

const char kPlane[] =
    "# two poses\n"
    "EDGE_SE2 10 11 1 0 0.5 2 0.1 0.2 3 0.3 4\n"
    "VERTEX_SE2 10 0 0 0\n"
    "VERTEX_SE2 11 1.5 0 0.5\r\n"
    "\n"
    "FIX 10\n";
const char kSpace[] =
    "VERTEX_SE3:QUAT 0 0 0 0 0 0 0 1\n"
    "VERTEX_SE3:QUAT 5 1 2 3 0 0 0.6 0.8 \n"
    "EDGE_SE3:QUAT 0 5 1 2 3 0 0 0 1 1 0 0 0 0 7 2 0 0 0 0 3 0 0 0 40 0 0 50 0 60\n";

TEST(G2o, ReadsThePlane) {
  const G2oFile file = parseG2o(kPlane, "a.g2o");
  EXPECT_TRUE(file.has_poses);
  EXPECT_TRUE(file.graph.planar());
  ASSERT_EQ(2u, file.graph.nodes().size());
  EXPECT_TRUE(file.graph.nodes()[0].fixed);
  const Edge& edge = file.graph.edges().at(0);
  EXPECT_EQ(EdgeType::kConsecutive, edge.type);
  EXPECT_DOUBLE_EQ(0.2, edge.information(5, 0));
  EXPECT_DOUBLE_EQ(0.3, edge.information(1, 5));
  // 0.5 m too far along x of `from`, seen from the measured pose, which is turned by 0.5 rad.
  const double x = 0.5 * std::cos(0.5), y = -0.5 * std::sin(0.5);
  EXPECT_NEAR(2 * x * x + 3 * y * y + 2 * 0.1 * x * y, file.graph.chi2(), 1e-12);
}

// The error is (0, 0, 0) and, of the quaternion, (0, 0, 0.6).
TEST(G2o, Chi2InSpaceIsOfTheVectorPart) {
  const G2oFile file = parseG2o(kSpace, "a.g2o");
  EXPECT_EQ(EdgeType::kLoopClosure, file.graph.edges().at(0).type);
  EXPECT_NEAR(0.6 * 0.6 * 60, file.graph.chi2(), 1e-12);
}

TEST(G2o, WhatIsWrittenIsReadAlike) {
  const mapping_common::TempDir dir;
  for (const char* text : {kPlane, kSpace}) {
    const Graph graph = parseG2o(text, "a.g2o").graph;
    writeG2o(dir.path("b.g2o"), graph);
    const Graph again = readG2o(dir.path("b.g2o")).graph;
    ASSERT_EQ(graph.nodes().size(), again.nodes().size());
    for (std::size_t i = 0; i < graph.nodes().size(); ++i) {
      const Node &a = graph.nodes()[i], &b = again.nodes()[i];
      EXPECT_EQ(a.id, b.id);
      EXPECT_EQ(a.fixed, b.fixed);
      EXPECT_EQ(a.pose.translation, b.pose.translation);
      EXPECT_TRUE(a.pose.rotation.isApprox(b.pose.rotation, 1e-15));
    }
    EXPECT_EQ(graph.edges().at(0).information, again.edges().at(0).information);
    EXPECT_NEAR(graph.chi2(), again.chi2(), 1e-12);
  }
}

TEST(G2o, EdgesAloneHaveNoPoses) {
  const G2oFile file = parseG2o("EDGE_SE2 4 3 1 0 0 1 0 0 1 0 1\nEDGE_SE2 4 9 1 0 0 1 0 0 1 0 1\n", "a.g2o");
  EXPECT_FALSE(file.has_poses);
  ASSERT_EQ(3u, file.graph.nodes().size());
  EXPECT_EQ(3, file.graph.nodes()[0].id);
  EXPECT_EQ(EdgeType::kLoopClosure, file.graph.edges()[1].type);
}

// TORO's information goes xx, xy, yy, tt, xt, yt.
TEST(G2o, ReadsToro) {
  const G2oFile file = parseG2o("EDGE2 0 1 1 0 0 1 2 8 9 0.1 0.2\n", "a.graph");
  const Matrix6& information = file.graph.edges().at(0).information;
  EXPECT_EQ(2.0, information(0, 1));
  EXPECT_EQ(8.0, information(1, 1));
  EXPECT_EQ(9.0, information(5, 5));
  EXPECT_EQ(0.2, information(1, 5));
}

TEST(G2o, ErrorsNameTheLine) {
  const auto error_of = [](const std::string& text) {
    return mapping_common::errorOf([&] { parseG2o("# a graph\n" + text, "a.g2o"); });
  };
  EXPECT_EQ("a.g2o has no vertices and no edges of poses", error_of(""));
  EXPECT_EQ("a.g2o:2: 'VERTEX_XY' is none of VERTEX_SE2 | EDGE_SE2 | VERTEX_SE3:QUAT | EDGE_SE3:QUAT | FIX",
            error_of("VERTEX_XY 1 2 3\n"));
  EXPECT_EQ("a.g2o:2: VERTEX_SE2 has 1 id and 3 numbers, not 3 in all", error_of("VERTEX_SE2 1 2 3\n"));
  EXPECT_EQ("a.g2o:2: 'x' is no number", error_of("VERTEX_SE2 1 x 3 0\n"));
  EXPECT_EQ("a.g2o:2: '1.5' is no id", error_of("VERTEX_SE2 1.5 2 3 0\n"));
  EXPECT_EQ("a.g2o:3: there is a node 1 already", error_of("VERTEX_SE2 1 2 3 0\nVERTEX_SE2 1 2 3 0\n"));
  EXPECT_EQ("a.g2o:3: EDGE_SE2 of a vertex 2 that the file doesn't have",
            error_of("VERTEX_SE2 1 2 3 0\nEDGE_SE2 1 2 1 0 0 1 0 0 1 0 1\n"));
  EXPECT_EQ("a.g2o:3: the information of edge 1 -> 2 isn't positive semidefinite",
            error_of("VERTEX_SE2 1 2 3 0\nEDGE_SE2 1 2 1 0 0 -1 0 0 1 0 1\nVERTEX_SE2 2 2 3 0\n"));
  EXPECT_EQ("a.g2o:3: VERTEX_SE3:QUAT in a graph of the plane",
            error_of("VERTEX_SE2 1 2 3 0\nVERTEX_SE3:QUAT 2 0 0 0 0 0 0 1\n"));
  EXPECT_EQ("a.g2o:2: the pose of node 1 isn't finite", error_of("VERTEX_SE2 1 nan 3 0\n"));
  EXPECT_EQ("a.g2o:2: a quaternion of length 0.000000", error_of("VERTEX_SE3:QUAT 1 0 0 0 0 0 0 0\n"));
}

TEST(Tum, HasStampsOrIds) {
  const mapping_common::TempDir dir;
  Graph graph(true);
  graph.addNode({3, 0, planarPose(1, 2, 0), false});
  graph.addNode({4, 1000000000000000005, {}, false});
  writeTum(dir.path("a.tum"), graph);
  EXPECT_EQ("3 1 2 0 0 0 0 1\n1000000000.000000005 0 0 0 0 0 0 1\n",
            mapping_common::readFile(dir.path("a.tum")));
}

}  // namespace
}  // namespace pose_graph
