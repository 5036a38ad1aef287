// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>
#include <vector>

#include "intensity_hector_slam/pose.h"

namespace intensity_hector_slam {

/// One sweep of a planar scanner in the frame of the body whose pose is estimated. Only what was measured:
/// beams without a return, too near or too far are left out by whoever makes the scan.
struct Scan {
  double stamp = 0.0;                                ///< s, the time whose pose is asked for
  Eigen::Vector2f origin = Eigen::Vector2f::Zero();  ///< m, where the scanner is
  std::vector<Eigen::Vector2f> points;               ///< m, ends of the beams, in the order of the sweep
  /// Of each point, about 0 (black) to 1 (white); NaN: unknown. Empty: of none.
  std::vector<float> reflectivities;
  /// s, when each point was measured, after the stamp. Empty: all at the stamp.
  std::vector<float> times;
  /// m, up to where beams without a return are taken to cross free space, where that is wanted.
  std::vector<Eigen::Vector2f> free;
  std::vector<float> free_times;  ///< as `times`
};

/// A scan whose points, seen by a body that moves, are where they are seen from at one time (thesis,
/// Eq. 3.7).
/// @param velocity of the body during the scan: m/s, m/s, rad/s, of its own axes
/// @param time s, after the stamp
/// @return with the times as they were
Scan seenAt(double time, const Scan& scan, const Pose& velocity);

}  // namespace intensity_hector_slam
