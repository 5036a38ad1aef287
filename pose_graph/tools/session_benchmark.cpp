// SPDX-License-Identifier: BSD-3-Clause
//
// What sessions and the maps that are made of them cost: writes a drive around a hall, reads it, and makes
// the maps.
#include <mapping_common/tool.h>
#include <sys/resource.h>

#include <boost/program_options.hpp>
#include <chrono>
#include <cmath>
#include <cstdio>
#include <fstream>
#include <random>
#include <string>
#include <thread>
#include <utility>
#include <vector>

#include "pose_graph/maps.h"

namespace po = boost::program_options;

namespace {

using namespace pose_graph;
using Clock = std::chrono::steady_clock;

const char kUsage[] =
    "Usage: session_benchmark FILE [options]\n"
    "\n"
    "Writes a session of a drive around a hall of 30 m x 20 m to FILE, which must not be there, reads it, "
    "and makes\n"
    "the 2D map, the R-tree map and the cloud of it. Prints sizes and times.\n";

struct Arguments {
  std::string path;
  int poses = 1000, beams = 1081, rings = 16;
  double rate = 0.0;
};

bool parse(int argc, char** argv, Arguments& a) {
  po::options_description options("Options"), unnamed;
  auto add = options.add_options();
  add("help,h", "print this");
  add("poses", po::value(&a.poses)->default_value(a.poses), "key poses, each with a scan and a cloud");
  add("beams", po::value(&a.beams)->default_value(a.beams), "of a scan, and of each ring of a cloud");
  add("rings", po::value(&a.rings)->default_value(a.rings), "of a cloud; 0: no clouds");
  add("rate", po::value(&a.rate)->default_value(a.rate), "key poses per second; 0: as fast as it goes");
  unnamed.add_options()("file", po::value(&a.path)->required(), "");
  if (!mapping_common::parseArguments(argc, argv, kUsage, options, unnamed)) return false;
  if (a.poses < 1 || a.beams < 3 || a.rings < 0 || !(a.rate >= 0.0))
    throw po::error("allowed are --poses from 1, --beams from 3, --rings and --rate from 0");
  if (std::ifstream(a.path)) throw po::error(a.path + " is there already");
  return true;
}

// Both of this process.
struct Times {
  double processor = 0.0, wall = 0.0;  // s
};
Times now() {
  rusage usage{};
  getrusage(RUSAGE_SELF, &usage);
  const auto seconds = [](const timeval& t) {
    return static_cast<double>(t.tv_sec) + 1e-6 * static_cast<double>(t.tv_usec);
  };
  return {seconds(usage.ru_utime) + seconds(usage.ru_stime),
          std::chrono::duration<double>(Clock::now().time_since_epoch()).count()};
}

void print(const char* what, const Times& start, int count, const std::string& more = "") {
  const Times end = now();
  std::printf("%-22s %8.3f s of processor time, %8.3f s, %8.3f ms each%s%s\n", what,
              end.processor - start.processor, end.wall - start.wall,
              1e3 * (end.processor - start.processor) / count, more.empty() ? "" : "; ", more.c_str());
}

// A hall with walls at +-15 and +-10 m, and noise of 1 cm.
class Hall {
 public:
  // m, from a point along a direction
  double range(const Pose& pose, double angle) {
    const double heading = pose.yaw() + angle, dx = std::cos(heading), dy = std::sin(heading);
    const double to_x = ((dx > 0.0 ? 15.0 : -15.0) - pose.translation.x()) / dx,
                 to_y = ((dy > 0.0 ? 10.0 : -10.0) - pose.translation.y()) / dy;
    return std::min(to_x, to_y) + 0.01 * normal_(random_);
  }
  float reflectivity() { return static_cast<float>(0.5 + 0.05 * normal_(random_)); }

