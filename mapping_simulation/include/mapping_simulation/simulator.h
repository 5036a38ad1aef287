// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <mapping_simulation/sensors.h>
#include <mapping_simulation/trajectory.h>
#include <mapping_simulation/world.h>

#include <cstdint>
#include <functional>
#include <vector>

namespace mapping_simulation {

/// A robot with sensors that drives through a world. Time starts with the trajectory.
struct Simulation {
  World world;
  Trajectory trajectory;              ///< base_link -> map frame
  std::vector<SensorConfig> sensors;  ///< k-th sweep of each begins k / rate after the start
  double duration = 0.0;              ///< s
  std::uint64_t seed = 0;  ///< same seed, same sweeps, whatever the duration and the sensors listed after

  double startTime() const { return trajectory.startTime(); }
  double endTime() const { return trajectory.startTime() + duration; }
};

/// Gives every sweep that ends within the duration to `sink`, in the order in which they end.
void simulate(const Simulation& simulation,
              const std::function<void(const SensorConfig&, const Sweep&)>& sink);

/// True poses of base_link at `rate` (Hz), with times that start at `start_time` (s).
std::vector<TimedPose> groundTruth(const Simulation& simulation, double rate, double start_time);

/// Errors of wheel odometry: a random walk over the way, in the plane of the body.
struct OdometryNoise {
  double translation = 0.0;  ///< m per sqrt(m) travelled, along and across
  double rotation = 0.0;     ///< rad per sqrt(m) travelled, and per sqrt(rad) turned
};

/// What odometry makes of a trajectory: base_link -> odom frame, at `rate` (Hz) from the start on for
/// `duration` (s). It starts at the true pose; without noise it is the trajectory itself.
Trajectory driftingOdometry(const Trajectory& truth, const OdometryNoise& noise, double rate, double duration,
                            std::uint64_t seed);

}  // namespace mapping_simulation
