// SPDX-License-Identifier: BSD-3-Clause
#include <mapping_simulation/sensors.h>
#include <mapping_simulation/yaml_map.h>

#include <algorithm>
#include <cmath>
#include <random>

namespace mapping_simulation {
namespace {

constexpr double kInfinity = std::numeric_limits<double>::infinity();
constexpr double kRadians = M_PI / 180.0;

double quantise(double value, double resolution) {
  return resolution > 0.0 ? std::round(value / resolution) * resolution : value;
}

// Casts one beam after the other and disturbs what returns.
class Beams {
 public:
  Beams(const BeamModel& model, std::uint64_t seed)
      : model_(model), random_(seed), spread_(std::tan(0.5 * model.divergence)) {}

  // `pose`: sensor frame -> map frame. `direction`: sensor frame.
  Echo measure(const Scene& scene, const Eigen::Isometry3d& pose, const Eigen::Vector3d& direction) {
    const Hit center = scene.cast({pose.translation(), pose.linear() * direction});
    if (!center) return {kInfinity, 0.0, center};
    double range = center.range, intensity = expectedIntensity(center);
    if (model_.sub_rays > 0) mix(scene, pose, direction, center, range, intensity);

    const double energy = center.reflectivity * model_.intensity.near(center.range) *
                          model_.intensity.angular(center.incidence) *
                          std::pow(model_.detection_range / center.range, 2);
    const bool lost = uniform_(random_) < model_.dropout_probability ||
                      energy * (1.0 + model_.detection_noise * gauss_(random_)) < 1.0;
    range += gauss_(random_) * (model_.range_noise + model_.range_noise_ratio * range);
    range = quantise(range, model_.range_resolution);
    if (lost || range > model_.range_max) return {kInfinity, 0.0, center};
    if (range < model_.range_min) return {-kInfinity, 0.0, center};

    return {range, model_.intensity.reported(intensity, gauss_(random_)), center};
  }

 private:
  double expectedIntensity(const Hit& hit) const {
    return hit.reflectivity * model_.intensity.response(hit.range, hit.incidence);
  }

  // A beam that straddles an edge returns two echoes; if they merge, the range is somewhere between them.
  void mix(const Scene& scene, const Eigen::Isometry3d& pose, const Eigen::Vector3d& direction,
           const Hit& center, double& range, double& intensity) {
    Eigen::Vector3d left = Eigen::Vector3d::UnitZ().cross(direction);
    left = left.norm() > 1e-9 ? left.normalized() : Eigen::Vector3d::UnitY();
    const Eigen::Vector3d up = direction.cross(left);
    Hit near = center, far = center;
    for (int i = 0; i < model_.sub_rays; ++i) {
      const double phi = 2.0 * M_PI * i / model_.sub_rays;
      const Eigen::Vector3d rim = direction + spread_ * (std::cos(phi) * left + std::sin(phi) * up);
      const Hit hit = scene.cast({pose.translation(), pose.linear() * rim.normalized()});
      if (hit && hit.range < near.range) near = hit;
      if (hit && hit.range > far.range) far = hit;
    }
    if (near.shape == far.shape || far.range - near.range > model_.mixed_max_gap) return;
    if (!(uniform_(random_) < model_.mixed_probability)) return;
    const double weight = uniform_(random_);
    range = (1.0 - weight) * near.range + weight * far.range;
    intensity = (1.0 - weight) * expectedIntensity(near) + weight * expectedIntensity(far);
  }

