// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <mapping_simulation/sensors.h>
#include <mapping_simulation/simulator.h>
#include <sensor_msgs/CameraInfo.h>
#include <sensor_msgs/Image.h>
#include <sensor_msgs/LaserScan.h>

#include <functional>
#include <string>

namespace mapping_simulation {

struct SimulationBagOptions {
  double start_time = 1000.0;    ///< s, ROS time at the start of the trajectory
  double clock_rate = 100.0;     ///< Hz of /clock, 0: none
  double odometry_rate = 100.0;  ///< Hz of /tf, /odom and /ground_truth
  OdometryNoise odometry_noise;  ///< drift of odom -> base_link
  bool map_to_odom = true;  ///< /tf has map -> odom, which corrects the drift; false: left to a SLAM node
};

/// Writes a simulation as a bag, as if the robot had recorded it:
///   sensors' topics   sensor_msgs LaserScan or PointCloud2; recorded when the sweep is over, stamped at its
///   first beam; Image, with CameraInfo on camera_info beside it
///   /tf               map -> odom -> base_link;   /tf_static (latched)   base_link -> sensors
///   /odom             nav_msgs/Odometry, base_link in odom, with drift;   /ground_truth   base_link in map
///   /clock            rosgraph_msgs/Clock
/// The bag is written as `file`.part and renamed when complete. `watch` gets each sweep, as simulate() gives
/// it. Returns the number of sweeps. Throws std::invalid_argument if two sensors share a topic or frame or an
/// option makes no sense, std::runtime_error if the file can't be written.
std::size_t writeSimulationBag(const std::string& file, const Simulation& simulation,
                               const SimulationBagOptions& options = SimulationBagOptions(),
                               const std::function<void(const SensorConfig&, const Sweep&)>& watch = {});

/// Message of a scan whose stamp is ROS time.
sensor_msgs::LaserScan toLaserScan(const PlanarScan& scan, const std::string& frame_id);
sensor_msgs::Image toImage(const Image& image, const std_msgs::Header& header);
sensor_msgs::CameraInfo toCameraInfo(const CameraModel& camera, const std_msgs::Header& header);

}  // namespace mapping_simulation
