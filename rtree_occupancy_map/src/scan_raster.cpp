// SPDX-License-Identifier: BSD-3-Clause
#include "scan_raster.h"

#include <cmath>
#include <cstring>

namespace rtree_occupancy_map {
namespace {

// A voxel's place in its block in one integer: z | x << 6 | y << 12. The bit above each coordinate's five is
// set when a step leaves the block. code >> 6 is the word in Mask::words, code & 31 the bit.
constexpr int kShift[3] = {6, 12, 0};
constexpr int kOutside = 1 << 5 | 1 << 11 | 1 << 17;

void mark(std::uint32_t* words, int code) {
  words[code >> 6] |= 1u << (code & 31);
}

}  // namespace

void ScanRaster::start(const Eigen::Vector3f& origin) {
  origin_ = origin;
  toVoxel(origin, 1.0 / resolution_, origin_voxel_);
  blocks_.clear();
  beams_.clear();
  if (table_.empty()) table_.resize(1 << 10);
  std::fill(table_.begin(), table_.end(), Bucket());
  last_hit_mask_ = nullptr;
  origin_words_ = &masks_[slotOf(OccupancyMap::blockOf(origin_voxel_))]->words[0][0];
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

// Beams side by side touch the same memory: sector by sector, the masks of a sector stay in the cache.
void ScanRaster::finish() {
  constexpr int kSectors = 256;
  const auto sectorOf = [this](const Beam& b) {
    const float x = b.end_point.x() - origin_.x(), y = b.end_point.y() - origin_.y();
    const float quarter =
        y / (std::abs(x) + std::abs(y) + 1e-9F);  // -1 to 1, monotonic from -90 to 90 degrees
    const int sector = static_cast<int>((quarter + 1.0F) * (kSectors / 4 - 1));
    return x >= 0.0F ? sector : kSectors - 1 - sector;
  };
  std::array<std::uint32_t, kSectors + 1> begin{};
  for (const Beam& b : beams_) ++begin[sectorOf(b) + 1];
  for (int i = 0; i < kSectors; ++i) begin[i + 1] += begin[i];
  sorted_beams_.resize(beams_.size());
  for (const Beam& b : beams_) sorted_beams_[begin[sectorOf(b)]++] = b;
  for (const Beam& b : sorted_beams_) traceBeam(b);
}

// Amanatides and Woo 1987: always step over the nearest border.
struct ScanRaster::Walk {
  double next[3];   // m, along the beam to the next border across each axis
  double delta[3];  // m, from border to border
  int offset[3];    // of the code, for a step
  int distance[3];  // voxels to go, along each axis
  int steps;        // left, along all axes
  Block block;
  std::uint32_t* words;
  int code;

  // Where a beam meets an edge or a corner, z comes before y and y before x.
  int nearest() const { return next[0] < next[1] && next[0] < next[2] ? 0 : next[1] < next[2] ? 1 : 2; }
};

void ScanRaster::traceBeam(const Beam& beam) {
  const Eigen::Vector3f difference = beam.end_point - origin_;
  const auto length = static_cast<float>(lengthOf(difference));
  const Eigen::Vector3f direction = difference / length;
  Walk walk;
  walk.steps = 0;
  int dominant = 0;
  double dominant_delta = std::numeric_limits<double>::max();
  double last = 0.0, beyond = dominant_delta;  // the last border before the end, the first one behind it
  for (int i = 0; i < 3; ++i) {
    const int sign = direction[i] > 0.0F ? 1 : -1;
    walk.distance[i] = sign * (beam.end[i] - origin_voxel_[i]);
    walk.steps += walk.distance[i];
    walk.offset[i] = sign * (1 << kShift[i]);
    walk.next[i] = walk.delta[i] = std::numeric_limits<double>::max();
    if (direction[i] == 0.0F) continue;
    const double border =
        (origin_voxel_[i] + 0.5) * resolution_ + static_cast<float>(sign * resolution_ * 0.5);
    walk.next[i] = (border - origin_[i]) / direction[i];
    walk.delta[i] = resolution_ / std::abs(static_cast<double>(direction[i]));
    beyond = std::min(beyond, walk.next[i] + walk.distance[i] * walk.delta[i]);
    if (walk.distance[i] <= 0) continue;
    last = std::max(last, walk.next[i] + (walk.distance[i] - 1) * walk.delta[i]);
    if (walk.delta[i] < dominant_delta) {
      dominant_delta = walk.delta[i];
      dominant = i;
    }
  }
  if (walk.steps == 0) return;
  walk.block = OccupancyMap::blockOf(origin_voxel_);
  walk.words = origin_words_;
  walk.code =
      (origin_voxel_[0] & 31) << kShift[0] | (origin_voxel_[1] & 31) << kShift[1] | (origin_voxel_[2] & 31);
  if (!(last * (1.0 + 1e-9) < beyond && last <= length)) {
    // The end is as near to a border as rounding, so the beam may pass it or not reach it. As OctoMap does,
    // it then goes on for as long as it is.
    walk.steps = std::numeric_limits<int>::max();
    const auto inside = [&walk](int i) {
      return std::abs(2 * walk.block[i] + 1) < 2 * kMaxVoxel / kBlockSize;
    };
    do {
      --walk.distance[step(walk)];
    } while ((walk.distance[0] | walk.distance[1] | walk.distance[2]) != 0 &&
             walk.next[walk.nearest()] <= length && inside(0) && inside(1) && inside(2));
    return;
  }
  switch (dominant) {
    case 0:
      stride<0>(walk);
      break;
    case 1:
      stride<1>(walk);
      break;
    default:
      stride<2>(walk);
  }
  while (walk.steps > 0) step(walk);
}

// Follows a step that has left the block across this axis.
void ScanRaster::leaveBlock(Walk& walk, int axis) {
  const int field = 31 << kShift[axis];
  const bool forward = walk.offset[axis] > 0;
  walk.block[axis] += forward ? 1 : -1;
  walk.code = ((walk.code - walk.offset[axis]) & ~field) | (forward ? 0 : field);
  walk.words = &masks_[slotOf(walk.block)]->words[0][0];
}

// Marks a voxel and steps over the next border; @return its axis.
int ScanRaster::step(Walk& walk) {
  mark(walk.words, walk.code);
  const int axis = walk.nearest();
  walk.next[axis] += walk.delta[axis];
  walk.code += walk.offset[axis];
  if (--walk.steps > 0 && (walk.code & kOutside) != 0) leaveBlock(walk, axis);
  return axis;
}

// Between two borders across the dominant axis A there is at most one across each of the others, B and C. So
// three voxels (not all different) are marked at a time, without a branch that would be as good as random.
template <int A>
void ScanRaster::stride(Walk& walk) {
  constexpr int B = A == 0 ? 1 : 0, C = A == 2 ? 1 : 2;
  const double da = walk.delta[A], db = walk.delta[B], dc = walk.delta[C];
  constexpr double kDiagonal = 1.0 + 1e-9;  // rounding might put two borders across B between two across A
  if (db < da * kDiagonal || dc < da * kDiagonal) return;
  double ta = walk.next[A], tb = walk.next[B], tc = walk.next[C];
  int code = walk.code, steps = walk.steps;
  const int step_a = walk.offset[A], step_b = walk.offset[B], step_c = walk.offset[C];
  std::uint32_t* words = walk.words;
  for (int left = walk.distance[A]; left > 0; --left) {
    const bool cross_b = B < A ? tb < ta : tb <= ta, cross_c = C < A ? tc < ta : tc <= ta;
    const int by_b = step_b & -static_cast<int>(cross_b), by_c = step_c & -static_cast<int>(cross_c);
    const int first = code + (tb < tc ? by_b : by_c), second = code + by_b + by_c;
    if (((first | second) & kOutside) != 0) {
      walk.next[A] = ta, walk.next[B] = tb, walk.next[C] = tc;
      walk.code = code, walk.steps = steps, walk.words = words;
      while (walk.steps > 0 && step(walk) != A) {
      }
      ta = walk.next[A], tb = walk.next[B], tc = walk.next[C];
      code = walk.code, steps = walk.steps, words = walk.words;
      continue;
    }
    mark(words, code);
    mark(words, first);
    mark(words, second);
    ta += da;
    tb += cross_b ? db : 0.0;
    tc += cross_c ? dc : 0.0;
    code = second + step_a;
    steps -= 1 + static_cast<int>(cross_b) + static_cast<int>(cross_c);
    if ((code & kOutside) != 0 && steps > 0) {
      walk.code = code;
      leaveBlock(walk, A);
      code = walk.code, words = walk.words;
    }
  }
  walk.next[A] = ta, walk.next[B] = tb, walk.next[C] = tc;
  walk.code = code, walk.steps = steps, walk.words = words;
}

}  // namespace rtree_occupancy_map
