// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>
#include <Eigen/Geometry>
#include <cstddef>
#include <utility>
#include <vector>

#include "rtree_occupancy_map/color.h"

namespace rtree_occupancy_map {

/// One scan in the map frame, metres.
struct Scan {
  double time = 0.0;                                 ///< s, when it was measured; for Options::decay_time
  Eigen::Vector3f origin = Eigen::Vector3f::Zero();  ///< where the beams start
  std::vector<Eigen::Vector3f> hits;  ///< where they were reflected; non-finite points are counted, not used
  std::vector<float> reflectivity;    ///< empty, or one value for each hit
  std::vector<Color> colors;          ///< the same
  std::vector<Eigen::Vector3f> misses;  ///< ends of beams without a return: they only clear
  /// Of a sensor that moved meanwhile: empty, or where the beam to each hit and to each miss starts. The
  /// fewer different ones follow each other, the better.
  std::vector<Eigen::Vector3f> hit_origins, miss_origins;
};

/// In another frame. @param transform to there
inline Scan transformed(Scan scan, const Eigen::Isometry3d& transform) {
  const Eigen::Isometry3f to = transform.cast<float>();
  scan.origin = to * scan.origin;
  for (auto* points : {&scan.hits, &scan.misses, &scan.hit_origins, &scan.miss_origins})
    for (Eigen::Vector3f& point : *points) point = to * point;
  return scan;
}

/// Takes the hits for which `is_meant(point)` is true out of a scan, with their beams. @return how many
template <class IsMeant>
std::size_t removeHits(const IsMeant& is_meant, Scan& scan) {
  std::size_t kept = 0;
  for (std::size_t i = 0; i < scan.hits.size(); ++i) {
    if (is_meant(scan.hits[i])) continue;
    scan.hits[kept] = scan.hits[i];
    if (!scan.reflectivity.empty()) scan.reflectivity[kept] = scan.reflectivity[i];
    if (!scan.colors.empty()) scan.colors[kept] = scan.colors[i];
    if (!scan.hit_origins.empty()) scan.hit_origins[kept] = scan.hit_origins[i];
    ++kept;
  }
  const std::size_t removed = scan.hits.size() - kept;
  scan.hits.resize(kept);
  if (!scan.reflectivity.empty()) scan.reflectivity.resize(kept);
  if (!scan.colors.empty()) scan.colors.resize(kept);
  if (!scan.hit_origins.empty()) scan.hit_origins.resize(kept);
  return removed;
}

}  // namespace rtree_occupancy_map
