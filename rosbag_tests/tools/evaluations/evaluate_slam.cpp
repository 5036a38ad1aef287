// SPDX-License-Identifier: BSD-3-Clause
//
// How often SLAM loses the map over many simulated drives, and how exact it is, for each cost.
#include <mapping_common/files.h>
#include <mapping_common/progress.h>
#include <mapping_common/tool.h>
#include <rosbag_tests/evaluations/slam_evaluation.h>
#include <rosbag_tests/evaluations/slam_scenario.h>

#include <atomic>
#include <boost/program_options.hpp>
#include <filesystem>
#include <iostream>
#include <mutex>
#include <stdexcept>
#include <string>
#include <thread>
#include <vector>

namespace po = boost::program_options;
using namespace rosbag_tests;

namespace {

const char kUsage[] =
    "Usage: evaluate_slam SCENARIO.yaml [SCENARIO.yaml ...] [options]\n"
    "\n"
    "Simulates random drives (a scenario each: config/slam_evaluation) without odometry and gives each to "
    "SLAM once for\n"
    "each cost: how often is the map lost, how exact are the poses? The map counts as lost where a pose is "
    "more than\n"
    "--lost-distance or --lost-angle from the truth at any time after the start. Only the cost differs.\n"
    "Reflectivities are made of the simulated intensities by the scenario's calibration.\n"
    "\n"
    "The table has, of the drives on which the map wasn't lost, the mean error from scan to scan (delta) and "
    "the "
    "mean\n"
    "and the greatest error of the poses, and the share of errors within 1, 2 and 3 sigma of SLAM's own "
    "covariance\n"
    "and their standard deviation by it, which is 1 where it holds.\n";

struct Arguments {
  std::vector<std::string> scenarios;
  std::vector<std::string> costs = mapping_common::namesOf(intensity_hector_slam::costs());
  std::string out, guess = "constant_velocity", model;
  double reflectivity_scale = 1.0;
  std::uint64_t first_seed = 1;
  int seeds = 10, jobs = 1;
  double duration = 0.0, lost_angle = 10.0;
  LossCriterion criterion;
  intensity_hector_slam::SlamOptions slam;
};

/// False if help was asked for and printed. Throws po::error for wrong usage.
bool parse(int argc, char** argv, Arguments& a) {
  po::options_description visible("Options");
  auto add = visible.add_options();
  add("help,h", "print this");
  add("seeds", po::value(&a.seeds)->default_value(a.seeds), "number of drives for each scenario");
  add("first-seed", po::value(&a.first_seed)->default_value(a.first_seed), "of drive, noise and clutter");
  add("duration", po::value(&a.duration), "s, in place of the scenarios' own");
  add("cost", po::value(&a.costs)->multitoken(),
      "those to compare, see the parameter of that name; by default all");
  add("guess", po::value(&a.guess)->default_value(a.guess),
      "last_pose or constant_velocity: where matching starts");
  add("model", po::value(&a.model),
      "lut (default), range or raw: of the scenarios' calibrations; ideal: the simulator's own f(r, alpha)");
  add("reflectivity-scale", po::value(&a.reflectivity_scale)->default_value(a.reflectivity_scale),
      "factor on the reflectivities, for --model raw");
  add("resolution", po::value(&a.slam.map.resolution)->default_value(a.slam.map.resolution, "0.025"),
      "of the map's finest level (m)");
  add("levels", po::value(&a.slam.map.levels)->default_value(a.slam.map.levels), "of the map");
  add("min-observability",
      po::value(&a.slam.matcher.min_observability)->default_value(a.slam.matcher.min_observability, "0.002"),
      "share of what the normals tell in the best direction, below which occupancy isn't used; with 0 and "
      "--cost occupancy\nit is always, as in Hector SLAM");
  add("lost-distance", po::value(&a.criterion.distance)->default_value(a.criterion.distance), "m");
  add("lost-angle", po::value(&a.lost_angle)->default_value(a.lost_angle), "degrees");
  add("jobs", po::value(&a.jobs)->default_value(a.jobs), "drives at the same time; times per scan need 1");
  add("out", po::value(&a.out),
      "folder for evaluation.json, evaluation.md, and of the first seed the maps (SCENARIO-COST.ppm), the "
      "true "
      "and the estimated ways (.tum), errors (.json) and what was seen from the true way "
      "(SCENARIO-seen.csv); "
      "plot_evaluation.py draws them");
  po::options_description unnamed;
  unnamed.add_options()("scenario", po::value(&a.scenarios)->composing());
  const auto given = mapping_common::parseArguments(argc, argv, kUsage, visible, unnamed);
  if (!given) return false;
  if (a.scenarios.empty()) throw po::error("a SCENARIO.yaml is needed");
  if (a.seeds < 1 || a.jobs < 1) throw po::error("--seeds and --jobs must be at least 1");
  if (given->count("duration") && !(a.duration > 0.0)) throw po::error("--duration must be positive");
  if (!(a.criterion.distance > 0.0 && a.lost_angle > 0.0))
    throw po::error("--lost-distance and --lost-angle must be positive");
  if (!(a.reflectivity_scale > 0.0)) throw po::error("--reflectivity-scale must be positive");
  a.criterion.angle = a.lost_angle * M_PI / 180.0;
  try {
    a.slam.guess = mapping_common::valueOf<intensity_hector_slam::Guess>(a.guess);
    for (const std::string& cost : a.costs) mapping_common::valueOf(intensity_hector_slam::costs(), cost);
    if (!a.model.empty() && a.model != "ideal")
      mapping_common::valueOf<laser_intensity_calib::ModelType>(a.model);
    mapping_common::validate(a.slam);
  } catch (const std::invalid_argument& e) {
    throw po::error(e.what());
  }
  return true;
}

void use(const std::string& model, SlamScenario& scenario) {
  if (model.empty()) return;
  if (model == "ideal") return scenario.calibration.reset();
  scenario.model = mapping_common::valueOf<laser_intensity_calib::ModelType>(model);
  if (!scenario.calibration || !scenario.calibration->has(scenario.model))
    throw std::runtime_error(scenario.name + " has no calibration with the model " + model +
                             "; --model ideal?");
}

/// All drives, some at the same time.
class Evaluation {
 public:
  explicit Evaluation(const Arguments& arguments) : a_(arguments) {
    for (const std::string& file : a_.scenarios) {
      scenarios_.push_back(loadScenario(file));
      use(a_.model, scenarios_.back());
      scenarios_.back().reflectivity_scale = a_.reflectivity_scale;
      if (a_.duration > 0.0) scenarios_.back().duration = a_.duration;
    }
    runs_.resize(scenarios_.size() * a_.seeds * a_.costs.size());
  }

