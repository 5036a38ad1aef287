// SPDX-License-Identifier: BSD-3-Clause
//
// Simulated recordings that SLAM is judged by: a scanner on a robot that drives through a world, what may go
// wrong on the way, and the true poses.
#pragma once

#include <intensity_hector_slam/scan.h>
#include <laser_intensity_calib/models.h>
#include <mapping_simulation/sensors.h>
#include <mapping_simulation/trajectory.h>
#include <mapping_simulation/world.h>

#include <Eigen/Geometry>
#include <cstdint>
#include <functional>
#include <optional>
#include <string>
#include <vector>

namespace rosbag_tests {

/// A robot with differential drive that goes from one random point of an area to the next, turning on the
/// spot where the next is behind it.
struct DriveOptions {
  Eigen::AlignedBox2d area;                 ///< m, map frame, of the points
  double min_speed = 0.3, max_speed = 0.6;  ///< m/s, drawn anew for each leg
  double turn_rate = 1.0;                   ///< rad/s, at most
  double acceleration = 0.8;                ///< m/s^2, at most
  double turn_acceleration = 3.0;           ///< rad/s^2, at most
  double min_leg = 1.0;                     ///< m, from point to point; must fit into the area
};

/// Poses of base_link every 20 ms from time 0 on. The same seed gives the same drive.
mapping_simulation::Trajectory randomDrive(const DriveOptions& options, double duration, std::uint64_t seed);

/// What goes wrong while the robot drives: clutter all the time, the others once, half way.
enum class Fault {
  kNone,
  kClutter,     ///< people who accompany the robot hide a share of the beams, walking all the time
  kPause,       ///< nothing for 10 s, in which the robot stands still
  kSilence,     ///< no scan while the robot moves on by 0.25 m or turns by 15 degrees
  kBackInTime,  ///< from then on the stamps are 30 s less, as where a bag starts again
  kEmpty,       ///< a second of scans without any point
};

struct SlamScenario {
  std::string name;
  mapping_simulation::World world;
  mapping_simulation::SensorConfig sensor;  ///< planar
  std::optional<DriveOptions> drive;        ///< none: the trajectory of the world's file
  mapping_simulation::Trajectory trajectory;
  double duration = 0.0;  ///< s
  Fault fault = Fault::kNone;
  double clutter = 0.3;  ///< share of the beams that kClutter hides, about
  /// What makes reflectivities of the intensities, as in laser_intensity_calib's nodelet; none: ideal,
  /// divided by the very f(r, alpha) that the simulator multiplied with.
  std::optional<laser_intensity_calib::Calibration> calibration{};
  laser_intensity_calib::ModelType model = laser_intensity_calib::ModelType::kLut;  ///< of the calibration
  double reflectivity_scale = 1.0;  ///< factor on the reflectivities, as SlamNodelet has it
};

/// Reads a scenario: `world` and `sensor` (paths from the file's folder), `duration` (s), and maybe
/// `calibration` (a file that calibrate wrote), `drive` and `fault`; config/slam_evaluation has examples.
/// Throws std::runtime_error that names file, line, key and what is allowed.
SlamScenario loadScenario(const std::string& file);

/// Scans as SLAM takes them, in the frame of base_link, and where base_link truly was.
struct SlamRecording {
  std::vector<intensity_hector_slam::Scan> scans;
  std::vector<mapping_simulation::TimedPose>
      truth;  ///< one for each scan; times (s) go on whatever happens to the scans' stamps
  std::size_t beams = 0, hidden = 0;  ///< with a return, and those of them that clutter hides
  std::size_t known = 0;              ///< beams that have a reflectivity
};

/// Simulates a scenario. Reflectivities come from the simulated raw intensities, at the measured range and at
/// the incidence that the scan's own points tell (laser_intensity_calib::ScanIncidence): NaN where that isn't
/// known, or where the calibration has no value. The seed decides drive, noise and clutter.
SlamRecording record(const SlamScenario& scenario, std::uint64_t seed);

/// From the names that scenario files use: none | clutter | pause | silence | back_in_time | empty.
Fault parseFault(const std::string& name);

}  // namespace rosbag_tests
