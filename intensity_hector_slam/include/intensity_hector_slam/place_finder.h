// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>
#include <optional>
#include <string>

#include "intensity_hector_slam/multi_map.h"
#include "intensity_hector_slam/scan_matcher.h"
#include "intensity_hector_slam/scan_search.h"

namespace intensity_hector_slam {

/// Where a scan was taken, without a first guess.
struct Place {
  Pose pose = Pose::Zero();                              ///< map frame
  Eigen::Matrix3d covariance = Eigen::Matrix3d::Zero();  ///< of x, y, theta: m^2, m rad, rad^2
  /// Share of the beams that end on what is occupied, less that of those that end where it is free or cross
  /// what is occupied, and less by the difference of the reflectivities: -3 to 1.
  double score = 0.0;
  double rival = 0.0;  ///< the same of the best place apart from it; 0: none comes near
  bool sure = false;
  std::string why;  ///< it isn't sure
};

/// Finds places in a map: by a search for the best poses, which are then matched, and compared beam by beam
/// on a finer level. A place is sure where nearly all beams agree with the map, and no other fits about as
/// well.
class PlaceFinder {
 public:
  explicit PlaceFinder(const SearchOptions& options = {}, const MatcherOptions& matcher = {});

  /// @param map the same one is prepared only once for each of its MultiMap::updates; see `forget`
  Place find(const MultiMap& map, const Scan& scan, const SearchRegion& region = {});
  /// Whether a scan at a pose looks like a place that could be sure, by its points alone.
  bool fits(const MultiMap& map, const Scan& scan, const Pose& pose);
  /// To be called where the next map is another one.
  void forget() { search_.reset(); }

 private:
  void prepare(const MultiMap& map, const Scan& scan, const SearchRegion& region);

  SearchOptions options_;
  ScanMatcher matcher_;
  bool reflectivity_;
  std::optional<ScanSearch> search_;
  std::size_t updates_ = 0;  // of the map that `search_` is of
  Eigen::AlignedBox2d box_;  // the same
};

}  // namespace intensity_hector_slam
