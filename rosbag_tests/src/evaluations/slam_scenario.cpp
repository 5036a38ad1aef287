// SPDX-License-Identifier: BSD-3-Clause
#include <laser_intensity_calib/calibration_file.h>
#include <laser_intensity_calib/incidence.h>
#include <mapping_simulation/simulator.h>
#include <mapping_simulation/yaml_map.h>
#include <rosbag_tests/evaluations/slam_scenario.h>

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <map>
#include <random>
#include <stdexcept>

namespace rosbag_tests {

using mapping_simulation::IntensityModel;
using mapping_simulation::kMetres;
using mapping_simulation::kRatio;
using mapping_simulation::Limits;
using mapping_simulation::loadSensor;
using mapping_simulation::loadTrajectory;
using mapping_simulation::loadWorld;
using mapping_simulation::PlanarScan;
using mapping_simulation::SensorConfig;
using mapping_simulation::Simulation;
using mapping_simulation::Sweep;
using mapping_simulation::TimedPose;
using mapping_simulation::Trajectory;
using mapping_simulation::YamlMap;

namespace {

const std::map<std::string, Fault> kFaults{
    {"none", Fault::kNone},       {"clutter", Fault::kClutter},         {"pause", Fault::kPause},
    {"silence", Fault::kSilence}, {"back_in_time", Fault::kBackInTime}, {"empty", Fault::kEmpty}};

constexpr double kDriveStep = 0.02;  // s
constexpr double kReached = 0.25;    // m from a point

double wrap(double angle) {
  return std::remainder(angle, 2.0 * M_PI);
}

Eigen::Isometry3d planar(const Eigen::Vector2d& position, double yaw) {
  return Eigen::Translation3d(position.x(), position.y(), 0.0) *
         Eigen::Isometry3d(Eigen::AngleAxisd(yaw, Eigen::Vector3d::UnitZ()));
}

/// People, as cylinders, who accompany the robot: they walk to and fro on all sides of it, whichever way it
/// turns.
class Clutter {
 public:
  /// `share` of all directions is hidden on the average.
  Clutter(double share, std::uint64_t seed) : random_(seed) {
    for (double hidden = 0.0; hidden < share * 2.0 * M_PI;) {
      people_.push_back({draw(1.0, 1.8), draw(0.2, 0.5), draw(0.3, 1.2), draw(-M_PI, M_PI), draw(0.3, 1.0),
                         draw(0.1, 0.8)});
      hidden += 2.0 * std::asin(kRadius / people_.back().distance);
    }
    for (std::size_t i = 0; i < people_.size(); ++i) people_[i].bearing = 2.0 * M_PI * i / people_.size();
  }

  /// What a beam meets of a person.
  struct Meeting {
    double range = std::numeric_limits<double>::infinity();  ///< m, infinite: nobody
    double incidence = 0.0, reflectivity = 0.0;              ///< rad
  };

  /// `bearing`: rad, in the map frame.
  Meeting cast(double bearing, double time) const {
    Meeting nearest;
    for (const Person& p : people_) {
      const double distance = p.distance + p.sway * std::sin(p.rate * time + p.phase);
      const double centre = p.bearing + 0.4 * std::sin(p.turn * time + p.phase);
      const double offset = wrap(bearing - centre), across = distance * std::sin(offset);
      if (std::abs(offset) > M_PI / 2 || std::abs(across) >= kRadius) continue;
      const double range = distance * std::cos(offset) - std::sqrt(kRadius * kRadius - across * across);
      if (range < nearest.range) nearest = {range, std::asin(std::abs(across) / kRadius), p.reflectivity};
    }
    return nearest;
  }

 private:
  static constexpr double kRadius = 0.25;  // m
  struct Person {
    double distance, sway, rate, phase, turn, reflectivity;
    double bearing = 0.0;
  };

  double draw(double min, double max) { return std::uniform_real_distribution<>(min, max)(random_); }

  std::mt19937_64 random_;
  std::vector<Person> people_;
};

/// Turns sweeps into scans.
class Recorder {
 public:
  Recorder(const SlamScenario& scenario, std::uint64_t seed)
      : scenario_(scenario),
        sensor_(scenario.sensor),
        clutter_(scenario.fault == Fault::kClutter ? scenario.clutter : 0.0, seed),
        random_(~seed) {}

  void add(const Sweep& sweep, SlamRecording& recording) {
    PlanarScan planar = toPlanarScan(sensor_, sweep);
    const double yaw = std::atan2(sweep.pose.linear()(1, 0), sweep.pose.linear()(0, 0));
    for (int i = 0; i < sensor_.columns; ++i) {
      const double bearing = planar.angle_min + i * planar.angle_increment;
      if (!(planar.ranges[i] > 0.0f)) continue;
      const Clutter::Meeting person = clutter_.cast(yaw + bearing, sweep.stamp);
      if (std::isfinite(planar.ranges[i])) ++recording.beams;
      if (!(person.range < planar.ranges[i])) continue;
      if (std::isfinite(planar.ranges[i])) ++recording.hidden;
      const IntensityModel& model = sensor_.beam.intensity;
      const double intensity = person.reflectivity * model.response(person.range, person.incidence);
      planar.ranges[i] = static_cast<float>(person.range);
      planar.intensities[i] = static_cast<float>(model.reported(intensity, gauss_(random_)));
    }
    recording.scans.push_back(toScan(planar));
    recording.truth.push_back({sweep.stamp, sweep.pose * sensor_.mount.inverse()});
    for (const float reflectivity : recording.scans.back().reflectivities)
      recording.known += std::isfinite(reflectivity);
  }

