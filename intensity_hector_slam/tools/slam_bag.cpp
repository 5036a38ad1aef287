// SPDX-License-Identifier: BSD-3-Clause
//
// SLAM over a recording, offline.
#include <intensity_hector_slam/ros/bag_runner.h>
#include <intensity_hector_slam/ros/result_files.h>
#include <mapping_common/progress.h>
#include <mapping_common/tool.h>

#include <boost/program_options.hpp>
#include <filesystem>
#include <iostream>
#include <optional>
#include <stdexcept>
#include <string>

namespace po = boost::program_options;
using namespace intensity_hector_slam;

namespace {

const char kUsage[] =
    "Usage: slam_bag --bag FILE --scan TOPIC --out DIR [options]\n"
    "\n"
    "Runs SLAM over the laser scans of a bag and writes trajectory.tum, map.pgm, map.yaml, "
    "reflectivity.png,\n"
    "edges.g2o, slam.map and timing.json.\n";

struct Arguments {
  BagOptions bag;
  std::string out, cost, config, base;
  double reflectivity_scale = 0.0;
};

/// False if help was asked for and printed. Throws po::error for wrong usage.
bool parse(int argc, char** argv, Arguments& a) {
  po::options_description all("Options");
  auto add = all.add_options();
  add("help,h", "print this");
  add("bag", po::value(&a.bag.bag)->required(), "recording");
  add("scan", po::value(&a.bag.scan_topic)->required(), "topic of the scans (sensor_msgs/LaserScan)");
  add("odom", po::value(&a.bag.odom_frame), "fixed frame of the odometry in tf, the first guess");
  add("odom-topic", po::value(&a.bag.odom_topic), "odometry of a topic (nav_msgs/Odometry) instead");
  add("base", po::value(&a.base), "frame of the body; by default the configuration's base_frame");
  const std::string all_costs = mapping_common::Option("cost", a.cost, "", "").oneOf(costs()).allowed();
  add("cost", po::value(&a.cost), (all_costs + "; by default the configuration's").c_str());
  add("reflectivity-scale", po::value(&a.reflectivity_scale),
      "factor on intensities; by default the configuration's");
  add("config", po::value(&a.config), "YAML file with the nodelet's parameters");
  add("out", po::value(&a.out)->required(), "folder for the results, made where it isn't there");
  return mapping_common::parseArguments(argc, argv, kUsage, all).has_value();
}

SlamParameters readParameters(const Arguments& a) {
  mapping_common::OptionValues values;
  if (!a.config.empty()) values = mapping_common::loadYaml(a.config);
  if (!a.cost.empty()) values["cost"] = a.cost;
  if (!a.base.empty()) values["base_frame"] = a.base;
  if (a.reflectivity_scale != 0.0) values["reflectivity_scale"] = a.reflectivity_scale;
  SlamParameters parameters;
  mapping_common::assign(parameters, values, {}, "~");
  parameters.resolve();
  return parameters;
}

void run(const Arguments& a) {
  const SlamParameters parameters = readParameters(a);
  std::filesystem::create_directories(a.out);
  std::optional<mapping_common::Progress> progress("slam_bag");
  const BagResult result = runBag(a.bag, parameters, [&progress](double share) {
    progress->show(static_cast<int>(100.0 * share), " %");
  });
  progress.reset();
  for (const auto* faults : {&result.warnings, &result.dropped}) {
    const char* const what = faults == &result.dropped ? " scans are dropped, " : " scans: ";
    for (const auto& [reason, fault] : *faults) {
      std::cerr << "slam_bag: " << fault.count << what << reason << ", the first because " << fault.why
                << '\n';
    }
  }
  if (!result.unused_odometry.empty()) {
    std::cerr << "slam_bag: tf has odometry, " << result.unused_odometry << " -> " << parameters.base_frame
              << ", which isn't used without --odom " << result.unused_odometry << '\n';
  }
  if (result.scanner_is_body) std::cerr << "slam_bag: the scanner is the body, its mounting isn't used\n";

  writeTum(a.out + "/trajectory.tum", result);
  writeG2o(a.out + "/edges.g2o", result.edges);
  writeOccupancy(a.out, result.map.level(0));
  writeReflectivity(a.out + "/reflectivity.png", result.map.level(0));
  writeTiming(a.out + "/timing.json", result);
  result.map.save(a.out + "/slam.map");

  std::map<std::string, std::size_t> counts;
  for (const auto& [reason, fault] : result.dropped) counts[reason] = fault.count;
  double seconds = 0.0;
  for (const auto& entry : result.entries) {
    ++counts[toString(entry.result.status)];
    seconds += entry.seconds;
  }
  std::cerr << "slam_bag: " << result.entries.size() << " scans, "
            << 1e3 * seconds / std::max<std::size_t>(1, result.entries.size()) << " ms each:";
  for (const auto& [name, count] : counts) std::cerr << ' ' << count << ' ' << name;
  std::cerr << " -> " << a.out << '\n';
  if (result.entries.empty()) throw std::runtime_error("not one scan could be used");
  if (counts[toString(Status::kEmpty)] == result.entries.size()) {
    throw std::runtime_error("all scans are empty: fewer than " + std::to_string(parameters.slam.min_points) +
                             " (min_points) of their ranges are returns between laser_min_dist, " +
                             std::to_string(parameters.scan.min_range) + " m, and laser_max_dist, " +
                             std::to_string(parameters.scan.max_range) + " m");
  }
}

}  // namespace

int main(int argc, char** argv) {
  return mapping_common::runTool(argc, argv, "slam_bag", kUsage, parse, run);
}
