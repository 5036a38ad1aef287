// SPDX-License-Identifier: BSD-3-Clause
#include <cmath>
#include <limits>
#include <stdexcept>

#include "rtree_occupancy_map/occupancy_map.h"

namespace rtree_occupancy_map {
namespace {

constexpr double kInfinity = std::numeric_limits<double>::infinity();
// In voxels: neighbouring cells share their border, so whatever is between them is rounding.
constexpr double kGap = 1e-6;

struct Interval {
  double enter, exit;
  bool empty() const { return !(enter < exit); }
};

// Slab method. In voxel units; the direction has unit length, so distances along the ray are in voxels as
// well.
class Ray {
 public:
  Ray(const Eigen::Vector3d& origin, const Eigen::Vector3d& direction, double length)
      : origin_(origin), direction_(direction), length_(length) {}

  Interval inside(const VoxelBox& box) const {
    Interval t{0.0, length_};
    for (int i = 0; i < 3; ++i) {
      if (direction_[i] == 0.0) {
        if (origin_[i] < box.min[i] || origin_[i] >= box.max[i]) return {1.0, 0.0};
        continue;
      }
      const double a = (box.min[i] - origin_[i]) / direction_[i],
                   b = (box.max[i] - origin_[i]) / direction_[i];
      t.enter = std::max(t.enter, std::min(a, b));
      t.exit = std::min(t.exit, std::max(a, b));
    }
    return t;
  }
  Eigen::Vector3d at(double t) const { return origin_ + t * direction_; }

 private:
  Eigen::Vector3d origin_, direction_;
  double length_;
};

}  // namespace

RayHit OccupancyMap::castRay(const Eigen::Vector3d& origin, const Eigen::Vector3d& direction,
                             double max_range, bool ignore_unknown) const {
  if (!origin.allFinite() || !direction.allFinite() || direction.norm() == 0.0 || !(max_range > 0.0)) {
    throw std::invalid_argument("a ray needs a finite origin, a direction with a length and a range above 0");
  }
  // No cell is further than this from an origin inside of the map, and infinity doesn't go well with the sums
  // below.
  const double diagonal = 2.0 * (kMaxVoxel - kMinVoxel);
  const double length =
      std::min(max_range / options_.resolution, diagonal + (origin / options_.resolution).norm());
  const Ray ray(origin / options_.resolution, direction.normalized(), length);

  RayHit hit;
  double known = 0.0;  // up to here the ray ran through known space
  double end = length;
  const auto enter = [&ray](const VoxelBox& box) {
    const Interval t = ray.inside(box);
    return t.empty() ? kInfinity : t.enter;
  };
  tree_.visitByDistance(ignore_unknown, enter, [&](const Cell& cell, double distance) {
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
  hit.point = hit.result == RayHit::Result::kNothing
                  ? Eigen::Vector3d(origin + max_range * direction.normalized())
                  : Eigen::Vector3d(ray.at(end) * options_.resolution);
  return hit;
}

}  // namespace rtree_occupancy_map
