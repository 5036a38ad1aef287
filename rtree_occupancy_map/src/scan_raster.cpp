// SPDX-License-Identifier: BSD-3-Clause
#include "scan_raster.h"

#include <cmath>
#include <cstring>

namespace rtree_occupancy_map {
namespace {

// A voxel's place in its block in one integer: z | x << 6 | y << 12. The bit above each coordinate's five is set when
// a step leaves the block. code >> 6 is the word in Mask::words, code & 31 the bit.
constexpr int kShift[3] = {6, 12, 0};
constexpr int kOutside = 1 << 5 | 1 << 11 | 1 << 17;

// Distances along a beam are counted in voxels with 42 fractional bits: exact sums, and a comparison takes one cycle.
constexpr double kFixedPoint = 1LL << 42;
constexpr std::int64_t kNever = std::int64_t{1} << 61;

std::int64_t toFixed(double voxels) {
  return voxels < static_cast<double>(kNever) / kFixedPoint ? static_cast<std::int64_t>(voxels * kFixedPoint) : kNever;
}

}  // namespace

void ScanRaster::start(const Eigen::Vector3f& origin) {
  origin_ = origin;
  toVoxel(origin, 1.0 / resolution_, origin_voxel_);
  blocks_.clear();
  if (table_.empty()) table_.resize(1 << 10);
  std::fill(table_.begin(), table_.end(), Bucket());
  last_hit_mask_ = nullptr;
}

std::uint32_t ScanRaster::slotOf(const Block& block) {
  const std::uint64_t k = key(block);
  const std::size_t last = table_.size() - 1;
  std::size_t i = (k * 0x9e3779b97f4a7c15ULL >> 20) & last;
  while (table_[i].key != k) {
    if (table_[i].key == kFree) {
      if (2 * (blocks_.size() + 1) > table_.size()) {
        grow();
        return slotOf(block);
      }
      const auto slot = static_cast<std::uint32_t>(blocks_.size());
      table_[i] = {k, slot};
      blocks_.push_back(block);
      if (masks_.size() < blocks_.size()) masks_.emplace_back(new Mask);
      std::memset(masks_[slot].get(), 0, sizeof(Mask));
      return slot;
    }
    i = (i + 1) & last;
  }
  return table_[i].slot;
}

void ScanRaster::grow() {
  std::vector<Bucket> old(2 * table_.size());
  old.swap(table_);
  for (const Bucket& b : old) {
    if (b.key == kFree) continue;
    std::size_t i = (b.key * 0x9e3779b97f4a7c15ULL >> 20) & (table_.size() - 1);
    while (table_[i].key != kFree) i = (i + 1) & (table_.size() - 1);
    table_[i] = b;
  }
}

bool ScanRaster::markHit(const Voxel& v) {
  const Block block = OccupancyMap::blockOf(v);
  if (last_hit_mask_ == nullptr || block != last_hit_block_) {
    last_hit_mask_ = masks_[slotOf(block)].get();
    last_hit_block_ = block;
  }
  std::uint32_t& word = last_hit_mask_->words[v[1] & 31][kBlockSize + (v[0] & 31)];
  const std::uint32_t bit = 1u << (v[2] & 31);
  const bool first = (word & bit) == 0;
  word |= bit;
  return first;
}

// Amanatides and Woo 1987: always step over the nearest border. The number of steps to the end voxel is known, so
// that rounding can't lead the beam past it.
void ScanRaster::traceBeam(const Voxel& end, const Eigen::Vector3f& end_point) {
  Eigen::Vector3f direction = end_point - origin_;
  direction /= static_cast<float>(std::sqrt(static_cast<double>(direction.x() * direction.x() + direction.y() * direction.y() +
                                                                direction.z() * direction.z())));
  int steps = 0;
  std::int64_t next[3], delta[3];  // distance to the next border, and from border to border
  int offset[3];                   // of the code, for a step
  for (int i = 0; i < 3; ++i) {
    steps += std::abs(end[i] - origin_voxel_[i]);
    const int sign = end[i] > origin_voxel_[i] ? 1 : -1;
    offset[i] = sign * (1 << kShift[i]);
    if (end[i] == origin_voxel_[i]) {  // no border to cross
      next[i] = delta[i] = kNever;
      continue;
    }
    const double border = (origin_voxel_[i] + 0.5) * resolution_ + static_cast<float>(sign * resolution_ * 0.5);
    next[i] = toFixed((border - origin_[i]) / direction[i] / resolution_);
    delta[i] = toFixed(1.0 / std::abs(static_cast<double>(direction[i])));
  }

  Block block = OccupancyMap::blockOf(origin_voxel_);
  std::uint32_t* words = &masks_[slotOf(block)]->words[0][0];
  int code = (origin_voxel_[0] & 31) << kShift[0] | (origin_voxel_[1] & 31) << kShift[1] | (origin_voxel_[2] & 31);
  std::int64_t tx = next[0], ty = next[1], tz = next[2];
  for (; steps > 0; --steps) {
    words[code >> 6] |= 1u << (code & 31);
    // Without branches: which border comes next is as good as random.
    const std::int64_t x = -static_cast<std::int64_t>((tx < ty) & (tx < tz));
    const std::int64_t y = -static_cast<std::int64_t>(ty < tz) & ~x;
    const std::int64_t z = ~(x | y);
    tx += delta[0] & x;
    ty += delta[1] & y;
    tz += delta[2] & z;
    const int step = (offset[0] & static_cast<int>(x)) | (offset[1] & static_cast<int>(y)) | (offset[2] & static_cast<int>(z));
    const int before = code;
    code += step;
    if ((code & kOutside) == 0) continue;
    const int axis = x ? 0 : y ? 1 : 2;
    const int field = 31 << kShift[axis];
    block[axis] += step > 0 ? 1 : -1;
    code = (before & ~field) | (step > 0 ? 0 : field);
    if (steps > 1) words = &masks_[slotOf(block)]->words[0][0];
  }
}

}  // namespace rtree_occupancy_map
