// SPDX-License-Identifier: BSD-3-Clause
//
// Says what is in a graph, optimises it, and converts it.
#include <mapping_common/tool.h>

#include <algorithm>
#include <boost/program_options.hpp>
#include <cmath>
#include <iostream>
#include <set>
#include <string>

#include "pose_graph/g2o_file.h"
#include "pose_graph/initialisation.h"
#include "pose_graph/loop_check.h"
#include "pose_graph/optimisation.h"
#include "pose_graph/trajectory_file.h"

namespace po = boost::program_options;

namespace {

using pose_graph::Graph;
using pose_graph::LoopCheck;
using pose_graph::Start;

const char kUsage[] =
    "Usage: pose_graph info GRAPH.g2o\n"
    "       pose_graph optimise GRAPH.g2o OUT.g2o|OUT.tum [options]\n"
    "       pose_graph export GRAPH.g2o OUT.g2o|OUT.tum\n"
    "\n"
    "Says what is in a pose graph in g2o's format, moves its poses to where chi2 is least, or writes it "
    "anew, or\n"
    "its poses alone as a trajectory in TUM's format.\n";

struct Arguments {
  std::string command, in, out;
  Start start = Start::kBest;
  pose_graph::LoopCheckOptions options;
};

bool endsWith(const std::string& text, const std::string& end) {
  return text.size() > end.size() && text.compare(text.size() - end.size(), end.size(), end) == 0;
}

/// False if help was asked for and printed. Throws po::error for wrong usage.
bool parse(int argc, char** argv, Arguments& a) {
  po::options_description options("Options"), unnamed;
  auto& o = a.options.optimisation;
  a.options.method = LoopCheck::kNone;
  auto add = options.add_options();
  add("help,h", "print this");
  add("start", po::value<std::string>()->default_value("best"),
      "where the optimisation begins: poses, those of the file; odometry, a chain of consecutive edges; "
      "chordal, "
      "linear least squares without any guess; best, all of these, and the least chi2 is kept");
  add("max-iterations", po::value(&o.max_iterations)->default_value(o.max_iterations),
      "the most for each start");
  add("tolerance", po::value(&o.tolerance)->default_value(o.tolerance, "1e-10"),
      "ends when an iteration lessens chi2 by less than this share");
  add("loop-check", po::value<std::string>()->default_value("none"),
      "none | pcm | gnc | dcs: how wrong loops are found, from a chain of consecutive edges on; those are "
      "left out of "
      "OUT.g2o");
  add("confidence", po::value(&a.options.confidence)->default_value(a.options.confidence),
      "share of right loops that is accepted, if their information is right");
  auto add_unnamed = unnamed.add_options();
  add_unnamed("command", po::value(&a.command)->required(), "");
  add_unnamed("in", po::value(&a.in)->required(), "");
  add_unnamed("out", po::value(&a.out), "");
  const auto given = mapping_common::parseArguments(argc, argv, kUsage, options, unnamed);
  if (!given) return false;
  a.start = mapping_common::valueOf<Start>((*given)["start"].as<std::string>());
  a.options.method = mapping_common::valueOf<LoopCheck>((*given)["loop-check"].as<std::string>());
  mapping_common::validate(a.options, "--");
  if (a.command != "info" && a.command != "optimise" && a.command != "export")
    throw po::error('\'' + a.command + "' is none of info | optimise | export");
  if (a.command == "info" && !a.out.empty()) throw po::error("info writes no file");
  if (a.command != "info" && !endsWith(a.out, ".g2o") && !endsWith(a.out, ".tum"))
    throw po::error(a.command + " needs a file to write that ends in .g2o or .tum");
  return true;
}

void print(const Graph& graph, bool has_poses) {
  std::size_t loops = 0, fixed = 0;
  for (const auto& edge : graph.edges()) loops += edge.type != pose_graph::EdgeType::kConsecutive ? 1 : 0;
  for (const auto& node : graph.nodes()) fixed += node.fixed ? 1 : 0;
  const auto parts = pose_graph::connectedParts(graph);
  std::cout << graph.nodes().size() << " poses in " << (graph.planar() ? "the plane" : "space") << ", "
            << fixed << " fixed, in " << std::set<std::size_t>(parts.begin(), parts.end()).size()
            << " connected parts\n"
            << graph.edges().size() << " edges, " << graph.edges().size() - loops << " of them consecutive\n";
  if (has_poses)
    std::cout << "chi2 " << graph.chi2() << '\n';
  else
    std::cout << "no poses: edges alone\n";
}

void write(const std::string& path, const Graph& graph) {
  if (endsWith(path, ".tum"))
    pose_graph::writeTum(path, graph);
  else
    pose_graph::writeG2o(path, graph);
  std::cerr << "pose_graph: " << graph.nodes().size() << " poses -> " << path << '\n';
}

void run(const Arguments& a) {
  pose_graph::G2oFile file = pose_graph::readG2o(a.in);
  std::cout.precision(10);
  if (a.command == "info") print(file.graph, file.has_poses);
  if (a.command == "export") {
    if (!file.has_poses) throw std::runtime_error(a.in + " has no poses; 'optimise' gives it some");
    write(a.out, file.graph);
  }
  if (a.command != "optimise") return;
  if (a.start == Start::kPoses && !file.has_poses)
    throw std::runtime_error(a.in + " has no poses to start from");
  std::cerr.precision(10);
  const auto progress = [](int iteration, double chi2) {
    std::cerr << "\rpose_graph: iteration " << iteration << ", chi2 " << chi2 << "          " << std::flush;
    return true;
  };
  pose_graph::OptimisationResult result;
  if (a.options.method == LoopCheck::kNone) {
    result = pose_graph::optimiseFrom(a.start, file.graph, a.options.optimisation, progress);
  } else {
    pose_graph::startFromOdometry(file.graph);
    const auto checked = pose_graph::optimiseAndCheck(file.graph, a.options, progress);
    result = checked.optimisation;
    for (const std::size_t e : checked.revoked) {
      const auto& edge = file.graph.edges()[e];
      std::cout << "wrong: " << file.graph.nodes()[edge.from].id << " -> " << file.graph.nodes()[edge.to].id
                << '\n';
    }
  }
  std::cerr << '\n';
  std::cout << "chi2 " << result.initial_chi2 << " -> " << result.chi2 << " in " << result.iterations
            << (result.converged ? " iterations\n" : " iterations; not converged, see --max-iterations\n");
  write(a.out, file.graph);
}

}  // namespace

int main(int argc, char** argv) {
  return mapping_common::runTool(argc, argv, "pose_graph", kUsage, parse, run);
}
