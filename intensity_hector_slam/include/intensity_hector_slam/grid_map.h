// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>
#include <Eigen/Geometry>
#include <array>
#include <cstdint>
#include <cstring>
#include <utility>
#include <vector>

#include "intensity_hector_slam/options.h"
#include "intensity_hector_slam/pose.h"
#include "intensity_hector_slam/scan.h"

namespace intensity_hector_slam {

/// G = {g_1, ..., g_p} of section 3.4.1: occupancy P(g_i) and mean reflectivity R(g_i) of square cells. Cell
/// (x, y) covers resolution() * [x, x + 1) x [y, y + 1) of the map frame, whatever the map's borders are.
/// Cells are kept in tiles, of which there are only those that something was observed in.
class GridMap {
 public:
  /// What the matcher reads, next to each other so that both are interpolated at once.
  struct Cell {
    float occupancy = 0.5f;     ///< P(g_i); 0.5 exactly: never observed
    float reflectivity = 0.0f;  ///< R(g_i); 0 without a hit
  };
  static constexpr int kTileBits = 6, kTileSide = 1 << kTileBits;  ///< cells along each side
  /// Cells row by row.
  struct Tile {
    std::array<Cell, kTileSide * kTileSide> cells;
    std::array<std::uint16_t, kTileSide * kTileSide> counts{};
  };
  /// Of P and R: the interpolated value, its derivatives by x and by y per metre.
  struct Interpolation {
    Eigen::Array2f value, dx, dy;
  };
  /// Two cells beside each other, and the two above them.
  struct Square {
    const Cell *lower, *upper;
  };
  using Squares = std::array<Square, 4>;
  using Seams = std::array<std::array<Cell, 4>, 4>;

  GridMap() = default;
  /// @param box the first and the last of the cells that can be observed
  GridMap(double resolution, const Eigen::AlignedBox2i& box);

  double resolution() const { return resolution_; }
  const Eigen::AlignedBox2i& box() const { return box_; }
  int width() const { return box_.sizes().x() + 1; }
  int height() const { return box_.sizes().y() + 1; }
  /// The corner of the first cell, m, map frame.
  Eigen::Vector2d origin() const { return resolution_ * box_.min().cast<double>(); }
  /// Any, also outside: never observed.
  const Cell& cell(int x, int y) const { return tileOf(x, y).cells[indexIn(x, y)]; }
  /// Hits that the cell's mean reflectivity goes over, at most MapOptions::max_count.
  std::uint16_t count(int x, int y) const { return tileOf(x, y).counts[indexIn(x, y)]; }
  /// Of four points between the centres of cells: the cell left of and below each, with those right of and
  /// above it.
  /// @param u, v cells, (0, 0) is the centre of cell (0, 0)
  /// @param fx, fy where the points are between the centres, 0 to 1
  /// @param seams are filled and pointed to where the cells aren't in one tile
  Squares squares(const Eigen::Array4f& u, const Eigen::Array4f& v, Eigen::Array4f& fx, Eigen::Array4f& fy,
                  Seams& seams) const {
    constexpr int kLast = kTileSide - 1;
    const Ints x = floor(u, fx), y = floor(v, fy), seam = ((x & kLast) == kLast) | ((y & kLast) == kLast);
    std::array<std::uint64_t, 2> any_seam;
    std::memcpy(&any_seam, &seam, sizeof(seam));
    const std::array<const Cell*, 4> lower = cells(x, y);
    Squares squares;
    for (int i = 0; i < 4; ++i) squares[i] = {lower[i], lower[i] + kTileSide};
    if ((any_seam[0] | any_seam[1]) != 0) {
      for (int i = 0; i < 4; ++i) {
        if (seam[i] != 0) squares[i] = square(x[i], y[i], seams[i]);
      }
    }
    return squares;
  }
  /// Those that four points are in; of points outside, one that was never observed.
  /// @param u, v cells, (0, 0) is the corner of cell (0, 0)
  std::array<const Cell*, 4> cellsAt(const Eigen::Array4f& u, const Eigen::Array4f& v) const {
    Eigen::Array4f fx = u, fy = v;
    return cells(floor(u, fx), floor(v, fy));
  }
  /// The cell that a point of the map frame (m) is in; what isn't finite or is very far away is in one that
  /// no map has.
  Eigen::Vector2i cellAt(const Eigen::Vector2d& point) const {
    const Eigen::Array2d at = point.array() / resolution_;
    if (!(at.abs() < kFarAway).all()) return Eigen::Vector2i::Constant(-kFarAway);
    const Eigen::Array2i cut = at.cast<int>();
    return {cut.x() - (at.x() < cut.x()), cut.y() - (at.y() < cut.y())};
  }
  /// The same; null outside.
  const Cell* find(const Eigen::Vector2d& point) const {
    const Eigen::Vector2i at = cellAt(point);
    return box_.contains(at) ? &cell(at.x(), at.y()) : nullptr;
  }
  static bool isKnown(const Cell& cell) { return cell.occupancy != 0.5f; }
  static bool isOccupied(const Cell& cell) { return cell.occupancy > 0.5f; }
  static bool isFree(const Cell& cell) { return cell.occupancy < 0.5f; }
  static bool hasReflectivity(const Cell& cell) { return cell.reflectivity != 0.0f; }

