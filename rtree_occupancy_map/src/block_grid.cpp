// SPDX-License-Identifier: BSD-3-Clause
#include "block_grid.h"

#include <algorithm>
#include <cmath>

#include "row_kernels.h"

namespace rtree_occupancy_map {
namespace {

constexpr int kSize = kBlockSize;

}  // namespace

BlockGrid::BlockGrid(const Options& options)
    : options_(options), model_(options), dense_(options.reflectivity), found_(kBlockRows * kBlockSize) {
  for (int i = 0; i < 3; ++i) axes_[i] = options.search_order[i] - 'x';
}

void BlockGrid::fuse(const Block& block, const BlockVoxels& voxels, const std::vector<VoxelBox>& before,
                     const std::vector<int>& selected, std::vector<Cell>& cells) {
  for (int i = 0; i < 3; ++i) base_[i] = block[i] * kSize;
  voxels_ = &voxels;
  voxels.unpack(dense_);
  if (fusible(Class::kBetween)) {
    rowKernels().link(voxels.rows(Class::kBetween), dense_.log_odds.data(), linked_);
  }
  num_found_ = 0;
  if (options_.fusion_strategy == FusionStrategy::kExpansion) {
    splitPieces(before);
    expand(selected);
    for (const Piece& piece : pieces_) emit(piece.box, piece.c);
  } else {
    for (const Class c : {Class::kHigh, Class::kBetween, Class::kLow}) {
      Rows open = voxels.rows(c);
      fuseClass(
          open, c, {{0, 0, 0}, {kSize, kSize, kSize}}, [&](const LocalBox& box) { emit(box, c); },
          [&](int x, int y, std::uint32_t voxels) { emitSingles(x, y, voxels, c); });
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

// The order of the cells in the list: occupied ones first, so that they share leaves, then by sub-blocks of
// 8^3 voxels along a Z-order curve; within those, single voxels first, since a run of like cells unpacks
// faster.
constexpr int kRanks = 2 * 64 * 2;
constexpr auto kZOrder = [] {
  std::array<std::uint8_t, 64> rank{};
  for (int z = 0; z < 4; ++z)
    for (int y = 0; y < 4; ++y)
      for (int x = 0; x < 4; ++x)
        rank[z << 4 | y << 2 | x] = static_cast<std::uint8_t>((x & 1) | (y & 1) << 1 | (z & 1) << 2 |
                                                              (x & 2) << 2 | (y & 2) << 3 | (z & 2) << 4);
  return rank;
}();

inline void BlockGrid::emit(const LocalBox& b, Class c) {
  Found& f = found_[num_found_++];
  for (int i = 0; i < 3; ++i) {
    f.min[i] = static_cast<std::uint8_t>(b.min[i]);
    f.max[i] = static_cast<std::uint8_t>(b.max[i]);
  }
  f.log_odds = logOddsOf(c, (b.min[1] * kSize + b.min[0]) * kSize + b.min[2]);
  const int sub_block = (b.min[2] & 24) << 1 | (b.min[1] & 24) >> 1 | b.min[0] >> 3;
  const bool single = b.max[0] + b.max[1] + b.max[2] - b.min[0] - b.min[1] - b.min[2] == 3;
  f.rank = static_cast<std::uint8_t>((f.log_odds < model_.occupied) << 7 | kZOrder[sub_block] << 1 |
                                     static_cast<int>(!single));
}

// Voxels of a column that are cells as they are.
inline void BlockGrid::emitSingles(int x, int y, std::uint32_t voxels, Class c) {
  const auto byte = [](int i) { return static_cast<std::uint8_t>(i); };
  const int row = y * kSize + x, sub_block = (y & 24) >> 1 | x >> 3;
  Found* f = &found_[num_found_];
  forEachBit(voxels, [&](int z) {
    const float log_odds = logOddsOf(c, row * kSize + z);
    const int rank = (log_odds < model_.occupied) << 7 | kZOrder[(z & 24) << 1 | sub_block] << 1;
    *f++ = {{byte(x), byte(y), byte(z)}, {byte(x + 1), byte(y + 1), byte(z + 1)}, byte(rank), log_odds};
  });
  num_found_ = static_cast<std::size_t>(f - found_.data());
}

Reflectivity BlockGrid::reflectivityOf(const Found& cell) const {
  const Rows* textured = voxels_->textured();
  if (textured == nullptr || cell.log_odds < model_.occupied) return {};
  double sum = 0.0, hits = 0.0;
  int voxels = 0;
  for (int y = cell.min[1]; y < cell.max[1]; ++y) {
    for (int x = cell.min[0]; x < cell.max[0]; ++x) {
      const int row = y * kSize + x;
      forEachBit((*textured)[row] & bits(cell.min[2], cell.max[2]), [&](int z) {
        sum += dense_.reflectivity[row * kSize + z].mean;
        hits += dense_.reflectivity[row * kSize + z].hits;
        ++voxels;
      });
    }
  }
  if (voxels == 0) return {};
  return {static_cast<float>(sum / voxels), static_cast<std::uint32_t>(std::ceil(hits / voxels))};
}

// Divides the open voxels within a box, all of one class, into cuboids of equal log odds: from the first
// voxel that is left, as far as possible along the first axis of the search order, then the second, then the
// third. `sink(box)` gets those, `singles(x, y, voxels)` columns of them that join nothing. kLinked: log odds
// are equal where linked_ says so; otherwise they are equal as a matter of course.
template <bool kLinked, class Sink, class Singles>
void BlockGrid::fuseGreedily(Rows& open, const LocalBox& within, Sink&& sink, Singles&& singles) const {
  const std::uint32_t column = bits(within.min[2], within.max[2]);
  // Whether the voxels of `mask` are open in a row and can join those of the row before it along an axis.
  const auto joins = [&](int row, std::uint32_t mask, int axis, int before) {
    return (open[row] & mask) == mask && (!kLinked || (linked_[axis][before] & mask) == mask);
  };
  for (int y = within.min[1]; y < within.max[1]; ++y) {
    if (!anyInLayer(open, y)) continue;
    for (int x = within.min[0]; x < within.max[0]; ++x) {
      const int first = y * kSize + x;
      const std::uint32_t here = open[first] & column;
      if (here == 0) continue;
      // Voxels that can join none of their neighbours, which is most of them, are cells as they are.
      std::uint32_t joined = kLinked ? linked_[2][first] : here & here >> 1;
      joined |= joined << 1;
      if (x + 1 < within.max[0]) joined |= kLinked ? linked_[0][first] : open[first + 1];
      if (y + 1 < within.max[1]) joined |= kLinked ? linked_[1][first] : open[first + kSize];
      if ((here & ~joined) != 0) singles(x, y, here & ~joined);
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

template <class Sink, class Singles>
void BlockGrid::fuseClass(Rows& open, Class c, const LocalBox& within, Sink&& sink, Singles&& singles) const {
  if (fusible(c)) {
    c == Class::kBetween ? fuseGreedily<true>(open, within, sink, singles)
                         : fuseGreedily<false>(open, within, sink, singles);
    return;
  }
  const std::uint32_t column = bits(within.min[2], within.max[2]);
  for (int y = within.min[1]; y < within.max[1]; ++y) {
    for (int x = within.min[0]; x < within.max[0]; ++x) {
      const int row = y * kSize + x;
      singles(x, y, open[row] & column);
      open[row] &= ~column;
    }
  }
}

void BlockGrid::order(std::vector<Cell>& cells) {
  std::array<std::uint32_t, kRanks + 1> begin{};
  for (std::size_t i = 0; i < num_found_; ++i) ++begin[found_[i].rank + 1];
  for (int i = 0; i < kRanks; ++i) begin[i + 1] += begin[i];
  cells.resize(num_found_);
  const bool textured = voxels_->textured() != nullptr;
  for (std::size_t i = 0; i < num_found_; ++i) {
    const Found& f = found_[i];
    Cell& cell = cells[begin[f.rank]++];
    for (int k = 0; k < 3; ++k) {
      cell.box.min[k] = static_cast<std::int16_t>(base_[k] + f.min[k]);
      cell.box.max[k] = static_cast<std::int16_t>(base_[k] + f.max[k]);
    }
    cell.log_odds = f.log_odds;
    cell.reflectivity = textured ? reflectivityOf(f) : Reflectivity();
  }
}

// ---- expansion and fusion of Fig. 2.7 ------------------------------------------------------------

// Starts from the cells that the block came with. Where observations contradicted one it is split: what still
// agrees stays in cuboids as large as possible. Voxels that are new become cells of their own.
void BlockGrid::splitPieces(const std::vector<VoxelBox>& before) {
  pieces_.clear();
  for (const Class c : {Class::kHigh, Class::kBetween, Class::kLow}) {
    Rows open = voxels_->rows(c);
    const auto add = [&](const LocalBox& box) { pieces_.push_back({box, c}); };
    const auto add_singles = [&](int x, int y, std::uint32_t voxels) {
      forEachBit(voxels, [&](int z) { add({{x, y, z}, {x + 1, y + 1, z + 1}}); });
    };
    for (const VoxelBox& b : before) {
      LocalBox local;
      for (int i = 0; i < 3; ++i) {
        local.min[i] = b.min[i] - base_[i];
        local.max[i] = b.max[i] - base_[i];
      }
      fuseClass(open, c, local, add, add_singles);
    }
    for (int row = 0; row < kSize * kSize; ++row) {
      add_singles(row % kSize, row / kSize, open[row]);
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
