// SPDX-License-Identifier: BSD-3-Clause
#include "block_grid.h"

#include <algorithm>
#include <cmath>

namespace rtree_occupancy_map {
namespace {

constexpr int kSize = kBlockSize;

// Bits z0 to z1 - 1.
std::uint32_t bits(int z0, int z1) { return (z1 - z0 == 32 ? ~0u : (1u << (z1 - z0)) - 1) << z0; }

template <class Function>
void forEachBit(std::uint32_t word, Function&& f) {
  for (; word != 0; word &= word - 1) f(__builtin_ctz(word));
}

}  // namespace

BlockGrid::BlockGrid(const Options& options) : options_(options), model_(options) {
  for (int i = 0; i < 3; ++i) axes_[i] = options.search_order[i] - 'x';
  frozen_.fill(0);
  textured_.fill(0);
  if (options.reflectivity) reflectivity_.resize(value_.size());
}

void BlockGrid::start(const Block& block) {
  for (int i = 0; i < 3; ++i) base_[i] = block[i] * kSize;
  low_.fill(0);
  high_.fill(0);
  between_.fill(0);
  if (!options_.dynamic) frozen_.fill(0);
  if (options_.reflectivity) textured_.fill(0);
  pieces_.clear();
}

void BlockGrid::add(const Cell& cell) {
  LocalBox b;
  for (int i = 0; i < 3; ++i) {
    b.min[i] = cell.box.min[i] - base_[i];
    b.max[i] = cell.box.max[i] - base_[i];
  }
  const Class c = cell.log_odds <= model_.min ? Class::kLow : cell.log_odds >= model_.max ? Class::kHigh : Class::kBetween;
  Rows& rows = rowsOf(c);
  const std::uint32_t mask = bits(b.min[2], b.max[2]);
  const bool freeze = !options_.dynamic && c != Class::kBetween && cell.box.volume() > 1;
  for (int y = b.min[1]; y < b.max[1]; ++y) {
    for (int x = b.min[0]; x < b.max[0]; ++x) {
      const int row = y * kSize + x;
      rows[row] |= mask;
      if (c == Class::kBetween) std::fill(&value_[row * kSize + b.min[2]], &value_[row * kSize] + b.max[2], cell.log_odds);
      if (freeze) frozen_[row] |= mask;
      if (cell.reflectivity.hits > 0 && options_.reflectivity) {
        textured_[row] |= mask;
        std::fill(&reflectivity_[row * kSize + b.min[2]], &reflectivity_[row * kSize] + b.max[2], cell.reflectivity);
      }
    }
  }
  if (options_.fusion_strategy == FusionStrategy::kExpansion) pieces_.push_back({b, c});
}

void BlockGrid::set(int row, int z, float log_odds) {
  const std::uint32_t bit = 1u << z;
  low_[row] &= ~bit;
  high_[row] &= ~bit;
  between_[row] &= ~bit;
  if (log_odds <= model_.min) {
    low_[row] |= bit;
  } else if (log_odds >= model_.max) {
    high_[row] |= bit;
  } else {
    between_[row] |= bit;
    value_[row * kSize + z] = log_odds;
  }
}

std::int64_t BlockGrid::knownVoxels() const {
  std::int64_t known = 0;
  for (int row = 0; row < kSize * kSize; ++row) known += __builtin_popcount(low_[row] | high_[row] | between_[row]);
  return known;
}

bool BlockGrid::update(const ScanRaster::Mask& mask) {
  bool changed = false;
  for (int y = 0; y < kSize; ++y) {
    for (int x = 0; x < kSize; ++x) {
      const int row = y * kSize + x;
      const std::uint32_t hit = mask.hit(x, y) & ~high_[row] & ~frozen_[row];
      const std::uint32_t miss = mask.crossed(x, y) & ~mask.hit(x, y) & ~low_[row] & ~frozen_[row];
      if ((hit | miss) == 0) continue;
      changed = true;
      const std::uint32_t high = high_[row], low = low_[row], between = between_[row];
      const auto add = [&](int z, float update) {
        const float before = between >> z & 1 ? value_[row * kSize + z]
                             : low >> z & 1   ? model_.min
                             : high >> z & 1  ? model_.max
                                              : model_.prior;
        set(row, z, before + update);
      };
      forEachBit(hit, [&](int z) { add(z, model_.hit); });
      forEachBit(miss, [&](int z) { add(z, model_.miss); });
    }
  }
  return changed;
}

void BlockGrid::addReflectivity(int index, float value) {
  std::uint32_t& row = textured_[index / kSize];
  const std::uint32_t bit = 1u << index % kSize;
  Reflectivity& r = reflectivity_[index];
  if ((row & bit) == 0) r = {0.0F, 0};
  row |= bit;
  ++r.hits;
  r.mean += (value - r.mean) / static_cast<float>(r.hits);
}

bool BlockGrid::setFree(const VoxelBox& box) {
  bool changed = false;
  const auto cut = [](int c) { return std::clamp(c, 0, kSize); };
  const int z0 = cut(box.min[2] - base_[2]), z1 = cut(box.max[2] - base_[2]);
  if (z0 >= z1) return false;
  for (int y = cut(box.min[1] - base_[1]); y < cut(box.max[1] - base_[1]); ++y) {
    for (int x = cut(box.min[0] - base_[0]); x < cut(box.max[0] - base_[0]); ++x) {
      const int row = y * kSize + x;
      const std::uint32_t cleared = (high_[row] | between_[row]) & bits(z0, z1);
      high_[row] &= ~cleared;
      between_[row] &= ~cleared;
      low_[row] |= cleared;
      changed |= cleared != 0;
    }
  }
  return changed;
}

// ------------------------------------------------------------------------------------------------------- fusion

bool BlockGrid::fusible(Class c) const {
  if (options_.fusion_strategy == FusionStrategy::kNone) return false;
  if (options_.fusion_rule == FusionRule::kEqualValue) return true;
  // Section 2.5.2: with the beam-end point model only occupied cells fuse.
  return c == Class::kHigh || (c == Class::kLow && options_.sensor_model == SensorModel::kBeam);
}

void BlockGrid::emit(const Piece& piece) {
  const LocalBox& b = piece.box;
  Cell cell;
  for (int i = 0; i < 3; ++i) {
    cell.box.min[i] = static_cast<std::int16_t>(base_[i] + b.min[i]);
    cell.box.max[i] = static_cast<std::int16_t>(base_[i] + b.max[i]);
  }
  cell.log_odds = logOddsOf(piece.c, (b.min[1] * kSize + b.min[0]) * kSize + b.min[2]);
  if (options_.reflectivity && cell.log_odds >= model_.occupied) {
    double sum = 0.0, hits = 0.0;
    int voxels = 0;
    for (int y = b.min[1]; y < b.max[1]; ++y) {
      for (int x = b.min[0]; x < b.max[0]; ++x) {
        const int row = y * kSize + x;
        forEachBit(textured_[row] & bits(b.min[2], b.max[2]), [&](int z) {
          sum += reflectivity_[row * kSize + z].mean;
          hits += reflectivity_[row * kSize + z].hits;
          ++voxels;
        });
      }
    }
    if (voxels > 0) cell.reflectivity = {static_cast<float>(sum / voxels), static_cast<std::uint32_t>(std::ceil(hits / voxels))};
  }
  out_.push_back(cell);
}

// Whether all voxels of the slab are open and have these log odds.
bool BlockGrid::slabFits(const Rows& open, Class c, float log_odds, const LocalBox& slab) const {
  const std::uint32_t mask = bits(slab.min[2], slab.max[2]);
  for (int y = slab.min[1]; y < slab.max[1]; ++y) {
    for (int x = slab.min[0]; x < slab.max[0]; ++x) {
      const int row = y * kSize + x;
      if ((open[row] & mask) != mask) return false;
      if (c != Class::kBetween) continue;
      for (int z = slab.min[2]; z < slab.max[2]; ++z) {
        if (value_[row * kSize + z] != log_odds) return false;
      }
    }
  }
  return true;
}

// Divides the open voxels within a box, all of class c, into cuboids of equal log odds: from the first voxel that is
// left, as far as possible along the first axis of the search order, then the second, then the third.
void BlockGrid::fuseGreedily(Rows& open, Class c, const LocalBox& within) {
  const bool grow = fusible(c);
  const std::uint32_t column = bits(within.min[2], within.max[2]);
  for (int y = within.min[1]; y < within.max[1]; ++y) {
    for (int x = within.min[0]; x < within.max[0]; ++x) {
      const int row = y * kSize + x;
      while ((open[row] & column) != 0) {
        const int z = __builtin_ctz(open[row] & column);
        LocalBox box{{x, y, z}, {x + 1, y + 1, z + 1}};
        const float log_odds = logOddsOf(c, row * kSize + z);
        for (int i = 0; i < 3 && grow; ++i) {
          const int axis = axes_[i];
          LocalBox slab = box;
          while (box.max[axis] < within.max[axis]) {
            slab.min[axis] = box.max[axis];
            slab.max[axis] = box.max[axis] + 1;
            if (!slabFits(open, c, log_odds, slab)) break;
            ++box.max[axis];
          }
        }
        const std::uint32_t mask = bits(box.min[2], box.max[2]);
        for (int v = box.min[1]; v < box.max[1]; ++v) {
          for (int u = box.min[0]; u < box.max[0]; ++u) open[v * kSize + u] &= ~mask;
        }
        pieces_.push_back({box, c});
      }
    }
  }
}

void BlockGrid::fuse(const std::vector<int>& selected, std::vector<Cell>& cells) {
  if (options_.fusion_strategy == FusionStrategy::kExpansion) {
    splitPieces();
    expand(selected);
  } else {
    for (const Class c : {Class::kHigh, Class::kBetween, Class::kLow}) {
      Rows open = rowsOf(c);
      fuseGreedily(open, c, {{0, 0, 0}, {kSize, kSize, kSize}});
    }
  }
  out_.clear();
  for (const Piece& piece : pieces_) emit(piece);
  order(cells);
}

// Occupied cells first, so that they share leaves, then by sub-blocks of 8^3 voxels along a Z-order curve.
void BlockGrid::order(std::vector<Cell>& cells) {
  static const std::array<std::uint8_t, 64> kZOrder = [] {
    std::array<std::uint8_t, 64> rank{};
    for (int z = 0; z < 4; ++z)
      for (int y = 0; y < 4; ++y)
        for (int x = 0; x < 4; ++x)
          rank[z << 4 | y << 2 | x] = static_cast<std::uint8_t>((x & 1) | (y & 1) << 1 | (z & 1) << 2 | (x & 2) << 2 |
                                                                (y & 2) << 3 | (z & 2) << 4);
    return rank;
  }();
  const auto rankOf = [this](const Cell& c) {
    const int x = (c.box.min[0] - base_[0]) >> 3, y = (c.box.min[1] - base_[1]) >> 3, z = (c.box.min[2] - base_[2]) >> 3;
    return kZOrder[z << 4 | y << 2 | x] + (c.log_odds >= model_.occupied ? 0 : 64);
  };
  std::array<std::uint32_t, 129> begin{};
  for (const Cell& c : out_) ++begin[rankOf(c) + 1];
  for (int i = 0; i < 128; ++i) begin[i + 1] += begin[i];
  cells.resize(out_.size());
  for (const Cell& c : out_) cells[begin[rankOf(c)]++] = c;
}

// ------------------------------------------------------------------------------ expansion and fusion of Fig. 2.7

// Starts from the cells that the block came with. Where observations contradicted one it is split: what still agrees
// stays in cuboids as large as possible. Voxels that are new become cells of their own.
void BlockGrid::splitPieces() {
  std::vector<Piece> before;
  before.swap(pieces_);
  Rows open[] = {low_, high_, between_};
  const Class classes[] = {Class::kLow, Class::kHigh, Class::kBetween};
  for (const Piece& p : before) {
    for (int c = 0; c < 3; ++c) fuseGreedily(open[c], classes[c], p.box);
  }
  for (int c = 0; c < 3; ++c) {
    for (int row = 0; row < kSize * kSize; ++row) {
      const int x = row % kSize, y = row / kSize;
      forEachBit(open[c][row], [&](int z) { pieces_.push_back({{{x, y, z}, {x + 1, y + 1, z + 1}}, classes[c]}); });
    }
  }
}

void BlockGrid::expand(const std::vector<int>& selected) {
  constexpr std::uint16_t kNobody = 0xffff;
  owner_.assign(value_.size(), kNobody);
  for (std::size_t i = 0; i < pieces_.size(); ++i) own(static_cast<int>(i), pieces_[i].box);
  for (const int voxel : selected) {
    if (owner_[voxel] == kNobody) continue;
    while (expandOnce(owner_[voxel])) {
    }
  }
  const auto fused = [](const Piece& p) { return p.box.max[0] == p.box.min[0]; };
  pieces_.erase(std::remove_if(pieces_.begin(), pieces_.end(), fused), pieces_.end());
}

void BlockGrid::own(int number, const LocalBox& box) {
  for (int y = box.min[1]; y < box.max[1]; ++y) {
    for (int x = box.min[0]; x < box.max[0]; ++x) {
      auto* column = &owner_[(y * kSize + x) * kSize];
      std::fill(column + box.min[2], column + box.max[2], static_cast<std::uint16_t>(number));
    }
  }
}

// Lines 1 to 12 of Fig. 2.7 for one cell; @return whether it has grown.
bool BlockGrid::expandOnce(int number) {
  const Piece piece = pieces_[number];
  if (!fusible(piece.c)) return false;
  const int* min = piece.box.min;
  const auto width = [&piece](int axis) { return piece.box.max[axis] - piece.box.min[axis]; };
  const float log_odds = logOddsOf(piece.c, (min[1] * kSize + min[0]) * kSize + min[2]);

  // The set S_i: along +, then along - each axis; the longer sides first where they differ.
  struct Direction {
    int axis;
    bool forward;
  };
  std::array<Direction, 6> directions;
  for (int i = 0; i < 6; ++i) directions[i] = {axes_[i % 3], i < 3};
  std::stable_sort(directions.begin(), directions.end(),
                   [&](const Direction& a, const Direction& b) { return width(a.axis) > width(b.axis); });

  for (const auto& [axis, forward] : directions) {
    LocalBox slab = piece.box;  // Eq. 2.8: the cell's own width is added
    slab.min[axis] = forward ? piece.box.max[axis] : piece.box.min[axis] - width(axis);
    slab.max[axis] = slab.min[axis] + width(axis);
    if (slab.min[axis] < 0 || slab.max[axis] > kSize) continue;
    if (!slabFits(rowsOf(piece.c), piece.c, log_odds, slab)) continue;
    // Eq. 2.9: every cell in the slab lies in it as a whole.
    std::vector<std::uint16_t> fused;
    bool contained = true;
    for (int y = slab.min[1]; y < slab.max[1] && contained; ++y) {
      for (int x = slab.min[0]; x < slab.max[0] && contained; ++x) {
        for (int z = slab.min[2]; z < slab.max[2] && contained; ++z) {
          const std::uint16_t k = owner_[(y * kSize + x) * kSize + z];
          if (!fused.empty() && fused.back() == k) continue;
          fused.push_back(k);
          for (int i = 0; i < 3; ++i) {
            contained &= slab.min[i] <= pieces_[k].box.min[i] && pieces_[k].box.max[i] <= slab.max[i];
          }
        }
      }
    }
    if (!contained) continue;
    for (const std::uint16_t k : fused) pieces_[k].box.max[0] = pieces_[k].box.min[0];  // gone
    LocalBox& grown = pieces_[number].box;
    grown.min[axis] = std::min(grown.min[axis], slab.min[axis]);
    grown.max[axis] = std::max(grown.max[axis], slab.max[axis]);
    own(number, slab);
    return true;
  }
  return false;
}

}  // namespace rtree_occupancy_map
