// SPDX-License-Identifier: BSD-3-Clause
//
// How often scans of a recording are found again in a map, without a first guess.
#include <intensity_hector_slam/place_finder.h>
#include <intensity_hector_slam/ros/bag_runner.h>
#include <intensity_hector_slam/ros/parameters.h>
#include <mapping_common/tool.h>

#include <algorithm>
#include <boost/program_options.hpp>
#include <chrono>
#include <fstream>
#include <iostream>
#include <random>
#include <stdexcept>
#include <string>

namespace po = boost::program_options;
using namespace intensity_hector_slam;

namespace {

const char kUsage[] =
    "Usage: evaluate_places --bag FILE --scan TOPIC [options]\n"
    "\n"
    "Runs SLAM over a bag, or takes a map and where it was driven through, and then seeks scans at random in "
    "all of\n"
    "the map: right are places within 0.3 m and 5 degrees of SLAM's own pose, wrong are sure ones "
    "elsewhere.\n";

struct Arguments {
  BagOptions bag;
  std::string config;
  int count = 200;
  unsigned seed = 1;
  double share = 1.0;
  bool verbose = false;
};

bool parse(int argc, char** argv, Arguments& a) {
  po::options_description all("Options");
  auto add = all.add_options();
  add("help,h", "print this");
  add("bag", po::value(&a.bag.bag)->required(), "recording");
  add("scan", po::value(&a.bag.scan_topic)->required(), "topic of the scans (sensor_msgs/LaserScan)");
  add("odom", po::value(&a.bag.odom_frame), "fixed frame of the odometry in tf, for SLAM");
  add("config", po::value(&a.config), "YAML file with the nodelet's parameters");
  add("count", po::value(&a.count)->default_value(a.count), "of scans that are sought");
  add("seed", po::value(&a.seed)->default_value(a.seed), "of the choice of scans");
  add("share", po::value(&a.share)->default_value(a.share),
      "of the recording that the map is made of, from its beginning; with less than 1 the scans that are "
      "sought come from the rest, and many of them are nowhere in the map");
  add("verbose", po::bool_switch(&a.verbose), "print each");
  return mapping_common::parseArguments(argc, argv, kUsage, all).has_value();
}

void run(const Arguments& a) {
  SlamParameters parameters;
  if (!a.config.empty()) mapping_common::assign(parameters, mapping_common::loadYaml(a.config), {}, "~");
  parameters.resolve();
  std::vector<Scan> scans;
  const BagResult result =
      runBag(a.bag, parameters, {}, [&scans](const Scan& scan) { scans.push_back(scan); });
  std::vector<std::size_t> usable;
  for (std::size_t i = 0; i < scans.size(); ++i) {
    const Status status = result.entries[i].result.status;
    if (status == Status::kMatched || status == Status::kUnobservable) usable.push_back(i);
  }
  // Where scans go into a map, it is made anew of the first.
  MultiMap first(parameters.slam.map);
  const auto last = static_cast<std::size_t>(a.share * scans.size());
  for (std::size_t i = 0; i < last; ++i)
    if (result.entries[i].result.map_updated) first.update(scans[i], result.entries[i].result.pose);
  const MultiMap& map = a.share < 1.0 ? first : result.map;
  if (a.share < 1.0) usable.erase(usable.begin(), std::lower_bound(usable.begin(), usable.end(), last));
  if (usable.empty()) throw std::runtime_error("not one scan was matched");
  PlaceFinder finder(parameters.slam.place, parameters.slam.matcher);
  finder.find(map, scans[usable.front()]);  // prepares the map
  std::mt19937 random(a.seed);
  int right = 0, wrong = 0, unsure = 0, best_right = 0;
  double seconds = 0.0, longest = 0.0;
  for (int i = 0; i < a.count; ++i) {
    const std::size_t k = usable[random() % usable.size()];
    const auto start = std::chrono::steady_clock::now();
    const Place place = finder.find(map, scans[k]);
    const std::chrono::duration<double> time = std::chrono::steady_clock::now() - start;
    seconds += time.count();
    longest = std::max(longest, time.count());
    const Pose error = between(result.entries[k].result.pose, place.pose);
    const bool is_right = error.head<2>().norm() < 0.3 && std::abs(error.z()) < 5.0 * M_PI / 180.0;
    ++(place.sure ? (is_right ? right : wrong) : unsure);
    best_right += is_right;
    if (a.verbose || (place.sure && !is_right)) {
      std::cout << k << (is_right ? " right " : " wrong ") << (place.sure ? "sure" : "unsure") << " error "
                << error.transpose() << " score " << place.score << " rival " << place.rival << ", "
                << time.count() << " s " << place.why << '\n';
    }
  }
  std::cout << a.count << " scans: " << right << " sure and right, " << wrong << " sure and wrong, " << unsure
            << " unsure; the best place is right for " << best_right << "; " << seconds / a.count
            << " s each, " << longest << " s the longest\n";
}

}  // namespace

int main(int argc, char** argv) {
  return mapping_common::runTool(argc, argv, "evaluate_places", kUsage, parse, run);
}
