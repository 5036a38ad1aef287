// SPDX-License-Identifier: BSD-3-Clause
#include <mapping_simulation/simulator.h>

#include <cmath>
#include <random>

namespace mapping_simulation {
namespace {

// Independent seed for each sweep of each sensor (and the odometry), so that none depends on the others.
std::uint64_t deriveSeed(std::uint64_t seed, std::uint64_t stream, std::uint64_t count) {
  std::seed_seq sequence{seed, seed >> 32, stream, count, count >> 32};
  std::uint32_t words[2];
  sequence.generate(words, words + 2);
  return static_cast<std::uint64_t>(words[0]) << 32 | words[1];
}

}  // namespace

void simulate(const Simulation& simulation,
              const std::function<void(const SensorConfig&, const Sweep&)>& sink) {
  const std::vector<SensorConfig>& sensors = simulation.sensors;
  std::vector<std::uint64_t> counts(sensors.size(), 0);
  const auto begin = [&](std::size_t i) { return simulation.startTime() + counts[i] / sensors[i].rate; };
  while (true) {
    std::size_t next = sensors.size();
    double next_end = simulation.endTime() + 1e-9;
    for (std::size_t i = 0; i < sensors.size(); ++i) {
      const double end = begin(i) + sensors[i].sweepDuration();
      if (end < next_end) {
        next_end = end;
        next = i;
      }
    }
    if (next == sensors.size()) return;
    sink(sensors[next], sweep(sensors[next], simulation.world, simulation.trajectory, begin(next),
                              deriveSeed(simulation.seed, next, counts[next])));
    ++counts[next];
  }
}

std::vector<TimedPose> groundTruth(const Simulation& simulation, double rate, double start_time) {
  std::vector<TimedPose> poses;
  const int last = static_cast<int>(std::floor(simulation.duration * rate + 1e-6));
  for (int i = 0; i <= last; ++i) {
    poses.push_back({start_time + i / rate, simulation.trajectory.at(simulation.startTime() + i / rate)});
  }
  return poses;
}

Trajectory driftingOdometry(const Trajectory& truth, const OdometryNoise& noise, double rate, double duration,
                            std::uint64_t seed) {
  if (noise.translation == 0.0 && noise.rotation == 0.0) return truth;
  std::mt19937_64 random(deriveSeed(seed, ~0ull, 0));
  std::normal_distribution<double> gauss;
  std::vector<TimedPose> poses{{truth.startTime(), truth.at(truth.startTime())}};
  Eigen::Isometry3d before = poses.front().pose;
  const int steps = static_cast<int>(std::ceil(duration * rate)) + 1;  // one more for the last velocity
  for (int i = 1; i <= steps; ++i) {
    const double time = truth.startTime() + i / rate;
    const Eigen::Isometry3d now = truth.at(time);
    Eigen::Isometry3d step = before.inverse() * now;
    const double way = step.translation().norm(), turn = Eigen::AngleAxisd(step.linear()).angle();
    const double sigma = noise.translation * std::sqrt(way);
    step.translation().x() += sigma * gauss(random);
    step.translation().y() += sigma * gauss(random);
    step.rotate(
        Eigen::AngleAxisd(noise.rotation * std::sqrt(way + turn) * gauss(random), Eigen::Vector3d::UnitZ()));
    poses.push_back({time, poses.back().pose * step});
    before = now;
  }
  return Trajectory(std::move(poses));
}

}  // namespace mapping_simulation
