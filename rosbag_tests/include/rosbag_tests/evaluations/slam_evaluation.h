// SPDX-License-Identifier: BSD-3-Clause
//
// How often SLAM loses the map, and how exact it is, over many simulated drives (thesis, section 3.5.2).
#pragma once

#include <intensity_hector_slam/slam.h>
#include <rosbag_tests/evaluations/slam_scenario.h>
#include <rosbag_tests/evaluations/trajectory_metrics.h>

#include <cstddef>
#include <cstdint>
#include <functional>
#include <iosfwd>
#include <string>
#include <vector>

namespace rosbag_tests {

/// The map counts as lost from the first scan on whose pose is farther than this from the truth, where both
/// start at the same pose.
struct LossCriterion {
  double distance = 0.5;             ///< m
  double angle = 10.0 * M_PI / 180;  ///< rad
};

/// One recording through SLAM with one cost.
struct SlamRun {
  std::string scenario;
  std::string cost;
  std::uint64_t seed = 0;
  double lost_after = std::numeric_limits<double>::infinity();  ///< s from the start; infinite: never lost
  std::size_t scans = 0, rejected = 0, unobservable = 0, empty = 0;
  PoseErrors delta;     ///< from scan to scan
  PoseErrors absolute;  ///< with the trajectories laid over each other (Alignment::kRigid)
  /// Errors of the edges between key poses that are observable, three each: whitened by the edge's
  /// covariance, so that each is of a standard normal distribution where the covariance is honest.
  std::vector<double> normalized_errors;
  std::vector<mapping_simulation::TimedPose> poses;  ///< estimated, in the frame of the truth
  double seconds_per_scan = 0.0;

  bool lost() const { return std::isfinite(lost_after); }
};

/// Feeds a recording to SLAM. The map as it is at the end goes to `map`, if given.
SlamRun runSlam(const SlamRecording& recording, const intensity_hector_slam::SlamOptions& options,
                const LossCriterion& criterion = LossCriterion(),
                intensity_hector_slam::MultiMap* map = nullptr);

/// A Markdown table with a row for each scenario and cost: in how many runs the map was lost; of those in
/// which it wasn't, the mean error from scan to scan (delta), the mean and the greatest error of the poses
/// and the share of the normalized errors within 1, 2 and 3 sigma (68.3, 95.4 and 99.7 % where the covariance
/// is honest) and their standard deviation (1 where it is); of all, the share of scans that were rejected or
/// not observable, and the time per scan.
void printTable(std::ostream& out, const std::vector<SlamRun>& runs);

/// An array with one object per run, without its poses.
std::string runsToJson(const std::vector<SlamRun>& runs);

/// What plot_evaluation.py needs of a run and the map at its end: the errors of each pose, as
/// trajectory_error
/// --json writes them, when the map was lost (s from the start), and of writeMapPicture() the lower left
/// corner (m, map frame) and the edge of a pixel (m).
std::string runToJson(const SlamRun& run, const intensity_hector_slam::GridMap& map);

/// Draws a level of the map, x to the right, y up, cropped to what is known, as a PPM picture: unknown grey,
/// free white, occupied coloured by reflectivity (hue from blue, dark, to red, bright; black where it isn't
/// known).
void writeMapPicture(const std::string& file, const intensity_hector_slam::GridMap& map);

/// Writes what the scanner saw where it truly was: ends of beams, evenly picked, as CSV (m, frame of the
/// truth).
void writeSeen(const std::string& file, const SlamRecording& recording);

}  // namespace rosbag_tests
