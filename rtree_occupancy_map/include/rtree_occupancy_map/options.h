// SPDX-License-Identifier: BSD-3-Clause
//
// What a map is built with. The sensor model's defaults are those of the thesis's evaluation (section 2.6).
#pragma once

#include <mapping_common/options.h>

#include <cstdint>
#include <limits>
#include <string>
#include <vector>

#include "rtree_occupancy_map/rtree.h"

namespace rtree_occupancy_map {

enum class SensorModel { kBeam, kEndPoint };
constexpr auto choicesOf(SensorModel) {
  return mapping_common::choices<SensorModel>(
      {{"beam", SensorModel::kBeam, "frees what beams cross and occupies the voxels where they end"},
       {"endpoint", SensorModel::kEndPoint, "only occupies"}});
}

/// Which neighbours may fuse. Either way all voxels of a fused cell have had the same log odds.
enum class FusionRule { kThesis, kEqualValue };
constexpr auto choicesOf(FusionRule) {
  return mapping_common::choices<FusionRule>(
      {{"thesis", FusionRule::kThesis, "those at or beyond the same clamping threshold, Eq. 2.10 and 2.11"},
       {"equal", FusionRule::kEqualValue, "those of equal log odds, as OctoMap prunes"}});
}

/// How cells to be fused are searched.
enum class FusionStrategy { kBlock, kExpansion, kNone };
constexpr auto choicesOf(FusionStrategy) {
  return mapping_common::choices<FusionStrategy>(
      {{"block", FusionStrategy::kBlock, "divides every changed block of 32^3 voxels into cuboids anew"},
       {"expansion", FusionStrategy::kExpansion,
        "selected cells double along the search directions for as long as they can, Fig. 2.7"},
       {"none", FusionStrategy::kNone, "cells stay voxels"}});
}

/// See describe() for what each is.
struct Options {
  double resolution = 0.2;
  SensorModel sensor_model = SensorModel::kBeam;
  double prob_hit = 0.7;                            ///< P_occ
  double prob_miss = 0.4;                           ///< P_free
  double clamping_min = 0.12, clamping_max = 0.97;  ///< mu_min, mu_max
  double prior = 0.5;
  double occupancy_threshold = 0.5;
  double min_range = 0.0, max_range = std::numeric_limits<double>::infinity();
  FusionRule fusion_rule = FusionRule::kEqualValue;
  FusionStrategy fusion_strategy = FusionStrategy::kBlock;
  std::string search_order = "zxy";
  double samples_per_metre = 0.5;
  std::uint64_t seed = 1;
  bool dynamic = true;
  bool reflectivity = false;
  bool color = false;
  double decay_time = 0.0;  ///< s, 0: none
  int threads = 0;
  double working_set_memory = 64.0;  ///< MiB
  RTreeOptions tree;                 ///< those that it doesn't describe are set by the map

  void describe(mapping_common::OptionList& o) {
    o("resolution", resolution, "m", "edge of a voxel, the smallest cell").above(0.0).below(1e6);
    o("reflectivity", reflectivity, "",
      "true: cells carry the mean reflectivity of their returns, for 8 bytes a cell");
    o("color", color, "",
      "true: occupied voxels carry the mean colour of their returns, of clouds that have rgb or rgba, for 18 "
      "bytes a voxel; not with a rolling window");
    o("dynamic", dynamic, "",
      "true: what moved away is cleared; false: what has reached a clamping threshold is no longer updated, "
      "as in the "
      "thesis (2.5.1), which costs less time");
    o("decay_time", decay_time, "s",
      "an obstacle that no beam has met or crossed for so long is forgotten: step by step, each as a miss, "
      "from the "
      "upper clamping threshold until it is no longer occupied, and then unknown; what settled less goes "
      "sooner. Free "
      "space stays. 0: nothing is forgotten")
        .atLeast(0.0);
    o("sensor_model/type", sensor_model, "", "");
    o("sensor_model/hit", prob_hit, "",
      "probability of being occupied where a beam ends: higher settles sooner")
        .atLeast(0.5)
        .below(1.0);
    o("sensor_model/miss", prob_miss, "", "the same where a beam crosses: lower clears sooner")
        .above(0.0)
        .atMost(0.5);
    o("sensor_model/min", clamping_min, "",
      "clamping thresholds, probabilities: the closer to 0 and 1, the more observations it takes to change "
      "what has "
      "settled")
        .above(0.0)
        .below(0.5);
    o("sensor_model/max", clamping_max, "", "the same for what is occupied").above(0.5).below(1.0);
    o("sensor_model/prior", prior, "", "probability of what was never observed");
    o("sensor_model/occupancy_threshold", occupancy_threshold, "",
      "from this probability up a cell is occupied");
    o("sensor_model/min_range", min_range, "m", "nearer returns are left out: the robot itself")
        .atLeast(0.0)
        .dynamic();
    o("sensor_model/max_range", max_range, "m",
      "to the centre of the voxel that a beam ends in; longer beams are cut here and only clear")
        .above(0.0)
        .orUnlimited()
        .dynamic();
    o("fusion/rule", fusion_rule, "", "which neighbouring cells fuse to larger ones");
    o("fusion/strategy", fusion_strategy, "", "how they are searched");
    o("fusion/search_order", search_order, "",
      "axes along which a cuboid grows, first to last; with expansion the directions while all sides are "
      "equal (the "
      "thesis's are xyz), otherwise the longer sides go first")
        .oneOf({"xyz", "xzy", "yxz", "yzx", "zxy", "zyx"});
    o("fusion/samples_per_metre", samples_per_metre, "1/m",
      "expansion: cells selected along each beam, besides its end; more fuse more, and take more time")
        .within(0.0, 1000.0);
    o("seed", seed, "", "expansion: of that selection. The same seed and scans give the same map").atLeast(0);
    o("threads", threads, "",
      "of an insertion, 0: as many as there are cores; the map is the same whatever their number")
        .within(0, 256);
    o("working_set_memory", working_set_memory, "MiB",
      "blocks that the last scans touched are kept taken apart into voxels, for the scans to come; what "
      "exceeds "
      "this goes back into the R-tree after each scan")
        .within(0.0, 1e6);
    o.group("tree", "the R-tree, a trade of memory against time", tree);
    o.require(prior >= prob_miss && prior <= prob_hit && prior > clamping_min && prior < clamping_max,
              "sensor_model/prior", "miss to hit, between the clamping thresholds");
    o.require(occupancy_threshold > clamping_min && occupancy_threshold < clamping_max,
              "sensor_model/occupancy_threshold", "between the clamping thresholds");
    o.require(decay_time == 0.0 || (dynamic && prob_miss < prior), "decay_time",
              "0, unless dynamic is true and sensor_model/miss below the prior");
    o.require(max_range > min_range, "sensor_model/max_range", "more than min_range");
  }
};

/// Those that files have: without color, which came later, where it is false, so that nothing changes for who
/// doesn't use it. @param options that outlive them
std::vector<mapping_common::Option> optionsInFiles(Options& options);

/// Whether maps mean the same: all but what a machine settles (threads, working_set_memory, decay_time),
/// colours, the limits of the range and the seed, which only count for scans to come, and the R-tree's own
/// options.
/// @throws std::invalid_argument that names the first option that differs, and both values
void requireLike(const Options& options, const Options& expected);

}  // namespace rtree_occupancy_map
