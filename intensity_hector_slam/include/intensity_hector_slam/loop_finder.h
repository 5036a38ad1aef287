// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstddef>
#include <deque>
#include <list>
#include <optional>
#include <string>
#include <vector>

#include "intensity_hector_slam/key_poses.h"
#include "intensity_hector_slam/multi_map.h"
#include "intensity_hector_slam/place_finder.h"

namespace intensity_hector_slam {

/// Of the transform between two key poses, of which the one's scan was matched in a map of scans around the
/// other: that of the match, and what such a map is off by.
/// @param match m^2, m rad, rad^2
Eigen::Matrix3d loopCovariance(const Eigen::Matrix3d& match, const LoopOptions& options);

/// Finds loops: key poses at which a place is seen again that earlier key scans saw.
///
/// How far a key pose may be from an earlier one follows from what lies between: covariances and drift add up
/// along the shortest way over consecutive edges and loops that are known. Where it may be near, its scan is
/// sought in all of that region of a small map made of the earlier scans (PlaceFinder). A place that isn't
/// sure is no loop; one in a large region isn't, either, until a second key pose some way on is found in the
/// same place relative to the first.
///
/// Nothing depends on where the front end has the key poses in its map, only on the edges between them.
class LoopFinder {
 public:
  /// @param slam what is searched and matched with
  /// @throws std::invalid_argument that names the option, its value and what is allowed
  explicit LoopFinder(const LoopOptions& options = {}, const SlamOptions& slam = {});

  /// Adds a key pose.
  /// @param scan from there
  /// @param edge from the key pose added before; none: nothing connects it with those before, which are
  /// forgotten
  /// @param search false: it is only kept, for those to come
  /// @return the loops that are sure now, from earlier key poses to this one or one shortly before it
  /// @throws std::invalid_argument where the edge isn't from the last key pose to this one
  std::vector<Edge> add(const KeyPose& key, const Scan& scan, const std::optional<Edge>& edge,
                        bool search = true);

  struct Counts {
    std::size_t key_poses = 0;
    std::size_t forgotten = 0;    ///< of those, whose scans are no more: LoopOptions::memory
    std::size_t searches = 0;     ///< of a scan in a map
    std::size_t unsure = 0;       ///< places found that weren't sure
    std::size_t unconfirmed = 0;  ///< sure ones that nothing has confirmed
    std::size_t loops = 0;
  };
  const Counts& counts() const { return counts_; }
  /// Why the last place that was found wasn't sure.
  const std::string& whyUnsure() const { return why_unsure_; }

 private:
  struct Link {
    std::size_t to;
    Pose transform;
    Eigen::Matrix3d covariance;
    double length;  // m
  };
  struct Node {
    KeyPose key;
    Scan scan;
    double travelled;  // m, with turns
    std::vector<Link> links;
    std::optional<Link> next;  // along the chain
  };
  // Where a key pose is, seen from another.
  struct Relative {
    bool known = false;
    double length = 0.0;
    Pose pose = Pose::Zero();
    Eigen::Matrix3d covariance = Eigen::Matrix3d::Zero();
  };
  struct Submap {
    std::size_t anchor;
    MultiMap map;
    std::vector<std::pair<std::size_t, Pose>> members;  // seen from the anchor
    PlaceFinder finder;
  };
  // A place that is sure by itself.
  struct Found {
    std::size_t from, to;
    Pose transform;
    Eigen::Matrix3d covariance;
    double score;
    bool confirmed;
  };

  void clear();
  double lengthOf(const Pose& transform) const;
  void connect(std::size_t from, std::size_t to, const Pose& transform, const Eigen::Matrix3d& covariance,
               double length);
  std::vector<Relative> reachFrom(std::size_t start) const;
  std::vector<std::size_t> anchorsNear(std::size_t node, const std::vector<Relative>& seen) const;
  std::optional<Found> search(std::size_t node, const std::vector<Relative>& seen);
  Submap& submapAt(std::size_t anchor);
  std::optional<Pose> alongChain(std::size_t from, std::size_t to) const;
  bool agree(const Found& earlier, const Found& later) const;
  Edge accept(const Found& found);
  void forgetBeyondMemory();

  LoopOptions options_;
  SlamOptions slam_;
  MapOptions map_options_;
  std::vector<Node> nodes_;
  std::vector<std::size_t> anchors_;
  std::list<Submap> submaps_;  // the last used first
  std::optional<Found> pending_;
  std::optional<double> last_tie_;  // travelled
  std::size_t points_ = 0, first_kept_ = 0;
  Counts counts_;
  std::string why_unsure_;
};

}  // namespace intensity_hector_slam
