// SPDX-License-Identifier: BSD-3-Clause
//
// Rough registration of one scan to many, to choose among them by their intensities.
#pragma once

#include <utility>
#include <vector>

#include "intensity_place_recognition/patch_grid.h"

namespace intensity_place_recognition {

/// Of pairs of values, what their correlation takes. Sums of parts can be taken off those of all.
struct PairSums {
  double count = 0.0, first = 0.0, second = 0.0, squares = 0.0, other_squares = 0.0, products = 0.0;

  void add(double a, double b) {
    count += 1.0;
    first += a;
    second += b;
    squares += a * a;
    other_squares += b * b;
    products += a * b;
  }
  PairSums without(const PairSums& part) const {
    return {count - part.count,
            first - part.first,
            second - part.second,
            squares - part.squares,
            other_squares - part.other_squares,
            products - part.products};
  }
  /// -1 to 1; 0 where either hardly varies.
  double correlation() const;
};
/// Fisher's transform, about normally distributed.
double fisher(double correlation);

/// Of pairs of patches' intensities, which are ranks, so that what changed counts no more than anything else;
/// -1 to 1. 0 where either hardly varies.
double correlationOf(const std::vector<std::pair<float, float>>& pairs);

/// A correlation of intensities, and in how many pieces (cubes of 2 m).
struct Correlation {
  double value = 0.0;
  int pieces = 0;
  double deviation = 0.0;  ///< standard, of Fisher's transform; 0: of as many independent samples as pieces
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
  struct Effort {
    int iterations;
    std::size_t aligned, judged;  ///< patches at most
  };
  static constexpr Effort kFull{10, 500, 1170}, kLittle{3, 150, 450};
  /// @param guess query's sensor seen from the place's, right to about a metre and 4 degrees
  Alignment operator()(const PackedShape& place, const Eigen::Isometry3d& guess,
                       const Effort& effort = kFull) const;

 private:
  PatchField field_;
};

}  // namespace intensity_place_recognition
