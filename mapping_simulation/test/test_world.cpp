// SPDX-License-Identifier: BSD-3-Clause
#include <gtest/gtest.h>
#include <mapping_simulation/testing/worlds.h>
#include <mapping_simulation/world.h>

#include <cmath>
#include <filesystem>
#include <random>
#include <set>

namespace mapping_simulation {
namespace {

using Type = Shape::Type;
using Eigen::Isometry3d;
using Eigen::Vector3d;

class Random {
 public:
  double uniform(double min, double max) { return std::uniform_real_distribution<double>(min, max)(random_); }
  Vector3d vector(double size) { return {uniform(-size, size), uniform(-size, size), uniform(-size, size)}; }
  Isometry3d pose(double size) {
    return Eigen::Translation3d(vector(size)) *
           Isometry3d(Eigen::AngleAxisd(uniform(0, 3), vector(1).normalized()));
  }

 private:
  std::mt19937 random_{1};
};

// A bounded shape with random size and pose.
Shape randomShape(Random& random, Type type, double extent) {
  Vector3d size(random.uniform(0.3, 2), random.uniform(0.3, 2), random.uniform(0.3, 3));
  if (type == Type::kCylinder) size.y() = size.x();
  return makeShape(type, size, random.pose(extent));
}

bool inside(const Shape& shape, const Vector3d& map_point) {
  const Vector3d p = shape.pose.inverse() * map_point;
  if (p.z() < 0 || p.z() > shape.size.z()) return false;
  if (shape.type == Type::kCylinder) return p.head<2>().norm() <= shape.size.x() / 2;
  return std::abs(p.x()) <= shape.size.x() / 2 && std::abs(p.y()) <= shape.size.y() / 2;
}

// Walks along the ray until it enters or leaves the shape.
double march(const Shape& shape, const Ray& ray, double max_range) {
  constexpr double kStep = 1e-3;
  const bool start = inside(shape, ray.origin);
  for (double t = kStep; t < max_range; t += kStep) {
    if (inside(shape, ray.origin + t * ray.direction) != start) return t - kStep / 2;
  }
  return INFINITY;
}

TEST(World, GroundInClosedForm) {
  const World world({makeShape(Type::kGround, Vector3d::Ones())});
  const Vector3d direction = Vector3d(3, 0, -4).normalized();
  const Hit hit = world.cast({{0, 0, 2}, direction}, 0.0);
  EXPECT_NEAR(hit.range, 2.5, 1e-12);
  EXPECT_NEAR(hit.incidence, std::acos(0.8), 1e-12);
  EXPECT_EQ(hit.shape, 0);
  EXPECT_FALSE(world.cast({{0, 0, 2}, Vector3d::UnitX()}, 0.0));
  EXPECT_FALSE(world.cast({{0, 0, 2}, Vector3d::UnitZ()}, 0.0));
  EXPECT_EQ(world.cast({{0, 0, 2}, Vector3d::UnitZ()}, 0.0).range, INFINITY);
}

TEST(World, RectangleHasEdgesAndTwoSides) {
  const World world({makeShape(Type::kRectangle, {4, 0, 2}, makePose(5, 0, 0, M_PI / 2))});
  for (double side : {0.0, 10.0}) {
    const Vector3d ahead(side > 0 ? -1 : 1, 0, 0);
    EXPECT_NEAR(world.cast({{side, 0, 1}, ahead}, 0.0).range, 5.0, 1e-12);
    EXPECT_TRUE(world.cast({{side, 1.999, 1.999}, ahead}, 0.0));
    EXPECT_TRUE(world.cast({{side, -1.999, 0.001}, ahead}, 0.0));
    EXPECT_FALSE(world.cast({{side, 2.001, 1}, ahead}, 0.0));
    EXPECT_FALSE(world.cast({{side, 0, 2.001}, ahead}, 0.0));
    EXPECT_FALSE(world.cast({{side, 0, -0.001}, ahead}, 0.0));
    EXPECT_FALSE(world.cast({{side, 0, 1}, -ahead}, 0.0));
  }
  EXPECT_TRUE(world.cast({{0, 0, 1}, Vector3d::UnitX()}, 0.0, 5.001));
  EXPECT_FALSE(world.cast({{0, 0, 1}, Vector3d::UnitX()}, 0.0, 4.999));
}

TEST(World, BoxAndCylinderAgreeWithMarching) {
  Random random;
  int hits = 0;
  for (int i = 0; i < 300; ++i) {
    const Shape shape = randomShape(random, i % 2 ? Type::kBox : Type::kCylinder, 1.0);
    const World world({shape});
    const Vector3d origin = random.vector(3.0);
    const Vector3d target = shape.pose * Vector3d(0, 0, shape.size.z() / 2) + random.vector(0.7);
    const Ray ray{origin, (target - origin).normalized()};
    const double expected = march(shape, ray, 10.0), range = world.cast(ray, 0.0).range;
    if (std::isinf(expected)) {
      // A corner that is cut off in less than a step may be missed by marching, but not by the ray.
      EXPECT_FALSE(inside(shape, ray.origin));
      if (std::isfinite(range)) {
        EXPECT_FALSE(inside(shape, ray.origin + (range + 1e-3) * ray.direction));
      }
    } else {
      EXPECT_NEAR(range, expected, 6e-4);
      ++hits;
    }
  }
  EXPECT_GT(hits, 80);
}

TEST(World, IncidenceOnCylinderAndBox) {
  const World world(
      {makeShape(Type::kCylinder, {2, 2, 2}), makeShape(Type::kBox, {2, 2, 2}, makePose(0, 10, 0))});
  // A chord at distance b from the axis meets the side at asin(b / radius).
  const Hit side = world.cast({{-5, 0.5, 1}, Vector3d::UnitX()}, 0.0);
  EXPECT_NEAR(side.range, 5 - std::sqrt(0.75), 1e-12);
  EXPECT_NEAR(side.incidence, M_PI / 6, 1e-12);
  EXPECT_NEAR(world.cast({{0.3, 0.2, 5}, -Vector3d::UnitZ()}, 0.0).range, 3.0, 1e-12);
  EXPECT_NEAR(world.cast({{0.3, 0.2, 5}, -Vector3d::UnitZ()}, 0.0).incidence, 0.0, 1e-7);
  const Hit face = world.cast({{-3, 8, 1}, Vector3d(1, 1, 0).normalized()}, 0.0);
  EXPECT_NEAR(face.range, 2 * std::sqrt(2.0), 1e-12);
  EXPECT_NEAR(face.incidence, M_PI / 4, 1e-12);
  EXPECT_EQ(face.shape, 1);
}

TEST(World, BoxIsARoomFromInside) {
  const World world({makeShape(Type::kBox, {8, 6, 3})});
  EXPECT_NEAR(world.cast({{1, 0, 1}, Vector3d::UnitX()}, 0.0).range, 3.0, 1e-12);
  EXPECT_NEAR(world.cast({{1, 0, 1}, -Vector3d::UnitY()}, 0.0).range, 3.0, 1e-12);
  EXPECT_NEAR(world.cast({{1, 0, 1}, Vector3d::UnitZ()}, 0.0).range, 2.0, 1e-12);
}

TEST(World, NearestOfManyShapesAgreesWithBruteForce) {
  Random random;
  std::vector<Shape> shapes{makeShape(Type::kGround, Vector3d::Ones(), makePose(0, 0, -12))};
  const Type types[] = {Type::kRectangle, Type::kBox, Type::kCylinder};
  const std::vector<Trajectory> motions{Trajectory({{0, random.pose(1)}, {1, random.pose(1)}})};
  for (int i = 0; i < 200; ++i) {
    shapes.push_back(randomShape(random, types[i % 3], 10.0));
    if (i % 4 == 0) shapes.back().motion = 0;
  }
  const World world(shapes, motions);
  std::vector<World> singles;
  for (const Shape& shape : shapes) singles.emplace_back(std::vector<Shape>{shape}, motions);
  std::set<int> seen;
  for (int i = 0; i < 1000; ++i) {
    Ray ray{random.vector(12.0), random.vector(1.0).normalized()};
    if (i % 10 == 0) ray.direction = Vector3d::Unit(i / 10 % 3);  // zeros in the direction
    const double time = random.uniform(0, 1);
    Hit expected;
    for (std::size_t s = 0; s < shapes.size(); ++s) {
      const Hit hit = singles[s].cast(ray, time);
      if (hit.range >= expected.range) continue;
      expected = hit;
      expected.shape = static_cast<int>(s);
    }
    const Hit hit = world.cast(ray, time);
    EXPECT_EQ(hit.shape, expected.shape);
    EXPECT_EQ(hit.range, expected.range);
    seen.insert(hit.shape);
  }
  EXPECT_GT(seen.size(), 100u);
}

TEST(World, MovingShapeIsWhereItIsAtTheTime) {
  Shape shape = makeShape(Type::kBox, {2, 1, 1}, makePose(0, 0, -0.5));
  shape.motion = 0;
  const World world({shape}, {Trajectory({{0, makePose(10, 0, 0)}, {4, makePose(18, 0, 0, M_PI)}})});
  const Ray ray{Vector3d::Zero(), Vector3d::UnitX()};
  EXPECT_NEAR(world.cast(ray, 0.0).range, 9.0, 1e-12);
  EXPECT_NEAR(world.cast(ray, 2.0).range, 13.5, 1e-12);  // half way it has turned by 90 degrees
  EXPECT_NEAR(world.cast(ray, 4.0).range, 17.0, 1e-12);
  EXPECT_TRUE(world.shapePose(0, 2.0).isApprox(makePose(14, 0, -0.5, M_PI / 2), 1e-12));
}

TEST(World, TextureStaysOnTheSurface) {
  Random random;
  for (Type type : {Type::kGround, Type::kRectangle, Type::kBox, Type::kCylinder}) {
    Shape shape = makeShape(type, {2, 2, 2});
    shape.texture.type = Texture::Type::kNoise;
    shape.texture.values = {0.0, 1.0};
    shape.texture.size = 0.3;
    Shape moved = shape;
    moved.pose = random.pose(5.0);
    const World before({shape}), after({moved});
    std::set<double> values;
    for (int i = 0; i < 50; ++i) {
      Vector3d origin = random.vector(1.0) + Vector3d(0, -4, 1);
      const Vector3d direction = (random.vector(0.5) + Vector3d(0, 0, 0.6) - origin).normalized();
      const Hit a = before.cast({origin, direction}, 0.0);
      const Hit b = after.cast({moved.pose * origin, moved.pose.linear() * direction}, 0.0);
      EXPECT_NEAR(a.reflectivity, b.reflectivity, 1e-9);
      if (a) values.insert(a.reflectivity);
    }
    EXPECT_GT(values.size(), 10u);
  }
}

TEST(World, RefusesWhatMakesNoSense) {
  const auto with = [](auto change) {
    Shape shape = makeShape(Type::kBox, {1, 1, 1});
    shape.name = "thing";
    change(shape);
    return [shape] { World({shape}); };
  };
  expectError(with([](Shape& s) { s.size.z() = 0.0; }), "shape 'thing': sizes must be positive");
  expectError(with([](Shape& s) { s.texture.values = {1.5}; }), "reflectivity must be in [0, 1]");
  expectError(with([](Shape& s) { s.texture.values = {}; }), "too few");
  expectError(with([](Shape& s) { s.texture.size = 0.0; }), "texture size");
  expectError(with([](Shape& s) { s.motion = 0; }), "no such motion");
}

TEST(Texture, CheckerboardAndStripes) {
  Texture texture;
  texture.type = Texture::Type::kCheckerboard;
  texture.values = {0.2, 0.8};
  texture.size = 0.5;
  EXPECT_EQ(texture.at({0.1, 0.1}), 0.2);
  EXPECT_EQ(texture.at({0.6, 0.1}), 0.8);
  EXPECT_EQ(texture.at({0.6, 0.6}), 0.2);
  EXPECT_EQ(texture.at({-0.1, 0.1}), 0.8);
  texture.type = Texture::Type::kStripes;
  texture.values = {0.1, 0.2, 0.3};
  EXPECT_EQ(texture.at({0.1, 9.0}), 0.1);
  EXPECT_EQ(texture.at({1.2, 9.0}), 0.3);
  EXPECT_EQ(texture.at({1.6, 9.0}), 0.1);
  EXPECT_EQ(texture.at({-0.1, 9.0}), 0.3);
  texture.angle = M_PI / 2;
  EXPECT_EQ(texture.at({9.0, 0.7}), 0.2);
}

TEST(Texture, NoiseIsSmoothSeededAndFillsItsRange) {
  Texture texture;
  texture.type = Texture::Type::kNoise;
  texture.values = {0.3, 0.7};
  Texture other = texture;
  other.seed = 1;
  double min = 1, max = 0, sum = 0, difference = 0;
  const int n = 20000;
  for (int i = 0; i < n; ++i) {
    const Eigen::Vector2d uv(0.37 * (i % 200) - 30, 0.41 * (i / 200) - 20);
    const double value = texture.at(uv);
    min = std::min(min, value);
    max = std::max(max, value);
    sum += value;
    difference += std::abs(value - other.at(uv));
    EXPECT_LT(std::abs(value - texture.at(uv + Eigen::Vector2d(1e-3, 1e-3))), 3e-3 * 0.4 * 1.01);
  }
  EXPECT_GE(min, 0.3);
  EXPECT_LT(min, 0.32);
  EXPECT_LE(max, 0.7);
  EXPECT_GT(max, 0.68);
  EXPECT_NEAR(sum / n, 0.5, 0.01);
  EXPECT_GT(difference / n, 0.05);
}

TEST(LoadWorld, ModelsRepeatsAndMotions) {
  const TempDir dir;
  const std::string file = dir.write("file.yaml", R"(
textures: {tiles: {type: checkerboard, values: [0.1, 0.9], size: 0.5}}
models:
  pair:
    - {type: box, name: left, size: [1, 2, 3], position: [0, 1, 0], reflectivity: tiles}
    - {type: cylinder, radius: 0.5, height: 2, position: [0, -1, 0], reflectivity: 0.3}
objects:
  - {type: ground, reflectivity: {type: noise, values: [0, 1], size: 2, seed: 7}}
  - {type: pair, position: [10, 0, 0], yaw_deg: 90, repeat: [{count: 2, step: [5, 0, 0]}, {count: 3, step: [0, 0, 4]}]}
  - {type: rectangle, size: [2, 1], reflectivity: 0, motion: {poses: [[0, 0, 0, 0], [2, 4, 0, 0]], loop: true}}
)");
  const World world = loadWorld(file);
  ASSERT_EQ(world.shapes().size(), 1u + 2 * 3 * 2 + 1);
  const Shape& box = world.shapes()[1];
  EXPECT_EQ(box.name, "pair/left");
  EXPECT_EQ(box.texture.type, Texture::Type::kCheckerboard);
  EXPECT_TRUE(box.pose.isApprox(makePose(9, 0, 0, M_PI / 2), 1e-12));
  EXPECT_EQ(world.shapes()[2].size, Vector3d(1, 1, 2));
  EXPECT_TRUE(world.shapes()[12].pose.isApprox(makePose(16, 0, 8, M_PI / 2), 1e-12));
  EXPECT_EQ(world.shapes()[0].texture.seed, 7u);
  EXPECT_NEAR(world.shapePose(13, 3.0).translation().x(), 2.0, 1e-12);
}

TEST(LoadWorld, NamesFileLineKeyValueAndRange) {
  const TempDir dir;
  const auto expect = [&](const std::string& yaml, const std::string& message) {
    const std::string file = dir.write("file.yaml", yaml);
    expectError([&] { loadWorld(file); }, file + message);
  };
  const std::string list = "objects:\n  - ";
  expect(list + "{type: ground, reflectivity: 1.5}", ":2: reflectivity is '1.5': must be a number in [0, 1]");
  expect(list + "{type: ground, reflectivity: brick}", ":2: reflectivity is 'brick': must be one of");
  expect(list + "{type: ball}", ":2: type is 'ball': must be one of box, cylinder, ground, rectangle");
  expect(list + "{type: ground}", ":2: key 'reflectivity' is missing");
  expect(list + "{type: box, size: [1, 2], reflectivity: 1}",
         ":2: size is [1, 2]: must be a list of 3 numbers");
  expect(list + "{type: box, size: [1, 2, -3], reflectivity: 1}",
         ":2: size is '-3': must be a number in [0.0001");
  expect(list + "{type: ground, reflectivity: 1, size: [1, 1]}", ":2: unknown key 'size'");
  expect(list + "{type: ground, reflectivity: 1, position: [.nan, 0, 0]}", ":2: position is '.nan'");
  expect(list + "{type: ground, reflectivity: 1, reflectivity: 0}", ":2: key 'reflectivity' appears twice");
  expect(list + "{type: ground, reflectivity: 1, yaw_deg: 1, rpy_deg: [0, 0, 1]}",
         ":2: yaw_deg and rpy_deg exclude each other");
  expect(list + "{type: ground, reflectivity: 1, repeat: {count: 0, step: [1, 0, 0]}}", ":2: count is '0'");
  expect(list + "{type: ground, reflectivity: 1, repeat: {count: 1.5, step: [1, 0, 0]}}",
         ":2: count is '1.5': must be a whole number");
  expect("models: {a: [{type: a}]}\n" + list + "{type: a}", ":1: model 'a' contains itself");
  expect("models:\n  a: [{type: ground, reflectivity: 1, motion: {}}]\n" + list + "{type: a}",
         ":2: unknown key 'motion'");
  expect("textures:\n  t: {type: noise, values: [1]}\n" + list + "{}", ":2: values is [1]");
  expect("shapes: []\n" + list + "{type: ground, reflectivity: 1}", ":1: unknown key 'shapes'");
  expect("objects: []", ":1: objects is []: must be a list");
  expect("- 1", ":1: the file must be a mapping");
}

TEST(ShippedWorlds, AllLoadAndHaveATrajectory) {
  int count = 0;
  for (const auto& entry : std::filesystem::directory_iterator(configFile("worlds"))) {
    SCOPED_TRACE(entry.path());
    const World world = loadWorld(entry.path().string());
    const Trajectory trajectory = loadTrajectory(entry.path().string());
    EXPECT_GE(world.shapes().size(), 6u);
    EXPECT_GT(trajectory.endTime(), 10.0);
    // The robot keeps a distance from everything that doesn't move.
    for (double t = 0; t < trajectory.endTime(); t += 0.5) {
      const Isometry3d pose = trajectory.at(t);
      for (int i = 0; i < 16; ++i) {
        const double yaw = i * M_PI / 8;
        const Ray ray{pose * Vector3d(0, 0, 0.5), {std::cos(yaw), std::sin(yaw), 0}};
        const Hit hit = world.cast(ray, t);
        const bool still = hit && world.shapes()[hit.shape].motion < 0;
        EXPECT_TRUE(!still || hit.range > 0.3) << hit.range << " m at t = " << t;
      }
    }
    ++count;
  }
  EXPECT_GE(count, 5);
}

TEST(ShippedWorlds, RoomHasItsSizeAndPatches) {
  const World world = loadWorld(configFile("worlds/room_8x5.yaml"));
  const auto range = [&](const Vector3d& direction) { return world.cast({{0, 0, 1}, direction}, 0.0).range; };
  EXPECT_NEAR(range(Vector3d::UnitX()) + range(-Vector3d::UnitX()), 8.5, 1e-9);
  EXPECT_NEAR(range(Vector3d::UnitY()) + range(-Vector3d::UnitY()), 5.5, 1e-9);
  EXPECT_NEAR(range(Vector3d::UnitZ()) + range(-Vector3d::UnitZ()), 2.5, 1e-9);
  std::set<double> reflectivities;
  for (double yaw = 0; yaw < 2 * M_PI; yaw += 0.05) {
    const Hit hit = world.cast({{0, 0, 1}, {std::cos(yaw), std::sin(yaw), 0}}, 0.0);
    ASSERT_TRUE(hit);
    reflectivities.insert(hit.reflectivity);
  }
  EXPECT_GT(reflectivities.size(), 8u);
}

TEST(ShippedWorlds, CorridorsDifferInReflectivityAlone) {
  const World plain = loadWorld(configFile("worlds/corridor.yaml"));
  const World textured = loadWorld(configFile("worlds/corridor_textured.yaml"));
  std::set<double> plain_values, textured_values;
  for (double x = 5; x < 75; x += 0.5) {
    const Ray ray{{x, 0.1, 0.3}, Vector3d(0.6, 0.8, 0.0)};
    const Hit a = plain.cast(ray, 0.0), b = textured.cast(ray, 0.0);
    EXPECT_DOUBLE_EQ(a.range, b.range);
    plain_values.insert(a.reflectivity);
    textured_values.insert(b.reflectivity);
  }
  EXPECT_EQ(plain_values.size(), 1u);
  EXPECT_GT(textured_values.size(), 4u);
}

TEST(ShippedWorlds, StreetIsFullAndAlive) {
  const World world = loadWorld(configFile("worlds/street.yaml"));
  EXPECT_GT(world.shapes().size(), 250u);
  std::set<int> motions;
  for (const Shape& shape : world.shapes()) motions.insert(shape.motion);
  EXPECT_GE(motions.size(), 5u);
}

}  // namespace
}  // namespace mapping_simulation

int main(int argc, char** argv) {
  testing::InitGoogleTest(&argc, argv);
  return RUN_ALL_TESTS();
}
