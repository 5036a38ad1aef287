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

GridMap::GridMap(double resolution, const Eigen::Vector2d& min, int width, int height)
    : resolution_(resolution),
      origin_(min),
      width_(width),
      height_(height),
      cells_(static_cast<std::size_t>(width) * height),
      counts_(cells_.size(), 0) {}

GridMap::Interpolation GridMap::interpolate(const Eigen::Vector2d& point) const {
  const Eigen::Array2d at = (point - origin_).array() / resolution_ - 0.5;
  if (!(at.x() >= 0.0 && at.y() >= 0.0 && at.x() < width_ - 1 && at.y() < height_ - 1)) {
    return {{0.5f, 0.0f}, {0.0f, 0.0f}, {0.0f, 0.0f}};
  }
  const int x = static_cast<int>(at.x()), y = static_cast<int>(at.y());
  const auto both = [this](int column, int row) {
    const Cell& cell = cells_[index(column, row)];
    return Eigen::Array2f(cell.occupancy, cell.reflectivity);
  };
  const Bilinear<Eigen::Array2f> bilinear(both(x, y), both(x + 1, y), both(x, y + 1), both(x + 1, y + 1),
                                          static_cast<float>(at.x() - x), static_cast<float>(at.y() - y));
  const float cell = static_cast<float>(resolution_);
  return {bilinear.value, bilinear.dx / cell, bilinear.dy / cell};
}

bool GridMap::isOpen(const Eigen::Vector2d& point, double sure_free) const {
  const Eigen::Vector2i at = cellAt(point);
  if (at.x() < 1 || at.y() < 1 || at.x() > width_ - 2 || at.y() > height_ - 2) return false;
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
  const Eigen::Vector2i from = cellAt(transform(pose, scan.origin.cast<double>()));
  if (!contains(from)) return;
  const Eigen::Isometry2d to_map = isometry(pose);
  ends_.resize(scan.points.size());
  Eigen::AlignedBox2i box(from);
  for (std::size_t i = 0; i < scan.points.size(); ++i) {
    ends_[i] = cellAt(to_map * scan.points[i].cast<double>());
    if (contains(ends_[i])) box.extend(ends_[i]);
  }
  free_ends_.clear();
  for (const Eigen::Vector2f& end : scan.free) {
    const Eigen::Vector2i at = cellAt(to_map * end.cast<double>());
    if (!contains(at)) continue;
    free_ends_.push_back(at);
    box.extend(at);
  }
  marks_.reset(box);
  observed_box_.extend(box);
  for (std::size_t i = 0; i < ends_.size(); ++i) {
    if (!contains(ends_[i])) continue;
    // Neighbouring beams that end in one cell cross the same cells.
    if (i == 0 || ends_[i] != ends_[i - 1]) markBeam(from, ends_[i], options.clear_margin);
    *marks_.find(ends_[i]) |= !appeared.empty() && appeared[i] ? Marks::kUnsureHit : Marks::kHit;
  }
  for (const Eigen::Vector2i& end : free_ends_) markBeam(from, end, 0.0);
  applyMarks(options);
  for (std::size_t i = 0; i < scan.reflectivities.size(); ++i) {
    if (!contains(ends_[i])) continue;
    const std::size_t cell = index(ends_[i].x(), ends_[i].y());
    if (isOccupied(cells_[cell])) average(cell, scan.reflectivities[i], options.max_count);
  }
}

void GridMap::Marks::reset(const Eigen::AlignedBox2i& box) {
  min = box.min();
  height = box.sizes().y() + 1;
  width = (box.sizes().x() / sizeof(Word) + 1) * sizeof(Word);
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
    const std::size_t first = index(marks_.min.x(), marks_.min.y() + y);
    for (int x = 0; x < marks_.width; ++x) {
      if (x % sizeof(Marks::Word) == 0) {
        Marks::Word word;
        std::memcpy(&word, row + x, sizeof(word));
        const bool inside = marks_.min.x() + x + static_cast<int>(sizeof(word)) <= width_;
        if (word == 0 || (inside && free_cells.clear(word, &cells_[first + x]))) {
          x += sizeof(word) - 1;
          continue;
        }
      }
      if (row[x] == Marks::kNone) continue;
      Cell& cell = cells_[first + x];
      if (row[x] >= Marks::kUnsureHit) {
        const float odds = row[x] & Marks::kHit ? hit_odds : unsure_odds;
        cell.occupancy = std::min(observed(cell.occupancy, odds), most);
      } else if (row[x] & Marks::kClear || !isKnown(cell)) {
        if (cell.occupancy <= least) continue;
        cell.occupancy = std::max(observed(cell.occupancy, miss_odds), least);
        if (!isOccupied(cell) && counts_[first + x] > 0) {
          counts_[first + x] = 0;
          cell.reflectivity = 0.0f;
        }
      }
    }
  }
}

void GridMap::average(std::size_t cell, float reflectivity, int max_count) {
  if (!std::isfinite(reflectivity)) return;
  if (counts_[cell] < max_count) ++counts_[cell];
  cells_[cell].reflectivity += (reflectivity - cells_[cell].reflectivity) / counts_[cell];
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

// No more than what was observed: a large map is much slower to fill than a scan.
void GridMap::clear() {
  if (observed_box_.isEmpty()) return;
  const std::size_t columns = observed_box_.sizes().x() + 1;
  for (int y = observed_box_.min().y(); y <= observed_box_.max().y(); ++y) {
    std::fill_n(&cells_[index(observed_box_.min().x(), y)], columns, Cell{});
    std::fill_n(&counts_[index(observed_box_.min().x(), y)], columns, 0);
  }
  observed_box_.setEmpty();
}

void GridMap::grow(int left, int right, int below, int above) {
  GridMap grown(resolution_, origin_ - resolution_ * Eigen::Vector2d(left, below), width_ + left + right,
                height_ + below + above);
  for (int y = 0; y < height_; ++y) {
    const std::size_t from = index(0, y), to = grown.index(left, y + below);
    std::copy_n(&cells_[from], width_, &grown.cells_[to]);
    std::copy_n(&counts_[from], width_, &grown.counts_[to]);
  }
  grown.observed_box_ = observed_box_;
  if (!observed_box_.isEmpty()) grown.observed_box_.translate(Eigen::Vector2i(left, below));
  *this = std::move(grown);
}

void GridMap::set(int x, int y, const Cell& cell, std::uint16_t count) {
  observed_box_.extend(Eigen::Vector2i(x, y));
  cells_[index(x, y)] = cell;
  counts_[index(x, y)] = count;
}

Eigen::AlignedBox2i GridMap::knownCells() const {
  Eigen::AlignedBox2i box;
  if (observed_box_.isEmpty()) return box;
  for (int y = observed_box_.min().y(); y <= observed_box_.max().y(); ++y) {
    for (int x = observed_box_.min().x(); x <= observed_box_.max().x(); ++x) {
      if (isKnown(cell(x, y))) box.extend(Eigen::Vector2i(x, y));
    }
  }
  return box;
}

}  // namespace intensity_hector_slam
