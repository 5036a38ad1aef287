// SPDX-License-Identifier: BSD-3-Clause
#include "block_voxels.h"

#include <algorithm>
#include <limits>

#include "row_kernels.h"

namespace rtree_occupancy_map {

void BlockVoxels::start() {
  low_.fill(0);
  high_.fill(0);
  between_.fill(0);
  begin_.fill(0);
  log_odds_.assign(1, 0.0F);
  texture_.reset();
}

void BlockVoxels::add(const VoxelBox& cell, float log_odds, const Reflectivity& reflectivity,
                      const LogOddsModel& model, DenseBlock& dense) {
  BlockRows& rows = log_odds <= model.min ? low_ : log_odds >= model.max ? high_ : between_;
  const bool textured = reflectivity.hits > 0 && !dense.reflectivity.empty();
  if (textured && !texture_) texture_ = std::make_unique<Texture>();
  const std::uint32_t mask = bits(cell.min[2], cell.max[2]);
  for (int y = cell.min[1]; y < cell.max[1]; ++y) {
    for (int x = cell.min[0]; x < cell.max[0]; ++x) {
      const int row = y * kBlockSize + x, begin = row * kBlockSize + cell.min[2],
                end = row * kBlockSize + cell.max[2];
      rows[row] |= mask;
      if (&rows == &between_) {
        for (int i = begin; i < end; ++i) dense.log_odds[i] = log_odds;
      }
      if (!textured) continue;
      texture_->rows[row] |= mask;
      std::fill(&dense.reflectivity[begin], dense.reflectivity.data() + end, reflectivity);
    }
  }
}

void BlockVoxels::pack(const DenseBlock& dense) {
  std::array<float, kBlockRows * kBlockSize + 1> packed;
  float* out = packed.data();
  for (int row = 0; row < kBlockRows; ++row) {
    begin_[row] = static_cast<std::uint16_t>(out - packed.data());
    forEachBit(between_[row], [&](int z) { *out++ = dense.log_odds[row * kBlockSize + z]; });
  }
  *out++ = 0.0F;
  log_odds_.assign(packed.data(), out);
  packTexture(dense);
}

void BlockVoxels::unpack(DenseBlock& dense) const {
  rowKernels().unpack(between_, log_odds_.data(), dense.log_odds.data());
  unpackTexture(dense);
}

void BlockVoxels::packTexture(const DenseBlock& dense) {
  if (!texture_) return;
  texture_->values.clear();
  for (int row = 0; row < kBlockRows; ++row) {
    forEachBit(texture_->rows[row],
               [&](int z) { texture_->values.push_back(dense.reflectivity[row * kBlockSize + z]); });
  }
}

void BlockVoxels::unpackTexture(DenseBlock& dense) const {
  if (!texture_) return;
  const Reflectivity* in = texture_->values.data();
  for (int row = 0; row < kBlockRows; ++row) {
    forEachBit(texture_->rows[row], [&](int z) { dense.reflectivity[row * kBlockSize + z] = *in++; });
  }
}

// Rows that the scan changes are written anew, those between are moved as a whole.
bool BlockVoxels::update(const ScanMask& mask, const LogOddsModel& model, bool settle, DenseBlock& buffer) {
  const float* const in = log_odds_.data();
  float* const begin = buffer.log_odds.data();
  float* out = begin;
  const RowKernels& kernels = rowKernels();
  int moved = 0;  // values that have been written, of those in log_odds_
  bool changed = false;
  const auto moveOn = [&](int first) {
    const auto shift = static_cast<std::uint16_t>(out - begin - moved);
    if (shift == 0) return;
    for (int x = 0; x < kBlockSize; ++x)
      begin_[first + x] = static_cast<std::uint16_t>(begin_[first + x] + shift);
  };
  for (int first = 0; first < kBlockRows; first += kBlockSize) {
    if ((mask.layers >> first / kBlockSize & 1) == 0) {
      moveOn(first);
      continue;
    }
    // At a threshold an update changes nothing or, in a static map, isn't made.
    const std::uint32_t settled = settle ? ~0u : 0;
    std::uint32_t hits[kBlockSize], misses[kBlockSize], any = 0;
    for (int x = 0; x < kBlockSize; ++x) {
      const std::uint32_t low = low_[first + x], high = high_[first + x];
      hits[x] = mask.hit[first + x] & ~(high | (low & settled));
      misses[x] = mask.crossed[first + x] & ~(low | (high & settled));
      any |= hits[x] | misses[x];
    }
    if (any == 0) {
      moveOn(first);
      continue;
    }
    changed = true;
    for (int x = 0; x < kBlockSize; ++x) {
      const int row = first + x;
      const std::uint32_t hit = hits[x], miss = misses[x];
      if ((hit | miss) == 0) {
        begin_[row] = static_cast<std::uint16_t>(begin_[row] + (out - begin) - moved);
        continue;
      }
      if (const int here = begin_[row]; here != moved) {
        out = std::copy(in + moved, in + here, out);
        moved = here;
      }
      begin_[row] = static_cast<std::uint16_t>(out - begin);
      RowUpdate update{low_[row], high_[row], between_[row], in + moved, out};
      kernels.update(update, hit, miss, model);
      low_[row] = update.low;
      high_[row] = update.high;
      between_[row] = update.between;
      moved = static_cast<int>(update.in - in);
      out = update.out;
    }
  }
  if (!changed) return false;
  out = std::copy(in + moved, in + log_odds_.size(), out);
  log_odds_.assign(begin, out);
  return true;
}

bool BlockVoxels::setFree(const VoxelBox& box) {
  std::vector<float> kept;
  bool changed = false;
  for (int row = 0; row < kBlockRows; ++row) {
    const int x = row % kBlockSize, y = row / kBlockSize;
    const bool inside = x >= box.min[0] && x < box.max[0] && y >= box.min[1] && y < box.max[1];
    const std::uint32_t in_box = inside && box.min[2] < box.max[2] ? bits(box.min[2], box.max[2]) : 0;
    const std::uint32_t cleared = (high_[row] | between_[row]) & in_box;
    const float* in = log_odds_.data() + begin_[row];
    begin_[row] = static_cast<std::uint16_t>(kept.size());
    forEachBit(between_[row], [&](int z) {
      if ((cleared >> z & 1) == 0) kept.push_back(*in);
      ++in;
    });
    high_[row] &= ~cleared;
    between_[row] &= ~cleared;
    low_[row] |= cleared;
    changed |= cleared != 0;
  }
  kept.push_back(0.0F);
  log_odds_ = std::move(kept);
  return changed;
}

bool BlockVoxels::decay(const BlockRows* seen, const LogOddsModel& model, DenseBlock& buffer) {
  unpack(buffer);
  bool changed = false;
  for (int row = 0; row < kBlockRows; ++row) {
    const std::uint32_t high = high_[row];
    forEachBit((high | between_[row]) & ~(seen != nullptr ? (*seen)[row] : 0), [&](int z) {
      float& log_odds = buffer.log_odds[row * kBlockSize + z];
      const std::uint32_t bit = 1u << z;
      if ((high & bit) != 0) log_odds = model.max;
      if (log_odds < model.occupied) return;
      log_odds += model.miss;
      const bool forgotten = log_odds < model.occupied;
      high_[row] &= ~bit;
      between_[row] = forgotten ? between_[row] & ~bit : between_[row] | bit;
      if (forgotten && texture_) texture_->rows[row] &= ~bit;
      changed = true;
    });
  }
  if (!changed) return false;
  pack(buffer);
  packTexture(buffer);
  return true;
}

bool BlockVoxels::anyOccupied(const LogOddsModel& model) const {
  const auto any = [](const BlockRows& rows) {
    return std::any_of(rows.begin(), rows.end(), [](std::uint32_t row) { return row != 0; });
  };
  return any(high_) || std::any_of(log_odds_.begin(), log_odds_.end() - 1,
                                   [&](float log_odds) { return log_odds >= model.occupied; });
}

BlockRows BlockVoxels::occupied(const LogOddsModel& model) const {
  BlockRows rows = high_;
  const float* log_odds = log_odds_.data();
  for (int row = 0; row < kBlockRows; ++row) {
    forEachBit(between_[row],
               [&](int z) { rows[row] |= static_cast<std::uint32_t>(*log_odds++ >= model.occupied) << z; });
  }
  return rows;
}

void BlockVoxels::addReflectivity(const std::vector<std::pair<int, float>>& returns, DenseBlock& buffer) {
  if (!texture_) texture_ = std::make_unique<Texture>();
  unpackTexture(buffer);
  for (const auto& [index, value] : returns) {
    std::uint32_t& row = texture_->rows[index / kBlockSize];
    const std::uint32_t bit = 1u << index % kBlockSize;
    Reflectivity& r = buffer.reflectivity[index];
    if ((row & bit) == 0) r = {0.0F, 0};
    row |= bit;
    if (r.hits < std::numeric_limits<std::uint32_t>::max()) ++r.hits;
    r.mean += (value - r.mean) / static_cast<float>(r.hits);
  }
  packTexture(buffer);
}

std::int64_t BlockVoxels::knownVoxels() const {
  std::int64_t known = 0;
  for (int row = 0; row < kBlockRows; ++row) {
    known += __builtin_popcount(low_[row] | high_[row] | between_[row]);
  }
  return known;
}

std::size_t BlockVoxels::memoryUsage() const {
  return sizeof(*this) + log_odds_.capacity() * sizeof(float) +
         (texture_ ? sizeof(Texture) + texture_->values.capacity() * sizeof(Reflectivity) : 0);
}

}  // namespace rtree_occupancy_map
