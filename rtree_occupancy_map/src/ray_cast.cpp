// SPDX-License-Identifier: BSD-3-Clause
#include <algorithm>
#include <cmath>
#include <limits>
#include <stdexcept>
#include <utility>
#include <vector>

#include "rolling_window.h"
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
  const auto visit = [&](const Cell& cell, double distance) {
    if (!ignore_unknown && distance > known + kGap) return false;
    if (isOccupied(cell)) {
      hit.result = RayHit::Result::kOccupied;
      hit.cell = cell;
      end = distance;
      return false;
    }
    known = std::max(known, ray.inside(cell.box).exit);
    return true;
  };
  const RTree& tree = treeWhere([&ray](const VoxelBox& block) { return !ray.inside(block).empty(); });
  if (!window_) {
    tree.visitAlong(ray, ignore_unknown, visit);
  } else {
    // Blocks don't overlap: between those outside of the window, one after the other, are those inside.
    bool goes_on = true;
    double from = 0.0;
    const auto visitInside = [&](double to) {
      const auto enter = [&](const VoxelBox& box) {
        const Ray::Interval t = ray.inside(box);
        return t.empty() || t.exit <= from || t.enter >= to ? std::numeric_limits<double>::infinity()
                                                            : t.enter;
      };
      tree.visitByDistance(ignore_unknown, enter, [&](const Cell& cell, double distance) {
        return distance < from || (goes_on = visit(cell, distance));
      });
    };
    const auto visitOutside = [&](const Cell& block, double enter) {
      visitInside(enter);
      from = enter;
      if (!goes_on) return false;
      std::vector<std::pair<double, const Cell*>> along;
      const Voxel corner = {block.box.min[0], block.box.min[1], block.box.min[2]};
      const RollingWindow::Cells cells = window_->cellsOf(blockOf(corner));
      for (const Cell& cell : *cells) {
        const Ray::Interval t = ray.inside(cell.box);
        if (!t.empty() && (!ignore_unknown || isOccupied(cell))) along.emplace_back(t.enter, &cell);
      }
      std::sort(along.begin(), along.end());
      goes_on = std::all_of(along.begin(), along.end(),
                            [&](const auto& at) { return visit(*at.second, at.first); });
      return goes_on;
    };
    window_->outside().visitAlong(ray, ignore_unknown, visitOutside);
    if (goes_on) visitInside(std::numeric_limits<double>::infinity());
  }
  if (!ignore_unknown && hit.result == RayHit::Result::kNothing && known < length - kGap) {
    hit.result = RayHit::Result::kUnknown;
    end = known;
  }
  hit.point = ray.at(end) * options_.resolution;
  return hit;
}

}  // namespace rtree_occupancy_map
