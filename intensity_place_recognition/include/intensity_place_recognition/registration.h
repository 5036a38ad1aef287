// SPDX-License-Identifier: BSD-3-Clause
//
// Verification: the pose of one scan seen from another in 6 degrees of freedom, and whether they show the
// same place.
#pragma once

#include <vector>

#include "intensity_place_recognition/shape.h"

namespace intensity_place_recognition {

struct RegistrationOptions {
  double max_distance = 6.0;
  double yaw_reach = 0.06981317, yaw_step = 0.06981317;
  int iterations = 15;
  double min_score = 0.45, min_intensity = 0.36;

  void describe(mapping_common::OptionList& o) {
    o("max_distance", max_distance, "m", "scans from places farther apart show different places")
        .within(0.5, 100.0);
    o("yaw_reach", yaw_reach, "deg", "how wrong the yaw of a description may be")
        .inDegrees()
        .within(0.0, 180.0);
    o("yaw_step", yaw_step, "deg", "of the search about it").inDegrees().within(0.1, 45.0);
    o("iterations", iterations, "", "of the iterative closest points").within(1, 200);
    o("min_score", min_score, "", "of a pair that is accepted").within(0.0, 1.0).dynamic();
    o("min_intensity", min_intensity, "",
      "correlation of its intensities, which tell places of one shape apart; -1 for scanners without")
        .within(-1.0, 1.0)
        .dynamic();
  }
};

using Matrix6 = Eigen::Matrix<double, 6, 6>;

struct Registration {
  Eigen::Isometry3d pose = Eigen::Isometry3d::Identity();  ///< query's sensor seen from the match's
  Matrix6 covariance = Matrix6::Identity();  ///< m, rad; x y z and rotation x y z about the match's axes
  double agreement = 0.0;                    ///< of what both must see, the part that both do, 0 to 1
  double common = 0.0;                       ///< the part of the patches that can be judged, 0 to 1
  double intensity = 0.0;                    ///< correlation of the intensities of matched patches, -1 to 1
  double score = 0.0;                        ///< 0 to 1, see RegistrationOptions::min_score
  bool accepted = false;
};

/// The inverse covariance of the same error in the axes of the query's sensor, as EdgeConstraint has it.
Matrix6 informationAtQuery(const Registration& registration);

/// Where a scan may have been taken, roughly.
struct Guess {
  Eigen::Isometry3d pose = Eigen::Isometry3d::Identity();  ///< query's sensor seen from the match's
  double correlation = 0.0;                                ///< of what stands where, 0 to 1
};

/// One scan that others are registered to; it has to outlive this.
class Registrar {
 public:
  Registrar(const Shape& match, const RegistrationOptions& options);
  /// By correlation of what stands where, seen from above.
  /// @param yaws rad, of the query's sensor seen from the match's, about the right one among them
  Guess guess(const Shape& query, const std::vector<double>& yaws) const;
  /// By iterative closest points, point to plane, from there on.
  Registration operator()(const Shape& query, const Guess& guess) const;

 private:
  using Tree = pcl::KdTreeFLANN<pcl::PointXYZ>;  // of the match's patches
  bool refine(const Shape& query, const Tree& tree, Registration& result) const;
  void judge(const Shape& query, const Tree& tree, Registration& result) const;

  const Shape& match_;
  RegistrationOptions options_;
  cv::Mat1f ground_plan_;
};

}  // namespace intensity_place_recognition
