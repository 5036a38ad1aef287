// SPDX-License-Identifier: BSD-3-Clause
#include "rtree_occupancy_map/ros/map_correction.h"

#include <utility>

namespace rtree_occupancy_map {
namespace {

Eigen::Isometry3d correctedMotion(const mapping_common::CorrectedMaps::Map& corrected,
                                  const RecentScans::Entry& entry) {
  if (entry.stamp >= corrected.corrected_from) return entry.value.moved;
  return corrected.correction * entry.value.moved;
}

}  // namespace

void keep(Scan&& scan, RecentScans& recent) {
  const double stamp = scan.time;
  const std::size_t bytes =
      sizeof(Scan) + sizeof(float) * scan.reflectivity.size() + sizeof(Color) * scan.colors.size() +
      sizeof(Eigen::Vector3f) *
          (scan.hits.size() + scan.misses.size() + scan.hit_origins.size() + scan.miss_origins.size());
  recent.add(stamp, bytes, {recent.keeps() ? std::make_shared<const Scan>(std::move(scan)) : nullptr});
}

OccupancyMap readCorrected(const mapping_common::CorrectedMaps::Map& corrected, const Options& options) {
  OccupancyMap map = OccupancyMap::fromBytes(corrected.begin, corrected.end, "its data", options);
  requireLike(map.options(), options);
  map.setRange(options.min_range, options.max_range);
  map.setColor(options.color);
  return map;
}

void insertAll(const std::vector<RecentScans::Entry>& scans,
               const mapping_common::CorrectedMaps::Map& corrected, OccupancyMap& map) {
  for (const auto& entry : scans)
    map.insertScan(transformed(*entry.value.scan, correctedMotion(corrected, entry)));
}

void correctAll(const mapping_common::CorrectedMaps::Map& corrected, RecentScans& recent) {
  for (auto& entry : recent.entries()) entry.value.moved = correctedMotion(corrected, entry);
}

}  // namespace rtree_occupancy_map
