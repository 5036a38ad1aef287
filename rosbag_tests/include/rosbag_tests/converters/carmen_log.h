// SPDX-License-Identifier: BSD-3-Clause
//
// Logs of CARMEN, the Carnegie Mellon Robot Navigation Toolkit, in which the field's classic 2D recordings
// come (Radish, Freiburg's SLAM evaluation).
#pragma once

#include <mapping_simulation/sensors.h>

#include <Eigen/Geometry>
#include <map>
#include <string>
#include <vector>

namespace rosbag_tests {

/// A line of a log that holds odometry or a scan.
struct CarmenRecord {
  enum class Kind { kOdometry, kFrontScan, kRearScan };  ///< ODOM; FLASER, ROBOTLASER1; RLASER, ROBOTLASER2
  Kind kind = Kind::kOdometry;
  double ipc_stamp = 0.0;                                   ///< s, of the measurement
  double logger_stamp = 0.0;                                ///< s, of its logging
  Eigen::Isometry3d robot = Eigen::Isometry3d::Identity();  ///< robot -> odometry frame
  double linear_velocity = 0.0, angular_velocity = 0.0;     ///< m/s, rad/s; 0 where the line has none
  mapping_simulation::PlanarScan
      scan;  ///< of a scan; its stamp is ipc_stamp, its pose the logged one of the laser

  bool isScan() const { return kind != Kind::kOdometry; }
};

struct CarmenLog {
  std::vector<CarmenRecord> records;              ///< in the file's order
  std::map<std::string, std::string> parameters;  ///< of its PARAM lines; the last of a name
  std::vector<std::string> malformed;             ///< "file:line: what" for each line that was left out

  /// Pose of a scanner on the robot: that between the logged poses of laser and robot if all scans agree on
  /// it to a millimetre and a milliradian, else what robot_frontlaser_offset or robot_rearlaser_offset says.
  Eigen::Isometry3d mount(CarmenRecord::Kind scanner) const;
};

struct CarmenOptions {
  double range_max = 80.0;  ///< m; readings from here on are no return (+inf, REP 117)
  /// rad; both 0: as the line says or, where it doesn't, as CARMEN takes it: 0.5 degrees where there are more
  /// than 181 readings, else 1 degree, from -135 degrees where there are more than 361, else from -90.
  double angle_min = 0.0, angle_increment = 0.0;
};

/// Reads a log, unpacked if its name ends in .gz or .xz. Knows ODOM, FLASER, RLASER, PARAM and ROBOTLASER1
/// and 2 (with the laser's configuration and remissions, and in the older form like FLASER); other lines are
/// ignored. Throws std::runtime_error if the file can't be read or has no scan.
CarmenLog readCarmenLog(const std::string& file, const CarmenOptions& options = CarmenOptions());

/// Stamps that increase from record to record by at least a microsecond. As many as possible stay as they
/// are; the others, and NaN, are spread evenly between their neighbours. `repaired` counts those that weren't
/// NaN. Throws std::runtime_error if that were more than half.
std::vector<double> risingStamps(const std::vector<double>& stamps, std::size_t& repaired);

}  // namespace rosbag_tests
