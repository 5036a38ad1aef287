// SPDX-License-Identifier: BSD-3-Clause
#include "intensity_place_recognition/patch_grid.h"

#include <algorithm>

namespace intensity_place_recognition {
namespace {

struct Box {
  Eigen::Vector3f low, high;
};

Box boxOf(const std::vector<Patch>& patches) {
  Box box{patches.front().point, patches.front().point};
  for (const Patch& p : patches) {
    box.low = box.low.cwiseMin(p.point);
    box.high = box.high.cwiseMax(p.point);
  }
  return box;
}

}  // namespace

PatchGrid::PatchGrid(const Shape& shape) : shape_(&shape) {
  const std::vector<Patch>& patches = shape.patches();
  if (patches.empty()) return;
  const Box box = boxOf(patches);
  origin_ = box.low.array() - kCell;
  size_ = ((box.high - origin_) / kCell).cast<int>().array() + 2;
  grid_ = BlockGrid(size_);
  first_.assign(grid_.slots(), -1);
  next_.resize(patches.size());
  for (std::size_t i = 0; i < patches.size(); ++i) {
    const Eigen::Vector3i cell = ((patches[i].point - origin_) / kCell).cast<int>();
    const std::size_t slot = grid_.makeSlot(cell.x(), cell.y(), cell.z());
    first_.resize(grid_.slots(), -1);
    std::int32_t& first = first_[slot];
    next_[i] = first;
    first = static_cast<std::int32_t>(i);
  }
}

const Patch* PatchGrid::nearest(const Eigen::Vector3f& point, float reach) const {
  const Eigen::Vector3f at = (point - origin_) / kCell;
  if (!((at.array() >= 0.0f).all() && (at.array() < size_.cast<float>().array()).all())) return nullptr;
  const Eigen::Vector3i cell = at.cast<int>(), first = (cell.array() - 1).max(0),
                        last = (cell.array() + 1).min(size_.array() - 1);
  float squared = reach * reach;
  const Patch* found = nullptr;
  for (int z = first.z(); z <= last.z(); ++z) {
    for (int y = first.y(); y <= last.y(); ++y) {
      for (int x = first.x(); x <= last.x(); ++x) {
        for (std::int32_t i = first_[grid_.slot(x, y, z)]; i >= 0; i = next_[i]) {
          const Patch& patch = shape_->patches()[i];
          const float distance = (patch.point - point).squaredNorm();
          if (distance >= squared) continue;
          squared = distance;
          found = &patch;
        }
      }
    }
  }
  return found;
}

PatchField::PatchField(const Shape& shape) : shape_(&shape) {
  const std::vector<Patch>& patches = shape.patches();
  if (patches.empty()) return;
  const Box box = boxOf(patches);
  origin_ = box.low.array() - kReach;
  size_ = (((box.high - origin_).array() + kReach) / kCell).cast<int>() + 1;
  grid_ = BlockGrid(size_);
  index_.assign(grid_.slots(), kNone);
  const float reach = kReach / kCell;
  std::vector<float> squared(grid_.slots());
  for (std::size_t i = 0; i < std::min<std::size_t>(kNone, patches.size()); ++i) {
    const Eigen::Vector3f at = (patches[i].point - origin_) / kCell - Eigen::Vector3f::Constant(0.5f);
    const Eigen::Vector3i first = (at.array() - reach).ceil().max(0.0f).cast<int>();
    const Eigen::Vector3i last = (at.array() + reach).floor().cast<int>().min(size_.array() - 1);
    for (int z = first.z(); z <= last.z(); ++z) {
      for (int y = first.y(); y <= last.y(); ++y) {
        const float dy = static_cast<float>(y) - at.y(), dz = static_cast<float>(z) - at.z();
        for (int x = first.x(); x <= last.x(); ++x) {
          const float dx = static_cast<float>(x) - at.x();
          const float distance = dx * dx + dy * dy + dz * dz;
          if (distance >= reach * reach) continue;
          const std::size_t slot = grid_.makeSlot(x, y, z);
          if (slot >= index_.size()) {
            index_.resize(grid_.slots(), kNone);
            squared.resize(grid_.slots(), reach * reach);
          }
          if (distance >= squared[slot]) continue;
          squared[slot] = distance;
          index_[slot] = static_cast<std::uint16_t>(i);
        }
      }
    }
  }
}

}  // namespace intensity_place_recognition
