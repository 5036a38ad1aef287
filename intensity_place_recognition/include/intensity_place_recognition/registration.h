// SPDX-License-Identifier: BSD-3-Clause
//
// Verification: the pose of one scan seen from another in 6 degrees of freedom, and whether they show the
// same place.
#pragma once

#include "intensity_place_recognition/alignment.h"
#include "intensity_place_recognition/patch_grid.h"

namespace intensity_place_recognition {

struct RegistrationOptions {
  double max_distance = 5.0;
  int iterations = 15;
  double min_score = 0.45, min_intensity = 0.2, min_evidence = 5.0;
  int min_pieces = 120;

  void describe(mapping_common::OptionList& o) {
    o("max_distance", max_distance, "m", "scans from places farther apart show different places")
        .within(0.5, 100.0);
    o("iterations", iterations, "", "of the iterative closest points").within(1, 200);
    o("min_score", min_score, "", "of a pair that is accepted").within(0.0, 1.0).dynamic();
    o("min_intensity", min_intensity, "",
      "correlation of intensities that places of one shape reach; -1 for scanners without intensities")
        .within(-1.0, 1.0)
        .dynamic();
    o("min_evidence", min_evidence, "", "standard deviations that the intensities' correlation is above it")
        .within(0.0, 100.0)
        .dynamic();
    o("min_pieces", min_pieces, "",
      "cubes of 2 m with surfaces that both see: rooms and the like may be built and furnished alike")
        .within(0, 100000)
        .dynamic();
  }
};

using Matrix6 = Eigen::Matrix<double, 6, 6>;

struct Registration {
  Eigen::Isometry3d pose = Eigen::Isometry3d::Identity();  ///< query's sensor seen from the match's
  Matrix6 covariance = Matrix6::Identity();  ///< m, rad; x y z and rotation x y z about the match's axes
  double agreement = 0.0;                    ///< of what both must see, the part that both do, 0 to 1
  double common = 0.0;                       ///< the part of the patches that can be judged, 0 to 1
  Correlation intensity;                     ///< of matched patches
  double evidence = 0.0;                     ///< see RegistrationOptions::min_evidence
  double score = 0.0;                        ///< 0 to 1, see RegistrationOptions::min_score
  bool accepted = false;
};

/// The inverse covariance of the same error in the axes of the query's sensor, as EdgeConstraint has it.
Matrix6 informationAtQuery(const Registration& registration);

/// One scan that is registered to others; it has to outlive this.
class Registrar {
 public:
  Registrar(const Shape& query, const RegistrationOptions& options);
  /// By iterative closest points, point to plane.
  /// @param guess query's sensor seen from the match's, right to about 0.3 m and a degree
  Registration operator()(const Shape& match, const Eigen::Isometry3d& guess) const;

 private:
  const Shape& query_;
  RegistrationOptions options_;
  PatchGrid grid_;
};

}  // namespace intensity_place_recognition
