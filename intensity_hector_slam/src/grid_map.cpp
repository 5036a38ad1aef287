// SPDX-License-Identifier: BSD-3-Clause
#include "intensity_hector_slam/grid_map.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdlib>
#include <cstring>
#include <limits>

#include "interpolation.h"

namespace intensity_hector_slam {
namespace {

// Eq. 2.6 with the prior P(g) = 0.5 (section 3.4.1); odds = P(g | z) / (1 - P(g | z)).
template <class Value>
Value observed(const Value& probability, const Value& odds) {
  return odds * probability / (odds * probability + (1.0f - probability));
}

float odds(double probability) {
  return static_cast<float>(probability / (1.0 - probability));
}

}  // namespace

// Most of a scan is space without anything, where beams only cross: all cells of a word of marks at once.
class GridMap::FreeCells {
 public:
  FreeCells(float miss_odds, float least) : least_(least, lowest(), least, lowest()) {
    for (int i = 0; i < 4; ++i)
      odds_[i] << (i & 1 ? miss_odds : 1.0f), 1.0f, (i & 2 ? miss_odds : 1.0f), 1.0f;
  }
  // @return false where one is occupied, or not all marks are kClear or kNone: nothing is done then
  bool clear(Marks::Word word, Cell* cells) const {
    constexpr Marks::Word all_clear = ~Marks::Word{0} / 0xff * Marks::kClear;
    if (word & ~all_clear) return false;
    Eigen::Map<Eigen::Array<float, 2 * sizeof(word), 1>> values(&cells->occupancy);
    if (!(values.maxCoeff() <= 0.5f)) return false;
    static_assert(Marks::kClear == 2, "the marks of two cells are two bits of the index");
    for (std::size_t i = 0; i < sizeof(word); i += 2) {
      const Eigen::Array4f& odds = odds_[(word >> 1 | word >> 8) & 3];
      values.segment<4>(2 * i) = observed<Eigen::Array4f>(values.segment<4>(2 * i), odds).max(least_);
      word >>= 16;
    }
    return true;
  }

