// SPDX-License-Identifier: BSD-3-Clause
#include "block_grid.h"

#include <algorithm>
#include <cmath>

namespace rtree_occupancy_map {
namespace {

constexpr int kSize = kBlockSize;

}  // namespace

BlockGrid::BlockGrid(const Options& options)
    : options_(options), model_(options), dense_(options.reflectivity) {
  for (int i = 0; i < 3; ++i) axes_[i] = options.search_order[i] - 'x';
}

void BlockGrid::fuse(const Block& block, const BlockVoxels& voxels, const std::vector<VoxelBox>& before,
                     const std::vector<int>& selected, std::vector<Cell>& cells) {
  for (int i = 0; i < 3; ++i) base_[i] = block[i] * kSize;
  voxels_ = &voxels;
  voxels.unpack(dense_);
  if (fusible(Class::kBetween)) linkNeighbours();
  out_.clear();
  if (options_.fusion_strategy == FusionStrategy::kExpansion) {
    splitPieces(before);
    expand(selected);
    for (const Piece& piece : pieces_) emit(piece.box, piece.c);
  } else {
    for (const Class c : {Class::kHigh, Class::kBetween, Class::kLow}) {
      Rows open = voxels.rows(c);
      fuseClass(open, c, {{0, 0, 0}, {kSize, kSize, kSize}}, [&](const LocalBox& box) { emit(box, c); });
    }
  }
  order(cells);
}

// Eq. 2.10 and 2.11, or the equal value rule.
bool BlockGrid::fusible(Class c) const {
  if (options_.fusion_strategy == FusionStrategy::kNone) return false;
  if (options_.fusion_rule == FusionRule::kEqualValue) return true;
  // Section 2.5.2: with the beam-end point model only occupied cells fuse.
  return c == Class::kHigh || (c == Class::kLow && options_.sensor_model == SensorModel::kBeam);
}

void BlockGrid::emit(const LocalBox& b, Class c) {
  Cell cell;
  for (int i = 0; i < 3; ++i) {
    cell.box.min[i] = static_cast<std::int16_t>(base_[i] + b.min[i]);
    cell.box.max[i] = static_cast<std::int16_t>(base_[i] + b.max[i]);
  }
  cell.log_odds = logOddsOf(c, (b.min[1] * kSize + b.min[0]) * kSize + b.min[2]);
  const Rows* textured = voxels_->textured();
  if (textured != nullptr && cell.log_odds >= model_.occupied) {
    double sum = 0.0, hits = 0.0;
    int voxels = 0;
    for (int y = b.min[1]; y < b.max[1]; ++y) {
      for (int x = b.min[0]; x < b.max[0]; ++x) {
        const int row = y * kSize + x;
        forEachBit((*textured)[row] & bits(b.min[2], b.max[2]), [&](int z) {
          sum += dense_.reflectivity[row * kSize + z].mean;
          hits += dense_.reflectivity[row * kSize + z].hits;
          ++voxels;
        });
      }
    }
    if (voxels > 0)
      cell.reflectivity = {static_cast<float>(sum / voxels),
                           static_cast<std::uint32_t>(std::ceil(hits / voxels))};
  }
  out_.push_back(cell);
}

// Which voxels between the thresholds have the log odds of their next one along x, y, z.
void BlockGrid::linkNeighbours() {
  const Rows& between = voxels_->rows(Class::kBetween);
  const auto link = [this](int row, int next_row, int dz, std::uint32_t both) {
    std::uint32_t equal = 0;
    const float *value = &dense_.log_odds[row * kSize], *next = &dense_.log_odds[next_row * kSize + dz];
    forEachBit(both, [&](int z) { equal |= static_cast<std::uint32_t>(value[z] == next[z]) << z; });
    return equal;
  };
  for (int row = 0; row < kSize * kSize; ++row) {
    const std::uint32_t here = between[row];
    linked_[0][row] = row % kSize < kSize - 1 ? link(row, row + 1, 0, here & between[row + 1]) : 0;
    linked_[1][row] = row / kSize < kSize - 1 ? link(row, row + kSize, 0, here & between[row + kSize]) : 0;
    linked_[2][row] = link(row, row, 1, here & here >> 1);
  }
}

// Divides the open voxels within a box, all of one class, into cuboids of equal log odds: from the first
// voxel that is left, as far as possible along the first axis of the search order, then the second, then the
// third. kLinked: log odds are equal where linked_ says so; otherwise they are equal as a matter of course.
template <bool kLinked, class Sink>
void BlockGrid::fuseGreedily(Rows& open, const LocalBox& within, Sink&& sink) const {
  const std::uint32_t column = bits(within.min[2], within.max[2]);
  // Whether the voxels of `mask` are open in a row and can join those of the row before it along an axis.
  const auto joins = [&](int row, std::uint32_t mask, int axis, int before) {
    return (open[row] & mask) == mask && (!kLinked || (linked_[axis][before] & mask) == mask);
  };
  for (int y = within.min[1]; y < within.max[1]; ++y) {
    for (int x = within.min[0]; x < within.max[0]; ++x) {
      const int first = y * kSize + x;
      const std::uint32_t here = open[first] & column;
      if (here == 0) continue;
      // Voxels that can join none of their neighbours, which is most of them, are cells as they are.
      std::uint32_t joined = kLinked ? linked_[2][first] : here & here >> 1;
      joined |= joined << 1;
      if (x + 1 < within.max[0]) joined |= kLinked ? linked_[0][first] : open[first + 1];
      if (y + 1 < within.max[1]) joined |= kLinked ? linked_[1][first] : open[first + kSize];
      forEachBit(here & ~joined, [&](int z) { sink(LocalBox{{x, y, z}, {x + 1, y + 1, z + 1}}); });
      open[first] &= ~(here & ~joined);

      while ((open[first] & column) != 0) {
        const int z = __builtin_ctz(open[first] & column);
        int x1 = x + 1, y1 = y + 1, z1 = z + 1;
        std::uint32_t mask = 1u << z;
        for (const int axis : axes_) {
          if (axis == 0) {
            for (; x1 < within.max[0]; ++x1) {
              bool all = true;
              for (int v = y; v < y1 && all; ++v) all = joins(v * kSize + x1, mask, 0, v * kSize + x1 - 1);
              if (!all) break;
            }
          } else if (axis == 1) {
            for (; y1 < within.max[1]; ++y1) {
              bool all = true;
              for (int u = x; u < x1 && all; ++u) all = joins(y1 * kSize + u, mask, 1, (y1 - 1) * kSize + u);
              if (!all) break;
            }
          } else {
            std::uint32_t next = column;  // voxels that the one below them can grow into
            for (int v = y; v < y1; ++v) {
              for (int u = x; u < x1; ++u) {
                const int row = v * kSize + u;
                next &= open[row] & (kLinked ? linked_[2][row] << 1 : ~0u);
              }
            }
            const std::uint32_t stop = z1 < kSize ? ~next >> z1 : 1;
            z1 = stop != 0 ? z1 + __builtin_ctz(stop) : kSize;
            mask = bits(z, z1);
          }
        }
        for (int v = y; v < y1; ++v) {
          for (int u = x; u < x1; ++u) open[v * kSize + u] &= ~mask;
        }
        sink(LocalBox{{x, y, z}, {x1, y1, z1}});
      }
    }
  }
}

template <class Sink>
void BlockGrid::fuseClass(Rows& open, Class c, const LocalBox& within, Sink&& sink) const {
  if (fusible(c)) {
    c == Class::kBetween ? fuseGreedily<true>(open, within, sink) : fuseGreedily<false>(open, within, sink);
    return;
  }
  const std::uint32_t column = bits(within.min[2], within.max[2]);
  for (int y = within.min[1]; y < within.max[1]; ++y) {
    for (int x = within.min[0]; x < within.max[0]; ++x) {
      const int row = y * kSize + x;
      forEachBit(open[row] & column, [&](int z) { sink(LocalBox{{x, y, z}, {x + 1, y + 1, z + 1}}); });
      open[row] &= ~column;
    }
  }
}

// Occupied cells first, so that they share leaves, then by sub-blocks of 8^3 voxels along a Z-order curve;
// within those, single voxels first, since a run of like cells unpacks faster.
void BlockGrid::order(std::vector<Cell>& cells) {
  static const std::array<std::uint8_t, 64> kZOrder = [] {
    std::array<std::uint8_t, 64> rank{};
    for (int z = 0; z < 4; ++z)
      for (int y = 0; y < 4; ++y)
        for (int x = 0; x < 4; ++x)
          rank[z << 4 | y << 2 | x] = static_cast<std::uint8_t>((x & 1) | (y & 1) << 1 | (z & 1) << 2 |
                                                                (x & 2) << 2 | (y & 2) << 3 | (z & 2) << 4);
    return rank;
  }();
  constexpr int kRanks = 2 * 64 * 2;
  std::array<std::uint32_t, kRanks + 1> begin{};
  ranks_.resize(out_.size());
  for (std::size_t i = 0; i < out_.size(); ++i) {
    const Cell& c = out_[i];
    const int x = (c.box.min[0] - base_[0]) >> 3, y = (c.box.min[1] - base_[1]) >> 3,
              z = (c.box.min[2] - base_[2]) >> 3;
    ranks_[i] = static_cast<std::uint8_t>((c.log_odds < model_.occupied) << 7 |
                                          kZOrder[z << 4 | y << 2 | x] << 1 | (c.box.margin() > 3));
    ++begin[ranks_[i] + 1];
  }
  for (int i = 0; i < kRanks; ++i) begin[i + 1] += begin[i];
  cells.resize(out_.size());
  for (std::size_t i = 0; i < out_.size(); ++i) cells[begin[ranks_[i]]++] = out_[i];
}

// ---- expansion and fusion of Fig. 2.7 ------------------------------------------------------------

// Starts from the cells that the block came with. Where observations contradicted one it is split: what still
// agrees stays in cuboids as large as possible. Voxels that are new become cells of their own.
void BlockGrid::splitPieces(const std::vector<VoxelBox>& before) {
  pieces_.clear();
  for (const Class c : {Class::kHigh, Class::kBetween, Class::kLow}) {
    Rows open = voxels_->rows(c);
    const auto add = [&](const LocalBox& box) { pieces_.push_back({box, c}); };
    for (const VoxelBox& b : before) {
      LocalBox local;
      for (int i = 0; i < 3; ++i) {
        local.min[i] = b.min[i] - base_[i];
        local.max[i] = b.max[i] - base_[i];
      }
      fuseClass(open, c, local, add);
    }
    for (int row = 0; row < kSize * kSize; ++row) {
      const int x = row % kSize, y = row / kSize;
      forEachBit(open[row], [&](int z) { add({{x, y, z}, {x + 1, y + 1, z + 1}}); });
    }
  }
}

void BlockGrid::expand(const std::vector<int>& selected) {
  constexpr std::uint16_t kNobody = 0xffff;
  owner_.assign(dense_.log_odds.size(), kNobody);
  for (std::size_t i = 0; i < pieces_.size(); ++i) own(static_cast<int>(i), pieces_[i].box);
  for (const int voxel : selected) {
    if (owner_[voxel] == kNobody) continue;
    while (expandOnce(owner_[voxel])) {  // line 13 of Fig. 2.7
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

// Whether all voxels of the slab are of this class and have these log odds.
bool BlockGrid::slabFits(Class c, float log_odds, const LocalBox& slab) const {
  const Rows& rows = voxels_->rows(c);
  const std::uint32_t mask = bits(slab.min[2], slab.max[2]);
  for (int y = slab.min[1]; y < slab.max[1]; ++y) {
    for (int x = slab.min[0]; x < slab.max[0]; ++x) {
      const int row = y * kSize + x;
      if ((rows[row] & mask) != mask) return false;
      for (int z = slab.min[2]; z < slab.max[2]; ++z) {
        if (logOddsOf(c, row * kSize + z) != log_odds) return false;
      }
    }
  }
  return true;
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
    if (!slabFits(piece.c, log_odds, slab)) continue;
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
