// SPDX-License-Identifier: BSD-3-Clause
#include "beam_tracer.h"

#include <algorithm>
#include <limits>

#include "bit_transpose.h"

namespace rtree_occupancy_map {
namespace {

constexpr int kMask = kBlockSize - 1;
// The two other axes of a plane; see BeamTracer::Plane.
constexpr int kLow[3] = {2, 2, 0}, kHigh[3] = {1, 0, 1};

constexpr double kFraction = 4294967296.0;                // fixed point has 32 bits behind the point
constexpr std::uint64_t kNever = std::uint64_t{1} << 62;  // no beam is as long
constexpr double kGuard = 1.0 + 1e-9;                     // well above the rounding of a sum of borders

}  // namespace

void BeamTracer::start() {
  index_.clear();
  slots_.clear();
  used_planes_ = 0;
}

void BeamTracer::setOrigin(const Eigen::Vector3f& origin) {
  origin_ = origin;
  toVoxel(origin, 1.0 / resolution_, origin_voxel_);
  origin_slot_ = slotOf(OccupancyMap::blockOf(origin_voxel_));
}

std::uint32_t BeamTracer::slotOf(const Block& block) {
  const std::uint32_t slot = index_.numberOf(block);
  if (slot == slots_.size()) slots_.emplace_back();
  return slot;
}

std::uint32_t BeamTracer::neighbourOf(std::uint32_t slot, int axis, int sign) {
  const int side = 2 * axis + (sign > 0 ? 1 : 0);
  if (slots_[slot].neighbours[side] == kNone) {
    Block block = index_[slot];
    block[axis] += sign;
    const std::uint32_t neighbour = slotOf(block);
    slots_[slot].neighbours[side] = neighbour;
  }
  return slots_[slot].neighbours[side];
}

std::uint32_t* BeamTracer::wordsOf(std::uint32_t slot, int axis) {
  Plane*& plane = slots_[slot].planes[axis];
  if (plane == nullptr) {
    if (used_planes_ == planes_.size()) planes_.emplace_back(new Plane);
    plane = planes_[used_planes_++].get();
    plane->fill(0);
  }
  return plane->data();
}

void BeamTracer::addTo(std::size_t number, BlockRows& crossed) const {
  const Slot& slot = slots_[number];
  for (int i = 0; i < kBlockSize; ++i) {
    const int words = i * kBlockSize;
    if (slot.planes[0] != nullptr) transposeInto(&(*slot.planes[0])[words], &crossed[words], 1);
    if (slot.planes[1] != nullptr) transposeInto(&(*slot.planes[1])[words], &crossed[i], kBlockSize);
  }
  if (slot.planes[2] == nullptr) return;
  for (int row = 0; row < kBlockRows; ++row) crossed[row] |= (*slot.planes[2])[row];
}

// A beam on its way. Per axis, in the order x, y, z.
struct BeamTracer::Walk {
  double next[3];   // m, along the beam to the next border
  double delta[3];  // m, from border to border
  int sign[3];      // of a step
  int distance[3];  // voxels to go
  int dominant;     // the axis that the beam runs along
  double length;    // m

  // Where a beam meets an edge or a corner, z comes before y and y before x.
  int nearest() const { return next[0] < next[1] && next[0] < next[2] ? 0 : next[1] < next[2] ? 1 : 2; }
};

// @return whether the beam ends in its last voxel for sure. Where that is as near to a border as rounding, it
// may pass it or not reach it.
bool BeamTracer::prepare(const Beam& beam, Walk& walk) const {
  const Eigen::Vector3f difference = beam.end_point - origin_;
  const auto length = static_cast<float>(lengthOf(difference));
  const Eigen::Vector3f direction = difference / length;
  walk.length = static_cast<double>(length);
  walk.dominant = 0;
  constexpr double kFar = std::numeric_limits<double>::max();
  double dominant_delta = kFar, last = 0.0,
         beyond = kFar;  // the last border before the end, the first behind
  bool ahead = true;
  for (int i = 0; i < 3; ++i) {
    const int sign = direction[i] > 0.0F ? 1 : -1;
    walk.sign[i] = sign;
    walk.distance[i] = sign * (beam.end[i] - origin_voxel_[i]);
    walk.next[i] = walk.delta[i] = kFar;
    ahead &= walk.distance[i] >= 0;
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
      walk.dominant = i;
    }
  }
  return ahead && last * kGuard < beyond && last * kGuard <= walk.length;
}

void BeamTracer::trace(const Beam& beam) {
  if (isSame(beam.end, origin_voxel_)) return;
  Walk walk;
  if (prepare(beam, walk)) {
    bool certain = false;
    switch (2 * walk.dominant + (walk.sign[walk.dominant] > 0 ? 1 : 0)) {
      case 0:
        certain = traceRuns<0, false>(walk);
        break;
      case 1:
        certain = traceRuns<0, true>(walk);
        break;
      case 2:
        certain = traceRuns<1, false>(walk);
        break;
      case 3:
        certain = traceRuns<1, true>(walk);
        break;
      case 4:
        certain = traceRuns<2, false>(walk);
        break;
      default:
        certain = traceRuns<2, true>(walk);
    }
    if (certain) return;
  }
  traceSteps(beam, walk);
}

