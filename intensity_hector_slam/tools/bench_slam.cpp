// SPDX-License-Identifier: BSD-3-Clause
//
// Time per scan of matching and map update: 1,081 beams in a generated room, or a recording.
#include <intensity_hector_slam/ros/bag_runner.h>
#include <mapping_common/tool.h>

#include <algorithm>
#include <boost/program_options.hpp>
#include <cstdio>
#include <ctime>
#include <vector>

#include "../test/flat_world.h"

namespace po = boost::program_options;
using namespace intensity_hector_slam;

namespace {

struct Times {
  std::vector<double> all, matched,
      updated;  // s; of scans that were only matched, and that went into the map

  void add(double seconds, const SlamResult& result) {
    all.push_back(seconds);
    (result.map_updated ? updated : matched).push_back(seconds);
  }
};

// Of the processor, s: what else runs on it doesn't count.
double threadTime() {
  timespec time;
  clock_gettime(CLOCK_THREAD_CPUTIME_ID, &time);
  return static_cast<double>(time.tv_sec) + 1e-9 * static_cast<double>(time.tv_nsec);
}

double quantile(std::vector<double> values, double share) {
  if (values.empty()) return 0.0;
  std::sort(values.begin(), values.end());
  return values[std::min(values.size() - 1, static_cast<std::size_t>(share * values.size()))];
}

void print(const char* name, const std::vector<double>& times) {
  double sum = 0.0;
  for (const double time : times) sum += time;
  std::printf("%-8s %6zu scans: mean %7.3f ms, median %7.3f ms, 95 %% %7.3f ms, longest %7.3f ms\n", name,
              times.size(), times.empty() ? 0.0 : 1e3 * sum / times.size(), 1e3 * quantile(times, 0.5),
              1e3 * quantile(times, 0.95), 1e3 * quantile(times, 1.0));
}

// A drive around in the room, at 0.5 m/s and 40 Hz.
Times runGenerated(const SlamOptions& options, int scans) {
  const std::vector<Wall> walls = furnishedRoom();
  Scanner scanner;
  scanner.range_noise = 0.01;
  scanner.reflectivity_noise = 0.02;
  Slam slam(options);
  Times times;
  for (int i = 0; i < scans; ++i) {
    const double angle = 0.0125 * i / 1.5;
    Scan scan = look(walls, {1.5 * std::sin(angle), -1.5 * std::cos(angle) + 0.3, angle}, scanner, i);
    scan.stamp = 0.025 * i;
    const double start = threadTime();
    const SlamResult result = slam.process(scan);
    times.add(threadTime() - start, result);
  }
  return times;
}

struct Arguments {
  BagOptions bag;
  std::string cost, config;
  int scans = 1000;
};

const char kUsage[] = "Usage: bench_slam [options]\n\nTime per scan of SLAM, one thread.\n";

bool parse(int argc, char** argv, Arguments& a) {
  po::options_description all("Options");
  auto add = all.add_options();
  add("help,h", "print this");
  add("scans", po::value(&a.scans)->default_value(a.scans), "number of scans in the generated room");
  add("bag", po::value(&a.bag.bag), "recording, instead of the generated room");
  add("scan", po::value(&a.bag.scan_topic)->default_value("scan"), "its topic of scans");
  add("odom", po::value(&a.bag.odom_frame), "its frame of odometry; without: none is used");
  const std::string all_costs = mapping_common::Option("cost", a.cost, "", "").oneOf(costs()).allowed();
  add("cost", po::value(&a.cost), (all_costs + "; by default the configuration's").c_str());
  add("config", po::value(&a.config),
      "YAML file with the nodelet's parameters; by default 3 levels of 25 mm");
  return mapping_common::parseArguments(argc, argv, kUsage, all).has_value();
}

void run(const Arguments& a) {
  mapping_common::OptionValues yaml;
  if (!a.config.empty()) yaml = mapping_common::loadYaml(a.config);
  if (!a.cost.empty()) yaml["cost"] = a.cost;
  SlamParameters parameters;
  mapping_common::assign(parameters, yaml);
  parameters.resolve();
  Times times;
  if (a.bag.bag.empty()) {
    times = runGenerated(parameters.slam, a.scans);
  } else {
    for (const auto& entry : runBag(a.bag, parameters).entries) times.add(entry.seconds, entry.result);
  }
  print("all", times.all);
  print("matched", times.matched);
  print("updated", times.updated);
}

}  // namespace

int main(int argc, char** argv) {
  return mapping_common::runTool(argc, argv, "bench_slam", kUsage, parse, run);
}
