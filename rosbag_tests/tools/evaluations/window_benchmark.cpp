// SPDX-License-Identifier: BSD-3-Clause
//
// What the rolling window of the R-tree map costs and saves, on a simulated street that is as long as one
// likes.
#include <fcntl.h>
#include <mapping_common/tool.h>
#include <mapping_simulation/posed_scan.h>
#include <mapping_simulation/simulator.h>
#include <rtree_occupancy_map/occupancy_map.h>
#include <rtree_occupancy_map/window.h>
#include <unistd.h>

#include <algorithm>
#include <boost/program_options.hpp>
#include <chrono>
#include <cmath>
#include <cstdio>
#include <ctime>
#include <filesystem>
#include <fstream>
#include <iostream>
#include <random>
#include <string>
#include <vector>

namespace po = boost::program_options;
using mapping_common::addOption;
using rtree_occupancy_map::OccupancyMap;
using rtree_occupancy_map::Scan;

namespace {

const char kUsage[] =
    "Usage: window_benchmark --world config/worlds/street.yaml --sensor "
    "config/simulator/velodyne_hdl64e.yaml [options]\n"
    "\n"
    "Drives along a simulated street and maps it with a 64-beam lidar: cells, memory, processor\n"
    "time for each scan, and for queries and for reading a part of it back at the end. The street is 100 m,\n"
    "again and again, in rows of 2 km that are 100 m apart, each time elsewhere within the voxels.\n";

// m
constexpr double kPiece = 100.0, kPieceBegin = 20.0, kRow = 2000.0, kRowDistance = 100.0;

// The middle of the street at a distance along it (m): rows to both sides of the map's origin in turn.
Eigen::Vector3d placeAt(double way) {
  const double row = std::floor(way / kRow), side = std::fmod(row, 2.0) == 0.0 ? 0.5 : -0.5;
  return {way - row * kRow - 0.5 * kRow, side * (row + 0.5) * kRowDistance, 0.0};
}

struct Arguments {
  double length = 1000.0, report_every = 500.0;  // m
  double scan_every = 2.0, read_back = 200.0;    // m
  int queries = 1000;
  rtree_occupancy_map::Options map;
  rtree_occupancy_map::WindowOptions window;
  std::string world, sensor, save;
};

bool parse(int argc, char** argv, Arguments& a) {
  a.map.max_range = 30.0;
  a.map.resolution = 0.1;
  a.map.threads = 1;
  po::options_description all("Options");
  auto add = all.add_options();
  add("help,h", "print this");
  add("world", po::value(&a.world)->required(), "a street along x, with a trajectory from x = 0 to 140 m");
  add("sensor", po::value(&a.sensor)->required(), "a lidar");
  add("length", po::value(&a.length)->default_value(a.length), "m, of the street");
  add("report-every", po::value(&a.report_every)->default_value(a.report_every), "m, of a line of figures");
  add("queries", po::value(&a.queries)->default_value(a.queries),
      "number of each kind at the end, at random places");
  add("scan-every", po::value(&a.scan_every)->default_value(a.scan_every), "m, from scan to scan");
  add("read-back", po::value(&a.read_back)->default_value(a.read_back),
      "m, of the street's beginning, whose cells are read at the end, from the disk");
  addOption(all, "resolution", a.map, "resolution");
  addOption(all, "fusion", a.map, "fusion/rule");
  addOption(all, "max-range", a.map, "sensor_model/max_range");
  addOption(all, "threads", a.map, "threads");
  addOption(all, "store", a.window, "file");
  addOption(all, "distance", a.window, "distance");
  addOption(all, "memory", a.window, "memory");
  add("save", po::value(&a.save), "write the map to this file at the end (.map, .db), and measure that");
  if (!mapping_common::parseArguments(argc, argv, kUsage, all)) return false;
  if (!(a.length >= kPiece && a.report_every > 0.0))
    throw po::error("--length must be at least 100, --report-every above 0");
  if (!(a.scan_every >= 0.5 && a.scan_every <= 20.0)) throw po::error("--scan-every must be 0.5 to 20");
  if (a.queries < 1) throw po::error("--queries must be at least 1");
  mapping_common::validate(a.map, "--");
  return true;
}

// Scans of one piece of the street, in its own frame.
std::vector<Scan> scansOfAPiece(const Arguments& a) {
  using namespace mapping_simulation;
  SensorConfig sensor = loadSensor(a.sensor);
  sensor.rate = 5.0 / a.scan_every;  // at 5 m/s
  std::vector<Scan> scans;
  simulate({loadWorld(a.world), loadTrajectory(a.world), {sensor}, 30.0, 1},
           [&](const SensorConfig& config, const Sweep& sweep) {
             const PosedScan posed = toPosedScan(config, sweep);
             const double x = posed.pose.translation().x();
             if (x < kPieceBegin || x >= kPieceBegin + kPiece) return;
             Scan scan;
             scan.origin = posed.pose.translation().cast<float>();
             for (const pcl::PointXYZI& p : posed.cloud) {
               const Eigen::Vector3d point = posed.pose * p.getVector3fMap().cast<double>();
               if (point.allFinite()) scan.hits.push_back(point.cast<float>());
             }
             scans.push_back(scan);
           });
  return scans;
}

double processorTime() {
  timespec t{};
  clock_gettime(CLOCK_PROCESS_CPUTIME_ID, &t);
  return static_cast<double>(t.tv_sec) + 1e-9 * static_cast<double>(t.tv_nsec);
}

// MB of this process that are in memory, now and at the most.
std::string residentMemory() {
  std::ifstream status("/proc/self/status");
  std::string line, now, most;
  while (std::getline(status, line)) {
    if (line.rfind("VmRSS:", 0) == 0) now = line.substr(6);
    if (line.rfind("VmHWM:", 0) == 0) most = line.substr(6);
  }
  const auto megabytes = [](const std::string& kilobytes) {
    return std::to_string(std::atol(kilobytes.c_str()) / 1000);
  };
  return megabytes(now) + " (" + megabytes(most) + ")";
}

void measureQueries(const OccupancyMap& map, int count, double length) {
  std::mt19937 random(1);
  std::uniform_real_distribution<double> along(0.0, length), across(-8.0, 8.0), up(0.1, 4.0);
  std::vector<Eigen::Vector3d> places;
  for (int i = 0; i < count; ++i) {
    const Eigen::Vector3d middle = placeAt(along(random));
    places.push_back(middle + Eigen::Vector3d(0.0, across(random), up(random)));
  }
  std::size_t found = 0;
  const auto measure = [&](const char* name, const auto& query) {
    const double start = processorTime();
    for (const Eigen::Vector3d& place : places) found += query(place);
    std::printf("%-28s %10.1f us\n", name, 1e6 * (processorTime() - start) / count);
  };
  measure("cellAt", [&](const Eigen::Vector3d& p) { return map.cellAt(p).has_value(); });
  measure("castRay, 30 m", [&](const Eigen::Vector3d& p) {
    return map.castRay(p, {0.6, p.y(), 0.1}, 30.0).result == rtree_occupancy_map::RayHit::Result::kOccupied;
  });
  measure("nearestOccupied, 5", [&](const Eigen::Vector3d& p) { return map.nearestOccupied(p, 5).size(); });
  measure("visitBox, 2 m", [&](const Eigen::Vector3d& p) {
    std::size_t cells = 0;
    map.visitBox(p.array() - 1.0, p.array() + 1.0,
                 [&cells](const rtree_occupancy_map::Cell&) { return ++cells > 0; });
    return cells;
  });
  std::printf("%zu answers\n", found);
}

// Has the system forget what it keeps of a file.
void dropFromCache(const std::string& path) {
  const int file = open(path.c_str(), O_RDONLY);
  if (file < 0) return;
  posix_fadvise(file, 0, 0, POSIX_FADV_DONTNEED);
  close(file);
}

void measureReadingBack(const Arguments& a, const OccupancyMap& map) {
  if (!a.window.file.empty()) dropFromCache(a.window.file);
  const double start = processorTime();
  const auto clock_start = std::chrono::steady_clock::now();
  std::size_t cells = 0;
  const Eigen::Vector3d first = placeAt(0.0), around(0.0, 0.5 * kRowDistance, 100.0);
  map.visitBox(first - around, first + around + Eigen::Vector3d(a.read_back, 0.0, 0.0),
               [&cells](const rtree_occupancy_map::Cell&) { return ++cells > 0; });
  const std::chrono::duration<double> elapsed = std::chrono::steady_clock::now() - clock_start;
  std::printf("%-28s %10.1f ms, %.1f elapsed: %zu cells\n", "read back", 1e3 * (processorTime() - start),
              1e3 * elapsed.count(), cells);
}

void run(const Arguments& a) {
  std::fprintf(stderr, "simulating\n");
  const std::vector<Scan> piece = scansOfAPiece(a);
  OccupancyMap map(a.map);
  if (!a.window.file.empty()) map.keepIn(a.window);
  std::printf("%8s %8s %12s %10s %16s %12s %12s\n", "m", "scans", "cells", "map, MB", "process, MB",
              "ms per scan", "longest, ms");
  double next_report = a.report_every, busy = 0.0, longest = 0.0, all_busy = 0.0;
  std::mt19937 random(1);
  std::uniform_real_distribution<double> within_voxel(0.0, a.map.resolution);
  std::size_t scans = 0, reported = 0;
  for (double way = 0.0; way < a.length; way += kPiece) {
    Eigen::Vector3d place = placeAt(way) - Eigen::Vector3d(kPieceBegin, 0.0, 0.0);
    for (double& coordinate : place) coordinate += within_voxel(random);
    const Eigen::Vector3f offset = place.cast<float>();
    for (const Scan& here : piece) {
      Scan scan = here;
      scan.origin += offset;
      for (Eigen::Vector3f& hit : scan.hits) hit += offset;
      const double start = processorTime();
      map.insertScan(scan);
      const double time = processorTime() - start;
      busy += time;
      all_busy += time;
      longest = std::max(longest, time);
      ++scans;
    }
    if (way + kPiece < next_report && way + kPiece < a.length) continue;
    next_report += a.report_every;
    std::printf("%8.0f %8zu %12zu %10.1f %16s %12.2f %12.2f\n", way + kPiece, scans, map.size(),
                1e-6 * static_cast<double>(map.memoryUsage()), residentMemory().c_str(),
                1e3 * busy / static_cast<double>(scans - reported), 1e3 * longest);
    std::fflush(stdout);
    reported = scans;
    busy = longest = 0.0;
  }
  std::printf("%-28s %10.1f s for %zu scans\n", "insertion", all_busy, scans);
  double start = processorTime();
  map.flush();
  if (!a.window.file.empty()) {
    std::printf("%-28s %10.1f ms\n", "flush", 1e3 * (processorTime() - start));
    std::printf("%-28s %10.1f MB\n", "store",
                1e-6 * static_cast<double>(std::filesystem::file_size(a.window.file)));
  }
  measureReadingBack(a, map);
  measureQueries(map, a.queries, a.length);
  if (!a.save.empty()) {
    start = processorTime();
    map.save(a.save);
    std::printf("%-28s %10.1f s, %.1f MB; process %s MB\n", "save", processorTime() - start,
                1e-6 * static_cast<double>(std::filesystem::file_size(a.save)), residentMemory().c_str());
  }
}

}  // namespace

int main(int argc, char** argv) {
  return mapping_common::runTool(argc, argv, "window_benchmark", kUsage, parse, run);
}
