// SPDX-License-Identifier: BSD-3-Clause
//
// Optimisation that finds out which loops are wrong, so that they don't bend the map.
#pragma once

#include <mapping_common/options.h>

#include <vector>

#include "pose_graph/graph.h"
#include "pose_graph/optimisation.h"

namespace pose_graph {

/// How wrong loops are found. Consecutive edges are trusted by all.
enum class LoopCheck { kNone, kGrowth, kPcm, kGnc, kDcs };
constexpr auto choicesOf(LoopCheck) {
  return mapping_common::choices<LoopCheck>(
      {{"none", LoopCheck::kNone, "all loops are trusted"},
       {"growth", LoopCheck::kGrowth, "loops that agree with all that is known by then, the surest first"},
       {"pcm", LoopCheck::kPcm, "the largest set of loops that agree pairwise over odometry"},
       {"gnc", LoopCheck::kGnc, "graduated non-convexity with truncated least squares"},
       {"dcs", LoopCheck::kDcs, "dynamic covariance scaling"}});
}

struct LoopCheckOptions {
  LoopCheck method = LoopCheck::kGrowth;
  double confidence = 0.99;
  int max_doubts = 100;
  OptimisationOptions optimisation;

  void describe(mapping_common::OptionList& o);
  /// The chi2 that a right loop exceeds with a probability of 1 - confidence.
  /// @param dimension of the error, 3 or 6
  double threshold(int dimension) const;
};

struct LoopCheckResult {
  OptimisationResult optimisation;             ///< with the loops that were accepted
  std::vector<std::size_t> accepted, revoked;  ///< edges that became active, and that have been and aren't
};

/// Optimises from the poses as they are, which should be those of odometry or of an earlier optimisation, and
/// makes loops active that fit, others inactive. All are judged anew, whatever they were before.
///
/// growth: the more loops are accepted, the better is known where the poses at another one's ends lie to each
/// other. Loops whose error is known best come first; accepted are those whose error fits its covariance,
/// alone and with each other of some at a time. Where others contradict what was accepted, it goes, singly or
/// with its neighbours, and what was refused is tried again when more is known; at last also without each of
/// some groups without which least would be known. Where loops fit much better
/// than their information says, as in most simulated graphs, they are judged by how well they do fit.
///
/// pcm: Mangelson et al., "Pairwise Consistent Measurement Set Maximization", ICRA 2018, with a greedy
/// clique. gnc: Yang et al., "Graduated Non-Convexity for Robust Spatial Perception", RA-L 2020. dcs: Agarwal
/// et al., ICRA 2013. After each of these, loops are accepted by their chi2 at the optimum of those accepted
/// before, until no more change.
/// @throws std::invalid_argument for options; std::runtime_error where Ceres fails, or for pcm, where
/// consecutive edges don't connect each node with the next
LoopCheckResult optimiseAndCheck(Graph& graph, const LoopCheckOptions& options = {},
                                 const Progress& progress = {});

}  // namespace pose_graph
