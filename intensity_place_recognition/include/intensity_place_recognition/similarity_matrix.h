// SPDX-License-Identifier: BSD-3-Clause
//
// Several descriptions together (5.2.3), by how similar each finds scans (4.5.3).
#pragma once

#include <Eigen/Core>
#include <vector>

namespace intensity_place_recognition {

/// Scans x scans, symmetric, of any scale; NaN where nothing is known. The diagonal doesn't count.
using SimilarityMatrix = Eigen::MatrixXf;

/// Fusion of scores: each similarity in standard deviations above the mean of its two scans' similarities to
/// all others (z-normalisation, Auckenthaler et al. 2000), so that scales don't matter. Of these the root of
/// the sum of the squares of those above 0, the likelihood ratio of places that look alike by how much isn't
/// known in each: who sees nothing by night neither helps nor outvotes. @param all of the same scans
SimilarityMatrix fused(const std::vector<SimilarityMatrix>& all);

/// `local` where one of the two scans is among the `count` that look the most like the other by `global`;
/// NaN elsewhere.
SimilarityMatrix confirmed(const SimilarityMatrix& global, const SimilarityMatrix& local, int count);

}  // namespace intensity_place_recognition
