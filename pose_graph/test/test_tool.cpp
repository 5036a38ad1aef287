// SPDX-License-Identifier: BSD-3-Clause
//
// The program from end to end.
#include <gtest/gtest.h>
#include <mapping_common/files.h>
#include <mapping_common/testing/tool_test.h>

#include <string>

#include "graphs.h"
#include "pose_graph/g2o_file.h"
#include "pose_graph/initialisation.h"

namespace pose_graph {
namespace {

using mapping_common::mentions;

class Tool : public mapping_common::ToolTest, public testing::WithParamInterface<bool> {
 protected:
  Tool() : ToolTest(POSE_GRAPH) {}
  const std::string in_ = dir_.path("in.g2o"), out_ = dir_.path("out.g2o");
};
INSTANTIATE_TEST_SUITE_P(PlaneAndSpace, Tool, testing::Bool());

TEST_P(Tool, OptimisesAndTellsAndExports) {
  Graph graph = rounds(GetParam(), 100, 30, 0.02, 1);
  startFromOdometry(graph);
  writeG2o(in_, graph);
  EXPECT_EQ(0, run("info " + in_)) << output();
  EXPECT_TRUE(mentions(output(),
                       {"100 poses in ", "1 connected parts", "169 edges, 99 of them consecutive", "chi2 "}));
  EXPECT_EQ(0, run("optimise " + in_ + ' ' + out_)) << output();
  EXPECT_TRUE(mentions(output(), {"chi2 ", " -> "}));
  EXPECT_FALSE(mentions(output(), {"iteration 0"})) << "how far it is, which takes no time";
  EXPECT_EQ(0, runOnTerminal("optimise " + in_ + ' ' + out_)) << output();
  EXPECT_TRUE(mentions(output(), {"pose_graph: iteration 0, chi2 ", "\r\033[Kchi2 "}))
      << "the result on a line of its own";
  const Graph optimised = readG2o(out_).graph;
  EXPECT_LT(optimised.chi2(), 0.5 * graph.chi2());
  EXPECT_EQ(0, run("export " + out_ + ' ' + dir_.path("out.tum"))) << output();
  EXPECT_TRUE(mentions(mapping_common::readFile(dir_.path("out.tum")), {"\n99 "}));
}

TEST_P(Tool, LeavesWrongLoopsOut) {
  Graph graph = rounds(GetParam(), 100, 30, 0.01, 1);
  Edge wrong = graph.edges().back();
  wrong.from = 5, wrong.to = 80;
  graph.addEdge(wrong);
  writeG2o(in_, graph);
  EXPECT_EQ(0, run("optimise " + in_ + ' ' + out_ + " --loop-check pcm")) << output();
  EXPECT_TRUE(mentions(output(), {"wrong: 5 -> 80"}));
  const Graph optimised = readG2o(out_).graph;
  EXPECT_LT(optimised.edges().size(), graph.edges().size());
  EXPECT_LT(meanDistance(graph, optimised), 0.1);
}

TEST_F(Tool, SaysWhatIsWrong) {
  writeG2o(in_, rounds(true, 10, 5, 0.0, 1));
  EXPECT_EQ(2, run("optimize " + in_ + ' ' + out_));
  EXPECT_TRUE(mentions(output(), {"'optimize' is none of info | optimise | merge | export"}));
  EXPECT_EQ(2, run("optimise " + in_));
  EXPECT_TRUE(mentions(output(), {"optimise needs a file to write that ends in .g2o or .tum"}));
  EXPECT_EQ(2, run("optimise " + in_ + ' ' + out_ + " --tolerance 2"));
  EXPECT_TRUE(mentions(output(), {"--tolerance", "0 to 1"}));
  EXPECT_EQ(2, run("optimise " + in_ + ' ' + out_ + " --start anywhere"));
  EXPECT_TRUE(mentions(output(), {"'anywhere' is none of best | poses | odometry | chordal"}));
  EXPECT_EQ(1, run("info " + dir_.path("none.g2o")));
  EXPECT_TRUE(mentions(output(), {"none.g2o"}));
  dir_.write("edges.g2o", "EDGE_SE2 0 1 1 0 0 1 0 0 1 0 1\n");
  EXPECT_EQ(1, run("export " + dir_.path("edges.g2o") + ' ' + out_));
  EXPECT_TRUE(mentions(output(), {"has no poses"}));
  EXPECT_EQ(0, run("--help"));
}

}  // namespace
}  // namespace pose_graph