 private:
  std::mt19937 random_{1};
  std::normal_distribution<double> normal_;
};

void run(const Arguments& a) {
  Hall hall;
  const auto pose_of = [&](int i) {
    const double way = 0.05 * i;
    return planarPose(9.0 * std::cos(way), 5.0 * std::sin(way), way + M_PI / 2.0);
  };
  std::vector<KeyData> all;
  for (int i = 0; i < a.poses; ++i) {
    intensity_hector_slam::Scan scan;
    rtree_occupancy_map::Scan cloud;
    scan.stamp = cloud.time = 0.5 * i;
    for (int k = 0; k < a.beams; ++k) {
      const double angle = -2.35 + 4.7 * k / a.beams, range = hall.range(pose_of(i), angle);
      const Eigen::Vector2d end = range * Eigen::Vector2d(std::cos(angle), std::sin(angle));
      scan.points.push_back(end.cast<float>());
      scan.reflectivities.push_back(hall.reflectivity());
      for (int ring = 0; ring < a.rings; ++ring) {
        const double height = range * std::tan(0.035 * (ring - 0.5 * a.rings)) + 0.005 * hall.reflectivity();
        cloud.hits.emplace_back(end.x(), end.y(), height);
        cloud.reflectivity.push_back(hall.reflectivity());
      }
    }
    all.push_back(toKeyData(scan));
    all.back().key_pose = i;
    if (a.rings == 0) continue;
    all.push_back(toKeyData(cloud));
    all.back().key_pose = i;
  }
  std::printf("%d key poses, scans of %d points, clouds of %d\n", a.poses, a.beams, a.beams * a.rings);

  Times start = now();
  {
    SessionWriter writer(a.path, true);
    writer.beginRun(0, "benchmark");
    std::size_t next = 0;
    double longest_put = 0.0;
    for (int i = 0; i < a.poses; ++i) {
      const auto begin = Clock::now();
      writer.put(KeyPose{i, 0, i * 500'000'000LL, pose_of(i), pose_of(i), false});
      if (i > 0) {
        SessionEdge edge;
        edge.id = i;
        edge.from = i - 1, edge.to = i;
        edge.transform = pose_of(i - 1).inverse() * pose_of(i);
        writer.put(edge);
      }
      for (; next < all.size() && all[next].key_pose == i; ++next) writer.put(std::move(all[next]));
      longest_put = std::max(longest_put, std::chrono::duration<double>(Clock::now() - begin).count());
      if (a.rate > 0.0) std::this_thread::sleep_for(std::chrono::duration<double>(1.0 / a.rate));
      if (writer.status().waiting_bytes > (std::size_t{64} << 20)) writer.flush();
    }
    writer.flush();
    char text[100];
    std::snprintf(text, sizeof(text), "longest call %.3f ms, longest commit %.1f ms", 1e3 * longest_put,
                  1e3 * writer.status().longest_commit);
    print("written", start, a.poses, text);
  }

  const Session session(a.path);
  for (const auto& [kind, amount] : session.amounts())
    std::printf("%ss: %.1f kB each, %.1f kB in the file\n", mapping_common::nameOf(kind).c_str(),
                1e-3 * amount.bytes / amount.count, 1e-3 * amount.stored_bytes / amount.count);
  start = now();
  Graph graph = readGraph(session).graph;
  print("graph read", start, a.poses);
  start = now();
  for (const DataKind kind : {DataKind::kScan, DataKind::kCloud})
    session.visitData(kind, [](KeyData&&) { return true; });
  print("data read", start, a.poses);
  start = now();
  const auto grid = buildGridMap(session, graph, {});
  print("2D map", start, a.poses);
  start = now();
  const std::string grid_bytes = grid->map.toBytes();
  print("  as bytes", start, 1, std::to_string(grid_bytes.size()) + " bytes");
  start = now();
  const auto occupancy = buildOccupancyMap(session, graph, {});
  print("R-tree map", start, a.poses);
  start = now();
  const std::string occupancy_bytes = occupancy->map.toBytes();
  print("  as bytes", start, 1, std::to_string(occupancy_bytes.size()) + " bytes");
  start = now();
  buildCloud(session, graph, 0.1);
  print("cloud, voxels of 0.1 m", start, a.poses);
}

}  // namespace

int main(int argc, char** argv) {
  return mapping_common::runTool(argc, argv, "session_benchmark", kUsage, parse, run);
}
