// SPDX-License-Identifier: BSD-3-Clause
//
// Delta pose error and absolute trajectory error of an estimated trajectory.
#include <mapping_common/files.h>
#include <mapping_common/tool.h>
#include <rosbag_tests/converters/bag_trajectory.h>
#include <rosbag_tests/evaluations/trajectory_metrics.h>

#include <boost/program_options.hpp>
#include <iostream>
#include <stdexcept>
#include <string>

namespace po = boost::program_options;
using rosbag_tests::Alignment;

namespace {

const char kUsage[] =
    "Usage: trajectory_error --reference R --estimate E.tum [options]\n"
    "\n"
    "The error of an estimated trajectory: delta pose error between consecutive poses (as in the thesis's "
    "Fig. 3.7) and\n"
    "absolute trajectory error. R is a .tum file, or a bag with the true poses on a topic or in /tf.\n";

struct Arguments {
  std::string reference, estimate, topic, parent = "map", child = "base_link", align = "rigid", json;
  double max_gap = 0.5;
};

/// False if help was asked for and printed. Throws po::error for wrong usage.
bool parse(int argc, char** argv, Arguments& a) {
  po::options_description all("Options");
  auto add = all.add_options();
  add("help,h", "print this");
  add("reference", po::value(&a.reference)->required(), "true poses: .tum, or a bag");
  add("estimate", po::value(&a.estimate)->required(), "estimated poses: .tum");
  add("topic", po::value(&a.topic),
      "of the true poses in the bag: Odometry, PoseStamped, PoseWithCovarianceStamped or TransformStamped; "
      "by "
      "default they come from /tf");
  add("parent", po::value(&a.parent)->default_value(a.parent), "fixed frame of the truth in /tf");
  add("child", po::value(&a.child)->default_value(a.child), "frame of the body in /tf");
  add("align", po::value(&a.align)->default_value(a.align),
      "how the estimate is laid over the reference for the absolute error: none, first (pose) or rigid");
  add("max-gap", po::value(&a.max_gap)->default_value(a.max_gap),
      "the reference is interpolated between poses that are at most so far apart (s)");
  add("json", po::value(&a.json), "write the figures and each pose's error to this file");
  if (!mapping_common::parseArguments(argc, argv, kUsage, all)) return false;
  if (a.align != "none" && a.align != "first" && a.align != "rigid")
    throw po::error("--align must be none, first or rigid");
  if (!(a.max_gap >= 0.0)) throw po::error("--max-gap must not be negative");
  return true;
}

mapping_simulation::Trajectory readReference(const Arguments& a) {
  const std::string& file = a.reference;
  if (file.size() < 4 || file.compare(file.size() - 4, 4, ".bag") != 0)
    return mapping_simulation::loadTrajectory(file);
  return a.topic.empty() ? rosbag_tests::readTransforms(file, a.parent, a.child)
                         : rosbag_tests::readPoseTopic(file, a.topic);
}

void run(const Arguments& a) {
  const mapping_simulation::Trajectory reference = readReference(a),
                                       estimate = mapping_simulation::loadTrajectory(a.estimate);
  const auto delta = rosbag_tests::deltaErrors(reference, estimate, a.max_gap);
  const auto absolute = rosbag_tests::absoluteErrors(reference, estimate, a.max_gap,
                                                     a.align == "none"    ? Alignment::kNone
                                                     : a.align == "first" ? Alignment::kFirst
                                                                          : Alignment::kRigid);
  if (delta.errors.empty())
    throw std::runtime_error(
        "fewer than two poses of the estimate have a reference: are the stamps the same?");
  rosbag_tests::printErrors(std::cout, "delta pose error", delta);
  rosbag_tests::printErrors(std::cout, "absolute trajectory error", absolute);
  if (!a.json.empty()) {
    mapping_common::writeFile(a.json, [&](std::ostream& out) {
      out << "{\"delta\": " << errorsToJson(delta) << ",\n\"absolute\": " << errorsToJson(absolute) << "}\n";
    });
  }
}

}  // namespace

int main(int argc, char** argv) {
  return mapping_common::runTool(argc, argv, "trajectory_error", kUsage, parse, run);
}
