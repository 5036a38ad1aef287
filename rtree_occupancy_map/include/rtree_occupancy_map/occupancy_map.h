// SPDX-License-Identifier: BSD-3-Clause
//
// Variable resolution 3D occupancy map (chapter 2): cuboids of equal log odds in an R-tree.
#pragma once

#include <Eigen/Geometry>
#include <cstdint>
#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "rtree_occupancy_map/cell.h"
#include "rtree_occupancy_map/color.h"
#include "rtree_occupancy_map/options.h"
#include "rtree_occupancy_map/rtree.h"
#include "rtree_occupancy_map/scan.h"

namespace mapping_common {
class ArchiveReader;
class ArchiveWriter;
}  // namespace mapping_common

namespace rtree_occupancy_map {

/// The edge in voxels of the blocks that the map is updated, fused and reported by; no cell crosses a block's
/// border.
constexpr int kBlockBits = 5;
constexpr int kBlockSize = 1 << kBlockBits;

/// A map from cells larger than blocks has no more blocks than these: 3e7 m^3 at 10 cm. A few bytes of a
/// corrupted file can claim any volume.
constexpr std::size_t kMostBlocks = std::size_t{1} << 20;

/// Block coordinates: the block holds voxels block * kBlockSize to (block + 1) * kBlockSize, exclusive.
using Block = std::array<int, 3>;

/// The voxels that a box (m) overlaps, cut to the map's coordinates; empty unless min <= max (NaN).
VoxelBox voxelsWithin(const Eigen::Vector3d& min, const Eigen::Vector3d& max, double resolution);

/// What insertScan did.
struct InsertReport {
  std::size_t hits = 0;               ///< points that ended in a voxel
  std::size_t non_finite = 0;         ///< points left out: NaN or infinite
  std::size_t too_near = 0;           ///< points left out: nearer than min_range
  std::size_t beyond_range = 0;       ///< points cut at max_range
  std::size_t outside = 0;            ///< points left out: outside of the voxel coordinates
  std::vector<Block> changed_blocks;  ///< whose cells or colours are others
  std::string window_error;           ///< why more than the rolling window stays in memory; mostly empty
};

enum class VoxelState { kUnknown, kFree, kOccupied };

struct RayHit {
  enum class Result {
    kOccupied,  ///< `cell` is the occupied cell that the ray ends at
    kUnknown,   ///< the ray leaves known space here, and unknown space was not to be ignored
    kNothing    ///< no occupied cell within the range
  };
  Result result = Result::kNothing;
  Eigen::Vector3d point =
      Eigen::Vector3d::Zero();  ///< m, where the ray ends; with no limit, far outside of the map
  Cell cell;
};

struct Statistics {
  std::size_t cells = 0, occupied_cells = 0, free_cells = 0;
  double occupied_volume = 0.0, free_volume = 0.0;  ///< m^3
  std::size_t nodes = 0;                            ///< of the R-tree, of all levels
  int height = 0;
  std::size_t memory_bytes = 0;  ///< see memoryUsage
};

class RollingWindow;
struct WindowOptions;

class OccupancyMap {
 public:
  /// @throws std::invalid_argument that names the option, its value and what is allowed
  explicit OccupancyMap(const Options& options = {});
  /// The map of these cells, which fuse as the options say. They may be of any size; log odds beyond the
  /// clamping thresholds are taken to be at them.
  /// @throws std::invalid_argument where a cell is empty, outside of the map's coordinates or has log odds
  /// that
  ///   aren't finite, where cells overlap, or where they are in more blocks than kMostBlocks
  static OccupancyMap fromCells(const Options& options, const std::vector<Cell>& cells);
  OccupancyMap(OccupancyMap&&) noexcept;
  OccupancyMap& operator=(OccupancyMap&&) noexcept;
  ~OccupancyMap();

  const Options& options() const { return options_; }
  /// All cells. A reference that is kept across an insertion doesn't see what that changes until the next
  /// call. With a rolling window all blocks are read into the memory: the visits below don't do that.
  const RTree& tree() const;
  std::size_t size() const;           ///< cells
  VoxelBox bounds() const;            ///< tight; VoxelBox::empty() without cells
  std::vector<Block> blocks() const;  ///< with cells, in the order of their coordinates

  /// Changes the range limits of Options for the scans to come (m).
  /// @throws std::invalid_argument that names the option, its value and what is allowed
  void setRange(double min_range, double max_range);

  /// Changes Options::color: from now on there are colours, or those there are are forgotten.
  /// @throws std::invalid_argument of a map in a rolling window, which has none
  void setColor(bool color);

