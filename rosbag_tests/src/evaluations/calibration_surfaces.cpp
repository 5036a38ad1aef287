// SPDX-License-Identifier: BSD-3-Clause
#include <mapping_simulation/simulator.h>
#include <rosbag_tests/evaluations/calibration_evaluation.h>

#include <algorithm>
#include <cmath>

namespace rosbag_tests {

using mapping_simulation::Echo;
using mapping_simulation::PosedScan;
using mapping_simulation::SensorConfig;
using mapping_simulation::Simulation;
using mapping_simulation::Sweep;
using mapping_simulation::Trajectory;
using mapping_simulation::World;

namespace {

using laser_intensity_calib::cloudIncidence;
using laser_intensity_calib::CloudIncidenceOptions;
using laser_intensity_calib::Sample;

// The scanner looks up and sweeps the plane across the way.
Eigen::Isometry3d pushBroomMount() {
  Eigen::Isometry3d mount = Eigen::Isometry3d::Identity();
  mount.linear().col(0) = Eigen::Vector3d::UnitZ();
  mount.linear().col(1) = Eigen::Vector3d::UnitY();
  mount.linear().col(2) = -Eigen::Vector3d::UnitX();
  mount.translation() = Eigen::Vector3d(0.0, 0.0, 0.7);
  return mount;
}

// The height (m) of the ground in the sensor's frame: the fullest layer below it.
float groundHeight(const pcl::PointCloud<pcl::PointXYZI>& cloud) {
  constexpr float kLayer = 0.05F;
  std::map<int, int> layers;
  for (const pcl::PointXYZI& p : cloud)
    if (p.z < -0.5F && std::hypot(p.x, p.y) < 15.0F) ++layers[static_cast<int>(std::floor(p.z / kLayer))];
  if (layers.empty()) return -1e9F;
  const auto fewer = [](const auto& l, const auto& r) { return l.second < r.second; };
  return (std::max_element(layers.begin(), layers.end(), fewer)->first + 0.5F) * kLayer;
}

const char* surfaceAt(float across, float height, float ground) {
  constexpr float kGround = 0.2F, kLane = 2.5F, kSideMin = 4.5F, kSideMax = 8.0F, kAboveSensor = 0.5F;  // m
  const bool low = std::abs(height - ground) < kGround;
  if (low && across < kLane) return "road";
  if (low && across > kSideMin && across < kSideMax) return "roadside";
  return height > kAboveSensor ? "facades" : nullptr;
}

}  // namespace

Surfaces simulateSurfaces(const World& world, const Trajectory& trajectory, const SensorConfig& sensor,
                          std::uint64_t seed, const CloudIncidenceOptions& options) {
  Simulation simulation{world, trajectory, {sensor}, trajectory.endTime() - trajectory.startTime(), seed};
  simulation.sensors[0].mount = pushBroomMount();
  std::vector<Eigen::Vector3f> points, viewpoints;
  std::vector<Sample> samples;
  std::vector<int> shapes;
  int scan = 0;
  simulate(simulation, [&](const SensorConfig& upright, const Sweep& sweep) {
    for (int column = 0; column < upright.columns; ++column) {
      const Echo& echo = sweep.echoes[column];
      if (!std::isfinite(echo.range)) continue;
      const Eigen::Isometry3d pose =
          trajectory.at(sweep.stamp + column * upright.timeIncrement()) * upright.mount;
      points.push_back((pose * (echo.range * upright.direction(column, 0))).cast<float>());
      viewpoints.push_back(pose.translation().cast<float>());
      samples.push_back({static_cast<float>(echo.range), 0.0F, static_cast<float>(echo.intensity), scan});
      shapes.push_back(echo.truth.shape);
    }
    ++scan;
  });
  Surfaces surfaces;
  if (points.empty()) return surfaces;
  const auto n = static_cast<Eigen::Index>(points.size());
  const Eigen::ArrayXf incidence =
      cloudIncidence(Eigen::Map<const Eigen::Matrix3Xf>(points.data()->data(), 3, n),
                     Eigen::Map<const Eigen::Matrix3Xf>(viewpoints.data()->data(), 3, n), options);
  for (Eigen::Index i = 0; i < n; ++i) {
    const std::string& name = world.shapes()[shapes[i]].name;
    samples[i].incidence = incidence[i];
    if (name.rfind("surface", 0) == 0) surfaces[name].push_back(samples[i]);
  }
  return surfaces;
}

Surfaces readStreet(ScanSource& scans, int step, const CloudIncidenceOptions& options,
                    const std::function<void(int)>& progress) {
  PosedScan scan;
  Surfaces surfaces;
  for (int number = 0; scans.next(scan); ++number) {
    if (number % step != 0) continue;
    if (progress) progress(number);
    const auto n = static_cast<Eigen::Index>(scan.cloud.size());
    Eigen::Matrix3Xf points(3, n);
    for (Eigen::Index i = 0; i < n; ++i) points.col(i) = scan.cloud[i].getVector3fMap();
    const Eigen::Matrix3Xf sensor = Eigen::Matrix3Xf::Zero(3, 1);
    const Eigen::ArrayXf incidence = cloudIncidence(points, sensor, options),
                         ranges = laser_intensity_calib::cloudRanges(points, sensor);
    const float ground = groundHeight(scan.cloud);
    int laser = 0;
    double before = 0.0;
    for (Eigen::Index i = 0; i < n; ++i) {
      const double azimuth = std::atan2(points(1, i), points(0, i)),
                   turned = azimuth < 0.0 ? azimuth + 2.0 * M_PI : azimuth;
      laser += turned < before - M_PI ? 1 : 0;
      before = turned;
      const char* name = surfaceAt(std::abs(points(1, i)), points(2, i), ground);
      if (name != nullptr)
        surfaces[name].push_back({ranges[i], incidence[i], scan.cloud[i].intensity, number, laser});
    }
  }
  return surfaces;
}

}  // namespace rosbag_tests