  /// Bilinear interpolation (section 3.4.1) of both at a point of the map frame (m).
  Interpolation interpolate(const Eigen::Vector2d& point) const;

  /// Each cell that a beam ends in is updated as occupied once, each that beams only cross as free once, but
  /// for known ones in the last MapOptions::clear_margin of each; so is each that free beams cross. Only
  /// occupied cells have a reflectivity. Beams that end outside are ignored, points without a known
  /// reflectivity count for the occupancy alone.
  /// @param appeared for each point, whether it counts as little as a beam that crosses; empty: none does
  void update(const Scan& scan, const Pose& pose, const MapOptions& options,
              const std::vector<bool>& appeared = {});

  /// Cells that the last update may have changed.
  const Eigen::AlignedBox2i& updated() const { return updated_; }

  /// Whether a point of the map frame (m) is in a cell with less than this occupancy, and none of the cells
  /// around is occupied.
  bool isOpen(const Eigen::Vector2d& point, double sure_free) const;

  /// Forgets all cells.
  void clear();
  /// Moves the borders outwards.
  void growTo(const Eigen::AlignedBox2i& box);

  /// Sets all of a cell, which is in box().
  void set(int x, int y, const Cell& cell, std::uint16_t count);
  /// Of a cell in its tile's arrays.
  static std::size_t indexIn(int x, int y) {
    constexpr int kMask = kTileSide - 1;
    return static_cast<std::size_t>(y & kMask) << kTileBits | (x & kMask);
  }
  /// Calls `use` for each tile in which something was observed, with the tile and the box of its cells that
  /// are in box(), row by row.
  template <class Use>
  void forTiles(const Use& use) const {
    for (std::size_t i = 1; i < tiles_.size(); ++i) {
      if (tiles_[i]) use(*tiles_[i].get(), cellsOf(i).intersection(box_));
    }
  }
  /// Adds a tile, at the place of the cell (x, y) among others, where there is none.
  /// @return false: there is one, or the cell isn't in the box
  bool add(int x, int y, const Tile& tile);
  /// The smallest box of cells with all that are known; empty without any.
  Eigen::AlignedBox2i knownCells() const;
  /// Of all tiles.
  std::size_t bytes() const;
  /// Whether the same is known, wherever the borders are.
  friend bool operator==(const GridMap& a, const GridMap& b);

