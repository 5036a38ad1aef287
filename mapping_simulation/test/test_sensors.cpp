// SPDX-License-Identifier: BSD-3-Clause
#include <gtest/gtest.h>
#include <mapping_simulation/posed_scan.h>
#include <mapping_simulation/sensors.h>
#include <mapping_simulation/testing/worlds.h>

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <set>

namespace mapping_simulation {
namespace {

using Type = Shape::Type;
using Eigen::Vector3d;

// Every beam in the plane meets the wall of this round room at `radius`, head on.
World roundRoom(double radius, double reflectivity = 0.5) {
  return World({makeShape(Type::kCylinder, {2 * radius, 2 * radius, 10}, makePose(0, 0, -5), reflectivity)});
}

SensorConfig planarSensor(int columns) {
  SensorConfig sensor;
  sensor.columns = columns;
  sensor.angle_min = -M_PI;
  sensor.angle_increment = 2 * M_PI / columns;
  sensor.rolling = false;
  return sensor;
}

Sweep sweepOnce(const SensorConfig& sensor, const World& world, std::uint64_t seed = 1) {
  return sweep(sensor, world, Trajectory(), 0.0, seed);
}

struct Moments {
  double mean = 0.0, sigma = 0.0;
};

template <typename Value>
Moments moments(const Sweep& sweep, Value value) {
  double sum = 0.0, squares = 0.0;
  for (const Echo& echo : sweep.echoes) {
    sum += value(echo);
    squares += value(echo) * value(echo);
  }
  const double n = sweep.echoes.size();
  return {sum / n, std::sqrt(squares / n - sum * sum / n / n)};
}

double rangeOf(const Echo& echo) {
  return echo.range;
}
double intensityOf(const Echo& echo) {
  return echo.intensity;
}

template <typename Predicate>
double shareOf(const Sweep& sweep, Predicate predicate) {
  return static_cast<double>(std::count_if(sweep.echoes.begin(), sweep.echoes.end(), predicate)) /
         sweep.echoes.size();
}

bool isLost(const Echo& echo) {
  return echo.range == INFINITY;
}

TEST(SensorConfig, DirectionsFollowRep103) {
  SensorConfig sensor = planarSensor(4);
  sensor.elevations = {0.0, M_PI / 6};
  EXPECT_TRUE(sensor.direction(2, 0).isApprox(Vector3d::UnitX()));
  EXPECT_TRUE(sensor.direction(3, 0).isApprox(Vector3d::UnitY()));
  EXPECT_TRUE(sensor.direction(3, 1).isApprox(Vector3d(0, std::sqrt(0.75), 0.5)));
}

TEST(Sweep, WithoutNoiseGivesTheTruth) {
  const World world({makeShape(Type::kBox, {8, 6, 4}, makePose(0, 0, -2), 0.4)});
  const SensorConfig sensor = planarSensor(360);
  const Sweep scan = sweepOnce(sensor, world);
  ASSERT_EQ(scan.echoes.size(), 360u);
  for (int i = 0; i < 360; ++i) {
    const Vector3d d = sensor.direction(i, 0).cwiseAbs();
    const double to_x = 4 / d.x(), to_y = 3 / d.y();
    EXPECT_NEAR(scan.echoes[i].range, std::min(to_x, to_y), 1e-9);
    EXPECT_EQ(scan.echoes[i].range, scan.echoes[i].truth.range);
    EXPECT_NEAR(scan.echoes[i].truth.incidence, std::acos(to_x < to_y ? d.x() : d.y()), 1e-6);
    EXPECT_EQ(scan.echoes[i].truth.reflectivity, 0.4);
  }
}

TEST(Sweep, RangeNoiseHasItsMeanAndSigma) {
  SensorConfig sensor = planarSensor(20000);
  sensor.beam.range_noise = 0.01;
  sensor.beam.range_noise_ratio = 0.002;
  for (double radius : {5.0, 20.0}) {
    const Moments range = moments(sweepOnce(sensor, roundRoom(radius)), rangeOf);
    const double sigma = 0.01 + 0.002 * radius;
    EXPECT_NEAR(range.mean, radius, 4 * sigma / std::sqrt(20000));
    EXPECT_NEAR(range.sigma, sigma, 4 * sigma / std::sqrt(2 * 20000));
  }
}

TEST(Sweep, RangesAreQuantised) {
  SensorConfig sensor = planarSensor(1000);
  sensor.beam.range_noise = 0.05;
  sensor.beam.range_resolution = 0.01;
  for (const Echo& echo : sweepOnce(sensor, roundRoom(5.003)).echoes) {
    EXPECT_NEAR(echo.range * 100, std::round(echo.range * 100), 1e-6);
  }
  sensor.beam.range_noise = 0.0;
  EXPECT_NEAR(sweepOnce(sensor, roundRoom(5.003)).echoes[0].range, 5.0, 1e-9);
}

TEST(Sweep, OutOfRangeFollowsRep117) {
  SensorConfig sensor = planarSensor(8);
  sensor.beam.range_min = 1.0;
  sensor.beam.range_max = 10.0;
  EXPECT_EQ(sweepOnce(sensor, roundRoom(0.9)).echoes[0].range, -INFINITY);
  EXPECT_NEAR(sweepOnce(sensor, roundRoom(9.9)).echoes[0].range, 9.9, 1e-9);
  const Echo far = sweepOnce(sensor, roundRoom(10.1)).echoes[0];
  EXPECT_EQ(far.range, INFINITY);
  EXPECT_EQ(far.intensity, 0.0);
  EXPECT_NEAR(far.truth.range, 10.1, 1e-9);
  const World open({makeShape(Type::kGround, Vector3d::Ones(), makePose(0, 0, -1))});
  EXPECT_EQ(sweepOnce(sensor, open).echoes[0].range, INFINITY);
  EXPECT_FALSE(sweepOnce(sensor, open).echoes[0].truth);
}

TEST(Sweep, MixedPixelsLieBetweenTheSurfaces) {
  // A panel 2 m ahead, half a metre to each side, before a wall 3 m ahead.
  const World world({makeShape(Type::kRectangle, {1, 0, 2}, makePose(2, 0, -1, M_PI / 2), 0.8),
                     makeShape(Type::kRectangle, {40, 0, 2}, makePose(3, 0, -1, M_PI / 2), 0.2)});
  SensorConfig sensor = planarSensor(1);
  sensor.columns = 101;
  sensor.angle_increment = 0.02 * M_PI / 180;
  sensor.angle_min = std::atan2(0.5, 2.0) - 50 * sensor.angle_increment;
  sensor.beam.divergence = 1.0 * M_PI / 180;
  sensor.beam.sub_rays = 2;
  sensor.beam.mixed_probability = 0.4;
  int mixed = 0, near_mixed = 0, straddling = 0;
  for (int seed = 0; seed < 100; ++seed) {
    const Sweep scan = sweepOnce(sensor, world, seed);
    for (int i = 0; i < sensor.columns; ++i) {
      const Echo& echo = scan.echoes[i];
      // Half a degree to each side of the edge the beam lies on both.
      const bool on_both = std::abs(i - 50) < 25;
      straddling += on_both;
      if (std::abs(echo.range - echo.truth.range) < 1e-9) continue;
      EXPECT_LE(std::abs(i - 50), 25);
      // Slanted by up to half a beam, the surfaces are at 2 and 3 m over the cosine.
      const double depth = echo.range * sensor.direction(i, 0).x();
      EXPECT_GT(depth, 2.0 - 0.02);
      EXPECT_LT(depth, 3.0 + 0.02);
      const auto intensity = [&](double rho, double x) {
        return rho * sensor.beam.intensity.response(x / sensor.direction(i, 0).x(), echo.truth.incidence);
      };
      EXPECT_GT(echo.intensity, 0.95 * intensity(0.2, 3.0));
      EXPECT_LT(echo.intensity, 1.05 * intensity(0.8, 2.0));
      near_mixed += depth < 2.5;
      ++mixed;
    }
  }
  EXPECT_NEAR(static_cast<double>(mixed) / straddling, 0.4, 0.05);
  EXPECT_NEAR(static_cast<double>(near_mixed) / mixed, 0.5, 0.06);

  sensor.beam.mixed_max_gap = 0.9;  // the receiver tells the two apart
  const Sweep separated = sweepOnce(sensor, world);
  EXPECT_EQ(shareOf(separated, [](const Echo& e) { return e.range != e.truth.range; }), 0.0);
}

TEST(Sweep, SlantedSurfaceMakesNoMixedPixels) {
  const World world({makeShape(Type::kGround, Vector3d::Ones(), makePose(0, 0, -1))});
  SensorConfig sensor = planarSensor(100);
  sensor.elevations = {-0.1};
  sensor.beam.divergence = 0.05;
  sensor.beam.sub_rays = 4;
  sensor.beam.mixed_probability = 1.0;
  EXPECT_EQ(shareOf(sweepOnce(sensor, world), [](const Echo& e) { return e.range != e.truth.range; }), 0.0);
}

TEST(Sweep, DropoutsHaveTheirRate) {
  SensorConfig sensor = planarSensor(20000);
  sensor.beam.dropout_probability = 0.03;
  EXPECT_NEAR(shareOf(sweepOnce(sensor, roundRoom(5.0)), isLost), 0.03, 0.005);
}

TEST(Sweep, DarkTargetsAreSeenLessFar) {
  SensorConfig sensor = planarSensor(4000);
  sensor.beam.detection_range = 20.0;  // of reflectivity 1, thus 10 m of 0.25
  EXPECT_EQ(shareOf(sweepOnce(sensor, roundRoom(9.9, 0.25)), isLost), 0.0);
  EXPECT_EQ(shareOf(sweepOnce(sensor, roundRoom(10.1, 0.25)), isLost), 1.0);
  EXPECT_EQ(shareOf(sweepOnce(sensor, roundRoom(19.9, 1.0)), isLost), 0.0);
  sensor.beam.detection_noise = 0.1;
  EXPECT_NEAR(shareOf(sweepOnce(sensor, roundRoom(10.0, 0.25)), isLost), 0.5, 0.03);
  // One sigma more energy than needed.
  EXPECT_NEAR(shareOf(sweepOnce(sensor, roundRoom(10.0, 0.25 / 0.9)), isLost), 0.159, 0.025);
}

TEST(Sweep, GrazingBeamsAreLost) {
  const World world({makeShape(Type::kGround, Vector3d::Ones(), makePose(0, 0, -0.5))});
  SensorConfig sensor = planarSensor(10);
  sensor.elevations = {-4.0 * M_PI / 180, -20.0 * M_PI / 180};
  sensor.beam.detection_range = 40.0;
  EXPECT_EQ(shareOf(sweepOnce(sensor, world), isLost), 0.0);
  sensor.beam.intensity.grazing_angle = 80 * M_PI / 180;
  sensor.beam.intensity.grazing_width = 2 * M_PI / 180;
  const Sweep scan = sweepOnce(sensor, world);
  for (std::size_t i = 0; i < scan.echoes.size(); i += 2) {
    EXPECT_EQ(scan.echoes[i].range, INFINITY);
    EXPECT_TRUE(std::isfinite(scan.echoes[i + 1].range));
  }
}

TEST(IntensityModel, LambertianByDefault) {
  IntensityModel model;
  model.gain = 100;
  model.reference_range = 2;
  EXPECT_NEAR(model.response(2.0, 0.0), 100.0, 1e-3);
  EXPECT_NEAR(model.response(4.0, M_PI / 3), 12.5, 1e-3);
}

TEST(IntensityModel, NearDistanceEffectAndGrazingFall) {
  IntensityModel model;
  model.range_exponent = 0.5;
  model.near_range = 1.0;
  model.grazing_angle = 75 * M_PI / 180;
  model.grazing_width = 3 * M_PI / 180;
  // Rises with range when near, falls when far.
  EXPECT_LT(model.response(0.2, 0), model.response(0.5, 0));
  EXPECT_LT(model.response(0.5, 0), model.response(1.0, 0));
  EXPECT_GT(model.response(2.0, 0), model.response(5.0, 0));
  EXPECT_NEAR(model.near(1.0), 1 - std::exp(-1.0), 1e-12);
  EXPECT_NEAR(model.angular(0.0), 1.0, 1e-12);
  EXPECT_NEAR(model.angular(model.grazing_angle), std::cos(model.grazing_angle) / 2, 1e-9);
  EXPECT_LT(model.angular(85 * M_PI / 180), 0.05 * std::cos(85 * M_PI / 180));
  EXPECT_GT(model.angular(60 * M_PI / 180), 0.98 * 0.5);
  EXPECT_NEAR(model.angular(M_PI / 2), 0.0, 1e-12);
}

TEST(IntensityModel, SpecularLobeStandsOutNearTheNormal) {
  IntensityModel model;
  model.specular = 0.3;
  model.specular_width = 0.1;
  EXPECT_NEAR(model.angular(0.0), 1.0, 1e-9);
  EXPECT_NEAR(model.angular(0.1), 0.7 * std::cos(0.1) + 0.3 * std::exp(-1.0), 1e-9);
  EXPECT_NEAR(model.angular(0.5), 0.7 * std::cos(0.5), 1e-9);
}

TEST(Sweep, IntensityIsReflectivityTimesResponseWithNoise) {
  SensorConfig sensor = planarSensor(20000);
  sensor.beam.intensity.noise = 2.0;
  sensor.beam.intensity.noise_ratio = 0.05;
  const double expected = 0.6 * sensor.beam.intensity.response(3.0, 0.0), sigma = 2.0 + 0.05 * expected;
  const Moments measured = moments(sweepOnce(sensor, roundRoom(3.0, 0.6)), intensityOf);
  EXPECT_NEAR(measured.mean, expected, 4 * sigma / std::sqrt(20000));
  EXPECT_NEAR(measured.sigma, sigma, 4 * sigma / std::sqrt(2 * 20000));

  sensor.beam.intensity.max = 48.0;
  sensor.beam.intensity.resolution = 4.0;
  for (const Echo& echo : sweepOnce(sensor, roundRoom(3.0, 0.6)).echoes) {
    ASSERT_EQ(std::fmod(echo.intensity, 4.0), 0.0);
    ASSERT_LE(echo.intensity, 48.0);
  }
}

TEST(Sweep, MovingSensorMeasuresFromTheTimeOfEachBeam) {
  const World world({makeShape(Type::kRectangle, {200, 0, 10}, makePose(20, 0, -5, M_PI / 2))});
  SensorConfig sensor;
  sensor.columns = 91;
  sensor.angle_min = -M_PI / 4;
  sensor.angle_increment = M_PI / 180;
  sensor.rate = 10.0;
  sensor.mount = makePose(0.5, 0.0, 0.2, 0.1);
  sensor.beam.range_max = 100.0;
  EXPECT_NEAR(sensor.timeIncrement(), 0.1 / 360, 1e-15);
  // 8 m/s ahead, turning at 1 rad/s.
  const Trajectory base({{0.0, makePose(0, 0, 0)}, {1.0, makePose(8, 0, 0, 1.0)}});
  const double stamp = 0.3;
  const Sweep rolling = sweep(sensor, world, base, stamp, 1);
  EXPECT_TRUE(rolling.pose.isApprox(makePose(2.4, 0, 0, 0.3) * sensor.mount, 1e-12));
  for (int i = 0; i < sensor.columns; ++i) {
    const double t = stamp + i * 0.1 / 360, x = 8 * t + 0.5 * std::cos(t);
    const double azimuth = t + 0.1 + sensor.angle_min + i * sensor.angle_increment;
    EXPECT_NEAR(rolling.echoes[i].range, (20 - x) / std::cos(azimuth), 1e-9);
  }
  sensor.rolling = false;
  EXPECT_EQ(sensor.timeIncrement(), 0.0);
  const Sweep frozen = sweep(sensor, world, base, stamp, 1);
  EXPECT_EQ(frozen.echoes[0].range, rolling.echoes[0].range);
  const double azimuth = stamp + 0.1 + sensor.angle_min + 90 * sensor.angle_increment;
  EXPECT_NEAR(frozen.echoes[90].range, (20 - 2.4 - 0.5 * std::cos(stamp)) / std::cos(azimuth), 1e-9);
}

TEST(Sweep, MovingTargetIsSeenAtTheTimeOfEachBeam) {
  Shape wall = makeShape(Type::kRectangle, {200, 0, 10}, makePose(0, 0, -5, M_PI / 2));
  wall.motion = 0;
  const World world({wall}, {Trajectory({{0, makePose(10, 0, 0)}, {1, makePose(20, 0, 0)}})});
  SensorConfig sensor = planarSensor(90);
  sensor.rolling = true;
  sensor.rate = 5.0;
  const Sweep scan = sweepOnce(sensor, world);
  EXPECT_NEAR(scan.echoes[45].range, 10.0 + 10.0 * 0.1, 1e-9);
}

TEST(Sweep, SeedDecidesAllNoise) {
  SensorConfig sensor = loadSensor(configFile("simulator/hokuyo_utm30lx.yaml"));
  const World world = loadWorld(configFile("worlds/laboratory.yaml"));
  const Sweep a = sweepOnce(sensor, world, 5), b = sweepOnce(sensor, world, 5),
              c = sweepOnce(sensor, world, 6);
  int differ = 0;
  for (std::size_t i = 0; i < a.echoes.size(); ++i) {
    ASSERT_EQ(a.echoes[i].range, b.echoes[i].range);
    ASSERT_EQ(a.echoes[i].intensity, b.echoes[i].intensity);
    ASSERT_EQ(a.echoes[i].truth.range, c.echoes[i].truth.range);
    differ += a.echoes[i].range != c.echoes[i].range;
  }
  EXPECT_GT(differ, 900);
}

TEST(Conversion, PlanarScan) {
  SensorConfig sensor = loadSensor(configFile("simulator/hokuyo_utm30lx.yaml"));
  const Sweep scan = sweep(sensor, roundRoom(5.0), Trajectory(), 3.0, 1);
  const PlanarScan planar = toPlanarScan(sensor, scan);
  ASSERT_EQ(planar.ranges.size(), 1081u);
  ASSERT_EQ(planar.intensities.size(), 1081u);
  EXPECT_NEAR(planar.angle_min, -0.75 * M_PI, 1e-9);
  EXPECT_NEAR(planar.angle_max, 0.75 * M_PI, 1e-9);
  EXPECT_NEAR(planar.time_increment, 0.025 / 1440, 1e-12);
  EXPECT_NEAR(planar.scan_time, 0.025, 1e-12);
  EXPECT_EQ(planar.stamp, 3.0);
  EXPECT_TRUE(planar.pose.isApprox(sensor.mount));
  EXPECT_EQ(planar.ranges[7], static_cast<float>(scan.echoes[7].range));
}

TEST(Conversion, PosedScanIsOrganised) {
  SensorConfig sensor = planarSensor(36);
  sensor.topic = "points";
  sensor.elevations = {-0.3, 0.0, 0.2};
  const World world({makeShape(Type::kGround, Vector3d::Ones(), makePose(0, 0, -1))});
  const PosedScan scan = toPosedScan(sensor, sweepOnce(sensor, world));
  ASSERT_EQ(scan.cloud.width, 36u);
  ASSERT_EQ(scan.cloud.height, 3u);
  EXPECT_EQ(scan.name, "points");
  for (int column = 0; column < 36; ++column) {
    EXPECT_NEAR(scan.cloud.at(column, 0).z, -1.0, 1e-6);
    EXPECT_NEAR(scan.cloud.at(column, 0).getVector3fMap().head<2>().norm(), 1 / std::tan(0.3), 1e-5);
    EXPECT_GT(scan.cloud.at(column, 0).intensity, 0.0f);
    EXPECT_TRUE(std::isnan(scan.cloud.at(column, 1).x));
    EXPECT_TRUE(std::isnan(scan.cloud.at(column, 2).z));
  }
}

TEST(ShippedSensors, AllLoadAndSeeTheStreet) {
  const World world = loadWorld(configFile("worlds/street.yaml"));
  int count = 0;
  for (const auto& entry : std::filesystem::directory_iterator(configFile("simulator"))) {
    SCOPED_TRACE(entry.path());
    SensorConfig sensor = loadSensor(entry.path().string());
    const Sweep scan = sweepOnce(sensor, world);
    ++count;
    if (sensor.type == SensorConfig::Type::kCamera) {
      const std::set<std::uint8_t> greys(scan.image.data.begin(), scan.image.data.end());
      EXPECT_GT(greys.size(), 100u);
      continue;
    }
    const double share = shareOf(scan, [](const Echo& e) { return std::isfinite(e.range); });
    EXPECT_GT(share, sensor.beam.range_max > 10 ? 0.4 : 0.1);
    for (const Echo& echo : scan.echoes) {
      if (!std::isfinite(echo.range)) continue;
      ASSERT_GE(echo.range, sensor.beam.range_min);
      ASSERT_LE(echo.range, sensor.beam.range_max);
      ASSERT_LE(echo.intensity, sensor.beam.intensity.max);
    }
  }
  EXPECT_GE(count, 5);
}

TEST(ShippedSensors, HaveTheirDataSheetsNumbers) {
  const SensorConfig utm = loadSensor(configFile("simulator/hokuyo_utm30lx.yaml"));
  EXPECT_EQ(utm.columns, 1081);
  EXPECT_EQ(utm.rate, 40.0);
  EXPECT_NEAR(utm.beam.range_noise + 7 * utm.beam.range_noise_ratio, 0.010, 1e-3);
  EXPECT_EQ(loadSensor(configFile("simulator/sick_lms291.yaml")).columns, 181);
  EXPECT_EQ(loadSensor(configFile("simulator/sick_lms291.yaml")).beam.range_max, 80.0);
  EXPECT_EQ(loadSensor(configFile("simulator/sick_lms291_mm.yaml")).beam.range_max, 8.0);
  const SensorConfig hdl = loadSensor(configFile("simulator/velodyne_hdl64e.yaml"));
  EXPECT_EQ(hdl.elevations.size(), 64u);
  EXPECT_TRUE(std::is_sorted(hdl.elevations.begin(), hdl.elevations.end()));
  const SensorConfig vlp = loadSensor(configFile("simulator/velodyne_vlp16.yaml"));
  ASSERT_EQ(vlp.elevations.size(), 16u);
  EXPECT_NEAR(vlp.elevations[0], -15 * M_PI / 180, 1e-12);
  EXPECT_NEAR(vlp.elevations[1], -13 * M_PI / 180, 1e-12);
}

TEST(LoadSensor, NamesFileLineKeyValueAndRange) {
  const TempDir dir;
  const auto expect = [&](const std::string& text, const std::string& replacement,
                          const std::string& message) {
    std::ifstream in(configFile("simulator/hokuyo_utm30lx.yaml"));
    std::string yaml{std::istreambuf_iterator<char>(in), {}};
    const std::size_t at = yaml.find(text);
    ASSERT_NE(at, std::string::npos) << text;
    yaml.replace(at, text.size(), replacement);
    const std::string line = std::to_string(std::count(yaml.begin(), yaml.begin() + at, '\n') + 1);
    const std::string file = dir.write("sensor.yaml", yaml);
    expectError([&] { loadSensor(file); }, file + ":" + line + ": " + message);
  };
  expect("rate: 40", "rate: fast", "rate is 'fast': must be a number in [0.01, 1000] Hz");
  expect("rate: 40", "rate: 0", "rate is '0': must be");
  expect("type: planar", "type: round", "type is 'round': must be one of planar, lidar");
  expect("range_min: 0.1", "range_minimum: 0.1", "key 'range_min' is missing");
  expect("range_max: 30", "range_max: 0.05", "range_max is '0.05': must be a number in [0.1, 10000] m");
  expect("angle_max_deg: 135", "angle_max_deg: -150", "angle_max_deg is '-150'");
  expect("angle_increment_deg: 0.25", "angle_increment_deg: 0.7", "angle_increment_deg is 0.7");
  expect("sub_rays: 2", "sub_rays: 2.5", "sub_rays is '2.5': must be a whole number");
  expect("near_range: 0.8", "far_range: 0.8",
         "unknown key 'far_range' in intensity; known: cosine_exponent, ");
  expect("mixed_probability: 0.5", "mixed_probability: 1.5", "mixed_probability is '1.5'");
}

}  // namespace
}  // namespace mapping_simulation

int main(int argc, char** argv) {
  testing::InitGoogleTest(&argc, argv);
  return RUN_ALL_TESTS();
}
