// SPDX-License-Identifier: BSD-3-Clause
//
// Files of maps: from one format, resolution and frame to another, and two into one.
#include <mapping_common/tool.h>
#include <rtree_occupancy_map/map_transform.h>
#include <rtree_occupancy_map/ros/map_formats.h>

#include <algorithm>
#include <boost/program_options.hpp>
#include <cmath>
#include <cstdlib>
#include <iostream>
#include <string>
#include <vector>

namespace po = boost::program_options;
using namespace rtree_occupancy_map;

namespace {

const char kUsage[] =
    "Usage: rtree_map info FILE\n"
    "       rtree_map convert IN OUT [options]\n"
    "       rtree_map merge A B [--transform X Y Z ROLL PITCH YAW] OUT [options]\n"
    "\n"
    "Files by their endings: .map or none (the R-tree map), .db (the same as a store, read block by block), "
    ".bt\n"
    "and .ot (OctoMap); to be written alone, .pcd (points at the occupied voxels), .pgm or .yaml (seen from\n"
    "above, both, for map_server).\n";

struct Arguments {
  std::string in, other, out;  // other: merged with `in`, empty if nothing is; out: empty for info
  Eigen::Isometry3d transform = Eigen::Isometry3d::Identity();
  double resolution = 0.0;  // m; 0: that of `in`
  DisplayOptions projection;
};

// Takes `--transform` and its numbers out, of which Boost would take negative ones for options.
Eigen::Isometry3d takeTransform(std::vector<std::string>& words) {
  const auto flag = std::find(words.begin(), words.end(), "--transform");
  Eigen::Isometry3d transform = Eigen::Isometry3d::Identity();
  if (flag == words.end()) return transform;
  double v[6] = {};
  for (int i = 0; i < 6; ++i) {
    if (words.end() - flag <= i + 1) throw po::error("--transform has less than six numbers");
    const std::string& word = flag[i + 1];
    char* end = nullptr;
    v[i] = std::strtod(word.c_str(), &end);
    if (word.empty() || *end != '\0' || !std::isfinite(v[i]))
      throw po::error("--transform has '" + word + "', expected are six numbers: X Y Z ROLL PITCH YAW");
  }
  words.erase(flag, flag + 7);
  using Eigen::AngleAxisd, Eigen::Vector3d;
  transform.linear() = (AngleAxisd(v[5], Vector3d::UnitZ()) * AngleAxisd(v[4], Vector3d::UnitY()) *
                        AngleAxisd(v[3], Vector3d::UnitX()))
                           .toRotationMatrix();
  transform.translation() = Vector3d(v[0], v[1], v[2]);
  return transform;
}

bool parse(int argc, char** argv, Arguments& a) {
  a.projection.occupancy_max_size = 20000;
  Options map;
  po::options_description visible("Options"), unnamed;
  auto add = visible.add_options();
  add("help,h", "print this");
  add("resolution", po::value(&a.resolution),
      "m, of OUT; by default that of IN or A. A larger voxel is as occupied as the most occupied of its "
      "parts");
  add("transform", po::value<std::string>(),
      "pose of B in A's frame: m, and rad about the fixed axes x, y, z (as static_transform_publisher)");
  mapping_common::addOption(visible, "min_z", a.projection, "occupancy_min_z");
  mapping_common::addOption(visible, "max_z", a.projection, "occupancy_max_z");
  mapping_common::addOption(visible, "max_size", a.projection, "occupancy_max_size");
  std::vector<std::string> words(argv + 1, argv + argc), files;
  a.transform = takeTransform(words);
  const bool has_transform = static_cast<int>(words.size()) + 1 < argc;
  unnamed.add_options()("files", po::value(&files)->composing());
  const auto given = mapping_common::parseArguments(words, kUsage, visible, unnamed);
  if (!given) return false;
  mapping_common::validate(a.projection, "--");
  if (given->count("resolution") > 0) {
    map.resolution = a.resolution;
    mapping_common::validate(map, "--");
  }
  const bool merges = files.size() == 4 && files[0] == "merge",
             informs = files.size() == 2 && files[0] == "info" && !has_transform;
  if (!merges && !informs && (files.size() != 3 || files[0] != "convert" || has_transform))
    throw po::error("expected is: info FILE, convert IN OUT, or merge A B OUT");
  a.in = files[1];
  if (informs) return true;
  if (merges) a.other = files[2];
  a.out = files.back();
  formatOf(a.out);
  return true;
}

void inform(const OccupancyMap& map) {
  const Statistics s = map.statistics();
  Options options = map.options();
  std::cout << "cells: " << s.cells << ", occupied " << s.occupied_cells << ", free " << s.free_cells
            << "\nvolume: occupied " << s.occupied_volume << " m^3, free " << s.free_volume << " m^3\n";
  if (const VoxelBox box = map.bounds(); !box.isEmpty()) {
    std::cout << "from: " << map.minCorner(box).transpose() << " m\nto: " << map.maxCorner(box).transpose()
              << " m\n";
  }
  std::cout << "blocks: " << map.blocks().size() << "\nmemory: " << static_cast<double>(s.memory_bytes) * 1e-6
            << " MB\n";
  for (const auto& [option, section] : mapping_common::optionsOf(options))
    std::cout << option.name() << ": " << option.word() << (option.unit().empty() ? "" : " ") << option.unit()
              << '\n';
}

void run(const Arguments& a) {
  OccupancyMap map = readMap(a.in);
  if (a.out.empty()) return inform(map);
  if (a.resolution > 0.0) {
    Options options = map.options();
    options.resolution = a.resolution;
    map = transformed(map, Eigen::Isometry3d::Identity(), options);
  }
  if (!a.other.empty()) map = merged(map, transformed(readMap(a.other), a.transform, map.options()));
  std::cout << writeMap(map, a.out, a.projection) << '\n';
}

}  // namespace

int main(int argc, char** argv) {
  return mapping_common::runTool(argc, argv, "rtree_map", kUsage, parse, run);
}
