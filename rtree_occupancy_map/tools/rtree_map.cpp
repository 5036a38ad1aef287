// SPDX-License-Identifier: BSD-3-Clause
//
// Files of maps: from one format to another.
#include <mapping_common/tool.h>
#include <rtree_occupancy_map/ros/map_formats.h>

#include <boost/program_options.hpp>
#include <iostream>
#include <string>
#include <vector>

namespace po = boost::program_options;
using namespace rtree_occupancy_map;

namespace {

const char kUsage[] =
    "Usage: rtree_map convert IN OUT [options]\n"
    "\n"
    "Files by their endings: .map or none (the R-tree map), .bt and .ot (OctoMap); to be written alone, "
    ".pcd\n"
    "(points at the occupied voxels), .pgm or .yaml (seen from above, both, for map_server).\n";

struct Arguments {
  std::string in, out;
  DisplayOptions projection;
};

bool parse(int argc, char** argv, Arguments& a) {
  a.projection.occupancy_max_size = 20000;
  po::options_description visible("Options"), all;
  visible.add_options()("help,h", "print this");
  mapping_common::addOption(visible, "min_z", a.projection, "occupancy_min_z");
  mapping_common::addOption(visible, "max_z", a.projection, "occupancy_max_z");
  mapping_common::addOption(visible, "max_size", a.projection, "occupancy_max_size");
  std::vector<std::string> words;
  all.add(visible).add_options()("words", po::value(&words));
  po::positional_options_description positional;
  positional.add("words", -1);
  po::variables_map values;
  po::store(po::command_line_parser(argc, argv)
                .options(all)
                .positional(positional)
                .style(po::command_line_style::unix_style ^ po::command_line_style::allow_guessing)
                .run(),
            values);
  if (values.count("help") > 0) {
    std::cout << kUsage << '\n' << visible;
    return false;
  }
  po::notify(values);
  mapping_common::validate(a.projection, "--");
  if (words.size() != 3 || words[0] != "convert") throw po::error("expected is: convert IN OUT");
  a.in = words[1];
  a.out = words[2];
  formatOf(a.out);
  return true;
}

void run(const Arguments& a) {
  std::cout << writeMap(readMap(a.in), a.out, a.projection) << '\n';
}

}  // namespace

int main(int argc, char** argv) {
  return mapping_common::runTool(argc, argv, "rtree_map", kUsage, parse, run);
}