  const BeamModel& model_;
  std::mt19937_64 random_;
  std::normal_distribution<double> gauss_;
  std::uniform_real_distribution<double> uniform_;
  double spread_;
};

}  // namespace

double IntensityModel::near(double range) const {
  return near_range > 0.0 ? 1.0 - std::exp(-std::pow(range / near_range, 2)) : 1.0;
}

double IntensityModel::angular(double incidence) const {
  const double diffuse = std::pow(std::max(std::cos(incidence), 0.0), cosine_exponent);
  const double mirror = specular > 0.0 ? std::exp(-std::pow(incidence / specular_width, 2)) : 0.0;
  const double fall = (1.0 + std::exp(-grazing_angle / grazing_width)) /
                      (1.0 + std::exp((incidence - grazing_angle) / grazing_width));
  return ((1.0 - specular) * diffuse + specular * mirror) * fall;
}

double IntensityModel::response(double range, double incidence) const {
  return gain * near(range) * std::pow(reference_range / range, range_exponent) * angular(incidence);
}

double IntensityModel::reported(double intensity, double gauss) const {
  const double noisy = intensity + gauss * (noise + noise_ratio * intensity);
  return std::clamp(quantise(noisy, resolution), 0.0, max);
}

Eigen::Vector3d SensorConfig::direction(int column, int ring) const {
  const double azimuth = angle_min + column * angle_increment, elevation = elevations[ring];
  return {std::cos(elevation) * std::cos(azimuth), std::cos(elevation) * std::sin(azimuth),
          std::sin(elevation)};
}

Sweep sweep(const SensorConfig& sensor, const World& world, const Trajectory& base, double stamp,
            std::uint64_t seed) {
  Sweep result;
  result.stamp = stamp;
  result.pose = base.at(stamp) * sensor.mount;
  if (sensor.type == SensorConfig::Type::kCamera) {
    result.image = renderImage(sensor.camera, world.at(stamp), result.pose, seed);
    return result;
  }
  const int rings = static_cast<int>(sensor.elevations.size());
  result.echoes.reserve(static_cast<std::size_t>(sensor.columns) * rings);
  Beams beams(sensor.beam, seed);
  Scene scene = world.at(stamp);
  Eigen::Isometry3d pose = result.pose;
  for (int column = 0; column < sensor.columns; ++column) {
    if (sensor.rolling && column > 0) {
      const double time = stamp + column * sensor.timeIncrement();
      scene = world.at(time);
      pose = base.at(time) * sensor.mount;
    }
    for (int ring = 0; ring < rings; ++ring) {
      result.echoes.push_back(beams.measure(scene, pose, sensor.direction(column, ring)));
    }
  }
  return result;
}

PlanarScan toPlanarScan(const SensorConfig& sensor, const Sweep& sweep) {
  PlanarScan scan;
  scan.stamp = sweep.stamp;
  scan.pose = sweep.pose;
  scan.angle_min = sensor.angle_min;
  scan.angle_max = sensor.angle_min + (sensor.columns - 1) * sensor.angle_increment;
  scan.angle_increment = sensor.angle_increment;
  scan.time_increment = sensor.timeIncrement();
  scan.scan_time = 1.0 / sensor.rate;
  scan.range_min = sensor.beam.range_min;
  scan.range_max = sensor.beam.range_max;
  for (const Echo& echo : sweep.echoes) {
    scan.ranges.push_back(static_cast<float>(echo.range));
    scan.intensities.push_back(static_cast<float>(echo.intensity));
  }
  return scan;
}

namespace {

IntensityModel readIntensity(const YamlMap& map) {
  IntensityModel m;
  m.gain = map.number("gain", {0.0, 1e9}, m.gain);
  m.reference_range = map.number("reference_range", {1e-3, 1e3, "m"}, m.reference_range);
  m.range_exponent = map.number("range_exponent", {0.0, 4.0}, m.range_exponent);
  m.near_range = map.number("near_range", {0.0, 100.0, "m"}, m.near_range);
  m.cosine_exponent = map.number("cosine_exponent", {0.0, 10.0}, m.cosine_exponent);
  m.specular = map.number("specular", kRatio, m.specular);
  m.specular_width =
      kRadians * map.number("specular_width_deg", {0.1, 90.0, "deg"}, m.specular_width / kRadians);
  m.grazing_angle = kRadians * map.number("grazing_angle_deg", {0.0, 1e3, "deg"}, m.grazing_angle / kRadians);
  m.grazing_width =
      kRadians * map.number("grazing_width_deg", {0.1, 90.0, "deg"}, m.grazing_width / kRadians);
  m.noise = map.number("noise", {0.0, 1e9}, m.noise);
  m.noise_ratio = map.number("noise_ratio", kRatio, m.noise_ratio);
  m.max = map.number("max", {0.0, 1e9}, m.max);
  m.resolution = map.number("resolution", {0.0, 1e9}, m.resolution);
  map.finish();
  return m;
}

BeamModel readBeam(const YamlMap& map) {
  BeamModel m;
  m.range_min = map.number("range_min", {0.0, 1e4, "m"});
  m.range_max = map.number("range_max", {m.range_min, 1e4, "m"});
  m.range_noise = map.number("range_noise", {0.0, 10.0, "m"}, m.range_noise);
  m.range_noise_ratio = map.number("range_noise_ratio", kRatio, m.range_noise_ratio);
  m.range_resolution = map.number("range_resolution", {0.0, 10.0, "m"}, m.range_resolution);
  m.divergence = kRadians * map.number("divergence_deg", {0.0, 10.0, "deg"}, m.divergence / kRadians);
  m.sub_rays = map.integer("sub_rays", {0, 64}, m.sub_rays);
  m.mixed_probability = map.number("mixed_probability", kRatio, m.mixed_probability);
  m.mixed_max_gap = map.number("mixed_max_gap", {0.0, 1e9, "m"}, m.mixed_max_gap);
  m.dropout_probability = map.number("dropout_probability", kRatio, m.dropout_probability);
  m.detection_range = map.number("detection_range", {1e-3, 1e9, "m"}, m.detection_range);
  m.detection_noise = map.number("detection_noise", kRatio, m.detection_noise);
  if (map.has("intensity")) m.intensity = readIntensity(map.map("intensity"));
  map.finish();
  return m;
}

std::vector<double> readElevations(const YamlMap& map) {
  const Limits limits{-90.0, 90.0, "deg"};
  std::vector<double> elevations;
  if (map.node("elevations_deg").IsSequence()) {
    elevations = map.numbers("elevations_deg", limits, 1, 1024);
  } else {
    const YamlMap evenly = map.map("elevations_deg");
    const int count = evenly.integer("count", {2, 1024});
    const double min = evenly.number("min", limits),
                 max = evenly.number("max", {min, limits.max, limits.unit});
    evenly.finish();
    for (int i = 0; i < count; ++i) elevations.push_back(min + (max - min) * i / (count - 1));
  }
  for (double& elevation : elevations) elevation *= kRadians;
  return elevations;
}

// From optical axes (x right, y down, z forward) to those of a body (x forward, y left, z up).
Eigen::Isometry3d opticalToBody() {
  Eigen::Isometry3d pose = Eigen::Isometry3d::Identity();
  pose.linear() << 0, 0, 1, -1, 0, 0, 0, -1, 0;
  return pose;
}

CameraModel readCamera(const YamlMap& map) {
  CameraModel m;
  m.width = map.integer("width", {1, 1e4});
  m.height = map.integer("height", {1, 1e4});
  m.fx = m.fy =
      0.5 * m.width / std::tan(0.5 * kRadians * map.number("field_of_view_deg", {1.0, 170.0, "deg"}));
  m.cx = 0.5 * (m.width - 1);
  m.cy = 0.5 * (m.height - 1);
  m.color = map.choice("encoding", {"mono8", "rgb8"}) == "rgb8";
  m.samples = map.integer("samples", {1, 16}, m.samples);
  m.exposure = map.has("exposure") && map.text("exposure") == "auto"
                   ? 0.0
                   : map.number("exposure", {1e-6, 1e6}, m.exposure);
  m.noise = map.number("noise", {0.0, 255.0}, m.noise);
  m.baseline = map.number("baseline", {0.0, 100.0, "m"}, m.baseline);
  return m;
}

}  // namespace

SensorConfig loadSensor(const std::string& file) {
  const YamlMap map = YamlMap::load(file);
  SensorConfig sensor;
  const std::string type = map.choice("type", {"planar", "lidar", "camera"});
  const bool planar = type == "planar";
  sensor.topic = map.text("topic");
  sensor.frame_id = map.text("frame_id");
  if (map.has("mount")) {
    const YamlMap mount = map.map("mount");
    sensor.mount = mount.pose();
    mount.finish();
  }
  sensor.rate = map.number("rate", {0.01, 1000.0, "Hz"});
  if (type == "camera") {
    sensor.type = SensorConfig::Type::kCamera;
    sensor.mount = sensor.mount * opticalToBody();
    sensor.camera = readCamera(map);
    map.finish();
    return sensor;
  }
  sensor.type = planar ? SensorConfig::Type::kPlanar : SensorConfig::Type::kLidar;
  if (planar) {
    sensor.angle_min = kRadians * map.number("angle_min_deg", kDegrees);
    const double span = kRadians * map.number("angle_max_deg", {sensor.angle_min / kRadians, 360.0, "deg"}) -
                        sensor.angle_min;
    sensor.angle_increment = kRadians * map.number("angle_increment_deg", {1e-3, 90.0, "deg"});
    const double steps = span / sensor.angle_increment;
    if (std::abs(steps - std::round(steps)) > 1e-3 || span > 2.0 * M_PI + 1e-9) {
      map.fail(map.node("angle_increment_deg"),
               "angle_increment_deg is " + map.text("angle_increment_deg") +
                   ": angle_max_deg - angle_min_deg must be at most 360 and a "
                   "multiple of it");
    }
    sensor.columns = static_cast<int>(std::lround(steps)) + 1;
  } else {
    sensor.columns = map.integer("azimuth_steps", {1, 1e6});
    sensor.angle_increment = 2.0 * M_PI / sensor.columns;
    sensor.angle_min = -M_PI;
    sensor.elevations = readElevations(map);
  }
  sensor.rolling = map.flag("rolling", sensor.rolling);
  sensor.beam = readBeam(map.map("beam"));
  map.finish();
  return sensor;
}

}  // namespace mapping_simulation