 private:
  intensity_hector_slam::Scan toScan(const PlanarScan& planar) {
    const Eigen::Map<const Eigen::ArrayXf> ranges(planar.ranges.data(), planar.ranges.size());
    const Eigen::Map<const Eigen::ArrayXf> intensities(planar.intensities.data(), planar.intensities.size());
    const Eigen::ArrayXf& incidence = incidence_.estimate(ranges, planar.angle_min, planar.angle_increment);
    const Eigen::ArrayXf reflectivities =
        static_cast<float>(scenario_.reflectivity_scale) * toReflectivities(ranges, incidence, intensities);
    intensity_hector_slam::Scan scan;
    scan.stamp = planar.stamp;
    scan.origin = sensor_.mount.translation().head<2>().cast<float>();
    for (int i = 0; i < sensor_.columns; ++i) {
      const float range = planar.ranges[i];
      if (!(range > 0.0f) || !std::isfinite(range)) continue;
      const Eigen::Vector3d point = sensor_.mount * (range * sensor_.direction(i, 0));
      scan.points.push_back(point.head<2>().cast<float>());
      scan.reflectivities.push_back(reflectivities[i]);
      scan.times.push_back(static_cast<float>(i * planar.time_increment));
    }
    return scan;
  }

  Eigen::ArrayXf toReflectivities(const Eigen::ArrayXf& ranges, const Eigen::ArrayXf& incidence,
                                  const Eigen::ArrayXf& intensities) const {
    using laser_intensity_calib::OutsidePolicy;
    if (scenario_.calibration)
      return laser_intensity_calib::reflectivity(*scenario_.calibration, scenario_.model,
                                                 OutsidePolicy::kDrop, ranges, incidence, intensities);
    return intensities / ranges.binaryExpr(incidence, [this](float range, float alpha) {
      return static_cast<float>(sensor_.beam.intensity.response(range, alpha));
    });
  }