  /// Updates every voxel that the scan touches once (Eq. 2.7), an end point before a crossing beam, and
  /// fuses. Beams run to the centre of the voxel that they end in, to each voxel the first.
  /// @throws std::invalid_argument if an origin is non-finite or outside of the map's coordinates, or if
  ///   reflectivities, colours or origins don't match the hits or misses in number; the map is then unchanged
  InsertReport insertScan(const Scan& scan);

  void clear();

  /// Makes all known voxels in the box (m) free. @return the blocks that changed
  std::vector<Block> clearBox(const Eigen::Vector3d& min, const Eigen::Vector3d& max);

  // ---- queries ----------------------------------------------------------------------------------

  /// The cell at a point (m); none where space is unknown.
  std::optional<Cell> cellAt(const Eigen::Vector3d& point) const;
  std::optional<Cell> cellAt(const Voxel& voxel) const;
  VoxelState stateAt(const Eigen::Vector3d& point) const;

  /// Calls `visit(cell)` for each cell that overlaps the box (m), until it returns false.
  template <class Visit>
  void visitBox(const Eigen::Vector3d& min, const Eigen::Vector3d& max, Visit&& visit) const {
    visitBox(boxOf(min, max), visit);
  }
  /// The same of a box in voxels. @return false if it was stopped
  template <class Visit>
  bool visitBox(const VoxelBox& box, Visit&& visit) const {
    return treeWithin(box).visitOverlapping(box, visit) &&
           (!window_ || visitOutside(box, false, [&visit](const Cell& cell) { return visit(cell); }));
  }
  template <class Visit>
  bool visitBlock(const Block& block, Visit&& visit) const {
    return visitBox(boxOf(block), visit);
  }
  template <class Visit>
  bool visitAll(Visit&& visit) const {
    return visitBox(VoxelBox::all(), visit);
  }
  /// Calls `visit(i, cell)` for each cell of each block i, until it returns false. All are brought up to date
  /// at once. @param blocks sorted
  template <class Visit>
  void visitBlocks(const std::vector<Block>& blocks, Visit&& visit) const {
    const RTree& tree = treeIn(blocks);
    for (std::size_t i = 0; i < blocks.size(); ++i) {
      const auto visitCell = [&](const Cell& cell) { return visit(i, cell); };
      if (!tree.visitOverlapping(boxOf(blocks[i]), visitCell)) return;
      if (window_ && !visitOutside(boxOf(blocks[i]), false, visitCell)) return;
    }
  }
  /// Calls `visit(cell)` for each occupied cell, until it returns false; free cells are not touched.
  template <class Visit>
  bool visitOccupied(Visit&& visit) const {
    const VoxelBox all = VoxelBox::all();
    return treeWithin(all).visitOccupied(visit) &&
           (!window_ || visitOutside(all, true, [&visit](const Cell& cell) { return visit(cell); }));
  }
  /// The same for those that overlap a box in voxels.
  template <class Visit>
  bool visitOccupied(const VoxelBox& box, Visit&& visit) const {
    const auto enter = [&box](const VoxelBox& b) { return box.overlaps(b); };
    return treeWithin(box).visitOccupiedIf(enter, visit) &&
           (!window_ || visitOutside(box, true, [&visit](const Cell& cell) { return visit(cell); }));
  }

  /// Follows a ray. With ignore_unknown it passes through unknown space, otherwise it ends there.
  /// @param direction of any length, not zero
  /// @param max_range m
  /// @throws std::invalid_argument on a direction of no length or non-finite input
  RayHit castRay(const Eigen::Vector3d& origin, const Eigen::Vector3d& direction, double max_range,
                 bool ignore_unknown = true) const;

  /// The k occupied cells nearest to a point (m), by distance to the cuboid, nearest first.
  std::vector<Cell> nearestOccupied(const Eigen::Vector3d& point, std::size_t k) const;

  // ---- colours of occupied voxels, with Options::color; without, there are none ------------------

  /// Of a cell of this map: the mean over its voxels that have one.
  std::optional<Color> colorOf(const Cell& cell) const;
  /// Of the voxel at a point (m).
  std::optional<Color> colorAt(const Eigen::Vector3d& point) const;
  /// Of a block's voxels; nullptr where none has one. Valid until the map changes.
  const BlockColors* colorsIn(const Block& block) const;
  /// All there are, block by block.
  std::vector<ColoredVoxel> coloredVoxels() const;
  /// Adds returns to the means of those voxels that are occupied. @param colors in any order
  void addColors(const std::vector<ColoredVoxel>& colors);

  /// Visits all cells.
  Statistics statistics() const;

