// SPDX-License-Identifier: BSD-3-Clause
//
// What is kept of a scan to measure the pose of another one by: small patches of its surfaces, and how far it
// saw.
#pragma once

#include <mapping_common/options.h>

#include <Eigen/Core>
#include <algorithm>
#include <cmath>
#include <cstddef>
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
    o("upright", upright, "", "at most so many patches of walls, poles and plants").within(50, 50000);
    o("level", level, "", "at most so many of the ground and the like").within(0, 15000);
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
  friend class PackedShape;
  std::vector<Patch> patches_;
  int rows_ = 0, columns_ = 0;
  float lowest_ = 0.0f, highest_ = 0.0f;  // rad, elevations
  std::vector<std::uint16_t> nearest_;    // cm, a panorama of coarse pixels; 0: nothing seen
};

/// A shape as places keep it, in a quarter of the memory: patches in 64 bits each, to 3 mm and half a degree
/// where they are within 50 m, and ranges as they are, compressed. Patches that follow one another are from
/// everywhere, so that a few of them read little memory.
class PackedShape {
 public:
  PackedShape() = default;
  PackedShape(const Shape& shape);
  /// @throws std::runtime_error where its ranges are damaged, as those of a file may be
  Shape unpacked() const;

  /// Of patches, which are in kGroups groups of about as many, one after the other; each is evenly from all,
  /// as are some that follow one another.
  std::size_t size() const { return patches_.size(); }
  static constexpr std::size_t kGroups = 24;

  Eigen::Vector3f point(std::size_t i) const {
    const std::uint64_t p = patches_[i];
    return Eigen::Vector3f(static_cast<float>(p & kMask), static_cast<float>(p >> 14 & kMask),
                           static_cast<float>(p >> 28 & kHeightMask))
               .cwiseProduct(step_) +
           lowest_point_;
  }
  /// Upward: which side of it is seen isn't kept.
  Eigen::Vector3f normal(std::size_t i) const {
    // The upper half of an octahedron (Cigolle et al. 2014, hemi-oct).
    const float u = static_cast<float>(patches_[i] >> 40 & 127) / kNormalSteps - 1.0f,
                v = static_cast<float>(patches_[i] >> 47 & 127) / kNormalSteps - 1.0f;
    const float x = 0.5f * (u + v), y = 0.5f * (u - v);
    return Eigen::Vector3f(x, y, std::max(0.0f, 1.0f - std::abs(x) - std::abs(y))).normalized();
  }
  float intensity(std::size_t i) const {
    return static_cast<float>(patches_[i] >> 54 & 63) / kIntensitySteps - 0.5f;
  }
  float flatness(std::size_t i) const { return static_cast<float>(patches_[i] >> 60 & 7) / kFlatnessSteps; }
  bool isLevel(std::size_t i) const { return patches_[i] >> 63 != 0; }

  /// That it takes in memory.
  std::size_t bytes() const;

  template <class Archive>
  void transfer(Archive& archive) {
    archive(patches_);
    archive(lowest_point_);
    archive(step_);
    archive(rows_);
    archive(columns_);
    archive(lowest_);
    archive(highest_);
    archive(ranges_);
  }

 private:
  static constexpr std::uint64_t kMask = (1u << 14) - 1, kHeightMask = (1u << 12) - 1;
  static constexpr float kNormalSteps = 63.0f;  // from 0 to 1
  static constexpr float kIntensitySteps = 62.0f, kFlatnessSteps = 7.0f;
  // From the lowest bit: 14 of x, 14 of y, 12 of z, 7 and 7 of the normal, 6 of the intensity, 3 of the
  // flatness, 1 of what is level.
  std::vector<std::uint64_t> patches_;
  Eigen::Vector3f lowest_point_ = Eigen::Vector3f::Zero(), step_ = Eigen::Vector3f::Zero();
  int rows_ = 0, columns_ = 0;
  float lowest_ = 0.0f, highest_ = 0.0f;
  std::vector<std::uint8_t> ranges_;  // zlib's, of each range's difference to the one before it
};

}  // namespace intensity_place_recognition
