// SPDX-License-Identifier: BSD-3-Clause
//
// SLAM over recordings with its loops and a pose graph, at several resolutions, map sizes and with scans left
// out.
#include <intensity_hector_slam/ros/bag_runner.h>
#include <mapping_common/markdown_table.h>
#include <mapping_common/tool.h>
#include <rosbag_tests/evaluations/loop_evaluation.h>
#include <rosbag_tests/evaluations/trajectory_metrics.h>

#include <boost/program_options.hpp>
#include <cstdio>
#include <filesystem>
#include <iostream>
#include <stdexcept>
#include <string>
#include <vector>

namespace po = boost::program_options;
using namespace rosbag_tests;
namespace slam = intensity_hector_slam;

namespace {

const char kUsage[] =
    "Usage: evaluate_slam_loops --bag FILE --scan TOPIC (--relations FILE [--stamps FILE] | --reference "
    "FILE) "
    "[options]\n"
    "\n"
    "Runs SLAM over a recording, puts key poses, edges and loops into a pose graph, and tells how far the "
    "poses are\n"
    "from the truth before and after: by relations, or over the whole way by a reference. Rows are all of "
    "the\n"
    "resolutions, map sizes and numbers of scans that are left out.\n";

struct Arguments {
  slam::BagOptions bag;
  std::string config, relations, stamps, reference;
  std::vector<double> resolutions = {0.025, 0.05};
  std::vector<int> sizes = {1024}, every = {1};
  bool verbose = false;
};

bool parse(int argc, char** argv, Arguments& a) {
  po::options_description all("Options");
  auto add = all.add_options();
  add("help,h", "print this");
  add("bag", po::value(&a.bag.bag)->required(), "recording");
  add("scan", po::value(&a.bag.scan_topic)->required(), "topic of the scans (sensor_msgs/LaserScan)");
  add("odom", po::value(&a.bag.odom_frame), "fixed frame of the odometry in tf");
  add("config", po::value(&a.config), "YAML file with the nodelet's parameters");
  add("relations", po::value(&a.relations), "lines: from to x y z roll pitch yaw (s, m, rad)");
  add("stamps", po::value(&a.stamps), "stamps that carmen_to_bag changed, for the relations");
  add("reference", po::value(&a.reference), "true poses, TUM format (.tum)");
  add("resolutions", po::value(&a.resolutions)->multitoken(), "of the map (m); by default 0.025 and 0.05");
  add("map-sizes", po::value(&a.sizes)->multitoken(), "cells at the start; by default 1024");
  add("every", po::value(&a.every)->multitoken(), "uses each n-th scan alone; by default 1");
  add("verbose", po::bool_switch(&a.verbose), "print each loop");
  if (!mapping_common::parseArguments(argc, argv, kUsage, all)) return false;
  if (a.relations.empty() && a.reference.empty()) throw po::error("--relations or --reference is needed");
  for (const int every : a.every)
    if (every < 1) throw po::error("--every must be at least 1");
  return true;
}

std::string number(const char* format, double value) {
  char text[40];
  std::snprintf(text, sizeof(text), format, value);
  return text;
}

class Evaluation {
 public:
  explicit Evaluation(const Arguments& a) : a_(a) {
    if (!a.config.empty()) mapping_common::assign(parameters_, mapping_common::loadYaml(a.config), {}, "~");
    parameters_.resolve();
    if (!a.relations.empty()) relations_ = readRelations(a.relations);
    if (!a.stamps.empty()) stamps_ = StampMap(a.stamps);
    if (!a.reference.empty()) reference_ = mapping_simulation::loadTrajectory(a.reference);
  }

  std::vector<std::string> row(double resolution, int size, int every) const {
    slam::SlamParameters parameters = parameters_;
    parameters.slam.map.resolution = resolution;
    parameters.slam.map.size = size;
    mapping_common::validate(parameters);
    slam::BagOptions bag = a_.bag;
    bag.every = every;
    const slam::BagResult result = slam::runBag(bag, parameters);
    const CorrectedRun run = correct(result);
    double seconds = 0.0;
    std::size_t rejected = 0;
    for (const auto& entry : result.entries) {
      seconds += entry.seconds;
      rejected += entry.result.status == slam::Status::kRejected;
    }
    std::size_t accepted = 0;
    for (const bool loop : run.accepted) accepted += loop;
    if (a_.verbose) print(run);
    std::string wrong = "-";
    if (reference_) {
      const auto [among_accepted, among_all] = wrongLoops(run, *reference_, 0.5, 10.0 * M_PI / 180.0);
      wrong = std::to_string(among_accepted) + " / " + std::to_string(among_all);
    }
    return {std::filesystem::path(bag.bag).stem().string(),
            number("%g", resolution),
            std::to_string(size),
            std::to_string(every),
            std::to_string(rejected),
            std::to_string(accepted) + " / " + std::to_string(run.loops.size()),
            wrong,
            errors(run.front_end),
            errors(run.corrected),
            number("%.2f", 1e3 * seconds / std::max<std::size_t>(1, result.entries.size())),
            number("%.1f", 1e3 * result.loop_seconds / std::max<std::size_t>(1, result.loops.key_poses)),
            number("%.0f", 1e3 * result.longest_loop_seconds)};
  }

 private:
  // Mean and greatest.
  std::string errors(const std::vector<mapping_simulation::TimedPose>& poses) const {
    const mapping_simulation::Trajectory trajectory(poses);
    const PoseErrors errors = relations_.empty()
                                  ? absoluteErrors(*reference_, trajectory, 0.5, Alignment::kRigid)
                                  : relationErrors(trajectory, relations_, 0.5, stamps_);
    if (errors.errors.empty()) throw std::runtime_error("no pose has a reference: are the stamps the same?");
    return number("%.3f", errors.translation().mean) + " (" + number("%.2f", errors.translation().max) + ")";
  }

  void print(const CorrectedRun& run) const {
    for (std::size_t i = 0; i < run.loops.size(); ++i) {
      const slam::Edge& loop = run.loops[i];
      const slam::Pose moved = slam::between(loop.transform, slam::between(loop.from.pose, loop.to.pose));
      std::cerr << loop.from.id << " -> " << loop.to.id << (run.accepted[i] ? "" : " REVOKED")
                << ", similarity " << loop.similarity << ", off the front end by " << moved.transpose();
      if (reference_) {
        CorrectedRun one;
        one.loops = {loop};
        one.accepted = {true};
        if (wrongLoops(one, *reference_, 0.5, 10.0 * M_PI / 180.0).second > 0) std::cerr << " WRONG";
      }
      std::cerr << '\n';
    }
  }

  const Arguments& a_;
  slam::SlamParameters parameters_;
  std::vector<Relation> relations_;
  StampMap stamps_;
  std::optional<mapping_simulation::Trajectory> reference_;
};

void run(const Arguments& a) {
  const Evaluation evaluation(a);
  std::vector<std::vector<std::string>> table = {
      {"recording", "cell (m)", "map size", "every", "rejected", "loops kept / found", "wrong",
       "front end (m)", "with loops (m)", "ms per scan", "ms per key pose", "longest (ms)"}};
  for (const int every : a.every)
    for (const double resolution : a.resolutions)
      for (const int size : a.sizes) table.push_back(evaluation.row(resolution, size, every));
  std::cout << mapping_common::markdownTable(table, 1);
}

}  // namespace

int main(int argc, char** argv) {
  return mapping_common::runTool(argc, argv, "evaluate_slam_loops", kUsage, parse, run);
}
