// SPDX-License-Identifier: BSD-3-Clause
//
// How well a trajectory keeps manually verified relations between poses.
#include <mapping_common/files.h>
#include <mapping_common/tool.h>
#include <rosbag_tests/evaluations/trajectory_metrics.h>

#include <boost/program_options.hpp>
#include <iostream>
#include <stdexcept>
#include <string>

namespace po = boost::program_options;

namespace {

const char kUsage[] =
    "Usage: relations_metric --trajectory T.tum --relations F.relations [options]\n"
    "\n"
    "The metric of Kuemmerle et al., \"On Measuring the Accuracy of SLAM Algorithms\" (Autonomous Robots, "
    "2009):\n"
    "mean and standard deviation, over all relations, of the absolute and squared error of the trajectory's "
    "relative\n"
    "poses, for translation and rotation.\n";

struct Arguments {
  std::string trajectory, relations, stamps, json;
  double max_gap = 0.5;
};

/// False if help was asked for and printed. Throws po::error for wrong usage.
bool parse(int argc, char** argv, Arguments& a) {
  po::options_description all("Options");
  auto add = all.add_options();
  add("help,h", "print this");
  add("trajectory", po::value(&a.trajectory)->required(), "poses of the robot, TUM format (.tum)");
  add("relations", po::value(&a.relations)->required(), "lines: from to x y z roll pitch yaw (s, m, rad)");
  add("stamps", po::value(&a.stamps),
      "stamps that carmen_to_bag changed: lines of stamp and original, which is what the relations have");
  add("max-gap", po::value(&a.max_gap)->default_value(a.max_gap),
      "a pose is interpolated between two that are at most so far apart (s)");
  add("json", po::value(&a.json), "write the figures and each relation's error to this file");
  if (!mapping_common::parseArguments(argc, argv, kUsage, all)) return false;
  if (!(a.max_gap >= 0.0)) throw po::error("--max-gap must not be negative");
  return true;
}

void run(const Arguments& a) {
  const auto errors = rosbag_tests::relationErrors(
      mapping_simulation::loadTrajectory(a.trajectory), rosbag_tests::readRelations(a.relations), a.max_gap,
      a.stamps.empty() ? rosbag_tests::StampMap() : rosbag_tests::StampMap(a.stamps));
  if (errors.errors.empty())
    throw std::runtime_error(
        "none of the relations has its two poses in the trajectory: are the stamps the same?");
  rosbag_tests::printErrors(std::cout, "relations", errors);
  if (!a.json.empty()) {
    mapping_common::writeFile(
        a.json, [&](std::ostream& out) { out << "{\"relations\": " << errorsToJson(errors) << "}\n"; });
  }
}

}  // namespace

int main(int argc, char** argv) {
  return mapping_common::runTool(argc, argv, "relations_metric", kUsage, parse, run);
}