  /// Bytes of the R-tree and what is beside it in memory, at no cost. The buffers of an insertion are not in
  /// it.
  std::size_t memoryUsage() const;

  // ---- conversions ------------------------------------------------------------------------------

  bool isOccupied(const Cell& cell) const { return cell.log_odds >= options_.tree.occupied_log_odds; }
  static double probability(float log_odds);
  Eigen::Vector3d minCorner(const VoxelBox& box) const;  ///< m
  Eigen::Vector3d maxCorner(const VoxelBox& box) const;  ///< m
  Eigen::Vector3d center(const VoxelBox& box) const { return 0.5 * (minCorner(box) + maxCorner(box)); }
  /// The voxels that the box (m) overlaps, cut to the map's coordinates; empty unless min <= max (NaN).
  VoxelBox boxOf(const Eigen::Vector3d& min, const Eigen::Vector3d& max) const {
    return voxelsWithin(min, max, options_.resolution);
  }
  /// Empty outside of the map's coordinates.
  static VoxelBox boxOf(const Block& block);
  static Block blockOf(const Voxel& voxel) {
    return {voxel[0] >> kBlockBits, voxel[1] >> kBlockBits, voxel[2] >> kBlockBits};
  }

  // ---- files ------------------------------------------------------------------------------------

  /// Writes to a temporary name beside `path` and renames. A path that ends in .db becomes a store, see
  /// below, which must not be open, and can't be of a map with colours.
  /// @throws std::runtime_error with the reason
  void save(const std::string& path) const;
  /// @throws std::runtime_error that says what is wrong with the file: foreign, another version, truncated,
  /// corrupted. Of a store cells are read when they are needed; what changes stays in memory.
  /// @param machine options of which threads, working_set_memory and, where the file's sensor model allows
  /// it, decay_time are taken, which a file doesn't settle
  static OccupancyMap load(const std::string& path, const Options& machine = {});
  /// What save() writes to a file that isn't a store, and the map of it.
  std::string toBytes() const;
  /// @param name in messages, instead of a file's
  static OccupancyMap fromBytes(const char* begin, const char* end, const std::string& name,
                                const Options& machine = {});

  // ---- rolling window ---------------------------------------------------------------------------
  // Blocks that are farther from the last scan's origin than a distance, and those used longest ago beyond a
  // bound on memory, are in a store, an SQLite file, alone. Scans bring in what they touch; queries, files
  // and conversions read what they need and see no difference. Where the store can't be read or written
  // functions throw std::runtime_error and have changed nothing; what an insertion can't write stays in
  // memory. A program that is killed leaves a store of blocks as they last left the memory or flush() wrote
  // them. One map at a time may write to a store.

  /// Goes on with the map of a store that there is.
  static OccupancyMap open(const WindowOptions& window, const Options& machine = {});
  /// Moves the map to a new store, in place of any of that name.
  /// @throws std::invalid_argument of a map with colours, which stores don't have
  void keepIn(const WindowOptions& window);
  /// Writes what the store has not got yet, as the destructor does, which says nothing of errors.
  void flush();

 private:
  struct Insertion;

  static OccupancyMap openStore(const WindowOptions& window, const Options& machine, bool writes);
  void write(mapping_common::ArchiveWriter& write) const;
  static OccupancyMap read(mapping_common::ArchiveReader& read, const Options& machine);
  static OccupancyMap restore(const Options& options, std::vector<Cell> cells);
  // The tree was filled in another way than by scans.
  void startDecay();
  void check(const Scan& scan) const;
  void flushQuietly() noexcept;
  void rasterize(const Scan& scan, InsertReport& report);
  // The voxel that a point is in, kMaxVoxel where that isn't in the map's coordinates.
  Voxel voxelAt(const Eigen::Vector3d& point) const;
  // The tree with the cells of those blocks up to date that overlap the region, or whose boxes pass
  // asked_for.
  const RTree& treeWithin(const VoxelBox& region) const;
  const RTree& treeIn(const std::vector<Block>& blocks) const;
  bool visitOutside(const VoxelBox& box, bool occupied_only,
                    const std::function<bool(const Cell&)>& visit) const;
  const RTree& treeWhere(const std::function<bool(const VoxelBox&)>& asked_for) const;

  Options options_;
  // Cells of blocks in the working set (part of Insertion) may be out of date; treeWithin() brings them up to
  // date, which is all that const functions change.
  mutable RTree tree_;
  std::unique_ptr<Insertion> insertion_;
  std::unique_ptr<RollingWindow> window_;  // none: all is in memory
};

}  // namespace rtree_occupancy_map
