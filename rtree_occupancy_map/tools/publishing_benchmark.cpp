// SPDX-License-Identifier: BSD-3-Clause
//
// What it takes to publish a large map after a scan: by what changed, and as a whole.
#include <mapping_common/tool.h>
#include <ros/serialization.h>
#include <rtree_occupancy_map/octomap_file.h>
#include <rtree_occupancy_map/ros/cell_conversion.h>
#include <rtree_occupancy_map/ros/marker_cache.h>
#include <rtree_occupancy_map/ros/octomap_message.h>
#include <rtree_occupancy_map/ros/projected_map.h>

#include <boost/program_options.hpp>
#include <cmath>
#include <cstdio>
#include <ctime>
#include <functional>
#include <limits>
#include <memory>
#include <random>
#include <string>
#include <vector>

namespace {

using namespace rtree_occupancy_map;

// Hills: height in voxels.
int heightAt(int x, int y) {
  return static_cast<int>(std::lround(8.0 + 3.0 * std::sin(0.02 * x) + 3.0 * std::cos(0.03 * y)));
}

// A voxel of ground in each column, of log odds that differ, and free space above it. Some are alike and
// fuse.
OccupancyMap makeMap(std::size_t cells) {
  const int edge = static_cast<int>(std::sqrt(static_cast<double>(cells) / 0.8)) / 2;
  std::mt19937 random(1);
  std::vector<Cell> all;
  for (int y = -edge; y < edge; ++y) {
    for (int x = -edge; x < edge; ++x) {
      Cell ground;
      ground.box = VoxelBox::unit({x, y, heightAt(x, y)});
      ground.log_odds = 0.4F * static_cast<float>(1 + random() % 8);
      all.push_back(ground);
    }
  }
  for (int y = -edge; y < edge; y += 8) {
    for (int x = -edge; x < edge; x += 8) {
      Cell free;
      free.box = {{{static_cast<std::int16_t>(x), static_cast<std::int16_t>(y), 16}},
                  {{static_cast<std::int16_t>(x + 8), static_cast<std::int16_t>(y + 8), 24}}};
      free.log_odds = -1.0F;
      all.push_back(free);
    }
  }
  return OccupancyMap::fromCells({}, all);
}

// Of 64 beams, up to 60 m away.
Scan makeScan(const OccupancyMap& map) {
  Scan scan;
  const double resolution = map.options().resolution;
  scan.origin = Eigen::Vector3d(0.1, 0.1, resolution * (heightAt(0, 0) + 10.5)).cast<float>();
  for (int ring = 0; ring < 64; ++ring) {
    for (int column = 0; column < 2000; ++column) {
      const double range = 2.0 + 58.0 * std::pow(ring / 63.0, 2), angle = 2.0 * M_PI * column / 2000;
      const int x = static_cast<int>(std::floor(range * std::cos(angle) / resolution)),
                y = static_cast<int>(std::floor(range * std::sin(angle) / resolution));
      scan.hits.push_back(
          (resolution * Eigen::Vector3d(x + 0.5, y + 0.5, heightAt(x, y) + 0.5)).cast<float>());
    }
  }
  return scan;
}

// Processor time.
double milliseconds(const std::function<void()>& work) {
  const std::clock_t start = std::clock();
  work();
  return 1e3 * static_cast<double>(std::clock() - start) / CLOCKS_PER_SEC;
}

template <class Message>
void serialize(const Message& message) {
  ros::serialization::serializeMessage(message);
}

void row(const char* what, double changed, double whole) {
  std::printf("| %-44s | %8.2f | %8.0f |\n", what, changed, whole);
}

struct Arguments {
  std::size_t cells = 10000000;
};

constexpr const char* kUsage = "Usage: publishing_benchmark [--cells N]\n";

bool parse(int argc, char** argv, Arguments& a) {
  namespace po = boost::program_options;
  po::options_description options("Options");
  options.add_options()("help,h", "print this")("cells", po::value(&a.cells)->default_value(a.cells),
                                                "of the map");
  if (!mapping_common::parseArguments(argc, argv, kUsage, options)) return false;
  if (a.cells < 1000 || a.cells > 100000000)
    throw po::error("--cells is out of range, allowed is 1000 to 1e8");
  return true;
}

void run(const Arguments& a) {
  OccupancyMap map = makeMap(a.cells);
  std::printf("%zu cells in %zu blocks, %.0f MiB\n\n", map.size(), knownBlocks(map).size(),
              static_cast<double>(map.memoryUsage()) / (1 << 20));
  MarkerCache occupied("map", MarkerCache::Show::kOccupied), free("map", MarkerCache::Show::kFree);
  OccupiedCloud cloud;
  Octree binary(OctomapFormat::kBinary), full(OctomapFormat::kFull);
  ProjectedMap projection;
  constexpr double kInfinity = std::numeric_limits<double>::infinity();
  const ColorScale colors;
  const MapSnapshot all(map);
  const double whole_snapshot = milliseconds([&] { const MapSnapshot again(map); });
  const double whole_occupied = milliseconds([&] { serialize(occupied.all(all, colors)); });
  const double whole_free = milliseconds([&] { serialize(free.all(all, colors)); });
  const double whole_cells = milliseconds([&] { serialize(occupiedCloud(all)); });
  const double whole_projection = milliseconds([&] {
    projection.rebuild(all, -kInfinity, kInfinity, 5000, {});
    serialize(projection.grid());
  });
  const auto octomap = [&](Octree& octree) {
    serialize(toMessage(octree.data(), octree.format(), octree.resolution(), {}));
  };
  const double whole_binary = milliseconds([&] { binary.update(all), octomap(binary); });
  const double whole_full = milliseconds([&] { full.update(all), octomap(full); });
  cloud.update(all);

  std::vector<Block> blocks;
  const double insertion = milliseconds([&] { blocks = map.insertScan(makeScan(map)).changed_blocks; });
  std::printf(
      "A scan of 64 x 2000 beams changed %zu blocks; its insertion "
      "took %.1f ms.\n\n",
      blocks.size(), insertion);
  std::printf("| %-44s | %8s | %8s |\n|---|---|---|\n", "processor time in ms, with serialisation", "changed",
              "whole");
  std::unique_ptr<MapSnapshot> changed;
  row("copy of the cells (while nobody inserts)",
      milliseconds([&] { changed = std::make_unique<MapSnapshot>(map, blocks); }), whole_snapshot);
  row("occupied_cells_vis_array", milliseconds([&] { serialize(occupied.changes(*changed, colors)); }),
      whole_occupied);
  row("free_cells_vis_array", milliseconds([&] { serialize(free.changes(*changed, colors)); }), whole_free);
  row("occupied_cells_centers_updates", milliseconds([&] { serialize(occupiedCloud(*changed)); }),
      whole_cells);
  row("projected_map_updates", milliseconds([&] {
        map_msgs::OccupancyGridUpdate patch;
        projection.update(*changed, {}, patch);
        serialize(patch);
      }),
      whole_projection);
  row("occupied_cells_centers, kept by blocks",
      milliseconds([&] { cloud.update(*changed), serialize(cloud.cloud()); }), whole_cells);
  row("octomap_binary, kept by blocks", milliseconds([&] { binary.update(*changed), octomap(binary); }),
      whole_binary);
  row("octomap_full, kept by blocks", milliseconds([&] { full.update(*changed), octomap(full); }),
      whole_full);
}

}  // namespace

int main(int argc, char** argv) {
  return mapping_common::runTool(argc, argv, "publishing_benchmark", kUsage, parse, run);
}
