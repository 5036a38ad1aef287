// SPDX-License-Identifier: BSD-3-Clause
#include "scan_raster.h"

#include <algorithm>
#include <array>
#include <cmath>

namespace rtree_occupancy_map {

ScanRaster::ScanRaster(double resolution, WorkerPool& pool) : pool_(pool) {
  for (int i = 0; i < pool.size(); ++i) tracers_.emplace_back(new BeamTracer(resolution));
}

void ScanRaster::start() {
  origins_.clear();
  index_.clear();
  slots_.clear();
  beams_.clear();
  traced_.clear();
  used_hits_ = 0;
  last_hits_ = nullptr;
}

std::uint32_t ScanRaster::slotOf(const Block& block) {
  const std::uint32_t slot = index_.numberOf(block);
  if (slot == slots_.size()) slots_.emplace_back();
  return slot;
}

bool ScanRaster::markHit(const Voxel& v) {
  const Block block = OccupancyMap::blockOf(v);
  if (last_hits_ == nullptr || !isSame(block, last_hit_block_)) {
    Slot& slot = slots_[slotOf(block)];
    if (slot.hit == nullptr) {
      if (used_hits_ == hits_.size()) hits_.emplace_back(new Hits);
      slot.hit = hits_[used_hits_++].get();
      slot.hit->layers = 0;
    }
    last_hits_ = slot.hit;
    last_hit_block_ = block;
  }
  const int index = indexInBlock(v);
  const int y = index / kBlockRows;
  if ((last_hits_->layers >> y & 1) == 0) {
    last_hits_->layers |= 1u << y;
    std::fill_n(&last_hits_->rows[y * kBlockSize], kBlockSize, 0u);
  }
  std::uint32_t& row = last_hits_->rows[index / kBlockSize];
  const std::uint32_t bit = 1u << index % kBlockSize;
  const bool first = (row & bit) == 0;
  row |= bit;
  return first;
}

// Beams side by side touch the same memory: sector by sector, the rows of a sector stay in the cache. (A
// sensor that moves has them in the order of time.)
void ScanRaster::sortBeams() {
  constexpr int kSectors = 256;
  const Eigen::Vector3f& origin = origins_.front().point;
  const auto sectorOf = [&origin](const BeamTracer::Beam& b) {
    const float x = b.end_point.x() - origin.x(), y = b.end_point.y() - origin.y();
    const float quarter =
        y / (std::abs(x) + std::abs(y) + 1e-9F);  // -1 to 1, monotonic from -90 to 90 degrees
    const int sector = static_cast<int>((quarter + 1.0F) * (kSectors / 4 - 1));
    return x >= 0.0F ? sector : kSectors - 1 - sector;
  };
  std::array<std::uint32_t, kSectors + 1> begin{};
  for (const BeamTracer::Beam& b : beams_) ++begin[sectorOf(b) + 1];
  for (int i = 0; i < kSectors; ++i) begin[i + 1] += begin[i];
  sorted_beams_.resize(beams_.size());
  for (const BeamTracer::Beam& b : beams_) sorted_beams_[begin[sectorOf(b)]++] = b;
  beams_.swap(sorted_beams_);
}

void ScanRaster::trace(std::size_t begin, std::size_t end, BeamTracer& tracer) const {
  tracer.start();
  for (auto origin = origins_.begin(); origin != origins_.end(); ++origin) {
    const std::size_t first = std::max(begin, origin->first_beam),
                      last = std::min(end, origin + 1 == origins_.end() ? end : origin[1].first_beam);
    if (first >= last) continue;
    tracer.setOrigin(origin->point);
    for (std::size_t i = first; i < last; ++i) tracer.trace(beams_[i]);
  }
}

void ScanRaster::finish() {
  if (beams_.empty()) return;
  if (origins_.size() == 1) sortBeams();
  constexpr std::size_t kWorthSharing = 2000;  // beams
  const std::size_t shares = beams_.size() < kWorthSharing ? 1 : tracers_.size();
  pool_.run(shares, 2, [&](std::size_t share, int) {
    trace(beams_.size() * share / shares, beams_.size() * (share + 1) / shares, *tracers_[share]);
  });
  for (std::uint32_t t = 0; t < shares; ++t) {
    for (std::uint32_t i = 0; i < tracers_[t]->size(); ++i) {
      Slot& slot = slots_[slotOf(tracers_[t]->block(i))];
      traced_.push_back({t, i, slot.traced});
      slot.traced = static_cast<std::uint32_t>(traced_.size() - 1);
    }
  }
}

void ScanRaster::gather(std::size_t number, ScanMask& mask) const {
  const Slot& slot = slots_[number];
  const std::uint32_t hit_layers = slot.hit != nullptr ? slot.hit->layers : 0;
  mask.layers = slot.traced == kNone ? hit_layers : ~0u;
  if (slot.traced != kNone) {
    mask.crossed.fill(0);
    for (std::uint32_t k = slot.traced; k != kNone; k = traced_[k].next)
      tracers_[traced_[k].tracer]->addTo(traced_[k].number, mask.crossed);
  }
  forEachBit(mask.layers, [&](int y) {
    const int first = y * kBlockSize;
    if ((hit_layers >> y & 1) == 0) {
      std::fill_n(&mask.hit[first], kBlockSize, 0u);
      return;
    }
    std::copy_n(&slot.hit->rows[first], kBlockSize, &mask.hit[first]);
    if (slot.traced == kNone) {
      std::fill_n(&mask.crossed[first], kBlockSize, 0u);
    } else {
      for (int row = first; row < first + kBlockSize; ++row) mask.crossed[row] &= ~mask.hit[row];
    }
  });
}

}  // namespace rtree_occupancy_map
