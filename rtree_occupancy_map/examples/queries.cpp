// SPDX-License-Identifier: BSD-3-Clause
//
// One short example of each query, on a small map of a room of its own or on one from a file.
#include <cmath>
#include <cstdio>
#include <exception>
#include <limits>
#include <string>

#include "rtree_occupancy_map/occupancy_map.h"

using rtree_occupancy_map::Cell;
using rtree_occupancy_map::OccupancyMap;
using rtree_occupancy_map::Options;
using rtree_occupancy_map::RayHit;
using rtree_occupancy_map::Scan;
using rtree_occupancy_map::Statistics;

namespace {

// Scans of a room of 6 m x 4 m x 3 m, from its middle.
OccupancyMap mapOfARoom() {
  Options options;
  options.resolution = 0.1;
  OccupancyMap map(options);
  const Eigen::Vector3f size(6.0F, 4.0F, 3.0F), origin = 0.5F * size;
  Scan scan;
  scan.origin = origin;
  for (double elevation = -1.5; elevation <= 1.5; elevation += 0.02) {
    for (double azimuth = 0.0; azimuth < 6.28; azimuth += 0.02) {
      const Eigen::Vector3f direction(static_cast<float>(std::cos(elevation) * std::cos(azimuth)),
                                      static_cast<float>(std::cos(elevation) * std::sin(azimuth)),
                                      static_cast<float>(std::sin(elevation)));
      const float range = (0.5F * size.array() / direction.array().abs()).minCoeff();
      scan.hits.emplace_back(origin + range * direction);
    }
  }
  for (int i = 0; i < 10; ++i) map.insertScan(scan);
  return map;
}

void query(const OccupancyMap& map) {
  const Eigen::Vector3d here(3.0, 2.0, 1.5);

  // The cell at a point.
  const char* const states[] = {"unknown", "free", "occupied"};
  std::printf("here it is %s\n", states[static_cast<int>(map.stateAt(here))]);
  if (const auto cell = map.cellAt(here)) {
    std::printf("  in a cell of %d x %d x %d voxels, occupied with probability %.2f\n", cell->box.width(0),
                cell->box.width(1), cell->box.width(2), OccupancyMap::probability(cell->log_odds));
  }

  // The cells in a box.
  int in_box = 0;
  map.visitBox({2.0, 1.0, 0.5}, {4.0, 3.0, 2.5}, [&in_box](const Cell&) { return ++in_box > 0; });
  std::printf("%d cells overlap the box\n", in_box);

  // The occupied cells alone. Free ones aren't touched.
  int occupied = 0;
  double highest = -std::numeric_limits<double>::infinity();
  map.visitOccupied([&](const Cell& cell) {
    ++occupied;
    highest = std::max(highest, map.maxCorner(cell.box).z());
    return true;  // false stops
  });
  std::printf("%d occupied cells, the highest up to z = %.1f m\n", occupied, highest);

  // A ray.
  const RayHit hit = map.castRay(here, {1.0, 0.0, 0.0}, /*max_range=*/20.0, /*ignore_unknown=*/false);
  if (hit.result == RayHit::Result::kOccupied)
    std::printf("ahead is something at x = %.2f m\n", hit.point.x());

  // The k nearest occupied cells.
  for (const Cell& cell : map.nearestOccupied(here, 3)) {
    const Eigen::Vector3d center = map.center(cell.box);
    std::printf("near: %.2f %.2f %.2f\n", center.x(), center.y(), center.z());
  }

  // Volumes.
  const Statistics s = map.statistics();
  std::printf("%.2f m^3 occupied, %.2f m^3 free, in %zu cells, %zu nodes, %zu bytes\n", s.occupied_volume,
              s.free_volume, s.cells, s.nodes, s.memory_bytes);
}

}  // namespace

int main(int argc, char** argv) {
  const std::string argument = argc > 1 ? argv[1] : "";
  if (argc > 2 || (!argument.empty() && argument[0] == '-')) {
    const bool help = argument == "-h" || argument == "--help";
    std::fprintf(
        help ? stdout : stderr,
        "Usage: queries [FILE.map]\n\nAsks a map all that can be asked: that of a file, or of a room.\n");
    return help ? 0 : 2;
  }
  try {
    query(argument.empty() ? mapOfARoom() : OccupancyMap::load(argument));
    return 0;
  } catch (const std::exception& e) {
    std::fprintf(stderr, "queries: %s\n", e.what());
    return 1;
  }
}
