// SPDX-License-Identifier: BSD-3-Clause
//
// The angle of incidence alpha between a beam and the normal of the surface that it meets (thesis, 3.3.1).
// The normal is the eigenvector of the smallest eigenvalue of the covariance of the neighbouring points.
// Where the neighbours don't tell it well enough, alpha is NaN.
#pragma once

#include <mapping_common/options.h>

#include <Eigen/Core>
#include <cmath>

namespace laser_intensity_calib {

struct ScanIncidenceOptions {
  int min_window = 7;
  double min_length = 0.2;
  double max_incidence = 85.0 * M_PI / 180.0;
  double range_noise = 0.02;
  double max_error = 5.0 * M_PI / 180.0;

  void describe(mapping_common::OptionList& o) {
    o("min_window", min_window, "", "beams that a normal is estimated from, at least, and ...")
        .within(3, 1000);
    o("min_length", min_length, "m",
      "... as many as span this length, r dphi (n - 1): more stand more noise, fewer see more detail")
        .within(0.0, 100.0);
    o("max_incidence_deg", max_incidence, "deg",
      "neighbours that would be on a surface seen at more than this are on two surfaces")
        .within(10.0, 89.9)
        .inDegrees();
    o("range_noise", range_noise, "m",
      "standard deviation of a range: a beam 3 times this off its surface is on none")
        .within(0.0, 10.0);
    o("max_error_deg", max_error, "deg",
      "where the standard error of the angle is larger, it counts as unknown")
        .within(0.01, 90.0)
        .inDegrees();
  }
};

/// Incidence angles of planar scans, in O(n) for n beams: each beam gets the best of the windows that end,
/// are centred or begin at it, so that the two sides of a corner are kept apart.
class ScanIncidence {
 public:
  explicit ScanIncidence(const ScanIncidenceOptions& options = ScanIncidenceOptions());

  /// The surface's normal is taken to lie in the plane of the scan (upright walls for a level scanner).
  /// @param ranges m; what isn't finite and positive is no return
  /// @param angle_increment rad between neighbouring beams, not 0
  /// @return rad, [0, pi/2] for each beam, or NaN
  const Eigen::ArrayXf& estimate(const Eigen::Ref<const Eigen::ArrayXf>& ranges, double angle_min,
                                 double angle_increment);

 private:
  void findSegments(const Eigen::Ref<const Eigen::ArrayXf>& ranges, double angle_min, double angle_increment);

  ScanIncidenceOptions options_;
  double angle_min_ = 0.0, angle_increment_ = 0.0;
  Eigen::Array2Xd directions_, points_;
  Eigen::Array<double, 5, Eigen::Dynamic> sums_;  // of x y xx yy xy over the beams before, n + 1 columns
  Eigen::ArrayXi begin_, end_;                    // segment of each beam; empty without a return
  Eigen::ArrayXf incidence_;
};

struct CloudIncidenceOptions {
  int neighbors = 12;
  double radius = 0.5;
  double leaf = 0.0;
  int rows = 1, columns = 3;
  double max_error = 5.0 * M_PI / 180.0;

  void describe(mapping_common::OptionList& o) {
    o("neighbors", neighbors, "", "nearest points that a normal is estimated from").within(4, 1000);
    o("radius", radius, "m", "those farther away are left out").within(0.001, 1000.0);
    o("leaf", leaf, "m",
      "above 0: searched neighbours are means over voxels of this edge, for lidars whose rings are much "
      "farther apart "
      "than the points of a ring; 0: the points")
        .within(0.0, 100.0);
    o("rows", rows, "",
      "organised clouds: neighbours are taken from so many rows and columns to each side, which is faster "
      "than a "
      "search; rows 0: search all the same")
        .within(0, 100);
    o("columns", columns, "", "the same").within(1, 1000);
    o("max_error_deg", max_error, "deg",
      "where the standard error of the normal is larger, the angle counts as unknown")
        .within(0.01, 90.0)
        .inDegrees();
  }
};

/// Incidence angles of a cloud, whatever its order: of a single scan, or accumulated by a scanner that moves
/// (push-broom), where each point needs the place that it was seen from.
/// @param points m, one column each; those not finite get NaN
/// @param viewpoints where the sensor was, in the frame of the points: a column for each point, or one for
/// all
/// @return rad, [0, pi/2] for each point, or NaN
/// @throws std::invalid_argument if there are neither one nor as many viewpoints as points, or no whole rows
Eigen::ArrayXf cloudIncidence(const Eigen::Matrix3Xf& points, const Eigen::Matrix3Xf& viewpoints,
                              const CloudIncidenceOptions& options = CloudIncidenceOptions(),
                              Eigen::Index width = 0);

/// Lengths (m) of the beams to the points; arguments and errors as above.
Eigen::ArrayXf cloudRanges(const Eigen::Matrix3Xf& points, const Eigen::Matrix3Xf& viewpoints);

}  // namespace laser_intensity_calib
