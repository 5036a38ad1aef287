// SPDX-License-Identifier: BSD-3-Clause
//
// OctoMap and the R-tree occupancy map in one process: the same scans in turn, the same sensor model and
// clamping, one thread (thesis, section 2.6).
#pragma once

#include <mapping_simulation/posed_scan.h>
#include <octomap/OcTree.h>

#include <array>
#include <cstddef>
#include <iosfwd>
#include <memory>
#include <set>
#include <vector>

#include "rtree_occupancy_map/occupancy_map.h"

namespace rosbag_tests {

/// What Fig. 2.9 and 2.10 plot, for one map.
struct MapFigures {
  std::size_t cells = 0;        ///< OctoMap: leaves after pruning; R-tree: entries of its leaf nodes
  std::size_t inner_nodes = 0;  ///< the hierarchy above the cells; R-tree: all of its nodes
  std::size_t occupied_cells = 0;
  double insertion_ns_per_point = 0.0;  ///< fusion or pruning included; points are in the map frame already.
                                        ///< Processor time with one thread, elapsed time with several
  double occupied_access_s = 0.0;       ///< to visit all occupied cells: median of several passes
  std::size_t memory_bytes = 0;
};

struct ComparisonResult {
  std::size_t scans = 0, points = 0;
  MapFigures octomap;
  MapFigures octomap_unpruned;       ///< cells and inner nodes alone
  std::size_t full_grid_voxels = 0;  ///< of the bounding box, as a dense grid would need
  std::vector<MapFigures> rtree;     ///< one for each set of options
  // Of the first R-tree map, voxel by voxel.
  std::size_t voxels_compared = 0;     ///< known in either map
  std::size_t voxels_differing = 0;    ///< in class
  std::size_t log_odds_differing = 0;  ///< in log odds, where both know the voxel
  /// [OctoMap's class][R-tree's class]: unknown, free, occupied.
  std::array<std::array<std::size_t, 3>, 3> voxels{};
};

class OctomapComparison {
 public:
  /// One R-tree map for each element; resolution, sensor model, probabilities and maximum range must agree.
  /// @param write_back_every after so many scans all cells are brought up to date in the R-trees, at least 1
  /// @throws std::invalid_argument if they don't, or as rtree_occupancy_map::Options::validate
  explicit OctomapComparison(const std::vector<rtree_occupancy_map::Options>& options,
                             std::size_t write_back_every = 1);

  /// Inserts the scan into all maps, in an order that changes from scan to scan. Non-finite points are left
  /// out.
  void insert(const mapping_simulation::PosedScan& scan);

  /// From each n-th beam of the scans to come keeps its end and three voxels on its way as probes; 0: none.
  void probeEvery(std::size_t beams) { probe_every_ = beams; }
  /// What OctoMap and the first R-tree map say of each probe, as CSV with a header: centre of the voxel (x,
  /// y, z, m, map frame), state (unknown, free, occupied) and log odds of either, empty where it is unknown.
  /// Each voxel once.
  void writeProbes(std::ostream& out) const;

  /// Measures the access and compares. No scan may follow.
  ComparisonResult finish();

  const rtree_occupancy_map::OccupancyMap& map(std::size_t i) const { return maps_[i]; }

 private:
  void keepProbes(const rtree_occupancy_map::Scan& scan);
  void insertIntoOctomap(const octomap::Pointcloud& cloud, const octomap::point3d& origin);
  void measureAccess(ComparisonResult& result) const;
  void compareVoxels(ComparisonResult& result) const;

  const std::size_t write_back_every_;
  octomap::OcTree octree_;
  std::vector<rtree_occupancy_map::OccupancyMap> maps_;
  std::size_t scans_ = 0, points_ = 0;
  double octomap_seconds_ = 0.0;
  std::vector<double> map_seconds_;
  std::size_t probe_every_ = 0;
  std::set<rtree_occupancy_map::Voxel> probes_;
};

/// The table for the terminal; the ratio's direction is in its heading.
void printTable(std::ostream& out, const ComparisonResult& result,
                const std::vector<rtree_occupancy_map::Options>& options);

/// One JSON object with the objects `octomap` and `rtree_occupancy_map` (of the first options).
void printJson(std::ostream& out, const ComparisonResult& result,
               const std::vector<rtree_occupancy_map::Options>& options);

}  // namespace rosbag_tests
