// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>
#include <algorithm>

#include "rtree_occupancy_map/cell.h"

namespace rtree_occupancy_map {

/// A segment in voxel units that can be intersected with boxes (slab method).
class Ray {
 public:
  struct Interval {
    double enter, exit;  ///< distance along the ray, voxels
    bool empty() const { return !(enter < exit); }
  };

  /// @param direction of unit length, so that distances are voxels as well
  Ray(const Eigen::Vector3d& origin, const Eigen::Vector3d& direction, double length)
      : origin_(origin), direction_(direction), length_(length) {}

  /// Where the ray runs inside of the box; empty if it misses it, or touches no more than an edge or a
  /// corner.
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

  Eigen::Vector3d at(double distance) const { return origin_ + distance * direction_; }

 private:
  Eigen::Vector3d origin_, direction_;
  double length_;
};

}  // namespace rtree_occupancy_map