  const SlamScenario& scenario_;
  const SensorConfig& sensor_;
  Clutter clutter_;
  std::mt19937_64 random_;
  std::normal_distribution<double> gauss_;
  laser_intensity_calib::ScanIncidence incidence_;
};

void erase(SlamRecording& recording, std::size_t from, std::size_t to) {
  recording.scans.erase(recording.scans.begin() + from, recording.scans.begin() + to);
  recording.truth.erase(recording.truth.begin() + from, recording.truth.begin() + to);
}

void addFault(Fault fault, double rate, SlamRecording& recording) {
  const std::size_t half = recording.scans.size() / 2, count = recording.scans.size();
  const auto shift = [&](double seconds) {
    for (std::size_t i = half; i < count; ++i) recording.scans[i].stamp += seconds;
  };
  switch (fault) {
    case Fault::kNone:
    case Fault::kClutter:
      return;
    case Fault::kPause:
      return shift(10.0);
    case Fault::kBackInTime:
      return shift(-30.0);
    case Fault::kEmpty:
      for (std::size_t i = half; i < std::min(count, half + static_cast<std::size_t>(rate)); ++i) {
        recording.scans[i].points.clear();
        recording.scans[i].reflectivities.clear();
        recording.scans[i].times.clear();
      }
      return;
    case Fault::kSilence:
      std::size_t next = half;
      for (; next + 1 < count; ++next) {
        const Eigen::Isometry3d moved = recording.truth[half].pose.inverse() * recording.truth[next].pose;
        if (moved.translation().norm() > 0.25 || Eigen::AngleAxisd(moved.linear()).angle() > M_PI / 12.0)
          break;
      }
      erase(recording, half, next);
  }
}

DriveOptions readDrive(const YamlMap& map) {
  DriveOptions drive;
  const auto interval = [&](const char* key, Limits limits) {
    const std::vector<double> v = map.numbers(key, limits, 2, 2);
    if (v[0] > v[1]) map.fail(map.node(key), std::string(key) + " must be [least, greatest]");
    return v;
  };
  const auto x = interval("x", kMetres), y = interval("y", kMetres),
             speed = interval("speed", {1e-3, 100.0, "m/s"});
  drive.area = Eigen::AlignedBox2d(Eigen::Vector2d(x[0], y[0]), Eigen::Vector2d(x[1], y[1]));
  drive.min_speed = speed[0];
  drive.max_speed = speed[1];
  drive.turn_rate =
      map.number("turn_rate_deg", {1.0, 1000.0, "deg/s"}, drive.turn_rate * 180.0 / M_PI) * M_PI / 180.0;
  drive.acceleration = map.number("acceleration", {0.01, 100.0, "m/s^2"}, drive.acceleration);
  drive.turn_acceleration =
      map.number("turn_acceleration_deg", {1.0, 1e5, "deg/s^2"}, drive.turn_acceleration * 180.0 / M_PI) *
      M_PI / 180.0;
  drive.min_leg = map.number("min_leg", {0.0, 0.5 * drive.area.diagonal().norm(), "m"}, drive.min_leg);
  map.finish();
  return drive;
}

}  // namespace

Fault parseFault(const std::string& name) {
  const auto found = kFaults.find(name);
  if (found != kFaults.end()) return found->second;
  std::string allowed;
  for (const auto& fault : kFaults) allowed += (allowed.empty() ? "" : ", ") + fault.first;
  throw std::invalid_argument("fault '" + name + "': must be one of " + allowed);
}

Trajectory randomDrive(const DriveOptions& options, double duration, std::uint64_t seed) {
  std::mt19937_64 random(seed);
  const auto draw = [&](double min, double max) { return min + (max - min) * (random() >> 11) * 0x1p-53; };
  const auto drawPoint = [&] {
    const double x = draw(options.area.min().x(), options.area.max().x());
    return Eigen::Vector2d(x, draw(options.area.min().y(), options.area.max().y()));
  };
  if (!(options.min_leg <= 0.5 * options.area.diagonal().norm()))
    throw std::invalid_argument("the legs of a random drive must be at most half the area's diagonal");
  Eigen::Vector2d position = drawPoint(), goal = position;
  double yaw = draw(-M_PI, M_PI), speed = 0.0, turn = 0.0, cruise = 0.0;
  std::vector<TimedPose> poses;
  for (int i = 0; i * kDriveStep <= duration + 1.0; ++i) {  // the last sweep needs poses beyond the end
    poses.push_back({i * kDriveStep, planar(position, yaw)});
    if ((goal - position).norm() < kReached) {
      do goal = drawPoint();
      while ((goal - position).norm() < options.min_leg);
      cruise = draw(options.min_speed, options.max_speed);
    }
    const double error = wrap(std::atan2(goal.y() - position.y(), goal.x() - position.x()) - yaw);
    const double wanted_turn = std::clamp(2.5 * error, -options.turn_rate, options.turn_rate);
    const double ahead = std::max(0.0, std::cos(error));
    const double wanted_speed = cruise * ahead * ahead;
    const double turn_step = options.turn_acceleration * kDriveStep, step = options.acceleration * kDriveStep;
    turn += std::clamp(wanted_turn - turn, -turn_step, turn_step);
    speed += std::clamp(wanted_speed - speed, -step, step);
    position += speed * kDriveStep * Eigen::Vector2d(std::cos(yaw), std::sin(yaw));
    yaw += turn * kDriveStep;
  }
  return Trajectory(std::move(poses));
}

SlamScenario loadScenario(const std::string& file) {
  const YamlMap map = YamlMap::load(file);
  const std::filesystem::path folder = std::filesystem::path(file).parent_path();
  const std::string world = (folder / map.text("world")).string();
  SlamScenario scenario{std::filesystem::path(file).stem().string(),
                        loadWorld(world),
                        loadSensor((folder / map.text("sensor")).string()),
                        {},
                        Trajectory()};
  if (scenario.sensor.type != SensorConfig::Type::kPlanar)
    map.fail(map.node("sensor"), "sensor must be a planar scanner");
  scenario.duration = map.number("duration", {0.1, 1e5, "s"});
  if (map.has("calibration")) {
    try {
      scenario.calibration =
          laser_intensity_calib::loadCalibration((folder / map.text("calibration")).string());
    } catch (const std::runtime_error& e) {
      map.fail(map.node("calibration"), std::string("calibration: ") + e.what());
    }
    if (!scenario.calibration->has(scenario.model))
      map.fail(map.node("calibration"), "calibration: it has no table (model lut)");
  }
  if (map.has("drive"))
    scenario.drive = readDrive(map.map("drive"));
  else
    scenario.trajectory = loadTrajectory(world);
  std::vector<std::string> faults;
  for (const auto& fault : kFaults) faults.push_back(fault.first);
  if (map.has("fault")) scenario.fault = kFaults.at(map.choice("fault", faults));
  scenario.clutter = map.number("clutter", kRatio, scenario.clutter);
  map.finish();
  return scenario;
}

SlamRecording record(const SlamScenario& scenario, std::uint64_t seed) {
  const Simulation simulation{
      scenario.world,
      scenario.drive ? randomDrive(*scenario.drive, scenario.duration, seed) : scenario.trajectory,
      {scenario.sensor},
      scenario.duration,
      seed};
  SlamRecording recording;
  Recorder recorder(scenario, seed);
  simulate(simulation, [&](const SensorConfig&, const Sweep& sweep) { recorder.add(sweep, recording); });
  addFault(scenario.fault, scenario.sensor.rate, recording);
  return recording;
}

}  // namespace rosbag_tests
