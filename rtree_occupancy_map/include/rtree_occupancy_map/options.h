// SPDX-License-Identifier: BSD-3-Clause
//
// What a map is built with. The sensor model's defaults are those of the thesis's evaluation (section 2.6).
#pragma once

#include <cstdint>
#include <limits>
#include <string>

#include "rtree_occupancy_map/rtree.h"

namespace rtree_occupancy_map {

enum class SensorModel {
  kBeam,     ///< a beam frees what it crosses and occupies the voxel that it ends in
  kEndPoint  ///< a beam occupies the voxel that it ends in, that is all
};

/// Which neighbours may fuse. Either way all voxels of a fused cell have had the same log odds.
enum class FusionRule {
  kThesis,     ///< both at or beyond the same clamping threshold, Eq. 2.10 and 2.11
  kEqualValue  ///< both of equal log odds, as OctoMap prunes
};

/// How cells to be fused are searched.
enum class FusionStrategy {
  kBlock,      ///< every block of 32^3 voxels that a scan changed is divided into cuboids anew
  kExpansion,  ///< Fig. 2.7: selected cells double along the search directions for as long as they can
  kNone        ///< cells stay voxels
};

struct Options {
  double resolution = 0.2;           ///< m, edge of a voxel, > 0
  double prob_hit = 0.7;             ///< P_occ, 0.5 to 1
  double prob_miss = 0.4;            ///< P_free, 0 to 0.5
  double clamping_min = 0.12;        ///< mu_min, probability
  double clamping_max = 0.97;        ///< mu_max, probability
  double prior = 0.5;                ///< of a voxel never observed, prob_miss to prob_hit
  double occupancy_threshold = 0.5;  ///< from this probability up a voxel is occupied
  double min_range = 0.0;            ///< m, nearer returns are dropped: the robot itself
  double max_range = std::numeric_limits<double>::infinity();  ///< m, to the end voxel's centre; longer beams
                                                               ///< are cut and only clear
  SensorModel sensor_model = SensorModel::kBeam;
  FusionRule fusion_rule = FusionRule::kEqualValue;
  FusionStrategy fusion_strategy = FusionStrategy::kBlock;
  /// Search order. Blocks: the axes along which a cuboid grows, first to last, a permutation of "xyz".
  /// Expansion: the directions while all sides are equal, + before - ("xyz" is the thesis's); otherwise the
  /// longer sides go first.
  std::string search_order = "zxy";
  double samples_per_metre = 0.5;  ///< expansion only: cells selected along each beam, besides its end point
  std::uint64_t seed = 1;          ///< of that selection
  /// true: cells are updated whatever they have settled at, and split where observations contradict them.
  /// false: what has reached a clamping threshold is no longer updated, as in the thesis (2.5.1).
  bool dynamic = true;
  bool reflectivity = false;  ///< cells carry the mean reflectivity of their returns
  RTreeOptions tree;          ///< order (d, M) and split; the other members are set by the map

  /// @throws std::invalid_argument that names the parameter, its value and the allowed range
  void validate() const;
};

/// From the names that parameters and command lines use, e.g. "beam", "thesis", "block", "quadratic".
/// @throws std::invalid_argument that names the parameter, the value and what is allowed
SensorModel parseSensorModel(const std::string& name);        ///< beam | endpoint
FusionRule parseFusionRule(const std::string& name);          ///< thesis | equal
FusionStrategy parseFusionStrategy(const std::string& name);  ///< block | expansion | none
SplitMethod parseSplitMethod(const std::string& name);        ///< quadratic | linear | rstar

}  // namespace rtree_occupancy_map
