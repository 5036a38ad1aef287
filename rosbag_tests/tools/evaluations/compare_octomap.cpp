// SPDX-License-Identifier: BSD-3-Clause
//
// OctoMap and the R-tree occupancy map side by side, on a folder of scans or a bag.
#include <mapping_common/files.h>
#include <mapping_common/progress.h>
#include <mapping_common/tool.h>
#include <rosbag_tests/converters/bag_scans.h>
#include <rosbag_tests/converters/scan_files.h>
#include <rosbag_tests/evaluations/octomap_comparison.h>
#include <rtree_occupancy_map/ros/map_formats.h>

#include <boost/program_options.hpp>
#include <iostream>
#include <limits>
#include <stdexcept>
#include <string>
#include <vector>

namespace po = boost::program_options;
using mapping_common::addOption;
using rtree_occupancy_map::Options;

namespace {

const char kUsage[] =
    "Usage: compare_octomap --scans DIR [--poses FILE] | --bag FILE [--cloud TOPIC] [options]\n"
    "\n"
    "Inserts the same scans into OctoMap and into the R-tree occupancy map, in turn, and compares insertion "
    "time,\n"
    "cells, nodes, access time, memory, and the class of every voxel.\n";

struct Arguments {
  std::string scans, poses, bag, json, save, dump;
  rosbag_tests::BagScansOptions bag_options;
  std::vector<Options> options;
  long first = 0, last = std::numeric_limits<long>::max(), step = 1, write_back_every = 5, dump_every = 100;
};

/// False if help was asked for and printed. Throws po::error or std::invalid_argument for wrong usage.
bool parse(int argc, char** argv, Arguments& a) {
  Options o;
  std::vector<std::string> fusion = {"equal"};
  std::vector<int> max_entries = {o.tree.max_entries};
  int min_entries = 0;
  po::options_description all("Options");
  auto add = all.add_options();
  add("help,h", "print this");
  add("scans", po::value(&a.scans), "scans: NNNN.bin[.xz], PCD, UOS, or an OctoMap .graph file");
  add("poses", po::value(&a.poses), "pose file of .bin scans; by default the one poses*.txt of the folder");
  add("bag", po::value(&a.bag), "ROS 1 bag");
  add("cloud", po::value(&a.bag_options.topic),
      "its PointCloud2 or LaserScan topic; by default the only one");
  add("fixed-frame", po::value(&a.bag_options.fixed_frame)->default_value(a.bag_options.fixed_frame),
      "map frame of its tf");
  add("pose-topic", po::value(&a.bag_options.pose_topic), "poses from this topic in place of tf");
  addOption(all, "resolution", o, "resolution");
  addOption(all, "model", o, "sensor_model/type");
  add("fusion", po::value(&fusion)->multitoken()->default_value(fusion, "equal"),
      "thesis | equal; several are compared in one run");
  addOption(all, "strategy", o, "fusion/strategy");
  addOption(all, "search-order", o, "fusion/search_order");
  add("max-entries", po::value(&max_entries)->multitoken()->default_value(max_entries, "16"),
      "M; several are compared in one run");
  add("min-entries", po::value(&min_entries), "d; by default 0.4 M");
  addOption(all, "split", o, "tree/split");
  addOption(all, "max-range", o, "sensor_model/max_range");
  add("first", po::value(&a.first)->default_value(a.first), "index of the first scan, from 0");
  add("last", po::value(&a.last), "index of the last scan; by default the last there is");
  add("step", po::value(&a.step)->default_value(a.step), "take each N-th scan");
  add("write-back-every", po::value(&a.write_back_every)->default_value(a.write_back_every),
      "bring all cells of the R-tree up to date every N scans, within the measured time");
  o.threads = 1;
  addOption(all, "threads", o, "threads");
  add("dump", po::value(&a.dump),
      "write a CSV file of voxels along the beams with what both maps say of them: x, y, z, state, log odds");
  add("dump-every", po::value(&a.dump_every)->default_value(a.dump_every),
      "of each N-th beam: its end and three voxels on its way, each voxel once");
  add("json", po::value(&a.json), "write the figures to this file");
  add("save", po::value(&a.save), "save the (first) R-tree map to this file: .map, .bt, .ot, .pcd or .pgm");
  const auto given = mapping_common::parseArguments(argc, argv, kUsage, all);
  if (!given) return false;
  if (a.scans.empty() == a.bag.empty()) throw po::error("either --scans or --bag is needed");
  rtree_occupancy_map::formatOf(a.save);
  if (a.step < 1) throw po::error("--step must be at least 1");
  if (a.write_back_every < 1) throw po::error("--write-back-every must be at least 1");
  if (a.dump_every < 1) throw po::error("--dump-every must be at least 1");
  if (a.first < 0 || a.last < a.first) throw po::error("--first must be at least 0, --last at least --first");
  mapping_common::OptionList options = mapping_common::optionsOf(o);
  for (const std::string& rule : fusion) {
    for (const int m : max_entries) {
      options.find("fusion/rule")->set(rule);
      o.tree.max_entries = m;
      o.tree.min_entries = given->count("min-entries") ? min_entries : std::max(1, 2 * m / 5);
      a.options.push_back(mapping_common::validate(o));
    }
  }
  return true;
}

void compare(const Arguments& a) {
  std::unique_ptr<rosbag_tests::ScanSource> source;
  const rosbag_tests::BagScans* bag = nullptr;
  if (a.bag.empty()) {
    source = rosbag_tests::openScans(a.scans, a.poses);
  } else {
    auto bag_source = std::make_unique<rosbag_tests::BagScans>(a.bag, a.bag_options);
    bag = bag_source.get();
    source = std::move(bag_source);
  }
  rosbag_tests::OctomapComparison comparison(a.options, static_cast<std::size_t>(a.write_back_every));
  if (!a.dump.empty()) comparison.probeEvery(static_cast<std::size_t>(a.dump_every));
  mapping_simulation::PosedScan scan;
  std::size_t inserted = 0;
  mapping_common::Progress progress("compare_octomap");
  for (long i = 0; i <= a.last && source->next(scan); ++i) {
    if (i < a.first || (i - a.first) % a.step != 0) continue;
    comparison.insert(scan);
    progress.show("inserted scan ", ++inserted, ", ", i + 1, " of ", source->size());
  }
  progress.say("inserted ", inserted, " scans");
  if (bag != nullptr && bag->withoutPose() + bag->malformed() > 0) {
    std::cerr << "left out: " << bag->withoutPose() << " scans without a pose, " << bag->malformed()
              << " malformed\n";
  }
  if (inserted == 0) throw std::runtime_error("there was no scan to insert");
  progress.say("comparing");
  if (!a.save.empty()) rtree_occupancy_map::writeMap(comparison.map(0), a.save);
  const rosbag_tests::ComparisonResult result = comparison.finish();
  rosbag_tests::printTable(std::cout, result, a.options);
  const auto write = [](const std::string& path, const auto& writeTo) {
    if (!path.empty()) mapping_common::writeFile(path, writeTo);
  };
  write(a.json, [&](std::ostream& out) { rosbag_tests::printJson(out, result, a.options); });
  write(a.dump, [&](std::ostream& out) { comparison.writeProbes(out); });
}

}  // namespace

int main(int argc, char** argv) {
  return mapping_common::runTool(argc, argv, "compare_octomap", kUsage, parse, compare);
}