 private:
  static constexpr float lowest() { return std::numeric_limits<float>::lowest(); }
  std::array<Eigen::Array4f, 4> odds_;  // of two cells, P and R in turn; the odds of 1 change nothing
  Eigen::Array4f least_;
};

GridMap::Tile GridMap::unknown_;

GridMap::GridMap(double resolution, const Eigen::AlignedBox2i& box) : resolution_(resolution) {
  growTo(box);
}

void GridMap::growTo(const Eigen::AlignedBox2i& box) {
  const auto tileAt = [](const Eigen::Vector2i& cell) {
    return Eigen::Vector2i(cell.x() >> kTileBits, cell.y() >> kTileBits);
  };
  GridMap grown;
  grown.box_ = box_.merged(box);
  grown.first_tile_ = tileAt(grown.box_.min());
  const Eigen::Vector2i size = tileAt(grown.box_.max()) - grown.first_tile_ + Eigen::Vector2i::Ones();
  grown.columns_ = size.x();
  while (1U << grown.column_bits_ < grown.columns_) ++grown.column_bits_;
  grown.rows_ = size.y();
  grown.tiles_.resize(1 + (std::size_t{grown.rows_} << grown.column_bits_));
  for (std::size_t i = 1; i < tiles_.size(); ++i) {
    if (!tiles_[i]) continue;
    const Eigen::Vector2i cell = cellsOf(i).min();
    grown.tiles_[grown.indexOf(cell.x(), cell.y())] = std::move(tiles_[i]);
  }
  grown.resolution_ = resolution_;
  *this = std::move(grown);
}

Eigen::AlignedBox2i GridMap::cellsOf(std::size_t tile) const {
  const Eigen::Vector2i at((tile - 1) & ((std::size_t{1} << column_bits_) - 1), (tile - 1) >> column_bits_);
  const Eigen::Vector2i first = (first_tile_ + at) * kTileSide;
  return {first, first + Eigen::Vector2i::Constant(kTileSide - 1)};
}

GridMap::Square GridMap::square(int x, int y, std::array<Cell, 4>& seam) const {
  seam = {cell(x, y), cell(x + 1, y), cell(x, y + 1), cell(x + 1, y + 1)};
  return {&seam[0], &seam[2]};
}

GridMap::Interpolation GridMap::interpolate(const Eigen::Vector2d& point) const {
  const Eigen::Array2d at = point.array() / resolution_ - 0.5;
  if (!(at.abs() < kFarAway).all()) return {{0.5f, 0.0f}, {0.0f, 0.0f}, {0.0f, 0.0f}};
  const Eigen::Array2i first = at.floor().cast<int>();
  std::array<Cell, 4> seam;
  const Square square = this->square(first.x(), first.y(), seam);
  const auto both = [](const Cell& cell) { return Eigen::Array2f(cell.occupancy, cell.reflectivity); };
  const Eigen::Array2f fraction = (at - first.cast<double>()).cast<float>();
  const Bilinear<Eigen::Array2f> bilinear(both(square.lower[0]), both(square.lower[1]), both(square.upper[0]),
                                          both(square.upper[1]), fraction.x(), fraction.y());
  const float cell = static_cast<float>(resolution_);
  return {bilinear.value, bilinear.dx / cell, bilinear.dy / cell};
}

bool GridMap::isOpen(const Eigen::Vector2d& point, double sure_free) const {
  const Eigen::Vector2i at = cellAt(point);
  if (cell(at.x(), at.y()).occupancy >= sure_free) return false;
  for (int y = at.y() - 1; y <= at.y() + 1; ++y) {
    for (int x = at.x() - 1; x <= at.x() + 1; ++x) {
      if (isOccupied(cell(x, y))) return false;
    }
  }
  return true;
}

void GridMap::update(const Scan& scan, const Pose& pose, const MapOptions& options,
                     const std::vector<bool>& appeared) {
  updated_.setEmpty();
  const Eigen::Vector2i from = cellAt(transform(pose, scan.origin.cast<double>()));
  if (!box_.contains(from)) return;
  const Eigen::Isometry2d to_map = isometry(pose);
  ends_.resize(scan.points.size());
  Eigen::AlignedBox2i box(from);
  for (std::size_t i = 0; i < scan.points.size(); ++i) {
    ends_[i] = cellAt(to_map * scan.points[i].cast<double>());
    if (box_.contains(ends_[i])) box.extend(ends_[i]);
  }
  free_ends_.clear();
  for (const Eigen::Vector2f& end : scan.free) {
    const Eigen::Vector2i at = cellAt(to_map * end.cast<double>());
    if (!box_.contains(at)) continue;
    free_ends_.push_back(at);
    box.extend(at);
  }
  updated_ = box;
  marks_.reset(box);
  for (std::size_t i = 0; i < ends_.size(); ++i) {
    if (!box_.contains(ends_[i])) continue;
    // Neighbouring beams that end in one cell cross the same cells.
    if (i == 0 || ends_[i] != ends_[i - 1]) markBeam(from, ends_[i], options.clear_margin);
    *marks_.find(ends_[i]) |= !appeared.empty() && appeared[i] ? Marks::kUnsureHit : Marks::kHit;
  }
  for (const Eigen::Vector2i& end : free_ends_) markBeam(from, end, 0.0);
  applyMarks(options);
  for (std::size_t i = 0; i < scan.reflectivities.size(); ++i) {
    if (!box_.contains(ends_[i])) continue;
    Tile& tile = tileFor(ends_[i].x(), ends_[i].y());
    const std::size_t at = indexIn(ends_[i].x(), ends_[i].y());
    Cell& cell = tile.cells[at];
    std::uint16_t& count = tile.counts[at];
    const float reflectivity = scan.reflectivities[i];
    if (!isOccupied(cell) || !std::isfinite(reflectivity)) continue;
    if (count < options.max_count) ++count;
    cell.reflectivity += (reflectivity - cell.reflectivity) / count;
  }
}

void GridMap::Marks::reset(const Eigen::AlignedBox2i& box) {
  constexpr int kWord = sizeof(Word);
  static_assert(kTileSide % kWord == 0);
  min = {box.min().x() & -kWord, box.min().y()};
  height = box.max().y() - min.y() + 1;
  width = ((box.max().x() - min.x()) / kWord + 1) * kWord;
  values.assign(static_cast<std::size_t>(width) * height, kNone);
}

// Row by row, which is how the cells are in memory.
void GridMap::applyMarks(const MapOptions& options) {
  const float hit_odds = odds(options.update_factor_occupied), miss_odds = odds(options.update_factor_free);
  const float unsure_odds = odds(1.0 - options.update_factor_free);
  const float most = static_cast<float>(options.max_probability),
              least = static_cast<float>(options.min_probability);
  const FreeCells free_cells(miss_odds, least);
  for (int y = 0; y < marks_.height; ++y) {
    const std::uint8_t* const row = &marks_.values[static_cast<std::size_t>(y) * marks_.width];
    Tile* in = nullptr;  // that the last word was in
    int begin = 0;       // its first column
    for (int x = 0; x < marks_.width; x += sizeof(Marks::Word)) {
      Marks::Word word;
      std::memcpy(&word, row + x, sizeof(word));
      if (word == 0) continue;
      const Eigen::Vector2i at = marks_.min + Eigen::Vector2i(x, y);
      const int tile_begin = at.x() & ~(kTileSide - 1);
      if (!in || tile_begin != begin) {
        in = &tileFor(at.x(), at.y());
        begin = tile_begin;
      }
      Tile& tile = *in;
      const std::size_t first = indexIn(at.x(), at.y());
      if (free_cells.clear(word, &tile.cells[first])) continue;
      for (std::size_t i = 0; i < sizeof(word); ++i) {
        const std::uint8_t mark = row[x + i];
        if (mark == Marks::kNone) continue;
        Cell& cell = tile.cells[first + i];
        if (mark >= Marks::kUnsureHit) {
          const float odds = mark & Marks::kHit ? hit_odds : unsure_odds;
          cell.occupancy = std::min(observed(cell.occupancy, odds), most);
        } else if (mark & Marks::kClear || !isKnown(cell)) {
          if (cell.occupancy <= least) continue;
          cell.occupancy = std::max(observed(cell.occupancy, miss_odds), least);
          if (!isOccupied(cell) && tile.counts[first + i] > 0) {
            tile.counts[first + i] = 0;
            cell.reflectivity = 0.0f;
          }
        }
      }
    }
  }
}

// The cells of a line that are nearest to it, one per row or column, without the last.
void GridMap::markBeam(const Eigen::Vector2i& from, const Eigen::Vector2i& to, double clear_margin) {
  const int dx = std::abs(to.x() - from.x()), dy = std::abs(to.y() - from.y());
  std::ptrdiff_t major = to.x() > from.x() ? 1 : -1, minor = to.y() > from.y() ? marks_.width : -marks_.width;
  int length = dx, rise = dy;
  if (dy > dx) {
    std::swap(major, minor);
    std::swap(length, rise);
  }
  if (length == 0) return;
  const double share = length / std::sqrt(static_cast<double>(dx) * dx + static_cast<double>(dy) * dy);
  const int unsure =
      static_cast<int>(std::min<double>(length, std::ceil(clear_margin / resolution_ * share)));
  std::uint8_t* const first = marks_.find(from);
  constexpr int kFraction = 32;  // bits
  const std::int64_t slope = (static_cast<std::int64_t>(rise) << kFraction) / length;
  std::int64_t at = std::int64_t{1} << (kFraction - 1);
  const auto clear = [&](int begin, int end, std::uint8_t mark) {
    for (int i = begin; i < end; ++i, at += slope) first[i * major + (at >> kFraction) * minor] |= mark;
  };
  clear(0, length - unsure, Marks::kClear);
  clear(length - unsure, length, Marks::kClearUnknown);
}

void GridMap::clear() {
  std::fill(tiles_.begin(), tiles_.end(), TilePointer());
}

void GridMap::set(int x, int y, const Cell& cell, std::uint16_t count) {
  Tile& tile = tileFor(x, y);
  tile.cells[indexIn(x, y)] = cell;
  tile.counts[indexIn(x, y)] = count;
}

bool GridMap::add(int x, int y, const Tile& tile) {
  if (!box_.contains(Eigen::Vector2i(x, y)) || tiles_[indexOf(x, y)]) return false;
  tileFor(x, y) = tile;
  return true;
}

Eigen::AlignedBox2i GridMap::knownCells() const {
  Eigen::AlignedBox2i known;
  forTiles([&](const Tile& tile, const Eigen::AlignedBox2i& box) {
    for (int y = box.min().y(); y <= box.max().y(); ++y) {
      for (int x = box.min().x(); x <= box.max().x(); ++x) {
        if (isKnown(tile.cells[indexIn(x, y)])) known.extend(Eigen::Vector2i(x, y));
      }
    }
  });
  return known;
}

std::size_t GridMap::bytes() const {
  return sizeof(Tile) *
             std::count_if(tiles_.begin(), tiles_.end(), [](const auto& tile) { return bool(tile); }) +
         sizeof(TilePointer) * tiles_.size();
}

bool operator==(const GridMap& a, const GridMap& b) {
  const auto holdsAllOf = [](const GridMap& one, const GridMap& other) {
    bool same = true;
    other.forTiles([&](const GridMap::Tile&, const Eigen::AlignedBox2i& box) {
      for (int y = box.min().y(); same && y <= box.max().y(); ++y) {
        for (int x = box.min().x(); same && x <= box.max().x(); ++x) {
          const GridMap::Cell &c = one.cell(x, y), &d = other.cell(x, y);
          same = c.occupancy == d.occupancy && c.reflectivity == d.reflectivity &&
                 one.count(x, y) == other.count(x, y);
        }
      }
    });
    return same;
  };
  return a.resolution_ == b.resolution_ && holdsAllOf(a, b) && holdsAllOf(b, a);
}

}  // namespace intensity_hector_slam
