// SPDX-License-Identifier: BSD-3-Clause
// Laser scanners and cameras in a World: what they measure, and what they should have measured.
#pragma once

#include <mapping_simulation/camera.h>
#include <mapping_simulation/trajectory.h>
#include <mapping_simulation/world.h>

#include <Eigen/Geometry>
#include <cstdint>
#include <string>
#include <vector>

namespace mapping_simulation {

/// Raw intensity of an echo: reflectivity * f(range r, incidence a), noise, limit and quantisation, where
///   f(r, a) = gain * near(r) * (reference_range / r)^range_exponent * angular(a)
///   near(r) = 1 - exp(-(r / near_range)^2)          close targets aren't in the receiver's focus
///   angular(a) = ((1 - specular) cos^cosine_exponent(a) + specular exp(-(a / specular_width)^2)) * g(a) /
///   g(0) g(a) = 1 / (1 + exp((a - grazing_angle) / grazing_width))   steep fall at grazing incidence
struct IntensityModel {
  double gain = 1000.0;  ///< intensity of a white target, head on, at the reference range (but for near(r))
  double reference_range = 1.0;  ///< m
  double range_exponent =
      2.0;                  ///< 2: physics; less: the receiver amplifies weak echoes; 0: it compensates range
  double near_range = 0.0;  ///< m, 0: no near-distance effect
  double cosine_exponent = 1.0;  ///< 1: Lambertian
  double specular = 0.0;         ///< [0, 1] share of the specular lobe
  double specular_width = 0.2;   ///< rad
  double grazing_angle = 10.0;   ///< rad, where half is lost; beyond pi/2: never
  double grazing_width = 0.05;   ///< rad
  double noise = 0.0;            ///< standard deviation, in units of intensity
  double noise_ratio = 0.0;      ///< standard deviation, relative to the intensity
  double max = 1e9;              ///< the receiver saturates here
  double resolution = 0.0;       ///< quantisation, 0: none

  double near(double range) const;
  double angular(double incidence) const;
  /// f(r, a), without noise.
  double response(double range, double incidence) const;
  /// What is reported of an intensity: with noise, `gauss` of which is standard normal, limit and
  /// quantisation.
  double reported(double intensity, double gauss) const;
};

/// What happens to a single beam.
struct BeamModel {
  double range_min = 0.1;          ///< m, nearer targets measure as -inf (REP 117)
  double range_max = 30.0;         ///< m, farther ones as +inf
  double range_noise = 0.0;        ///< m, standard deviation ...
  double range_noise_ratio = 0.0;  ///< ... plus this share of the range
  double range_resolution = 0.0;   ///< m, quantisation, 0: none
  double divergence = 0.0;         ///< rad, full angle of the beam
  int sub_rays = 0;                ///< rays on the rim of the beam, the first to its left; 0: no mixed pixels
  double mixed_probability = 0.0;  ///< that a beam on two shapes measures a range between them
  double mixed_max_gap = 1e9;      ///< m, the receiver separates echoes farther apart
  double dropout_probability = 0.0;  ///< of a beam without any return
  double detection_range = 1e9;      ///< m, where a white target, head on, returns just enough energy ...
  double detection_noise = 0.0;      ///< ... relative standard deviation of that energy
  IntensityModel intensity;          ///< its near() and angular() also govern the energy
};

/// A camera, or a scanner whose mirror or head turns at constant speed. Column c looks to azimuth angle_min +
/// c * angle_increment (about z from x, counterclockwise) at stamp + c * time_increment, with one beam per
/// elevation.
struct SensorConfig {
  enum class Type { kPlanar, kLidar, kCamera };  ///< LaserScan, PointCloud2, Image
  Type type = Type::kPlanar;
  std::string topic = "scan";
  std::string frame_id = "laser";
  Eigen::Isometry3d mount =
      Eigen::Isometry3d::Identity();    ///< sensor frame (a camera's optical frame) -> base_link
  double rate = 40.0;                   ///< Hz
  double angle_min = 0.0;               ///< rad
  double angle_increment = 0.0;         ///< rad, > 0
  int columns = 0;                      ///< beams of a planar scan, azimuth steps of a lidar
  std::vector<double> elevations{0.0};  ///< rad, {0} for a planar scanner
  bool rolling =
      true;  ///< every column has the pose of its own time; false: the sensor stands still meanwhile
  BeamModel beam;
  CameraModel camera;  ///< of a camera, which uses nothing else but topic, frame, mount and rate

  double timeIncrement() const { return rolling ? angle_increment / (2.0 * M_PI * rate) : 0.0; }  ///< s
  double sweepDuration() const { return columns * timeIncrement(); }                              ///< s
  /// Direction of a beam, sensor frame, unit length.
  Eigen::Vector3d direction(int column, int ring) const;
};

/// Reads a sensor from YAML; angles in degrees, lengths in m. The files in config/simulator show all keys but
/// `rolling: false`.
/// Throws std::runtime_error that names file, line, key, value and what is allowed.
SensorConfig loadSensor(const std::string& file);

/// One measurement and its truth.
struct Echo {
  double range;      ///< m; +inf: no return, -inf: too close
  double intensity;  ///< 0 without a return
  Hit truth;         ///< of the central ray, without noise
};

/// All echoes of one turn, or the image of one moment.
struct Sweep {
  double stamp = 0.0;                                      ///< s, of the first column
  Eigen::Isometry3d pose = Eigen::Isometry3d::Identity();  ///< sensor frame -> map frame, at the stamp
  std::vector<Echo> echoes;  ///< echo of (column, ring) is at column * rings + ring
  Image image;               ///< of a camera
};

/// Sweeps the world from a base_link that follows `base`. The seed decides all noise.
Sweep sweep(const SensorConfig& sensor, const World& world, const Trajectory& base, double stamp,
            std::uint64_t seed);

/// A 2D scan, as sensor_msgs/LaserScan has it.
struct PlanarScan {
  double stamp = 0.0;                                      ///< s, of the first beam
  Eigen::Isometry3d pose = Eigen::Isometry3d::Identity();  ///< sensor frame -> map frame, at the stamp
  double angle_min = 0.0, angle_max = 0.0, angle_increment = 0.0;  ///< rad
  double time_increment = 0.0, scan_time = 0.0;                    ///< s
  double range_min = 0.0, range_max = 0.0;                         ///< m
  std::vector<float> ranges;       ///< m; +inf: no return, -inf: too close (REP 117)
  std::vector<float> intensities;  ///< raw; as many as ranges
};

PlanarScan toPlanarScan(const SensorConfig& sensor, const Sweep& sweep);

}  // namespace mapping_simulation
