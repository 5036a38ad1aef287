// SPDX-License-Identifier: BSD-3-Clause
#include "decay.h"

#include <algorithm>
#include <cmath>
#include <utility>

#include "block_index.h"
#include "log_odds.h"

namespace rtree_occupancy_map {
namespace {

// When a block's steps begin, as a part of one.
double phaseOf(const Block& block) {
  return static_cast<double>(keyOf(block) * 0x9e3779b97f4a7c15ULL >> 40) / (1 << 24);
}

}  // namespace

Decay::Decay(const Options& options) : decay_time_(options.decay_time) {
  if (decay_time_ == 0.0) return;
  const LogOddsModel model(options);
  int misses = 0;
  for (float log_odds = model.max; log_odds >= model.occupied; log_odds += model.miss) ++misses;
  step_ = decay_time_ / misses;
}

std::vector<Decay::Due> Decay::advance(double time) {
  std::vector<Due> due;
  if (!started_ || time < time_ - decay_time_) {
    started_ = true;
    time_ = time;
  }
  if (time <= time_) return due;
  for (auto& [block, seen] : blocks_) {
    const double phase = phaseOf(block);
    const double steps = std::floor(time / step_ + phase) - std::floor(time_ / step_ + phase);
    if (steps >= 1.0) due.push_back({block, static_cast<int>(std::min(steps, 1e6)), std::move(seen)});
  }
  time_ = time;
  return due;
}

void Decay::see(const Block& block, const ScanMask& mask) const {
  const auto found = blocks_.find(block);
  if (found == blocks_.end()) return;
  std::unique_ptr<BlockRows>& seen = found->second;
  if (!seen) seen = std::make_unique<BlockRows>(BlockRows{});
  forEachBit(mask.layers, [&](int y) {
    for (int row = y * kBlockSize; row < (y + 1) * kBlockSize; ++row)
      (*seen)[row] |= mask.hit[row] | mask.crossed[row];
  });
}

void Decay::clear() {
  blocks_.clear();
  started_ = false;
}

std::size_t Decay::memoryUsage() const {
  std::size_t bytes = 0;
  for (const auto& [block, seen] : blocks_) {
    bytes += sizeof(block) + 6 * sizeof(void*) + (seen ? sizeof(*seen) : 0);
  }
  return bytes;
}

}  // namespace rtree_occupancy_map
