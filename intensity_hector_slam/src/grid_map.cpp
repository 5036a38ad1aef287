// SPDX-License-Identifier: BSD-3-Clause
#include "intensity_hector_slam/grid_map.h"

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <cstring>

#include "interpolation.h"

namespace intensity_hector_slam {
namespace {

// Eq. 2.6 with the prior P(g) = 0.5 (section 3.4.1); odds = P(g | z) / (1 - P(g | z)).
float observed(float probability, float odds) {
  return odds * probability / (odds * probability + (1.0f - probability));
}

float odds(double probability) {
  return static_cast<float>(probability / (1.0 - probability));
}

}  // namespace

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
  const Eigen::Isometry2d to_map = Eigen::Translation2d(pose.head<2>()) * Eigen::Rotation2Dd(pose.z());
  ends_.resize(scan.points.size());
  Eigen::AlignedBox2i box(from);
  for (std::size_t i = 0; i < scan.points.size(); ++i) {
    ends_[i] = cellAt(to_map * scan.points[i].cast<double>());
    if (contains(ends_[i])) box.extend(ends_[i]);
  }
  marks_.reset(box);
  for (std::size_t i = 0; i < ends_.size(); ++i) {
    if (!contains(ends_[i])) continue;
    // Neighbouring beams that end in one cell cross the same cells.
    if (i == 0 || ends_[i] != ends_[i - 1]) markBeam(from, ends_[i], options.clear_margin);
    std::uint8_t& mark = *marks_.find(ends_[i]);
    mark = std::max<std::uint8_t>(mark, !appeared.empty() && appeared[i] ? Marks::kUnsureHit : Marks::kHit);
  }
  applyMarks(options);
  for (std::size_t i = 0; i < scan.reflectivities.size(); ++i) {
    if (!contains(ends_[i])) continue;
    const std::size_t cell = index(ends_[i].x(), ends_[i].y());
    if (!isFree(cells_[cell])) average(cell, scan.reflectivities[i], options.max_count);
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
  for (int y = 0; y < marks_.height; ++y) {
    const std::uint8_t* const row = &marks_.values[static_cast<std::size_t>(y) * marks_.width];
    const std::size_t first = index(marks_.min.x(), marks_.min.y() + y);
    for (int x = 0; x < marks_.width; ++x) {
      if (x % sizeof(Marks::Word) == 0) {
        Marks::Word word;
        std::memcpy(&word, row + x, sizeof(word));
        if (word == 0) {
          x += sizeof(word) - 1;
          continue;
        }
      }
      if (row[x] == Marks::kNone) continue;
      Cell& cell = cells_[first + x];
      if (row[x] >= Marks::kUnsureHit) {
        const float odds = row[x] == Marks::kHit ? hit_odds : unsure_odds;
        cell.occupancy = std::min(observed(cell.occupancy, odds), most);
      } else if (row[x] == Marks::kClear || (row[x] == Marks::kClearUnknown && !isKnown(cell))) {
        if (cell.occupancy <= least) continue;
        cell.occupancy = std::max(observed(cell.occupancy, miss_odds), least);
        if (isFree(cell) && counts_[first + x] > 0) {
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

// Bresenham's line, without its last cell.
void GridMap::markBeam(const Eigen::Vector2i& from, const Eigen::Vector2i& to, double clear_margin) {
  const int dx = std::abs(to.x() - from.x()), dy = std::abs(to.y() - from.y());
  std::ptrdiff_t major = to.x() > from.x() ? 1 : -1, minor = to.y() > from.y() ? marks_.width : -marks_.width;
  int length = dx, rise = dy;
  if (dy > dx) {
    std::swap(major, minor);
    std::swap(length, rise);
  }
  const double unsure = clear_margin / resolution_ * length / std::max(1.0, std::hypot(dx, dy));
  const int sure = length - std::min<double>(length, std::ceil(unsure));
  std::uint8_t* mark = marks_.find(from);
  int error = length / 2;
  const auto clear = [&](int steps, std::uint8_t value) {
    for (int i = 0; i < steps; ++i) {
      *mark = std::max(*mark, value);
      mark += major;
      error -= rise;
      if (error < 0) {
        mark += minor;
        error += length;
      }
    }
  };
  clear(sure, Marks::kClear);
  clear(length - sure, Marks::kClearUnknown);
}

void GridMap::grow(int left, int right, int below, int above) {
  GridMap grown(resolution_, origin_ - resolution_ * Eigen::Vector2d(left, below), width_ + left + right,
                height_ + below + above);
  for (int y = 0; y < height_; ++y) {
    const std::size_t from = index(0, y), to = grown.index(left, y + below);
    std::copy_n(&cells_[from], width_, &grown.cells_[to]);
    std::copy_n(&counts_[from], width_, &grown.counts_[to]);
  }
  *this = std::move(grown);
}

void GridMap::set(int x, int y, const Cell& cell, std::uint16_t count) {
  cells_[index(x, y)] = cell;
  counts_[index(x, y)] = count;
}

Eigen::AlignedBox2i GridMap::knownCells() const {
  Eigen::AlignedBox2i box;
  for (int y = 0; y < height_; ++y) {
    for (int x = 0; x < width_; ++x) {
      if (isKnown(cell(x, y))) box.extend(Eigen::Vector2i(x, y));
    }
  }
  return box;
}

}  // namespace intensity_hector_slam
