// SPDX-License-Identifier: BSD-3-Clause
#include <gtest/gtest.h>
#include <mapping_simulation/camera.h>
#include <mapping_simulation/sensors.h>
#include <mapping_simulation/simulator.h>
#include <mapping_simulation/testing/worlds.h>

#include <cmath>
#include <numeric>
#include <set>

namespace mapping_simulation {
namespace {

using Type = Shape::Type;
using Eigen::Isometry3d;
using Eigen::Vector3d;

// Looks along x from a point; yaw to the left.
Isometry3d lookFrom(const Vector3d& position, double yaw = 0.0) {
  Isometry3d pose = makePose(position.x(), position.y(), position.z(), yaw);
  Eigen::Matrix3d optical;
  optical << 0, 0, 1, -1, 0, 0, 0, -1, 0;
  pose.linear() = pose.linear() * optical;
  return pose;
}

// Of one colour, without detail.
Shape plain(Type type, const Vector3d& size, const Isometry3d& pose, double reflectivity) {
  Shape shape = makeShape(type, size, pose, reflectivity);
  shape.texture.detail = 0.0;
  return shape;
}

// A rectangle that faces along x, around a point.
Shape wall(double x, double y, double z, double width, double height, double reflectivity) {
  return plain(Type::kRectangle, {width, 0, height}, makePose(x, y, z - height / 2, M_PI / 2), reflectivity);
}

Light even(double strength) {  // from one side, with nothing that depends on the surface's direction
  Light light;
  light.ambient = 0.0;
  light.sun = Color::Constant(static_cast<float>(strength));
  light.to_sun = -Vector3d::UnitX();
  return light;
}

CameraModel smallCamera() {
  CameraModel camera;
  camera.width = 80;
  camera.height = 60;
  camera.fx = camera.fy = 60.0;
  camera.cx = 39.5;
  camera.cy = 29.5;
  return camera;
}

int at(const Image& image, int u, int v, int channel = 0) {
  return image.data[(static_cast<std::size_t>(v) * image.width + u) * image.channels + channel];
}

double meanOf(const Image& image) {
  return std::accumulate(image.data.begin(), image.data.end(), 0.0) / image.data.size();
}

TEST(Camera, APointLandsWhereThePoseSays) {
  const Vector3d dot(6, 0.7, 1.9);
  const World world({wall(6.01, 0, 0, 100, 100, 0.0), wall(dot.x(), dot.y(), dot.z(), 0.3, 0.3, 1.0)}, {},
                    even(1.0));
  CameraModel camera;
  camera.cx = 300.0;
  camera.cy = 250.0;
  camera.fy = 420.0;
  camera.samples = 8;
  for (const double yaw : {-0.2, 0.0, 0.15}) {
    const Isometry3d pose = lookFrom({1, -0.4, 1.6}, yaw);
    const Image image = renderImage(camera, world.at(0), pose, 0);
    double sum = 0, u = 0, v = 0;
    for (int y = 0; y < image.height; ++y) {
      for (int x = 0; x < image.width; ++x) {
        sum += at(image, x, y);
        u += x * at(image, x, y);
        v += y * at(image, x, y);
      }
    }
    ASSERT_GT(sum, 255 * 100);
    const Vector3d in_camera = pose.inverse() * dot;
    EXPECT_NEAR(u / sum, camera.cx + camera.fx * in_camera.x() / in_camera.z(), 0.15);
    EXPECT_NEAR(v / sum, camera.cy + camera.fy * in_camera.y() / in_camera.z(), 0.15);
  }
}

TEST(Camera, NearerShapesHideFartherOnes) {
  Light light;
  light.ambient = 1.0;
  const World world({wall(8, 0, 0, 100, 100, 0.2), wall(4, 0, 0, 1, 1, 0.6), wall(-3, 0, 0, 9, 9, 0.9)}, {},
                    light);
  const Image image = renderImage(smallCamera(), world.at(0), lookFrom({0, 0, 0}), 0);
  const double share = 0.85 - 0.15 * 0.36;  // of the ambient light, on a wall that faces away from x
  EXPECT_NEAR(at(image, 40, 30), 255 * share * 0.6, 0.6);
  EXPECT_NEAR(at(image, 2, 30), 255 * share * 0.2, 0.6);
}

TEST(Camera, EdgesAreSharedBySamples) {  // half of a pixel is white
  CameraModel camera = smallCamera();
  camera.cx = 40.0;
  const World world({wall(8, 0, 0, 100, 100, 0.0), wall(4, 50, 0, 100, 100, 1.0)}, {}, even(1.0));
  const Image image = renderImage(camera, world.at(0), lookFrom({0, 0, 0}), 0);
  EXPECT_EQ(at(image, 39, 30), 255);
  EXPECT_NEAR(at(image, 40, 30), 128, 1);
  EXPECT_EQ(at(image, 41, 30), 0);
}

TEST(Camera, SeesTheShapesThatALaserSees) {
  const World world = loadWorld(configFile("worlds/laboratory.yaml"));
  const Scene scene = world.at(12.0);
  const Isometry3d pose = lookFrom({-1, 0.5, 1.3}, 2.0);
  const CameraModel camera = smallCamera();
  std::set<int> shapes;
  for (int v = 0; v < camera.height; ++v) {
    for (int u = 0; u < camera.width; ++u) {
      const Ray ray{pose.translation(), pose.linear() * camera.direction(u, v)};
      const Hit hit = scene.cast(ray);
      const SurfacePoint point = scene.look(ray);
      ASSERT_EQ(hit.shape, point.shape);
      ASSERT_EQ(hit.range, point.range);
      ASSERT_NEAR(hit.incidence, std::acos(std::min(1.0, -point.normal.dot(ray.direction))), 1e-6);
      ASSERT_EQ(hit.reflectivity, scene.shape(hit.shape).texture.at(point.uv));
      shapes.insert(hit.shape);
    }
  }
  EXPECT_GT(shapes.size(), 8u);
}

TEST(Camera, SeedDecidesTheNoiseAndThreadsNothing) {
  CameraModel camera = smallCamera();
  const World world({wall(5, 0, 0, 100, 100, 0.5)}, {}, even(1.0));
  const auto render = [&](int seed, int threads) {
    return renderImage(camera, world.at(0), lookFrom({0, 0, 0}), seed, threads).data;
  };
  EXPECT_EQ(render(1, 1), std::vector<std::uint8_t>(80 * 60, 128));
  camera.noise = 4.0;
  EXPECT_EQ(render(1, 1), render(1, 3));
  EXPECT_NE(render(1, 1), render(2, 1));
  double squares = 0.0;
  for (const int value : render(1, 1)) squares += std::pow(value - 127.5, 2);
  EXPECT_NEAR(std::sqrt(squares / (80 * 60)), 4.0, 0.2);
}

TEST(Camera, ColorsAndExposure) {
  Shape shape = wall(5, 0, 0, 100, 100, 0.5);
  shape.texture.colors = {Color(0.8f, 0.4f, 0.2f)};
  const World world({shape}, {}, even(1.0));
  CameraModel camera = smallCamera();
  camera.exposure = 0.5;
  const auto render = [&] { return renderImage(camera, world.at(0), lookFrom({0, 0, 0}), 0); };
  EXPECT_NEAR(at(render(), 40, 30), 127.5 * (0.299 * 0.8 + 0.587 * 0.4 + 0.114 * 0.2), 1.0);
  camera.color = true;
  const Image color = render();
  ASSERT_EQ(color.data.size(), 80u * 60u * 3u);
  EXPECT_NEAR(at(color, 40, 30, 0), 102, 1);
  EXPECT_NEAR(at(color, 40, 30, 1), 51, 1);
  EXPECT_NEAR(at(color, 40, 30, 2), 25.5, 1);
  camera.color = false;
  camera.exposure = 0.0;
  EXPECT_NEAR(meanOf(render()), 110, 1.0);
}

TEST(Light, SunThrowsShadowsAndLampsFallWithTheSquareOfTheDistance) {
  Light light;
  light.ambient = 0.0;
  light.sun = Color::Constant(1.0f);
  light.to_sun = Vector3d(0.6, 0, 0.8);
  const Shape ground = plain(Type::kGround, Vector3d::Ones(), Isometry3d::Identity(), 1.0);
  const Shape roof = plain(Type::kBox, {2, 2, 0.1}, makePose(0, 0, 4), 1.0);
  const Scene sunny = World({ground, roof}, {}, light).at(0);
  EXPECT_NEAR(sunny.lightAt({3, 0, 0}, Vector3d::UnitZ())[0], 0.8, 1e-6);
  EXPECT_NEAR(sunny.lightAt({-3, 0, 0}, Vector3d::UnitZ())[0], 0.0,
              1e-6);  // under the roof, seen from the sun
  EXPECT_EQ(sunny.lightAt({3, 0, 0}, -Vector3d::UnitZ())[0], 0.0f);
  light.sun.setZero();
  light.lamps = {{{0, 0, 3}, Color(9, 4.5, 0)}};
  const Scene night = World({ground, roof}, {}, light).at(0);
  EXPECT_TRUE(night.lightAt({0, 0, 0}, Vector3d::UnitZ()).isApprox(Color(1, 0.5, 0), 1e-5f));
  EXPECT_NEAR(night.lightAt({4, 0, 0}, Vector3d::UnitZ())[0], 9.0 / 25 * 0.6, 1e-5);
  EXPECT_EQ(night.lightAt({0, 0, 6}, Vector3d::UnitZ())[0], 0.0f);  // on the roof
}

TEST(Light, ChangesWithTime) {
  Light light = even(1.0);
  light.changes = {{10, 1.0}, {20, 0.5}};
  const World world({wall(5, 0, 0, 100, 100, 1.0)}, {}, light);
  const auto mean = [&](double time) {
    return meanOf(renderImage(smallCamera(), world.at(time), lookFrom({0, 0, 0}), 0));
  };
  EXPECT_NEAR(mean(0), 255, 0.5);
  EXPECT_NEAR(mean(15), 191, 0.5);
  EXPECT_NEAR(mean(99), 127.5, 0.6);
}

TEST(Texture, DetailIsSeenAtEveryDistanceAndItsMeanIsTheReflectivity) {
  Shape shape = wall(0, 0, 0, 100, 100, 0.5);
  shape.texture.detail = 0.1;
  const World world({shape}, {}, even(1.0));
  CameraModel camera = smallCamera();
  for (const double distance : {0.5, 2.0, 8.0}) {
    const Image image = renderImage(camera, world.at(0), lookFrom({-distance, 0.3, 0.2}), 0);
    double differences = 0.0;
    for (int v = 0; v < 60; ++v)
      for (int u = 1; u < 80; ++u)
        differences += std::abs(at(image, u, v) - at(image, u - 1, v)) / (60.0 * 79.0);
    EXPECT_GT(differences, 1.5) << distance;
    if (distance > 4.0) {
      EXPECT_NEAR(meanOf(image), 127.5, 4.0);
    }
  }
  EXPECT_EQ(shape.texture.at({0.1, 0.2}), 0.5);
}

TEST(Texture, BricksAreInRunningBond) {
  Texture bricks;
  bricks.type = Texture::Type::kBricks;
  bricks.size = 0.2;
  bricks.height = 0.1;
  bricks.values = {0.3, 0.6, 0.9};
  std::set<double> values;
  for (double u = 0.05; u < 10; u += 0.2) {
    EXPECT_EQ(bricks.at({u - 0.045, 0.05}), 0.9);        // joint
    EXPECT_EQ(bricks.at({u - 0.045 + 0.1, 0.15}), 0.9);  // half a brick on in the next row
    EXPECT_EQ(bricks.at({u, 0.05}), bricks.at({u + 0.1, 0.09}));
    values.insert(bricks.at({u, 0.05}));
  }
  EXPECT_GT(values.size(), 40u);
  EXPECT_GE(*values.begin(), 0.3);
  EXPECT_LE(*values.rbegin(), 0.6);
}

// Mean difference of two houses' fronts, of what cameras and lasers see.
double difference(const Texture& a, const Texture& b) {
  double sum = 0.0;
  int count = 0;
  for (double u = -3.9; u < 4; u += 0.13) {
    for (double v = 0.1; v < 9; v += 0.13, ++count)
      sum += std::abs(a.seenAt({u, v}, 0.1).albedo.mean() - b.seenAt({u, v}, 0.1).albedo.mean()) +
             std::abs(a.at({u, v}) - b.at({u, v}));
  }
  return sum / count;
}

TEST(Texture, EachSeedIsAnotherHouse) {
  Texture house, other;
  house.type = other.type = Texture::Type::kFacade;
  house.size = other.size = 3.0;
  house.span = other.span = 8.0;
  house.seed = 1;
  for (other.seed = 2; other.seed < 12; ++other.seed) EXPECT_GT(difference(house, other), 0.1) << other.seed;
  other.seed = 1;
  EXPECT_EQ(difference(house, other), 0.0);
  for (double u = -4; u < 4; u += 0.1) {
    for (double v = -1; v < 12; v += 0.1) {
      const double reflectivity = house.at({u, v});
      ASSERT_TRUE(reflectivity >= 0.0 && reflectivity <= 1.0);
    }
  }
}

TEST(LoadWorld, HousesStandSideBySideByTheSeed) {
  const TempDir dir;
  const std::string file = dir.write("file.yaml", R"(
objects:
  - {type: houses, length: 60, width: [5, 11], height: [6, 12], seed: 3, position: [2, 9, 0]}
light: {ambient: 0.1, sun: {strength: 2, azimuth_deg: 90, elevation_deg: 30}, changes: [[0, 1], [5, 0.5]],
        lamps: [{strength: 3, color: [1, 0.5, 0], position: [0, 0, 5], repeat: {count: 2, step: [10, 0, 0]}}]}
)");
  const World world = loadWorld(file);
  double end = 2.0;
  for (const Shape& house : world.shapes()) {
    EXPECT_NEAR(house.pose.translation().x() - 0.5 * house.size.x(), end, 1e-9);
    EXPECT_GE(house.size.x(), 5.0);
    EXPECT_EQ(house.texture.span, house.size.x());
    EXPECT_TRUE(house.size.z() >= 6.0 && house.size.z() <= 12.0);
    end = house.pose.translation().x() + 0.5 * house.size.x();
    EXPECT_NEAR(world.cast({house.pose * Vector3d(0, -9, 1), Vector3d::UnitY()}, 0).range, 6.0, 1e-9);
  }
  EXPECT_NEAR(end, 62.0, 1e-9);
  EXPECT_NE(loadWorld(file, 1).shapes()[0].size.x(), world.shapes()[0].size.x());
  EXPECT_TRUE(world.light().to_sun.isApprox(Vector3d(0, std::sqrt(0.75), 0.5), 1e-9));
  ASSERT_EQ(world.light().lamps.size(), 2u);
  EXPECT_EQ(world.light().lamps[1].position, Vector3d(10, 0, 5));
  EXPECT_TRUE(world.light().lamps[1].color.isApprox(Color(3, 1.5, 0)));
  EXPECT_EQ(world.light().changes.size(), 2u);
}

TEST(LoadWorld, SaysWhatIsWrongWithLightAndColors) {
  const TempDir dir;
  const auto expect = [&](const std::string& yaml, const std::string& message) {
    const std::string file = dir.write("file.yaml", yaml + "\nobjects: [{type: ground, reflectivity: 1}]\n");
    expectError([&] { loadWorld(file); }, file + message);
  };
  expect("light: {ambient: -1}", ":1: ambient is '-1'");
  expect("light: {moon: 1}", ":1: unknown key 'moon'");
  expect("light: {changes: [[1, 1], [1, 2]]}", ":1: the time of a change must be after the one before");
  expect("light: {sun: {strength: 1, azimuth_deg: 0, elevation_deg: 91}}", ":1: elevation_deg is '91'");
  expect("textures: {t: {type: noise, size: 1, values: [0, 1], colors: [[1, 1, 1]]}}",
         ":1: colors must be as many as values");
  expect("textures: {t: {type: bricks, size: 1, values: [0, 1, 1]}}", ":1: key 'height' is missing");
}

TEST(LoadSensor, CameraLooksAlongTheAxisOfItsBody) {
  const SensorConfig sensor = loadSensor(configFile("simulator/camera.yaml"));
  EXPECT_EQ(sensor.type, SensorConfig::Type::kCamera);
  EXPECT_TRUE((sensor.mount.linear() * Vector3d::UnitZ()).isApprox(Vector3d::UnitX(), 1e-12));
  EXPECT_TRUE((sensor.mount.linear() * Vector3d::UnitX()).isApprox(-Vector3d::UnitY(), 1e-12));
  EXPECT_NEAR(std::atan2(0.5 * sensor.camera.width, sensor.camera.fx) * 360 / M_PI, 77.8, 1e-6);
  EXPECT_NEAR(loadSensor(configFile("simulator/camera_right.yaml")).camera.baseline, 0.3, 1e-12);
}

TEST(Simulate, CamerasLeaveTheScannersNoiseAlone) {
  const World world({makeShape(Type::kBox, {30, 20, 4}, makePose(0, 0, -2))});
  SensorConfig scanner, camera;
  scanner.columns = 36;
  scanner.angle_increment = M_PI / 36;
  scanner.beam.range_noise = 0.1;
  camera.type = SensorConfig::Type::kCamera;
  camera.topic = "image";
  camera.rate = 10.0;
  camera.camera = smallCamera();
  camera.mount = lookFrom({0, 0, 0.5});
  const auto rangesWith = [&](const std::vector<SensorConfig>& sensors) {
    std::vector<double> ranges;
    int images = 0;
    simulate({world, driveThrough({{{-5, 0, 0}, 2.0}, {{5, 0, 0}, 2.0}}), sensors, 0.5, 9},
             [&](const SensorConfig& sensor, const Sweep& sweep) {
               for (const Echo& echo : sweep.echoes) ranges.push_back(echo.range);
               if (sensor.type != SensorConfig::Type::kCamera) return;
               EXPECT_EQ(sweep.image.data.size(), 80u * 60u);
               EXPECT_NEAR(sweep.pose.translation().x(), -5 + 2.0 * sweep.stamp, 1e-6);
               EXPECT_NEAR(sweep.stamp, 0.1 * images++, 1e-9);
             });
    EXPECT_EQ(images, sensors.size() > 1 ? 6 : 0);
    return ranges;
  };
  EXPECT_EQ(rangesWith({scanner}), rangesWith({scanner, camera}));
}

TEST(Trajectory, SwaysWithItsDeviationsAndMemory) {
  const Trajectory path({{0.0, makePose(0, 0, 0)}, {2000.0, makePose(1000, 0, 0)}});
  Sway sway;
  sway.side = 0.1;
  sway.yaw = 0.05;
  sway.memory = 2.0;
  const Trajectory swayed = swaying(path, sway, 1);
  double side = 0.0, yaw = 0.0, together = 0.0;
  int count = 0;
  for (double t = 0; t < 1998; t += 0.5, ++count) {
    const auto yawAt = [&](double time) { return Eigen::AngleAxisd(swayed.at(time).linear()); };
    const Isometry3d pose = swayed.at(t);
    EXPECT_NEAR(pose.translation().x(), 0.5 * t, 1e-6);
    EXPECT_EQ(pose.translation().z(), 0.0);
    side += std::pow(pose.translation().y(), 2);
    yaw += std::pow(yawAt(t).angle(), 2);
    together += pose.translation().y() * swayed.at(t + 2.0).translation().y();
  }
  EXPECT_NEAR(std::sqrt(side / count), 0.1, 0.015);
  EXPECT_NEAR(std::sqrt(yaw / count), 0.05, 0.008);
  EXPECT_NEAR(together / side, std::exp(-1.0), 0.12);
}

}  // namespace
}  // namespace mapping_simulation
