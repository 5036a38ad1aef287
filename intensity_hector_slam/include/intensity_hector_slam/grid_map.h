// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>
#include <Eigen/Geometry>
#include <cstdint>
#include <vector>

#include "intensity_hector_slam/options.h"
#include "intensity_hector_slam/pose.h"
#include "intensity_hector_slam/scan.h"

namespace intensity_hector_slam {

/// G = {g_1, ..., g_p} of section 3.4.1: occupancy P(g_i) and mean reflectivity R(g_i) of square cells. Cell
/// (x, y) covers origin() + resolution() * [x, x + 1) x [y, y + 1).
class GridMap {
 public:
  /// What the matcher reads, next to each other so that both are interpolated at once.
  struct Cell {
    float occupancy = 0.5f;     ///< P(g_i); 0.5 exactly: never observed
    float reflectivity = 0.0f;  ///< R(g_i); 0 without a hit
  };
  /// Of P and R: the interpolated value, its derivatives by x and by y per metre.
  struct Interpolation {
    Eigen::Array2f value, dx, dy;
  };

  GridMap() = default;
  /// @param min corner of the first cell, m, map frame
  GridMap(double resolution, const Eigen::Vector2d& min, int width, int height);

  double resolution() const { return resolution_; }
  const Eigen::Vector2d& origin() const { return origin_; }
  int width() const { return width_; }
  int height() const { return height_; }
  const Cell& cell(int x, int y) const { return cells_[index(x, y)]; }
  /// Hits that the cell's mean reflectivity goes over, at most MapOptions::max_count.
  std::uint16_t count(int x, int y) const { return counts_[index(x, y)]; }
  /// The cell that a point of the map frame (m) is in; null outside.
  const Cell* find(const Eigen::Vector2d& point) const {
    const Eigen::Vector2i at = cellAt(point);
    return contains(at) ? &cells_[index(at.x(), at.y())] : nullptr;
  }
  static bool isKnown(const Cell& cell) { return cell.occupancy != 0.5f; }
  static bool isOccupied(const Cell& cell) { return cell.occupancy > 0.5f; }
  static bool isFree(const Cell& cell) { return cell.occupancy < 0.5f; }
  static bool hasReflectivity(const Cell& cell) { return cell.reflectivity != 0.0f; }
  /// Row by row, height() x width().
  const std::vector<Cell>& cells() const { return cells_; }
  const std::vector<std::uint16_t>& counts() const { return counts_; }

  /// Bilinear interpolation (section 3.4.1) of both at a point of the map frame (m). Beyond the centres of
  /// the outermost cells: never observed.
  Interpolation interpolate(const Eigen::Vector2d& point) const;

  /// Each cell that a beam ends in is updated as occupied once, each that beams only cross as free once, but
  /// for known ones in the last MapOptions::clear_margin of each; so is each that free beams cross. Only
  /// occupied cells have a reflectivity. Beams that end outside are ignored, points without a known
  /// reflectivity count for the occupancy alone.
  /// @param appeared for each point, whether it counts as little as a beam that crosses; empty: none does
  void update(const Scan& scan, const Pose& pose, const MapOptions& options,
              const std::vector<bool>& appeared = {});

  /// Whether a point of the map frame (m) is in a cell with less than this occupancy, and none of the cells
  /// around is occupied.
  bool isOpen(const Eigen::Vector2d& point, double sure_free) const;

  /// Forgets all cells.
  void clear();
  /// Adds cells at the borders, 0 or more.
  void grow(int left, int right, int below, int above);

  /// Sets all of a cell.
  void set(int x, int y, const Cell& cell, std::uint16_t count);
  /// A box of cells outside which nothing was ever observed; empty at the start.
  const Eigen::AlignedBox2i& observedBox() const { return observed_box_; }
  /// The smallest box of cells with all that are known; empty without any.
  Eigen::AlignedBox2i knownCells() const;

 private:
  std::size_t index(int x, int y) const { return static_cast<std::size_t>(y) * width_ + x; }
  bool contains(const Eigen::Vector2i& c) const {
    return c.x() >= 0 && c.y() >= 0 && c.x() < width_ && c.y() < height_;
  }
  Eigen::Vector2i cellAt(const Eigen::Vector2d& point) const {
    const Eigen::Array2d at = (point - origin_).array() / resolution_;
    if (!(at.x() >= 0.0 && at.y() >= 0.0 && at.x() < width_ && at.y() < height_)) return {-1, -1};
    return at.cast<int>();
  }
  // What a scan does to cells, of which the strongest counts: in a box around it, small enough for the cache.
  struct Marks {
    enum : std::uint8_t { kNone = 0, kClearUnknown = 1, kClear = 2, kUnsureHit = 4, kHit = 8 };
    using Word = std::uint64_t;  // cells of a row that are skipped at once, none marked
    Eigen::Vector2i min;         // cell
    int width = 0, height = 0;
    std::vector<std::uint8_t> values;

    void reset(const Eigen::AlignedBox2i& box);
    std::uint8_t* find(const Eigen::Vector2i& cell) {
      return &values[static_cast<std::size_t>(cell.y() - min.y()) * width + cell.x() - min.x()];
    }
  };
  class FreeCells;
  void markBeam(const Eigen::Vector2i& from, const Eigen::Vector2i& to, double clear_margin);
  void applyMarks(const MapOptions& options);
  void average(std::size_t cell, float reflectivity, int max_count);

  double resolution_ = 0.0;
  Eigen::Vector2d origin_ = Eigen::Vector2d::Zero();
  int width_ = 0, height_ = 0;
  std::vector<Cell> cells_;
  std::vector<std::uint16_t> counts_;
  Eigen::AlignedBox2i observed_box_;
  Marks marks_;
  std::vector<Eigen::Vector2i> ends_, free_ends_;  // cells of the scan's points, and of its free beams
};

}  // namespace intensity_hector_slam