 private:
  static constexpr int kFarAway = 1000000000;  // cells; more than any map has
  static Tile unknown_;                        // stands where nothing was observed; isn't written to
  // To a tile that is copied with the map, or to unknown_.
  class TilePointer {
   public:
    TilePointer() = default;
    TilePointer(const TilePointer& other) : tile_(other ? new Tile(*other.tile_) : &unknown_) {}
    TilePointer(TilePointer&& other) noexcept : tile_(std::exchange(other.tile_, &unknown_)) {}
    TilePointer& operator=(TilePointer other) noexcept {
      std::swap(tile_, other.tile_);
      return *this;
    }
    ~TilePointer() {
      if (*this) delete tile_;
    }
    explicit operator bool() const { return tile_ != &unknown_; }
    void make() { *this = TilePointer(new Tile); }
    Tile* get() const { return tile_; }

   private:
    explicit TilePointer(Tile* tile) : tile_(tile) {}
    Tile* tile_ = &unknown_;
  };
  // In tiles_.
  std::size_t indexOf(int x, int y) const {
    const unsigned column = (x >> kTileBits) - first_tile_.x(), row = (y >> kTileBits) - first_tile_.y();
    return column < columns_ && row < rows_ ? (std::size_t{row} << column_bits_) + column + 1 : 0;
  }
  const Tile& tileOf(int x, int y) const { return *tiles_[indexOf(x, y)].get(); }
  // Of a cell in the box; makes it if there is none.
  Tile& tileFor(int x, int y) {
    TilePointer& tile = tiles_[indexOf(x, y)];
    if (!tile) tile.make();
    return *tile.get();
  }
  Square square(int x, int y, std::array<Cell, 4>& seam) const;

  using Ints = int __attribute__((vector_size(16)));  // of Eigen few operations are vectorised
  using Unsigned = unsigned __attribute__((vector_size(16)));
  using Floats = float __attribute__((vector_size(16)));
  // The next integers below, within the range of int.
  static Ints floor(const Eigen::Array4f& values, Eigen::Array4f& fraction) {
    const Eigen::Array4f near = values.max(-kFarAway).min(kFarAway);
    Floats at, left;
    std::memcpy(&at, near.data(), sizeof(at));
    Ints cells = __builtin_convertvector(at, Ints);
    cells += at < __builtin_convertvector(cells, Floats);  // -1 where it is
    left = at - __builtin_convertvector(cells, Floats);
    std::memcpy(fraction.data(), &left, sizeof(left));
    return cells;
  }
  std::array<const Cell*, 4> cells(const Ints& x, const Ints& y) const {
    constexpr int kMask = kTileSide - 1;
    const Unsigned column = (Unsigned)(x >> kTileBits) - static_cast<unsigned>(first_tile_.x()),
                   row = (Unsigned)(y >> kTileBits) - static_cast<unsigned>(first_tile_.y());
    const Unsigned tile =
        (Unsigned)((column < columns_) & (row < rows_)) & ((row << column_bits_) + column + 1U);
    const Ints at = (y & kMask) << kTileBits | (x & kMask);
    std::array<const Cell*, 4> result;
    for (int i = 0; i < 4; ++i) result[i] = tiles_[tile[i]].get()->cells.data() + at[i];
    return result;
  }
  Eigen::AlignedBox2i cellsOf(std::size_t tile) const;

  // What a scan does to cells, of which the strongest counts: in a box around it, small enough for the cache.
  struct Marks {
    enum : std::uint8_t { kNone = 0, kClearUnknown = 1, kClear = 2, kUnsureHit = 4, kHit = 8 };
    using Word = std::uint64_t;  // cells of a row that are skipped at once, none marked; all in one tile
    Eigen::Vector2i min;         // cell, the first of a word
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

  double resolution_ = 0.0;
  Eigen::AlignedBox2i box_, updated_;
  Eigen::Vector2i first_tile_ = Eigen::Vector2i::Zero();
  unsigned columns_ = 0, rows_ = 0, column_bits_ = 0;  // of tiles; in memory 2^column_bits_ columns
  std::vector<TilePointer> tiles_ = std::vector<TilePointer>(1);  // one for what is outside, then row by row
  Marks marks_;
  std::vector<Eigen::Vector2i> ends_, free_ends_;  // cells of the scan's points, and of its free beams
};

}  // namespace intensity_hector_slam
