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
#include <optional>
#include <random>
#include <stdexcept>
#include <string>
#include <vector>

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

constexpr double kStep = 0.5, kTurn = 0.5;  // m, rad, from a scan to the next while a robot drives on

struct Arguments {
  BagOptions bag;
  std::string config;
  int count = 200;
  unsigned seed = 1;
  double share = 1.0, travel = 0.0;
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
  add("travel", po::value(&a.travel)->default_value(a.travel),
      "m, that a robot which isn't sure of its place drives on, with a scan each half metre");
  add("verbose", po::bool_switch(&a.verbose), "print each");
  return mapping_common::parseArguments(argc, argv, kUsage, all).has_value();
}

// The next of the scans that is half a metre or half a rad from this, none at the end. @param way to it, m
std::optional<std::size_t> nextPlace(const BagResult& result, const std::vector<std::size_t>& usable,
                                     std::size_t scan, double& way) {
  const auto pose = [&](std::size_t i) { return result.entries[i].result.pose; };
  std::size_t last = scan;
  way = 0.0;
  for (auto i = std::upper_bound(usable.begin(), usable.end(), scan); i != usable.end(); ++i) {
    way += between(pose(last), pose(*i)).head<2>().norm();
    last = *i;
    if (way >= kStep || std::abs(between(pose(scan), pose(*i)).z()) >= kTurn) return *i;
  }
  return std::nullopt;
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
  int right = 0, wrong = 0, unsure = 0, best_right = 0, sought = 0;
  double seconds = 0.0, longest = 0.0, travelled = 0.0;
  for (int i = 0; i < a.count; ++i) {
    std::size_t k = usable[random() % usable.size()];
    for (double travel = 0.0;; ++sought) {
      const auto start = std::chrono::steady_clock::now();
      const Place place = finder.find(map, scans[k]);
      const std::chrono::duration<double> time = std::chrono::steady_clock::now() - start;
      seconds += time.count();
      longest = std::max(longest, time.count());
      const Pose error = between(result.entries[k].result.pose, place.pose);
      const bool is_right = error.head<2>().norm() < 0.3 && std::abs(error.z()) < 5.0 * M_PI / 180.0;
      if (a.verbose || (place.sure && !is_right)) {
        std::cout << k << (is_right ? " right " : " wrong ") << (place.sure ? "sure" : "unsure") << " error "
                  << error.transpose() << " score " << place.score << " rival " << place.rival << ", "
                  << time.count() << " s " << place.why << '\n';
      }
      double way = 0.0;
      const auto next = place.sure ? std::nullopt : nextPlace(result, usable, k, way);
      if (next && travel + way <= a.travel) {
        k = *next;
        travel += way;
        continue;
      }
      ++(place.sure ? (is_right ? right : wrong) : unsure);
      best_right += is_right;
      travelled += travel;
      break;
    }
  }
  sought += a.count;
  std::cout << a.count << " places: " << right << " sure and right, " << wrong << " sure and wrong, "
            << unsure << " unsure; the best place is right for " << best_right << "; " << sought << " scans, "
            << seconds / sought << " s each, " << longest << " s the longest, after " << travelled / a.count
            << " m\n";
}

}  // namespace

int main(int argc, char** argv) {
  return mapping_common::runTool(argc, argv, "evaluate_places", kUsage, parse, run);
}
