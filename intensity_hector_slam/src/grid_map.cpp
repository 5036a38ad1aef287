// SPDX-License-Identifier: BSD-3-Clause
#include "intensity_hector_slam/grid_map.h"

#include <algorithm>
#include <cmath>
#include <cstdlib>

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
      counts_(cells_.size(), 0),
      marks_(cells_.size(), 0) {}

GridMap::Interpolation GridMap::interpolate(const Eigen::Vector2d& point) const {
  const Eigen::Array2d at = (point - origin_).array() / resolution_ - 0.5;
  Interpolation result{{0.5f, 0.0f}, {0.0f, 0.0f}, {0.0f, 0.0f}};
  if (!(at.x() >= 0.0 && at.y() >= 0.0 && at.x() < width_ - 1 && at.y() < height_ - 1)) return result;
  const int x = static_cast<int>(at.x()), y = static_cast<int>(at.y());
  const Cell* cell = &cells_[index(x, y)];
  result =
      interpolateCells(cell, cell + width_, static_cast<float>(at.x() - x), static_cast<float>(at.y() - y));
  result.dx /= static_cast<float>(resolution_);
  result.dy /= static_cast<float>(resolution_);
  return result;
}

void GridMap::update(const Scan& scan, const Pose& pose, const MapOptions& options) {
  const Eigen::Vector2i from = cellAt(transform(pose, scan.origin.cast<double>()));
  if (!contains(from)) return;
  if (mark_ >= 0xfffffff0u) {
    std::fill(marks_.begin(), marks_.end(), 0);
    mark_ = 0;
  }
  mark_ += 2;  // of hits; free cells get one less, so that a hit isn't cleared by the same scan

  const Eigen::Isometry2d to_map = Eigen::Translation2d(pose.head<2>()) * Eigen::Rotation2Dd(pose.z());
  ends_.resize(scan.points.size());
  for (std::size_t i = 0; i < scan.points.size(); ++i) {
    ends_[i] = cellAt(to_map * scan.points[i].cast<double>());
    if (!contains(ends_[i])) continue;
    const std::size_t cell = index(ends_[i].x(), ends_[i].y());
    hit(cell, options);
    if (!scan.reflectivities.empty()) average(cell, scan.reflectivities[i], options.max_count);
  }
  for (const Eigen::Vector2i& end : ends_) {
    if (contains(end)) clearBeam(from, end, options);
  }
}

void GridMap::hit(std::size_t cell, const MapOptions& options) {
  if (marks_[cell] == mark_) return;
  marks_[cell] = mark_;
  const float updated = observed(cells_[cell].occupancy, odds(options.update_factor_occupied));
  cells_[cell].occupancy = std::min(updated, static_cast<float>(options.max_probability));
}

void GridMap::average(std::size_t cell, float reflectivity, int max_count) {
  if (!std::isfinite(reflectivity)) return;
  if (counts_[cell] < max_count) ++counts_[cell];
  cells_[cell].reflectivity += (reflectivity - cells_[cell].reflectivity) / counts_[cell];
}

// Bresenham's line, without its last cell.
void GridMap::clearBeam(const Eigen::Vector2i& from, const Eigen::Vector2i& to, const MapOptions& options) {
  const float free_odds = odds(options.update_factor_free);
  const float min_probability = static_cast<float>(options.min_probability);
  const int dx = std::abs(to.x() - from.x()), dy = std::abs(to.y() - from.y());
  std::ptrdiff_t major = to.x() > from.x() ? 1 : -1, minor = to.y() > from.y() ? width_ : -width_;
  int length = dx, rise = dy;
  if (dy > dx) {
    std::swap(major, minor);
    std::swap(length, rise);
  }
  const double unsure = options.clear_margin / resolution_ * length / std::max(1.0, std::hypot(dx, dy));
  const int sure = length - std::min<double>(length, std::ceil(unsure));
  std::size_t cell = index(from.x(), from.y());
  int error = length / 2;
  for (int i = 0; i < length; ++i) {
    if (marks_[cell] < mark_ - 1 && (i < sure || !isKnown(cells_[cell]))) {
      marks_[cell] = mark_ - 1;
      float& occupancy = cells_[cell].occupancy;
      if (occupancy > min_probability) {
        occupancy = std::max(observed(occupancy, free_odds), min_probability);
        if (occupancy < 0.5f && counts_[cell] > 0) {
          counts_[cell] = 0;
          cells_[cell].reflectivity = 0.0f;
        }
      }
    }
    cell += major;
    error -= rise;
    if (error < 0) {
      cell += minor;
      error += length;
    }
  }
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
