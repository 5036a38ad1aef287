// SPDX-License-Identifier: BSD-3-Clause
//
// What a graph that grows costs: each consecutive edge, and each loop.
#include <mapping_common/markdown_table.h>
#include <mapping_common/tool.h>

#include <boost/program_options.hpp>
#include <cmath>
#include <ctime>
#include <iomanip>
#include <iostream>
#include <random>
#include <sstream>
#include <string>
#include <utility>
#include <vector>

#include "pose_graph/online_graph.h"

namespace po = boost::program_options;

namespace {

using namespace pose_graph;

const char kUsage[] =
    "Usage: pose_graph_benchmark [options]\n"
    "\n"
    "Drives rounds of 500 m in the plane, half a metre from one key pose to the next, and prints processor "
    "time as a\n"
    "table: of a consecutive edge; of what a loop takes in the background, the last ones of a graph of that "
    "size; and of\n"
    "the copy before and the merging after it, which edges wait for.\n";

struct Arguments {
  std::vector<int> poses;
  int loop_every = 20, measured = 20;
};

bool parse(int argc, char** argv, Arguments& a) {
  po::options_description options("Options");
  auto add = options.add_options();
  add("help,h", "print this");
  add("poses", po::value(&a.poses)->multitoken()->default_value({1000, 10000, 100000}, "1000 10000 100000"),
      "sizes of graphs");
  add("loop-every", po::value(&a.loop_every)->default_value(a.loop_every),
      "key poses from one loop to the next, from the second round on");
  add("measured", po::value(&a.measured)->default_value(a.measured), "loops that are timed one by one");
  if (!mapping_common::parseArguments(argc, argv, kUsage, options)) return false;
  for (const int poses : a.poses)
    if (poses < 100) throw po::error("--poses must be 100 at least");
  if (a.loop_every < 1 || a.measured < 1) throw po::error("--loop-every and --measured must be 1 at least");
  return true;
}

class Stopwatch {
 public:
  double seconds() const { return static_cast<double>(std::clock() - start_) / CLOCKS_PER_SEC; }

 private:
  std::clock_t start_ = std::clock();
};

std::string text(double value, int digits) {
  std::ostringstream out;
  out << std::fixed << std::setprecision(digits) << value;
  return out.str();
}

class Drive {
 public:
  explicit Drive(int poses) : per_round_(std::min(1000, poses / 2)), poses_(poses) {}

  int perRound() const { return per_round_; }
  Measurement step(int to) { return measure(to - 1, to, EdgeType::kConsecutive, 0.002, 0.0005); }
  Measurement loop(int to) {
    return measure(to - per_round_ * std::uniform_int_distribution<>(1, to / per_round_)(random_), to,
                   EdgeType::kLoopClosure, 0.02, 0.005);
  }

 private:
  Pose truth(int pose) const {
    const double angle = 2.0 * M_PI * pose / per_round_, radius = per_round_ / 4.0 / M_PI;
    return planarPose(radius * std::cos(angle), radius * std::sin(angle), angle + M_PI / 2.0);
  }
  Measurement measure(int from, int to, EdgeType type, double metres, double rad) {
    const auto error = [&](double sigma) { return std::normal_distribution<>(0.0, sigma)(random_); };
    const double dx = error(metres), dy = error(metres), turn = error(rad);
    Measurement m;
    m.from_stamp = (from + 1) * 1'000'000'000LL;
    m.to_stamp = (to + 1) * 1'000'000'000LL;
    m.type = type;
    m.transform = truth(from).inverse() * truth(to) * planarPose(dx, dy, turn);
    m.information.diagonal().head<3>().setConstant(1.0 / (metres * metres));
    m.information.diagonal().tail<3>().setConstant(1.0 / (rad * rad));
    m.source = type == EdgeType::kConsecutive ? "edges" : "loops";
    return m;
  }
  int per_round_, poses_;
  std::mt19937 random_{1};
};

std::vector<std::string> measure(int poses, const Arguments& a) {
  OnlineGraph graph;
  Drive drive(poses);
  double growing = 0.0, solving = 0.0, longest = 0.0, waiting = 0.0;
  int steps = 0, loops = 0, since = 0;
  const auto optimise = [&](bool measured) {
    const Stopwatch copying;
    auto task = graph.begin();
    double waited = copying.seconds();
    const Stopwatch running;
    task->run();
    const double ran = running.seconds();
    const Stopwatch merging;
    graph.finish(std::move(*task));
    waited += merging.seconds();
    if (!measured) return;
    solving += ran;
    longest = std::max(longest, ran);
    waiting += waited;
  };
  const int last_loops = std::max(poses - a.measured * a.loop_every, poses / 2);
  int measured = 0;
  for (int i = 1; i < poses; ++i) {
    const Measurement step = drive.step(i);
    const Stopwatch stopwatch;
    graph.add(step);
    growing += stopwatch.seconds();
    ++steps;
    if (i < drive.perRound() || i % a.loop_every != 0) continue;
    graph.add(drive.loop(i));
    ++loops;
    if (i < last_loops) {
      // Many at once, so that large graphs don't take hours.
      if (++since >= std::max(10, poses / a.loop_every / 20)) optimise(false), since = 0;
    } else {
      optimise(measured > 0 || since == 0);
      ++measured;
    }
  }
  measured = std::max(1, measured - (since == 0 ? 0 : 1));
  const auto counts = graph.countsOfLoops();
  return {std::to_string(poses),
          std::to_string(loops),
          std::to_string(counts[static_cast<std::size_t>(EdgeState::kAccepted)]),
          text(1e6 * growing / steps, 1),
          text(1e3 * solving / measured, 1),
          text(1e3 * longest, 1),
          text(1e3 * waiting / measured, 2)};
}

void run(const Arguments& a) {
  std::vector<std::vector<std::string>> rows = {{"poses", "loops", "accepted", "consecutive edge (µs)",
                                                 "loop (ms)", "longest", "copied and merged (ms)"}};
  for (const int poses : a.poses) rows.push_back(measure(poses, a));
  std::cout << mapping_common::markdownTable(rows, 0);
}

}  // namespace

int main(int argc, char** argv) {
  return mapping_common::runTool(argc, argv, "pose_graph_benchmark", kUsage, parse, run);
}
