// SPDX-License-Identifier: BSD-3-Clause
//
// What is kept of a scan to measure the pose of another one by: small patches of its surfaces, and how far it
// saw.
#pragma once

#include <mapping_common/options.h>
#include <pcl/kdtree/kdtree_flann.h>

#include <cstdint>
#include <vector>

#include "intensity_place_recognition/panorama.h"

namespace intensity_place_recognition {

struct ShapeOptions {
  static constexpr double kFarthest = 200.0;  ///< m, which bounds what grids of patches take
  double voxel = 0.5, radius = 50.0;
  int upright = 2500, level = 1000;

  void describe(mapping_common::OptionList& o) {
    o("voxel", voxel, "m", "size of a patch of surface").within(0.02, 10.0);
    o("radius", radius, "m", "patches farther away aren't kept").within(1.0, kFarthest);
    o("upright", upright, "", "at most so many patches of walls, poles and plants").within(50, 100000);
    o("level", level, "", "at most so many of the ground and the like").within(0, 100000);
  }
};

struct Patch {
  Eigen::Vector3f point, normal;  ///< sensor frame, m
  float intensity = 0.0f;         ///< rank among patches of like range, incidence and slope, -0.5 to 0.5
  float flatness = 0.0f;          ///< 0 to 1; 1: a plane
  bool isLevel() const { return std::abs(normal.z()) > 0.7f && flatness > 0.5f; }
};

class Shape {
 public:
  Shape() = default;
  Shape(const Cloud& cloud, const Panorama& panorama, const ShapeOptions& options);

  const std::vector<Patch>& patches() const { return patches_; }
  /// Whether the sensor saw past a point, at least `margin` (m) behind it, in all directions near it.
  bool seesThrough(const Eigen::Vector3f& point, float margin) const;

  /// What was read from a file may not be.
  bool isSound() const;

  template <class Archive>
  void transfer(Archive& archive) {
    archive(patches_);
    archive(rows_);
    archive(columns_);
    archive(lowest_);
    archive(highest_);
    archive(nearest_);
  }

 private:
  std::vector<Patch> patches_;
  int rows_ = 0, columns_ = 0;
  float lowest_ = 0.0f, highest_ = 0.0f;  // rad, elevations
  std::vector<std::uint16_t> nearest_;    // cm, a panorama of coarse pixels; 0: nothing seen
};

}  // namespace intensity_place_recognition
