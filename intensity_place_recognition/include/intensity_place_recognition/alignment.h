// SPDX-License-Identifier: BSD-3-Clause
//
// Rough registration of one scan to many, to choose among them by their intensities.
#pragma once

#include <utility>
#include <vector>

#include "intensity_place_recognition/patch_grid.h"

namespace intensity_place_recognition {

/// Of pairs of patches' intensities, which are ranks, so that what changed counts no more than anything else;
/// -1 to 1. 0 where either hardly varies.
double correlationOf(const std::vector<std::pair<float, float>>& pairs);

/// A correlation of intensities, and in how many pieces (cubes of 2 m), which count as independent.
struct Correlation {
  double value = 0.0;
  int pieces = 0;
};
/// By how many standard deviations a correlation is above a value, or above another correlation, in Fisher's
/// transform.
double evidence(const Correlation& correlation, double above);
double evidence(const Correlation& correlation, const Correlation& above);

struct Alignment {
  Eigen::Isometry3d pose = Eigen::Isometry3d::Identity();  ///< query's sensor seen from the place's
  double fit = 0.0;       ///< part of the place's upright patches that the query has, too
  Correlation intensity;  ///< of matched patches
};

/// One query, which has to outlive this.
class Aligner {
 public:
  explicit Aligner(const Shape& query) : field_(query) {}
  /// @param guess query's sensor seen from the place's, right to about a metre and 4 degrees
  Alignment operator()(const Shape& place, const Eigen::Isometry3d& guess) const;

 private:
  PatchField field_;
};

}  // namespace intensity_place_recognition
