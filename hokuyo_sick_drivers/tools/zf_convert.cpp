// SPDX-License-Identifier: BSD-3-Clause
//
// Converts terrestrial scans (E57, PTX, PTS, ASC) to PCD files or a bag.
#include <mapping_common/files.h>
#include <mapping_common/progress.h>
#include <mapping_common/tool.h>
#include <tf2_msgs/TFMessage.h>

#include <atomic>
#include <boost/program_options.hpp>
#include <chrono>
#include <csignal>
#include <cstdio>
#include <iomanip>
#include <iostream>
#include <optional>
#include <sstream>
#include <stdexcept>

#include "hokuyo_sick_drivers/zf/scan_choice.h"
#include "hokuyo_sick_drivers/zf/scan_cloud.h"
#include "hokuyo_sick_drivers/zf/scan_file.h"
#include "zf/ros/cloud_bag.h"
#include "zf/ros/scan_message.h"

namespace po = boost::program_options;

namespace hokuyo_sick_drivers {
namespace {

enum ExitCode { kDone = 0, kFailed = 1, kWrongUse = 2, kInterrupted = 130 };

std::atomic<bool> interrupted{false};

struct UsageError : std::runtime_error {
  using std::runtime_error::runtime_error;
};

struct Arguments {
  std::string in, out, scan = "all", offset = "auto", frame = "scanner", parent = "map";
  std::string topic = "cloud";
  std::vector<double> limits;
  bool list = false, quiet = false, no_grid = false, apply_pose = false, ignore_checksums = false;
  double stamp = 0.0;
  ReadOptions reading;
  CloudOptions cloud;
};

bool endsWith(const std::string& text, const std::string& end) {
  return text.size() >= end.size() && text.compare(text.size() - end.size(), end.size(), end) == 0;
}

// Of what is read.
class Progress {
 public:
  Progress(const Arguments& arguments, const std::string& what) {
    if (!arguments.quiet) line_.emplace(what);
  }

  bool operator()(double done, std::uint64_t points) {
    if (line_) {
      const double millions = 1e-6 * static_cast<double>(points);
      line_->show(std::fixed, std::setprecision(2), static_cast<int>(100.0 * done), " %, ", millions,
                  " million points, ", millions / seconds(), " million/s");
    }
    return !interrupted;
  }
  double seconds() const {
    return std::max(1e-6, std::chrono::duration<double>(std::chrono::steady_clock::now() - start_).count());
  }
  void say(const std::string& text) {
    if (line_) line_->say(text);
  }

