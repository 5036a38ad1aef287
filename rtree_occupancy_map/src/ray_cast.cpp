// SPDX-License-Identifier: BSD-3-Clause
#include <cmath>
#include <stdexcept>

#include "rtree_occupancy_map/occupancy_map.h"
#include "rtree_occupancy_map/ray.h"

namespace rtree_occupancy_map {
namespace {

// In voxels: neighbouring cells share their border, so whatever is between them is rounding.
constexpr double kGap = 1e-6;

}  // namespace

RayHit OccupancyMap::castRay(const Eigen::Vector3d& origin, const Eigen::Vector3d& direction,
                             double max_range, bool ignore_unknown) const {
  if (!origin.allFinite() || !direction.allFinite() || direction.stableNorm() == 0.0 || !(max_range > 0.0)) {
    throw std::invalid_argument("a ray needs a finite origin, a direction with a length and a range above 0");
  }
  // No cell is further than this from an origin inside of the map, and infinity doesn't go well with the sums
  // below.
  const double diagonal = 2.0 * (kMaxVoxel - kMinVoxel);
  const double length =
      std::min(max_range / options_.resolution, diagonal + (origin / options_.resolution).norm());
  const Ray ray(origin / options_.resolution, direction.stableNormalized(), length);

  RayHit hit;
  double known = 0.0;  // up to here the ray ran through known space
  double end = length;
  const RTree& tree = treeWhere([&ray](const VoxelBox& block) { return !ray.inside(block).empty(); });
  tree.visitAlong(ray, ignore_unknown, [&](const Cell& cell, double distance) {
    if (!ignore_unknown && distance > known + kGap) return false;
    if (isOccupied(cell)) {
      hit.result = RayHit::Result::kOccupied;
      hit.cell = cell;
      end = distance;
      return false;
    }
    known = std::max(known, ray.inside(cell.box).exit);
    return true;
  });
  if (!ignore_unknown && hit.result == RayHit::Result::kNothing && known < length - kGap) {
    hit.result = RayHit::Result::kUnknown;
    end = known;
  }
  hit.point = ray.at(end) * options_.resolution;
  return hit;
}

}  // namespace rtree_occupancy_map
