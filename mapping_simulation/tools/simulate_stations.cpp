// SPDX-License-Identifier: BSD-3-Clause
//
// A terrestrial scanner that is carried from station to station, and writes a scan file at each.
#include <mapping_common/files.h>
#include <mapping_common/progress.h>
#include <mapping_common/tool.h>
#include <mapping_simulation/city.h>
#include <mapping_simulation/posed_scan.h>
#include <mapping_simulation/sensors.h>

#include <algorithm>
#include <boost/program_options.hpp>
#include <cmath>
#include <cstdio>
#include <filesystem>
#include <iostream>
#include <random>
#include <stdexcept>
#include <string>
#include <vector>

namespace po = boost::program_options;
namespace fs = std::filesystem;
using namespace mapping_simulation;

namespace {

const char kUsage[] =
    "Usage: simulate_stations --sensor SENSOR.yaml [--world WORLD.yaml] --out DIR   [options]\n"
    "\n"
    "Scans a world from stations along its trajectory, or a street of the city (simulate_city) on the\n"
    "way out on one side and back on the other. Writes DIR/scan_001.ptx and so on, in the scanner's own\n"
    "frame and without its pose, and DIR/truth.tum, the scanner's poses with the number of the scan for a\n"
    "time. At each station the scanner looks anywhere, and is tilted.\n";

struct Arguments {
  std::string sensor, world, out;
  int stations = 11, place = 0;
  double step = 6.0, tilt = 2.0;
  std::uint32_t seed = 1;
};

bool parse(int argc, char** argv, Arguments& a) {
  po::options_description all("Options");
  auto add = all.add_options();
  add("help,h", "print this");
  add("sensor", po::value(&a.sensor)->required(), "3D scanner, a YAML file as in config/simulator");
  add("world", po::value(&a.world),
      "YAML file of a world with a trajectory; by default a street of the city");
  add("out", po::value(&a.out)->required(), "folder to write");
  add("place", po::value(&a.place)->default_value(a.place),
      "whose street is scanned, from 0: of four kinds in turn");
  add("stations", po::value(&a.stations)->default_value(a.stations), "");
  add("step", po::value(&a.step)->default_value(a.step), "m, from one to the next");
  add("tilt", po::value(&a.tilt)->default_value(a.tilt), "degrees, at most, of the scanner at a station");
  add("seed", po::value(&a.seed)->default_value(a.seed), "of all that is left to chance");
  if (!mapping_common::parseArguments(argc, argv, kUsage, all)) return false;
  if (a.stations < 1 || a.stations > 999) throw po::error("--stations must be in 1 to 999");
  if (!(a.step > 0.0 && a.step < 1e3)) throw po::error("--step must be in (0, 1000) m");
  if (!(a.tilt >= 0.0 && a.tilt < 90.0)) throw po::error("--tilt must be in [0, 90) degrees");
  return true;
}

// Out along one side of the road, and back on the other.
Trajectory alongStreet(const Arguments& a) {
  const double length = 0.5 * a.step * (a.stations - 1);
  return driveThrough({{{-0.5 * length, -1.0, 0.0}, 1.0},
                       {{0.5 * length, -1.0, 0.0}, 1.0},
                       {{0.5 * length + 1.0, 0.0, 0.0}, 1.0},
                       {{0.5 * length, 1.0, 0.0}, 1.0},
                       {{-0.5 * length - a.step, 1.0, 0.0}, 1.0}});
}

// Positions of the way, `step` apart.
std::vector<Eigen::Vector3d> stationsAlong(const Trajectory& way, const Arguments& a) {
  constexpr double kTick = 0.01;  // s
  std::vector<Eigen::Vector3d> stations{way.at(way.startTime()).translation()};
  double gone = 0.0;
  Eigen::Vector3d last = stations.front();
  for (double t = way.startTime(); static_cast<int>(stations.size()) < a.stations; t += kTick) {
    if (t > way.endTime())
      throw std::runtime_error("the way is too short: it has room for " + std::to_string(stations.size()) +
                               " stations, fewer than --stations");
    const Eigen::Vector3d here = way.at(t).translation();
    gone += (here - last).norm();
    last = here;
    if (gone >= a.step * static_cast<double>(stations.size())) stations.push_back(here);
  }
  return stations;
}

// Column after column, from below to above. Intensities are shares of the greatest.
void writePtx(const SensorConfig& sensor, const Sweep& seen, const std::string& path) {
  const PosedScan scan = toPosedScan(sensor, seen);
  std::vector<std::size_t> rings(sensor.elevations.size());
  for (std::size_t i = 0; i < rings.size(); ++i) rings[i] = i;
  std::sort(rings.begin(), rings.end(),
            [&](std::size_t a, std::size_t b) { return sensor.elevations[a] < sensor.elevations[b]; });
  mapping_common::writeFile(path, [&](std::ostream& out) {
    out << sensor.columns << '\n' << rings.size() << "\n0 0 0\n1 0 0\n0 1 0\n0 0 1\n";
    out << "1 0 0 0\n0 1 0 0\n0 0 1 0\n0 0 0 1\n";
    char line[80];
    for (int column = 0; column < sensor.columns; ++column) {
      for (const std::size_t ring : rings) {
        const pcl::PointXYZI& p = scan.cloud.at(column, static_cast<int>(ring));
        if (std::isfinite(p.x))
          std::snprintf(line, sizeof(line), "%.4f %.4f %.4f %.4f\n", p.x, p.y, p.z,
                        std::clamp(p.intensity / sensor.beam.intensity.max, 0.0, 1.0));
        else
          std::snprintf(line, sizeof(line), "0 0 0 0.5\n");
        out << line;
      }
    }
  });
}

void run(const Arguments& a) {
  const SensorConfig sensor = loadSensor(a.sensor);
  if (sensor.type != SensorConfig::Type::kLidar) throw std::runtime_error(a.sensor + " isn't a 3D scanner");
  CityOptions city;
  city.places = a.place + 1;
  city.seed = a.seed;
  const World world = a.world.empty() ? cityAt(city, CityVisit{a.place}) : loadWorld(a.world, a.seed);
  const Eigen::Isometry3d street =
      a.world.empty() ? poseOfPlace(city, a.place) : Eigen::Isometry3d::Identity();
  const Trajectory way = a.world.empty() ? alongStreet(a) : loadTrajectory(a.world);
  fs::create_directories(a.out);
  std::mt19937 random(a.seed);
  const auto between = [&](double low, double high) {
    return low + (high - low) * static_cast<double>(random()) / 4294967296.0;
  };
  std::vector<TimedPose> truth;
  mapping_common::Progress progress("simulate_stations");
  for (const Eigen::Vector3d& position : stationsAlong(way, a)) {
    const double towards = between(-M_PI, M_PI), tilt = between(0.0, a.tilt * M_PI / 180.0);
    const Eigen::AngleAxisd tilted(tilt, Eigen::Vector3d(std::cos(towards), std::sin(towards), 0.0));
    const Eigen::Isometry3d body = street * Eigen::Translation3d(position) * tilted *
                                   Eigen::AngleAxisd(between(-M_PI, M_PI), Eigen::Vector3d::UnitZ());
    const Sweep seen = sweep(sensor, world, Trajectory({TimedPose{0.0, body}}), 0.0,
                             a.seed + 1000003u * static_cast<std::uint32_t>(truth.size()));
    truth.push_back({static_cast<double>(truth.size() + 1), seen.pose});
    char name[32];
    std::snprintf(name, sizeof(name), "/scan_%03d.ptx", static_cast<int>(truth.size()));
    writePtx(sensor, seen, a.out + name);
    progress.show(truth.size(), " of ", a.stations);
  }
  writeTum(a.out + "/truth.tum", truth);
  progress.say(truth.size(), " stations -> ", a.out);
}

}  // namespace

int main(int argc, char** argv) {
  return mapping_common::runTool(argc, argv, "simulate_stations", kUsage, parse, run);
}
