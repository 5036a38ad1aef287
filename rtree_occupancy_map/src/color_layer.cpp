// SPDX-License-Identifier: BSD-3-Clause
#include "color_layer.h"

#include <algorithm>

namespace rtree_occupancy_map {

std::optional<Color> BlockColors::meanIn(const VoxelBox& box) const {
  std::array<std::uint32_t, 3> sum{};
  std::uint32_t count = 0;
  auto from = voxels_.begin();
  for (int y = box.min[1]; y < box.max[1]; ++y) {
    for (int x = box.min[0]; x < box.max[0]; ++x) {
      const int row = (y * kBlockSize + x) * kBlockSize;
      from = std::lower_bound(from, voxels_.end(), row + box.min[2]);
      for (; from != voxels_.end() && *from < row + box.max[2]; ++from, ++count) {
        const Color mean = colors_[static_cast<std::size_t>(from - voxels_.begin())].mean();
        for (int i = 0; i < 3; ++i) sum[i] += mean[i];
      }
    }
  }
  if (count == 0) return std::nullopt;
  return ColorSum{sum, count}.mean();
}

bool BlockColors::update(const std::vector<Entry>& seen, const BlockRows& occupied) {
  const auto isOccupied = [&occupied](Index voxel) {
    return (occupied[voxel / kBlockSize] >> voxel % kBlockSize & 1) != 0;
  };
  bool changed = false;
  // What there is stays in its place, mostly.
  std::size_t kept = 0, fresh = 0;
  auto next = seen.begin();
  std::vector<Entry> others;  // voxels that had no colour yet
  const auto addOther = [&](const Entry& entry) {
    if (!isOccupied(entry.voxel)) return;
    if (others.empty() || others.back().voxel != entry.voxel) {
      others.push_back(entry);
    } else {
      others.back().color.add(entry.color);
    }
  };
  for (std::size_t i = 0; i < voxels_.size(); ++i) {
    const Index voxel = voxels_[i];
    for (; next != seen.end() && next->voxel < voxel; ++next) addOther(*next);
    if (!isOccupied(voxel)) {
      changed = true;
      while (next != seen.end() && next->voxel == voxel) ++next;
      continue;
    }
    ColorSum color = colors_[i];
    if (next != seen.end() && next->voxel == voxel) {
      for (; next != seen.end() && next->voxel == voxel; ++next) color.add(next->color);
      changed |= color.mean() != colors_[i].mean();
    }
    voxels_[kept] = voxel;
    colors_[kept++] = color;
  }
  for (; next != seen.end(); ++next) addOther(*next);
  fresh = others.size();
  voxels_.resize(kept + fresh);
  colors_.resize(kept + fresh);
  // From behind, so that nothing is overwritten before it has moved.
  for (std::size_t to = kept + fresh; fresh > 0;) {
    --to;
    if (kept > 0 && voxels_[kept - 1] > others[fresh - 1].voxel) {
      --kept;
      voxels_[to] = voxels_[kept];
      colors_[to] = colors_[kept];
    } else {
      --fresh;
      voxels_[to] = others[fresh].voxel;
      colors_[to] = others[fresh].color;
    }
  }
  return changed || !others.empty();
}

void ColorLayer::keep(const Block& block, const BlockRows& occupied) {
  const auto found = blocks_.find(block);
  if (found == blocks_.end()) return;
  found->second.update({}, occupied);
  if (found->second.empty()) blocks_.erase(found);
}

void ColorLayer::forgetEmpty(const Block& block) {
  const auto found = blocks_.find(block);
  if (found != blocks_.end() && found->second.empty()) blocks_.erase(found);
}

std::size_t ColorLayer::memoryUsage() const {
  std::size_t bytes = 0;
  for (const auto& [block, colors] : blocks_)
    bytes += sizeof(block) + 4 * sizeof(void*) + colors.memoryUsage();
  return bytes;
}

}  // namespace rtree_occupancy_map
