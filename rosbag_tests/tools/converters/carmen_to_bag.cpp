// SPDX-License-Identifier: BSD-3-Clause
//
// Converts a log of CARMEN to a bag that can be played to a SLAM node.
#include <mapping_common/progress.h>
#include <mapping_common/tool.h>
#include <rosbag_tests/converters/carmen_bag.h>
#include <rosbag_tests/converters/carmen_log.h>

#include <algorithm>
#include <boost/program_options.hpp>
#include <cmath>
#include <iostream>
#include <string>

namespace po = boost::program_options;
using rosbag_tests::CarmenBagOptions;

namespace {

const char kUsage[] =
    "Usage: carmen_to_bag IN.clf[.gz] OUT.bag [options]\n"
    "\n"
    "Converts a log of CARMEN (FLASER, RLASER, ROBOTLASER1, ROBOTLASER2, ODOM, PARAM) to a bag: LaserScan, "
    "Odometry,\n"
    "/tf odom -> base_link, /tf_static base_link -> laser. A stamp that doesn't increase is replaced; "
    "--stamps writes\n"
    "which, for relations_metric.\n";

struct Arguments {
  std::string log, bag, stamps, reference, clock = "ipc", odometry = "scans";
  double angle_min = 0.0, angle_increment = 0.0;
  rosbag_tests::CarmenOptions read;
  CarmenBagOptions write;
};

/// False if help was asked for and printed. Throws po::error for wrong usage.
bool parse(int argc, char** argv, Arguments& a) {
  po::options_description visible("Options");
  auto& w = a.write;
  auto add = visible.add_options();
  add("help,h", "print this");
  add("stamps", po::value(&a.stamps), "write the stamps that were changed to this file: stamp original");
  add("reference", po::value(&a.reference),
      "write the logged poses of base_link at the scans to this file, in TUM format: of a corrected log, the "
      "reference trajectory");
  add("clock", po::value(&a.clock)->default_value(a.clock),
      "stamps of the messages: ipc (of the measurement), logger, or none (made up, see --rate)");
  add("rate", po::value(&w.rate), "scans per second (Hz) with --clock none");
  add("offset", po::value(&w.offset)->default_value(0.0, "0"), "added to the stamps (s)");
  add("odometry", po::value(&a.odometry)->default_value(a.odometry),
      "scans: poses logged with the scans; lines: of the ODOM lines, for corrected logs");
  add("scan-topic", po::value(&w.scan_topic)->default_value(w.scan_topic), "sensor_msgs/LaserScan");
  add("laser-frame", po::value(&w.laser_frame)->default_value(w.laser_frame), "frame of the scans");
  add("base-frame", po::value(&w.base_frame)->default_value(w.base_frame), "frame of the robot");
  add("odom-frame", po::value(&w.odom_frame)->default_value(w.odom_frame), "frame of the odometry");
  add("range-max", po::value(&a.read.range_max)->default_value(a.read.range_max),
      "readings from here on (m) are no return");
  add("angle-min", po::value(&a.angle_min), "of the first reading (deg); by default as CARMEN has it");
  add("angle-increment", po::value(&a.angle_increment), "between readings (deg)");
  po::options_description unnamed;
  unnamed.add_options()("log", po::value(&a.log))("bag", po::value(&a.bag));
  const auto given = mapping_common::parseArguments(argc, argv, kUsage, visible, unnamed);
  if (!given) return false;
  if (a.log.empty() || a.bag.empty()) throw po::error("IN.clf and OUT.bag are needed");
  if (a.clock != "ipc" && a.clock != "logger" && a.clock != "none")
    throw po::error("--clock must be ipc, logger or none");
  if ((a.clock == "none") != (given->count("rate") == 1))
    throw po::error("--rate goes with --clock none, and --clock none with --rate");
  if (given->count("rate") && !(w.rate > 0.0 && w.rate <= 1000.0))
    throw po::error("--rate must be in (0, 1000] Hz");
  if (a.odometry != "scans" && a.odometry != "lines") throw po::error("--odometry must be scans or lines");
  if (given->count("angle-min") != given->count("angle-increment"))
    throw po::error("--angle-min and --angle-increment go together");
  if (given->count("angle-increment") && a.angle_increment == 0.0)
    throw po::error("--angle-increment must not be 0");
  if (!(a.read.range_max > 0.0)) throw po::error("--range-max must be positive");
  a.read.angle_min = a.angle_min * M_PI / 180.0;
  a.read.angle_increment = a.angle_increment * M_PI / 180.0;
  w.stamps = a.clock == "ipc"      ? CarmenBagOptions::Stamps::kIpc
             : a.clock == "logger" ? CarmenBagOptions::Stamps::kLogger
                                   : CarmenBagOptions::Stamps::kRate;
  w.odometry =
      a.odometry == "scans" ? CarmenBagOptions::Odometry::kScans : CarmenBagOptions::Odometry::kLines;
  return true;
}

void convert(const Arguments& a) {
  const rosbag_tests::CarmenLog log = rosbag_tests::readCarmenLog(a.log, a.read);
  constexpr std::size_t kShown = 5;
  for (std::size_t i = 0; i < std::min(kShown, log.malformed.size()); ++i)
    std::cerr << "carmen_to_bag: left out " << log.malformed[i] << '\n';
  mapping_common::Progress progress("carmen_to_bag");
  const auto summary =
      rosbag_tests::writeCarmenBag(a.bag, log, a.write, a.stamps, a.reference,
                                   [&progress](std::size_t scans) { progress.show(scans, " scans"); });
  progress.say(summary.scans, " scans",
               summary.rear_scans > 0 ? ", " + std::to_string(summary.rear_scans) + " rear scans" : "", ", ",
               summary.odometry, " poses of the odometry, ", summary.repaired_scans,
               " stamps of scans replaced, ", log.malformed.size(), " malformed lines left out -> ", a.bag);
}

}  // namespace

int main(int argc, char** argv) {
  return mapping_common::runTool(argc, argv, "carmen_to_bag", kUsage, parse, convert);
}
