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
#include <utility>
#include <vector>

#include "pose_graph/g2o_file.h"
#include "pose_graph/initialisation.h"
#include "pose_graph/loop_check.h"
#include "pose_graph/optimisation.h"
#include "pose_graph/session.h"
#include "pose_graph/trajectory_file.h"
#include "session_commands.h"
#include "shown.h"

namespace po = boost::program_options;

namespace {

using pose_graph::Graph;
using pose_graph::LoopCheck;
using pose_graph::Start;

const char kUsage[] =
    "Usage: pose_graph info FILE\n"
    "       pose_graph optimise GRAPH.g2o OUT.g2o|OUT.tum [options]\n"
    "       pose_graph optimise SESSION [OUT] [options]\n"
    "       pose_graph merge SESSION... -o OUT [options]\n"
    "       pose_graph export FILE OUT\n"
    "\n"
    "Says what is in a pose graph in g2o's format or in a session, moves its poses to where chi2 is least, "
    "merges\n"
    "sessions, or writes the graph (.g2o), the poses (.tum), and of a session a 2D map (.pgm with .yaml), "
    "the clouds\n"
    "(.pcd) or the R-tree map (.map, .db). What a file is its content tells.\n";

struct Arguments {
  std::string command, out;
  std::vector<std::string> files;
  bool session = false, without_loops = false;
  double resolution = 0.0, voxel = 0.0;
  Start start = Start::kBest;
  pose_graph::LoopCheckOptions options;
};

bool endsWith(const std::string& text, const std::string& end) {
  return text.size() > end.size() && text.compare(text.size() - end.size(), end.size(), end) == 0;
}

// Which files a command takes depends on what is in the first.
void checkFiles(Arguments& a) {
  if (a.command != "info" && a.command != "optimise" && a.command != "merge" && a.command != "export")
    throw po::error('\'' + a.command + "' is none of info | optimise | merge | export");
  if (a.command == "merge") {
    if (a.out.empty()) throw po::error("merge needs a file to write: -o FILE");
    return;
  }
  if (!a.out.empty()) throw po::error("-o is for merge: " + a.command + " has its output after its input");
  a.session = pose_graph::isSession(a.files.front());
  if (a.files.size() > 2) throw po::error(a.command + " takes two files at most");
  if (a.files.size() == 2) a.out = a.files[1];
  if (a.command == "info" && !a.out.empty()) throw po::error("info writes no file");
  if (a.command == "info") return;
  if (!a.session && !endsWith(a.out, ".g2o") && !endsWith(a.out, ".tum"))
    throw po::error(a.command + " needs a file to write that ends in .g2o or .tum");
  if (a.session && a.command == "export" && !pose_graph::isExport(a.out))
    throw po::error(std::string("export needs a file to write that ends in ") + pose_graph::kExports);
  for (const auto& [name, value] : {std::pair("resolution", a.resolution), std::pair("voxel", a.voxel)})
    if (!(value >= 0.0)) throw po::error(std::string("--") + name + " must be 0 or more");
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
      "none | growth | pcm | gnc | dcs: how wrong loops are found, from a chain of consecutive edges on; "
      "those are "
      "left out of "
      "OUT.g2o");
  add("confidence", po::value(&a.options.confidence)->default_value(a.options.confidence),
      "share of right loops that is accepted, if their information is right");
  add("output,o", po::value(&a.out), "the file that merge writes");
  add("resolution", po::value(&a.resolution)->default_value(0.0, "that of the session"),
      "m, of the maps that export makes of a session");
  add("voxel", po::value(&a.voxel)->default_value(0.0, "all points"),
      "m: export to .pcd writes the mean of the points in each cube with this edge");
  add("without-loops", po::bool_switch(&a.without_loops),
      "export of a session goes along consecutive edges alone, to show what loops are worth");
  auto add_unnamed = unnamed.add_options();
  add_unnamed("command", po::value(&a.command)->required(), "");
  add_unnamed("files", po::value(&a.files)->required()->composing(), "");
  const auto given = mapping_common::parseArguments(argc, argv, kUsage, options, unnamed);
  if (!given) return false;
  a.start = mapping_common::valueOf<Start>((*given)["start"].as<std::string>());
  a.options.method = mapping_common::valueOf<LoopCheck>((*given)["loop-check"].as<std::string>());
  mapping_common::validate(a.options, "--");
  checkFiles(a);
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

void runOnSessions(const Arguments& a) {
  pose_graph::SessionArguments session;
  session.in = a.files.front();
  session.out = a.out;
  session.check = a.options;
  session.resolution = a.resolution;
  session.voxel = a.voxel;
  session.without_loops = a.without_loops;
  if (a.command == "info") pose_graph::printSession(session.in);
  if (a.command == "optimise") pose_graph::optimiseSession(session);
  if (a.command == "export") pose_graph::exportSession(session);
  if (a.command == "merge") pose_graph::mergeSessionFiles(a.files, session);
}

void run(const Arguments& a) {
  std::cout.precision(10);
  std::cerr.precision(10);
  if (a.session || a.command == "merge") return runOnSessions(a);
  const std::string& in = a.files.front();
  pose_graph::G2oFile file = pose_graph::readG2o(in);
  if (a.command == "info") print(file.graph, file.has_poses);
  if (a.command == "export") {
    if (!file.has_poses) throw std::runtime_error(in + " has no poses; 'optimise' gives it some");
    write(a.out, file.graph);
  }
  if (a.command != "optimise") return;
  if (a.start == Start::kPoses && !file.has_poses)
    throw std::runtime_error(in + " has no poses to start from");
  pose_graph::OptimisationResult result;
  if (a.options.method == LoopCheck::kNone) {
    result =
        pose_graph::optimiseFrom(a.start, file.graph, a.options.optimisation, pose_graph::iterationsShown());
  } else {
    pose_graph::startFromOdometry(file.graph);
    const auto checked = pose_graph::optimiseAndCheck(file.graph, a.options, pose_graph::iterationsShown());
    result = checked.optimisation;
    for (const std::size_t e : checked.revoked) {
      const auto& edge = file.graph.edges()[e];
      std::cout << "wrong: " << file.graph.nodes()[edge.from].id << " -> " << file.graph.nodes()[edge.to].id
                << '\n';
    }
  }
  std::cout << "chi2 " << result.initial_chi2 << " -> " << result.chi2 << " in " << result.iterations
            << (result.converged ? " iterations\n" : " iterations; not converged, see --max-iterations\n");
  write(a.out, file.graph);
}

}  // namespace

int main(int argc, char** argv) {
  return mapping_common::runTool(argc, argv, "pose_graph", kUsage, parse, run);
}
