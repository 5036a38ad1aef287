// SPDX-License-Identifier: BSD-3-Clause
#include <gtest/gtest.h>
#include <mapping_simulation/simulator.h>
#include <mapping_simulation/testing/worlds.h>

#include <cmath>
#include <map>

namespace mapping_simulation {
namespace {

SensorConfig makeSensor(const std::string& topic, double rate) {
  SensorConfig sensor;
  sensor.topic = topic;
  sensor.columns = 36;
  sensor.angle_increment = M_PI / 36;  // half a turn
  sensor.rate = rate;
  sensor.beam.range_noise = 0.1;
  return sensor;
}

Simulation makeSimulation(std::vector<SensorConfig> sensors) {
  return {World({makeShape(Shape::Type::kBox, {30, 20, 4}, makePose(0, 0, -2))}),
          driveThrough({{{-5, 0, 0}, 2.0}, {{5, 0, 0}, 2.0}}), std::move(sensors), 1.0, 9};
}

using Record = std::map<std::string, std::vector<Sweep>>;

Record record(const Simulation& simulation) {
  Record sweeps;
  simulate(simulation,
           [&](const SensorConfig& sensor, const Sweep& sweep) { sweeps[sensor.topic].push_back(sweep); });
  return sweeps;
}

TEST(Simulate, GivesSweepsInTheOrderOfTheirEnds) {
  Simulation simulation = makeSimulation({makeSensor("slow", 4), makeSensor("fast", 10)});
  simulation.trajectory = Trajectory({{100.0, makePose(-5, 0, 0)}, {105.0, makePose(5, 0, 0)}});
  double end = 0.0;
  int count = 0;
  simulate(simulation, [&](const SensorConfig& sensor, const Sweep& sweep) {
    EXPECT_GE(sweep.stamp + sensor.sweepDuration(), end);
    end = sweep.stamp + sensor.sweepDuration();
    EXPECT_TRUE(sweep.pose.isApprox(simulation.trajectory.at(sweep.stamp)));
    ++count;
  });
  EXPECT_EQ(count, 14);
  EXPECT_LE(end, 101.0);
  const Record sweeps = record(simulation);
  EXPECT_NEAR(sweeps.at("fast")[3].stamp, 100.3, 1e-9);
  EXPECT_EQ(sweeps.at("slow").size(), 4u);
}

TEST(Simulate, SeedRepeatsARunWhateverItsDurationAndTheSensorsAfter) {
  const Record first = record(makeSimulation({makeSensor("a", 10)}));
  Simulation longer = makeSimulation({makeSensor("a", 10), makeSensor("b", 20)});
  longer.duration = 2.0;
  const Record second = record(longer);
  longer.seed = 10;
  const Record third = record(longer);
  ASSERT_EQ(first.at("a").size(), 10u);
  for (std::size_t i = 0; i < 10; ++i) {
    for (std::size_t k = 0; k < 36; ++k) {
      ASSERT_EQ(first.at("a")[i].echoes[k].range, second.at("a")[i].echoes[k].range);
      ASSERT_NE(first.at("a")[i].echoes[k].range, third.at("a")[i].echoes[k].range);
    }
  }
  // Sensors and sweeps have noise of their own.
  EXPECT_NE(second.at("a")[0].echoes[0].range, second.at("b")[0].echoes[0].range);
  const auto noise = [&](int i) {
    return first.at("a")[i].echoes[0].range - first.at("a")[i].echoes[0].truth.range;
  };
  EXPECT_NE(noise(0), noise(1));
}

TEST(GroundTruth, SamplesTheTrajectory) {
  const Simulation simulation = makeSimulation({});
  const std::vector<TimedPose> poses = groundTruth(simulation, 10.0, 50.0);
  ASSERT_EQ(poses.size(), 11u);
  EXPECT_NEAR(poses[10].time, 51.0, 1e-12);
  EXPECT_NEAR(poses[10].pose.translation().x(), -3.0, 1e-9);
}

TEST(DriftingOdometry, WithoutNoiseIsTheTruth) {
  const Trajectory truth = driveThrough({{{0, 0, 0}, 1}, {{3, 1, 0}, 1}, {{6, 0, 0}, 1}});
  const Trajectory odometry = driftingOdometry(truth, {}, 50.0, truth.endTime(), 1);
  for (double t = 0; t < truth.endTime(); t += 0.3) EXPECT_TRUE(odometry.at(t).isApprox(truth.at(t), 1e-12));
}

TEST(DriftingOdometry, ErrorGrowsWithTheSquareRootOfTheWay) {
  const Trajectory truth = driveThrough({{{1, 2, 0}, 2.0}, {{26, 2, 0}, 2.0}});
  const OdometryNoise noise{0.1, 0.02};
  const int runs = 300;
  double along = 0.0, heading = 0.0, mean = 0.0;
  for (int seed = 0; seed < runs; ++seed) {
    const Trajectory odometry = driftingOdometry(truth, noise, 20.0, truth.endTime(), seed);
    EXPECT_TRUE(odometry.at(0.0).isApprox(truth.at(0.0)));
    const Eigen::Isometry3d end = odometry.at(truth.endTime());
    const double yaw = std::atan2(end.linear()(1, 0), end.linear()(0, 0));
    mean += yaw / runs;
    heading += yaw * yaw / runs;
    const Eigen::Isometry3d quarter = odometry.at(truth.endTime() / 4);
    along += std::pow(quarter.translation().x() - 7.25, 2) / runs;
    EXPECT_NEAR(end.translation().z(), 0.0, 1e-9);
  }
  EXPECT_NEAR(mean, 0.0, 0.1 / std::sqrt(runs) * 4);
  EXPECT_NEAR(std::sqrt(heading), 0.02 * std::sqrt(25.0), 0.02);
  EXPECT_NEAR(std::sqrt(along), 0.1 * std::sqrt(6.25), 0.05);
}

}  // namespace
}  // namespace mapping_simulation

int main(int argc, char** argv) {
  testing::InitGoogleTest(&argc, argv);
  return RUN_ALL_TESTS();
}