 private:
  std::optional<mapping_common::Progress> line_;
  std::chrono::steady_clock::time_point start_ = std::chrono::steady_clock::now();
};

const char kUsage[] =
    "Usage: zf_convert IN OUT.pcd|OUT.bag\n"
    "Converts scans of E57, PTX, PTS or ASC files. Several scans become OUT_1.pcd, OUT_2.pcd ... or messages "
    "of "
    "one bag.\n";

po::options_description describe(Arguments& a) {
  po::options_description options("Options");
  options.add_options()("help,h", "this text")                                                       //
      ("list,l", po::bool_switch(&a.list), "only say what is in the file")                           //
      ("scan", po::value(&a.scan)->default_value(a.scan), "which: a number from 1, a name, or all")  //
      ("intensity-limits", po::value(&a.limits)->multitoken(), "MIN MAX that become 0 and 1")        //
      ("offset", po::value(&a.offset)->default_value(a.offset),
       "taken off all points: auto (where they are beyond 10 km), none, or X,Y,Z")                         //
      ("no-grid", po::bool_switch(&a.no_grid), "only the points that were measured, in the file's order")  //
      ("apply-pose", po::bool_switch(&a.apply_pose), "points in the registered frame")                     //
      ("ignore-checksums", po::bool_switch(&a.ignore_checksums), "E57: read damaged pages, too")           //
      ("frame", po::value(&a.frame)->default_value(a.frame),
       "bag: frame of the clouds; several scans: with _1, _2 ...")(
          "parent", po::value(&a.parent)->default_value(a.parent), "bag: frame that the poses are in")   //
      ("topic", po::value(&a.topic)->default_value(a.topic), "bag: topic of the clouds")                 //
      ("stamp", po::value(&a.stamp)->default_value(a.stamp), "bag: time (s) of the first scan; 0: now")  //
      ("quiet,q", po::bool_switch(&a.quiet), "no progress");
  for (const char* name : {"intensity", "columns"}) mapping_common::addOption(options, name, a.reading, name);
  mapping_common::addOption(options, "voxel", a.cloud, "voxel");
  return options;
}

void check(Arguments& a) {
  if (!a.list && !endsWith(a.out, ".pcd") && !endsWith(a.out, ".bag")) {
    throw UsageError("OUT is \"" + a.out + "\", has to end with .pcd or .bag");
  }
  if (a.reading.intensity == IntensityScale::kLimits) {
    if (a.limits.size() != 2 || !(a.limits[0] < a.limits[1])) {
      throw UsageError("--intensity limits takes --intensity-limits MIN MAX, the smaller one first");
    }
    a.reading.intensity_limits = {a.limits[0], a.limits[1]};
  }
  if (!(a.stamp >= 0.0 && a.stamp < 4e9)) throw UsageError("--stamp has to be 0 to 4e9");
  if (!parseOffset(a.offset, a.cloud)) {
    throw UsageError("--offset is \"" + a.offset + "\", allowed are auto, none and X,Y,Z");
  }
  a.cloud.grid = !a.no_grid;
  a.cloud.apply_pose = a.apply_pose;
  a.reading.verify_checksums = !a.ignore_checksums;
}

std::string describe(const ScanInfo& info) {
  std::ostringstream text;
  text << info.name << ": " << info.points << " points";
  if (info.hasGrid()) text << ", grid of " << info.rows << " x " << info.columns;
  if (info.has_intensity) text << ", intensity";
  if (info.intensity_limits)
    text << ' ' << info.intensity_limits->min << " to " << info.intensity_limits->max;
  if (info.has_colour) text << ", colour";
  if (info.has_pose)
    text << ", at " << std::fixed << std::setprecision(3) << info.pose.translation().transpose();
  return text.str();
}

ScanCloud readCloud(ScanFileReader& reader, std::size_t scan, const Arguments& a) {
  const ScanInfo& info = reader.scans()[scan];
  CloudBuilder builder(info, a.cloud);
  Progress progress(a, info.name);
  std::uint64_t points = 0;
  const bool whole = reader.read(scan, [&](const std::vector<ScanPoint>& chunk, double done) {
    builder.add(chunk);
    points += chunk.size();
    return progress(done, points);
  });
  if (!whole) throw ReadStopped();
  ScanCloud cloud = builder.finish();
  std::ostringstream text;
  text << std::fixed << std::setprecision(2) << cloud.points << " points, " << cloud.missing << " missing";
  if (cloud.duplicates > 0) text << ", " << cloud.duplicates << " in a cell that was taken";
  if (cloud.outside > 0) text << ", " << cloud.outside << " outside of the grid";
  if (a.cloud.voxel > 0.0) text << ", in " << cloud.width << " voxels";
  text << "; " << progress.seconds() << " s, " << 1e-6 * static_cast<double>(points) / progress.seconds()
       << " million points/s";
  if (!cloud.offset.isZero()) text << "; offset " << cloud.offset.transpose() << " taken off";
  progress.say(text.str());
  return cloud;
}

void writePcds(ScanFileReader& reader, const std::vector<std::size_t>& chosen, const Arguments& a) {
  for (const std::size_t scan : chosen) {
    std::string path = a.out;
    if (chosen.size() > 1) path.insert(path.size() - 4, '_' + std::to_string(scan + 1));
    const ScanCloud cloud = readCloud(reader, scan, a);
    mapping_common::writeFile(path, [&](std::ostream& out) { writePcd(out, cloud); });
  }
}

void writeBag(ScanFileReader& reader, const std::vector<std::size_t>& chosen, const Arguments& a) {
  std_msgs::Header header;
  header.stamp = a.stamp > 0.0 ? ros::Time(a.stamp) : ros::Time(ros::WallTime::now().toSec());
  mapping_common::writeFile(a.out, [&](std::ostream& out) {
    CloudBag bag(out);
    tf2_msgs::TFMessage poses;  // all up to now: who comes late gets the latest message alone
    for (const std::size_t scan : chosen) {
      header.frame_id = a.frame + (chosen.size() > 1 ? '_' + std::to_string(scan + 1) : "");
      ScanCloud cloud = readCloud(reader, scan, a);
      poses.transforms.push_back(toMessage(cloud.pose, header, a.parent));
      bag.write("/tf_static", header.stamp, poses);
      bag.write(a.topic, header.stamp, toMessage(std::move(cloud), header));
      header.stamp += ros::Duration(1.0);
    }
    bag.close();
  });
}

void convert(Arguments& a) {
  check(a);
  std::optional<Progress> opening(std::in_place, a, "looking through " + a.in);
  a.reading.opening = [&opening](double done) { return opening ? (*opening)(done, 0) : !interrupted; };
  const auto reader = openScanFile(a.in, a.reading);
  opening.reset();
  try {
    if (a.list) {
      std::cout << a.in << ": " << toString(reader->format()) << ", scans: " << reader->scans().size()
                << '\n';
      for (const ScanInfo& info : reader->scans()) std::cout << describe(info) << '\n';
    } else {
      const std::vector<std::size_t> chosen = chooseScans(*reader, a.scan);
      endsWith(a.out, ".pcd") ? writePcds(*reader, chosen, a) : writeBag(*reader, chosen, a);
    }
  } catch (const ReadStopped&) {
    throw;
  } catch (const std::runtime_error& e) {
    throw std::runtime_error(a.in + ' ' + e.what());
  }
  for (const std::string& warning : reader->warnings())
    std::cerr << "Warning: " << a.in << ": " << warning << '\n';
}

int run(int argc, char** argv) {
  Arguments arguments;
  const po::options_description options = describe(arguments);
  po::options_description unnamed;
  unnamed.add_options()("in", po::value(&arguments.in))("out", po::value(&arguments.out));
  try {
    if (!mapping_common::parseArguments(argc, argv, kUsage, options, unnamed)) return kDone;
    if (arguments.in.empty()) throw UsageError("IN is missing");
    convert(arguments);
    return kDone;
  } catch (const ReadStopped&) {
    std::cerr << "zf_convert: interrupted, nothing was written\n";
    return kInterrupted;
  } catch (const po::error& e) {
    std::cerr << "zf_convert: " << e.what() << ". See zf_convert --help\n";
    return kWrongUse;
  } catch (const UsageError& e) {
    std::cerr << "zf_convert: " << e.what() << ". See zf_convert --help\n";
    return kWrongUse;
  } catch (const std::bad_alloc&) {
    std::cerr << "zf_convert: not enough memory: use --voxel\n";
    return kFailed;
  } catch (const std::exception& e) {
    std::cerr << "zf_convert: " << e.what() << '\n';
    return kFailed;
  }
}

}  // namespace
}  // namespace hokuyo_sick_drivers

int main(int argc, char** argv) {
  const auto interrupt = [](int) { hokuyo_sick_drivers::interrupted = true; };
  std::signal(SIGINT, interrupt);
  std::signal(SIGTERM, interrupt);
  return hokuyo_sick_drivers::run(argc, argv);
}