// Between two borders across the other axes, L and H, the beam runs along A: these voxels are marked at once.
// Where it meets a border is measured in borders across A that it has met before.
// @return false if two borders are too near to each other to tell which comes first; what is marked by then
// is crossed in any case.
template <int A, bool kForward>
bool BeamTracer::traceRuns(const Walk& walk) {
  constexpr int L = kLow[A], H = kHigh[A];
  const auto borders = static_cast<std::uint64_t>(walk.distance[0]) + walk.distance[1] + walk.distance[2];
  // Half a unit for each border from rounding the increment, n^2 ulp from the sums in double precision.
  const std::uint64_t error = 2 * (borders + 8) + (borders * borders >> 18);
  if (error > 1u << 28) return false;
  const auto fixed = [](double borders) { return static_cast<std::uint64_t>(borders * kFraction); };
  std::uint64_t at[2] = {kNever, kNever}, step[2] = {0, 0};  // across L and H
  for (const int side : {0, 1}) {
    const int axis = side == 0 ? L : H;
    if (walk.distance[axis] == 0) continue;
    const double first = (walk.next[axis] - walk.next[A]) / walk.delta[A] + 1.0;
    if (!(first >= 0.0)) return false;
    at[side] = fixed(first);
    step[side] = fixed(std::min(walk.delta[axis] / walk.delta[A], 1e9));
  }
  std::uint64_t at_low = at[0], at_high = at[1];

  std::uint32_t slot = origin_slot_;
  std::uint32_t* words = wordsOf(slot, A);
  // The word in its plane, as high << 6 | low; the bit above each is set when a step leaves the block.
  constexpr int kHighBit = 6, kOutside = kBlockSize | kBlockSize << kHighBit;
  int code = (origin_voxel_[H] & kMask) << kHighBit | (origin_voxel_[L] & kMask);
  const int step_low = walk.sign[L], step_high = walk.sign[H] * (1 << kHighBit);
  int a = 0;                                                                  // where the run begins
  int bit = kForward ? origin_voxel_[A] & kMask : ~origin_voxel_[A] & kMask;  // of a = 0, counted from entry
  int last_in_block = kMask - bit;
  const auto markUntil = [&](int end) {
    const int row = code - (code >> kHighBit) * (kBlockSize);
    while (end > last_in_block) {
      words[row] |= kForward ? ~0u << (a + bit) : ~0u >> (a + bit);
      a = last_in_block + 1;
      last_in_block += kBlockSize;
      bit -= kBlockSize;
      slot = neighbourOf(slot, A, kForward ? 1 : -1);
      words = wordsOf(slot, A);
    }
    words[row] |= kForward ? (2u << (end + bit)) - (1u << (a + bit))
                           : (~0u >> (a + bit)) & (~0u << (kMask - (end + bit)));
  };
  for (int left = walk.distance[L] + walk.distance[H]; left > 0; --left) {
    // Which of the two comes next is anybody's guess, so there is no branch.
    const std::uint64_t low = at_low < at_high ? ~std::uint64_t{0} : 0;
    const std::uint64_t border = std::min(at_low, at_high);
    const bool beside_a = static_cast<std::uint32_t>(border + error) < 2 * error;
    const bool beside_other = at_low - at_high + 2 * error < 4 * error;
    if (beside_a | beside_other) return false;
    const int end = static_cast<int>(border >> 32);
    markUntil(end);
    a = end;
    at_low += step[0] & low;
    at_high += step[1] & ~low;
    code += step_high + ((step_low - step_high) & static_cast<int>(low));
    if ((code & kOutside) == 0) continue;
    const int axis = low != 0 ? L : H;
    code -= (low != 0 ? step_low : step_high) * kBlockSize;
    slot = neighbourOf(slot, axis, walk.sign[axis]);
    words = wordsOf(slot, A);
  }
  if (a < walk.distance[A]) markUntil(walk.distance[A] - 1);  // the end's voxel is not crossed
  return true;
}

void BeamTracer::traceSteps(const Beam& beam, Walk walk) {
  Voxel v = origin_voxel_;
  const auto inside = [&v](int i) { return v[i] >= kMinVoxel && v[i] < kMaxVoxel; };
  std::uint32_t slot = origin_slot_;
  std::uint32_t* words = wordsOf(slot, 2);
  while (true) {
    words[(v[1] & kMask) * kBlockSize + (v[0] & kMask)] |= 1u << (v[2] & kMask);
    const int axis = walk.nearest();
    const int block = v[axis] >> kBlockBits;
    walk.next[axis] += walk.delta[axis];
    v[axis] += walk.sign[axis];
    // The end may be passed by for rounding. As OctoMap does, the beam then goes on for as long as it is.
    if (isSame(v, beam.end) || walk.next[walk.nearest()] > walk.length || !inside(axis)) return;
    if (v[axis] >> kBlockBits == block) continue;
    slot = neighbourOf(slot, axis, walk.sign[axis]);
    words = wordsOf(slot, 2);
  }
}

}  // namespace rtree_occupancy_map
