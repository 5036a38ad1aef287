// SPDX-License-Identifier: BSD-3-Clause
//
// Converts recorded scans with poses (see scan_files.h for the formats) to a bag that can be played to a
// mapper.
#include <mapping_common/progress.h>
#include <mapping_common/tool.h>
#include <rosbag_tests/converters/scan_bag_writer.h>
#include <rosbag_tests/converters/scan_files.h>

#include <boost/program_options.hpp>
#include <cstddef>
#include <iostream>
#include <limits>
#include <stdexcept>
#include <string>

namespace po = boost::program_options;

namespace {

const char kUsage[] =
    "Usage: scans_to_bag SCANS OUT.bag [options]\n"
    "\n"
    "Converts scans with poses to a bag: the clouds, /tf, /tf_static, the true poses and /clock.\n"
    "SCANS is a folder of NNNN.bin[.xz] with a pose file, of *.pcd, or of scanNNN.3d[.xz] with scanNNN.pose "
    "(3DTK),\n"
    "or an OctoMap .graph file.\n";

struct Arguments {
  std::string scans, bag, poses, pcd_frame = "map";
  rosbag_tests::ScanBagOptions options;
  double rate = 0.0;
  long first = 0, last = std::numeric_limits<long>::max(), step = 1;
};

/// False if help was asked for and printed. Throws po::error for wrong usage.
bool parse(int argc, char** argv, Arguments& a) {
  po::options_description visible("Options");
  auto& o = a.options;
  auto add = visible.add_options();
  add("help,h", "print this");
  add("poses", po::value(&a.poses), "pose file of .bin scans; by default the one poses*.txt of the folder");
  add("pcd-frame", po::value(&a.pcd_frame)->default_value(a.pcd_frame),
      "frame of the points of PCD files: map or sensor");
  add("cloud-topic", po::value(&o.cloud_topic)->default_value(o.cloud_topic), "sensor_msgs/PointCloud2");
  add("pose-topic", po::value(&o.pose_topic)->default_value(o.pose_topic), "geometry_msgs/PoseStamped");
  add("sensor-frame", po::value(&o.sensor_frame)->default_value(o.sensor_frame), "frame of the clouds");
  add("base-frame", po::value(&o.base_frame)->default_value(o.base_frame),
      "frame of the robot, at the sensor's pose");
  add("rate", po::value(&a.rate), "scans per second (Hz); by default the scans' own stamps");
  add("start", po::value(&o.stamp_offset)->default_value(o.stamp_offset), "added to the stamps (s)");
  add("first", po::value(&a.first)->default_value(a.first), "index of the first scan, from 0");
  add("last", po::value(&a.last), "index of the last scan; by default the last there is");
  add("step", po::value(&a.step)->default_value(a.step), "take each N-th scan");
  po::options_description unnamed;
  unnamed.add_options()("scans", po::value(&a.scans))("bag", po::value(&a.bag));
  const auto given = mapping_common::parseArguments(argc, argv, kUsage, visible, unnamed);
  if (!given) return false;
  if (a.scans.empty() || a.bag.empty()) throw po::error("SCANS and OUT.bag are needed");
  if (a.pcd_frame != "map" && a.pcd_frame != "sensor") throw po::error("--pcd-frame must be map or sensor");
  if (given->count("rate") && !(a.rate > 0.0 && a.rate < 500.0))
    throw po::error("--rate must be in (0, 500) Hz");
  if (a.step < 1) throw po::error("--step must be at least 1");
  if (a.first < 0 || a.last < a.first) throw po::error("--first must be at least 0, --last at least --first");
  return true;
}

void convert(const Arguments& a) {
  const auto source = rosbag_tests::openScans(
      a.scans, a.poses,
      a.pcd_frame == "map" ? rosbag_tests::PcdFrame::kMap : rosbag_tests::PcdFrame::kSensor);
  if (a.first >= static_cast<long>(source->size()))
    throw std::runtime_error("--first " + std::to_string(a.first) + " is beyond the " +
                             std::to_string(source->size()) + " scans of " + a.scans);
  rosbag_tests::ScanBagWriter writer(a.bag, a.options);
  mapping_simulation::PosedScan scan;
  std::size_t written = 0, points = 0;
  mapping_common::Progress progress("scans_to_bag");
  for (long i = 0; i <= a.last && source->next(scan); ++i) {
    if (i < a.first || (i - a.first) % a.step != 0) continue;
    if (a.rate > 0.0) scan.stamp = written / a.rate;
    writer.write(scan);
    ++written;
    points += scan.cloud.size();
    progress.show(written, " scans, ", points, " points");
  }
  writer.close();
  progress.say(written, " scans, ", points, " points -> ", a.bag);
}

}  // namespace

int main(int argc, char** argv) {
  return mapping_common::runTool(argc, argv, "scans_to_bag", kUsage, parse, convert);
}
