// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>
#include <Eigen/Geometry>
#include <array>
#include <cstdint>
#include <vector>

#include "intensity_hector_slam/grid_map.h"
#include "intensity_hector_slam/options.h"
#include "intensity_hector_slam/pose.h"
#include "intensity_hector_slam/scan.h"

namespace intensity_hector_slam {

/// Poses of the body among which a scan's is sought.
struct SearchRegion {
  /// m, map frame, where the scanner may be; all of the map where it's larger.
  Eigen::AlignedBox2d box = {Eigen::Vector2d::Constant(-1e9), Eigen::Vector2d::Constant(1e9)};
  double angle = 0.0, half_range = M_PI;  ///< rad: angle +- half_range

  static SearchRegion around(const Pose& pose, double distance, double half_range);
  bool isEverywhere() const { return box.contains(SearchRegion().box); }
};

/// Numbers of a scan's points, without those nearer than a distance (m) to the last before them: what is near
/// has the most beams, and tells no more than what is far.
std::vector<std::size_t> pointsApart(const Scan& scan, double distance);

/// Finds where a scan fits to a map, over all poses on a grid: exactly, by branch and bound on a pyramid of
/// the map (Olson, "Real-time correlative scan matching", ICRA 2009; Hess et al., "Real-time loop closure in
/// 2D LIDAR SLAM", ICRA 2016), here on the reflectivity, too.
///
/// The score of a pose is the mean over the scan's points of what each finds in the cell where it ends: 1 on
/// what is occupied, 1/2 beside, 0 elsewhere, and less by the difference of the reflectivities. The scanner
/// stands in a cell that is free.
class ScanSearch {
 public:
  struct Optimum {
    Pose pose = Pose::Zero();
    double score = 0.0;  ///< 0 to 1
  };

  /// @param map is copied as far as it is needed
  /// @param reflectivity whether it counts
  /// @param box outside which the map isn't looked at, m
  ScanSearch(const GridMap& map, const SearchOptions& options, bool reflectivity,
             const Eigen::AlignedBox2d& box = SearchRegion().box);

  /// The best pose, and the best of those that are SearchOptions::apart from all before it, and so on.
  /// @param least share of the best score that the others have; scores below SearchOptions::min_score don't
  ///   count
  /// @param count of poses, at most
  std::vector<Optimum> optima(const Scan& scan, const SearchRegion& region, double least, int count) const;

  /// The score of a pose, from all points.
  double score(const Scan& scan, const Pose& pose) const;
  /// Mean difference of the points' reflectivities from those of the map around; 0 where none is known.
  double difference(const Scan& scan, const Pose& pose) const;

  /// All poses that `optima` looks at, one by one: what it must find. Slow.
  Optimum bestOfAll(const Scan& scan, const SearchRegion& region) const;

 private:
  // Of a window of 2^h x 2^h cells: what bounds the score of a point that ends in one of them.
  struct Bound {
    std::uint8_t occupied = 0;           // 2: one is; 1: one is beside such a cell
    std::uint8_t least = 255, most = 0;  // of the reflectivities, 255 for 1
    std::uint8_t free = 0;               // 1: one is free
  };
  struct Window;
  struct Turned;
  class Level;

  std::vector<Turned> turn(const Scan& scan, const SearchRegion& region) const;
  // Of the scores in a window; or `least`, where they aren't above that.
  std::int32_t bound(int level, const Turned& turned, const Eigen::Vector2i& at, std::int32_t least) const;
  bool mayStand(int level, const Eigen::Vector2i& at) const;
  const Bound& at(int level, int x, int y) const;
  Eigen::AlignedBox2i cellsOf(const SearchRegion& region) const;
  Pose poseOf(const Turned& turned, const Eigen::Vector2i& at, const Scan& scan) const;
  void descend(const Scan& scan, const std::vector<Turned>& turned, std::vector<Window> windows,
               const Eigen::AlignedBox2i& box, const std::vector<Optimum>& found, std::int32_t& best_score,
               Optimum& best) const;
  std::vector<Eigen::Vector2f> thinned(const Scan& scan, std::vector<int>& reflectivities) const;
  bool isApart(const Pose& pose, const std::vector<Optimum>& found) const;
  const Bound& endOf(const Eigen::Isometry2d& to_map, const Eigen::Vector2f& point) const;
  std::int32_t pointScore(const Bound& bound, int reflectivity) const;

  SearchOptions options_;
  double cell_ = 0.0;
  Eigen::Vector2d origin_ = Eigen::Vector2d::Zero();
  int width_ = 0, height_ = 0;
  std::vector<std::vector<Bound>> levels_;  // level h has 2^h - 1 more columns and rows, before the first
  std::array<std::int32_t, 256> factors_;   // of a point's score, by the difference of the reflectivities
};

}  // namespace intensity_hector_slam
