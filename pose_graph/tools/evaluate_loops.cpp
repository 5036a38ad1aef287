// SPDX-License-Identifier: BSD-3-Clause
//
// How well wrong loops are found: false ones are added to a graph, and what is made of it is compared with
// the optimum without them.
#include <mapping_common/markdown_table.h>
#include <mapping_common/progress.h>
#include <mapping_common/tool.h>

#include <algorithm>
#include <boost/program_options.hpp>
#include <ctime>
#include <filesystem>
#include <iomanip>
#include <iostream>
#include <random>
#include <sstream>
#include <string>
#include <vector>

#include "pose_graph/g2o_file.h"
#include "pose_graph/initialisation.h"
#include "pose_graph/loop_check.h"
#include "pose_graph/online_graph.h"

namespace po = boost::program_options;

namespace {

using namespace pose_graph;

const char kUsage[] =
    "Usage: evaluate_loops GRAPH.g2o... [options]\n"
    "\n"
    "Adds false loops to pose graphs and prints how far each way to find them is from the optimum without "
    "any (mean\n"
    "distance of positions, m), precision and recall of the loops it keeps, and processor time, as a "
    "table.\n";

const char kOnline[] = "online";

struct Arguments {
  std::vector<std::string> graphs, methods;
  std::vector<double> shares;
  int seeds = 3, group = 1, batch = 10;
  LoopCheckOptions options;
};

bool parse(int argc, char** argv, Arguments& a) {
  po::options_description options("Options"), unnamed;
  auto add = options.add_options();
  add("help,h", "print this");
  add("share", po::value(&a.shares)->multitoken()->default_value({0.1, 0.3, 0.5}, "0.1 0.3 0.5"),
      "of all loops that is false, in [0, 1)");
  add("group", po::value(&a.group)->default_value(a.group), "so many false loops agree with each other");
  add("seeds", po::value(&a.seeds)->default_value(a.seeds), "runs with other false loops");
  add("method",
      po::value(&a.methods)
          ->multitoken()
          ->default_value({"none", "growth", "pcm", "gnc", "dcs", "online"}, "all"),
      "none | growth | pcm | gnc | dcs: all at once; online: as they come while driving");
  add("batch", po::value(&a.batch)->default_value(a.batch), "online: poses between optimisations");
  add("confidence", po::value(&a.options.confidence)->default_value(a.options.confidence),
      "share of right loops that is accepted");
  auto add_unnamed = unnamed.add_options();
  add_unnamed("graph", po::value(&a.graphs)->required()->composing(), "");
  const auto given = mapping_common::parseArguments(argc, argv, kUsage, options, unnamed);
  if (!given) return false;
  for (const double share : a.shares)
    if (!(share >= 0.0 && share < 1.0)) throw po::error("--share must be in [0, 1)");
  if (a.group < 1 || a.seeds < 1) throw po::error("--group and --seeds must be 1 at least");
  if (a.batch < 1) throw po::error("--batch must be 1 at least");
  for (const std::string& method : a.methods)
    if (method != kOnline) mapping_common::valueOf<LoopCheck>(method);
  mapping_common::validate(a.options, "--");
  return true;
}

/// Adds loops until `share` of all is false: in groups, each with a transform and an information of some true
/// loop, and consistent with the optimum along the trajectory.
void addFalseLoops(Graph& graph, const Graph& optimum, double share, int group, double threshold,
                   unsigned seed) {
  std::vector<Edge> loops;
  for (const Edge& edge : graph.edges())
    if (edge.type != EdgeType::kConsecutive) loops.push_back(edge);
  std::mt19937 random(seed);
  const auto any = [&](std::size_t n) {
    return std::uniform_int_distribution<std::size_t>(0, n - 1)(random);
  };
  const auto& nodes = optimum.nodes();
  std::size_t missing = static_cast<std::size_t>(share / (1.0 - share) * loops.size() + 0.5);
  while (missing > 0) {
    Edge edge = loops[any(loops.size())];
    const std::size_t count = std::min<std::size_t>(missing, group);
    const std::size_t from = any(nodes.size() - count), to = any(nodes.size() - count);
    if (from < to + 2 * count && to < from + 2 * count) continue;
    // Where the map would have to be, seen from `to`, for the first to be true.
    const Pose shift = nodes[from].pose * edge.transform * nodes[to].pose.inverse();
    std::vector<Edge> added;
    for (std::size_t k = 0; k < count; ++k) {
      edge.from = from + k, edge.to = to + k;
      edge.transform = nodes[edge.from].pose.inverse() * shift * nodes[edge.to].pose;
      edge.type = EdgeType::kLoopClosure;
      const Vector6 error = errorOf(edge, nodes[edge.from].pose, nodes[edge.to].pose, graph.planar());
      if (error.dot(edge.information * error) > 10.0 * threshold) added.push_back(edge);
    }
    if (added.size() < count) continue;  // true by chance
    for (const Edge& e : added) graph.addEdge(e);
    missing -= count;
  }
}

/// As a robot gets them: loops come with the later of their poses, and are tried after each `batch` poses.
void checkOnline(Graph& graph, const Arguments& a) {
  OnlineOptions options;
  options.planar = graph.planar();
  options.confidence = a.options.confidence;
  OnlineGraph online(options);
  std::vector<std::vector<std::size_t>> ending(graph.nodes().size());
  for (std::size_t e = 0; e < graph.edges().size(); ++e)
    ending[std::max(graph.edges()[e].from, graph.edges()[e].to)].push_back(e);
  std::vector<std::size_t> order;
  const auto stamp = [](std::size_t node) { return static_cast<std::int64_t>(node + 1) * 1'000'000'000; };
  const auto optimise = [&](bool all) {
    auto task = online.begin(all);
    if (!task) return;
    task->run();
    online.finish(std::move(*task));
  };
  for (std::size_t i = 0; i < graph.nodes().size(); ++i) {
    std::stable_sort(ending[i].begin(), ending[i].end(), [&](std::size_t x, std::size_t y) {
      return graph.edges()[x].type < graph.edges()[y].type;
    });
    for (const std::size_t e : ending[i]) {
      const Edge& edge = graph.edges()[e];
      const bool chain = edge.type == EdgeType::kConsecutive;
      online.add({stamp(edge.from), stamp(edge.to), edge.type, edge.transform, edge.information,
                  chain ? "edges" : "loops " + std::to_string(e), false});
      order.push_back(e);
    }
    if (i % a.batch == 0) optimise(false);
  }
  optimise(false);
  for (std::size_t i = 0; i < order.size(); ++i) graph.setActive(order[i], online.graph().edges()[i].active);
  const Pose shift = graph.nodes()[0].pose * online.graph().nodes()[0].pose.inverse();
  for (std::size_t i = 0; i < graph.nodes().size(); ++i)
    graph.setPose(i, shift * online.graph().nodes()[*online.find(stamp(i))].pose);
}

void run(const Arguments& a) {
  std::vector<std::vector<std::string>> rows = {
      {"graph", "method", "false", "mean error (m)", "worst", "precision", "recall", "time (s)"}};
  const auto text = [](double value, int digits) {
    std::ostringstream out;
    out << std::fixed << std::setprecision(digits) << value;
    return out.str();
  };
  mapping_common::Progress progress("evaluate_loops");
  for (const std::string& path : a.graphs) {
    Graph graph = readG2o(path).graph, optimum = graph;
    optimiseFrom(Start::kBest, optimum);
    startFromOdometry(graph);
    const std::size_t true_edges = graph.edges().size();
    const std::string name = std::filesystem::path(path).stem().string();
    for (const double share : a.shares)
      for (const std::string& method : a.methods) {
        double sum = 0.0, worst = 0.0, seconds = 0.0;
        std::size_t right = 0, wrong = 0, all = 0;
        for (int seed = 1; seed <= a.seeds; ++seed) {
          progress.show(name, ' ', share, ' ', method, ' ', seed);
          Graph tried = graph;
          LoopCheckOptions options = a.options;
          if (method != kOnline) options.method = mapping_common::valueOf<LoopCheck>(method);
          addFalseLoops(tried, optimum, share, a.group, options.threshold(graph.dimension()), seed);
          const std::clock_t start = std::clock();
          if (method == kOnline)
            checkOnline(tried, a);
          else
            optimiseAndCheck(tried, options);
          seconds += static_cast<double>(std::clock() - start) / CLOCKS_PER_SEC;
          double error = 0.0;
          for (std::size_t i = 0; i < tried.nodes().size(); ++i)
            error += (tried.nodes()[i].pose.translation - optimum.nodes()[i].pose.translation).norm();
          error /= tried.nodes().size();
          sum += error;
          worst = std::max(worst, error);
          for (std::size_t e = 0; e < tried.edges().size(); ++e) {
            const Edge& edge = tried.edges()[e];
            if (edge.type == EdgeType::kConsecutive) continue;
            all += e < true_edges ? 1 : 0;
            if (edge.active) ++(e < true_edges ? right : wrong);
          }
        }
        rows.push_back({name, method, text(100.0 * share, 0) + " %", text(sum / a.seeds, 4), text(worst, 4),
                        text(right + wrong == 0 ? 1.0 : static_cast<double>(right) / (right + wrong), 4),
                        text(static_cast<double>(right) / std::max<std::size_t>(all, 1), 4),
                        text(seconds / a.seeds, 2)});
      }
  }
  progress.say(rows.size() - 1, " rows");
  std::cout << mapping_common::markdownTable(rows, 2);
}

}  // namespace

int main(int argc, char** argv) {
  return mapping_common::runTool(argc, argv, "evaluate_loops", kUsage, parse, run);
}
