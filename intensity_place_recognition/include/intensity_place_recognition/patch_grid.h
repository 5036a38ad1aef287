// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstdint>
#include <vector>

#include "intensity_place_recognition/block_grid.h"
#include "intensity_place_recognition/shape.h"

namespace intensity_place_recognition {

/// The patches of a scan by the cubes that they are in. It refers to the shape.
class PatchGrid {
 public:
  explicit PatchGrid(const Shape& shape);
  /// The nearest patch, nullptr: none within `reach`, which is at most kCell.
  const Patch* nearest(const Eigen::Vector3f& point, float reach) const;

  static constexpr float kCell = 0.5f;  // m

 private:
  const Shape* shape_;
  Eigen::Vector3f origin_ = Eigen::Vector3f::Zero();
  Eigen::Vector3i size_ = Eigen::Vector3i::Zero();  // with an empty cell around
  BlockGrid grid_;
  std::vector<std::int32_t> first_, next_;  // of each cell; after each patch; -1: none
};

/// Which patch is about the nearest to any point, from a grid of all answers.
class PatchField {
 public:
  explicit PatchField(const Shape& shape);
  /// nullptr: none within about kReach. Of several about as near any.
  const Patch* nearest(const Eigen::Vector3f& point) const {
    const Eigen::Vector3f at = (point - origin_) / kCell;
    if (!((at.array() >= 0.0f).all() && (at.array() < size_.cast<float>().array()).all())) return nullptr;
    const std::uint16_t found =
        index_[grid_.slot(static_cast<int>(at.x()), static_cast<int>(at.y()), static_cast<int>(at.z()))];
    return found == kNone ? nullptr : &shape_->patches()[found];
  }

  static constexpr float kCell = 0.5f, kReach = 1.3f;  // m

 private:
  const Shape* shape_;
  Eigen::Vector3f origin_ = Eigen::Vector3f::Zero();
  Eigen::Vector3i size_ = Eigen::Vector3i::Zero();
  BlockGrid grid_;
  static constexpr std::uint16_t kNone = 0xffff;
  std::vector<std::uint16_t> index_;  // of the patch
};

}  // namespace intensity_place_recognition