  std::vector<SlamRun> run() {
    std::vector<std::thread> workers;
    for (int i = 0; i < a_.jobs; ++i) workers.emplace_back([this] { work(); });
    for (std::thread& worker : workers) worker.join();
    progress_.say(done_, " of ", runs_.size(), " runs, ", lost_, " lost");
    if (!error_.empty()) throw std::runtime_error(error_);
    return std::move(runs_);
  }

 private:
  void work() {
    try {
      for (std::size_t i = next_++; i < scenarios_.size() * a_.seeds; i = next_++) drive(i);
    } catch (const std::exception& e) {
      const std::lock_guard<std::mutex> lock(mutex_);
      error_ = e.what();
      next_ = runs_.size();
    }
  }

  void drive(std::size_t index) {
    const SlamScenario& scenario = scenarios_[index / a_.seeds];
    const std::uint64_t seed = a_.first_seed + index % a_.seeds;
    const SlamRecording recording = record(scenario, seed);
    for (std::size_t k = 0; k < a_.costs.size(); ++k) {
      intensity_hector_slam::SlamOptions options = a_.slam;
      options.matcher.cost = a_.costs[k];
      intensity_hector_slam::MultiMap map(options.map);
      SlamRun run = runSlam(recording, options, a_.criterion, &map);
      run.scenario = scenario.name;
      run.seed = seed;
      if (!a_.out.empty() && seed == a_.first_seed) save(run, recording, map);
      run.poses.clear();  // of all drives they would fill the memory
      report(run);
      runs_[index * a_.costs.size() + k] = std::move(run);
    }
  }

  void save(const SlamRun& run, const SlamRecording& recording, const intensity_hector_slam::MultiMap& map) {
    const std::string path = a_.out + "/" + run.scenario + "-" + run.cost;
    writeMapPicture(path + ".ppm", map.level(0));
    writeTum(path + ".tum", run.poses);
    mapping_common::writeFile(path + ".json",
                              [&](std::ostream& out) { out << runToJson(run, map.level(0)) << '\n'; });
    writeTum(a_.out + "/" + run.scenario + "-truth.tum", recording.truth);
    writeSeen(a_.out + "/" + run.scenario + "-seen.csv", recording);
  }

  void report(const SlamRun& run) {
    const std::lock_guard<std::mutex> lock(mutex_);
    ++done_;
    lost_ += run.lost();
    progress_.show(done_, " of ", runs_.size(), " runs, ", lost_, " lost");
  }

  const Arguments& a_;
  std::vector<SlamScenario> scenarios_;
  std::vector<SlamRun> runs_;
  std::atomic<std::size_t> next_{0};
  std::mutex mutex_;
  std::string error_;
  std::size_t done_ = 0, lost_ = 0;
  mapping_common::Progress progress_{"evaluate_slam"};
};

void evaluate(const Arguments& a) {
  if (!a.out.empty()) std::filesystem::create_directories(a.out);
  const std::vector<SlamRun> runs = Evaluation(a).run();
  printTable(std::cout, runs);
  if (a.out.empty()) return;
  mapping_common::writeFile(a.out + "/evaluation.json",
                            [&](std::ostream& out) { out << runsToJson(runs) << '\n'; });
  mapping_common::writeFile(a.out + "/evaluation.md", [&](std::ostream& out) { printTable(out, runs); });
}

}  // namespace

int main(int argc, char** argv) {
  return mapping_common::runTool(argc, argv, "evaluate_slam", kUsage, parse, evaluate);
}
