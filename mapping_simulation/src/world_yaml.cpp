// SPDX-License-Identifier: BSD-3-Clause
#include <mapping_simulation/world.h>
#include <mapping_simulation/yaml_map.h>

#include <algorithm>
#include <cmath>
#include <map>
#include <random>

#include "trajectory_yaml.h"

namespace mapping_simulation {
namespace {

const std::map<std::string, Shape::Type> kShapes{{"ground", Shape::Type::kGround},
                                                 {"rectangle", Shape::Type::kRectangle},
                                                 {"box", Shape::Type::kBox},
                                                 {"cylinder", Shape::Type::kCylinder}};
const std::map<std::string, Texture::Type> kTextures{
    {"constant", Texture::Type::kConstant}, {"checkerboard", Texture::Type::kCheckerboard},
    {"stripes", Texture::Type::kStripes},   {"noise", Texture::Type::kNoise},
    {"bricks", Texture::Type::kBricks},     {"facade", Texture::Type::kFacade}};
constexpr Limits kSizes{1e-4, 1e5, "m"};
constexpr Limits kStrength{0.0, 1e6};
const char kHouses[] = "houses";
constexpr int kMaxDepth = 8;  // of models within models
constexpr std::size_t kMaxShapes = 1000000;

template <typename Values>
std::vector<std::string> keysOf(const Values& values) {
  std::vector<std::string> keys;
  for (const auto& entry : values) keys.push_back(entry.first);
  return keys;
}

Color toColor(const std::vector<double>& rgb) {
  return Eigen::Array3d(rgb.data()).cast<float>();
}

// Offsets of the copies of an object, in the frame that it is placed in.
std::vector<Eigen::Vector3d> readRepeat(const YamlMap& map) {
  std::vector<Eigen::Vector3d> offsets{Eigen::Vector3d::Zero()};
  if (!map.has("repeat")) return offsets;
  const bool several = map.node("repeat").IsSequence();
  const std::vector<YAML::Node> repeats = several ? map.sequence("repeat") : std::vector{map.node("repeat")};
  for (const YAML::Node& node : repeats) {
    const YamlMap repeat(node, map.file(), "repeat");
    const int count = repeat.integer("count", {1, 10000});
    const Eigen::Vector3d step = repeat.vector3("step", kMetres);
    repeat.finish();
    if (offsets.size() * count > kMaxShapes) map.fail(node, "repeat makes more than a million copies");
    std::vector<Eigen::Vector3d> all;
    for (const Eigen::Vector3d& offset : offsets) {
      for (int i = 0; i < count; ++i) all.push_back(offset + i * step);
    }
    offsets = std::move(all);
  }
  return offsets;
}

class LightReader {
 public:
  explicit LightReader(const YamlMap& map) : map_(map) {}

  Light read() const {
    Light light;
    light.ambient = map_.number("ambient", kStrength, light.ambient);
    if (map_.has("sun")) {
      const YamlMap sun = map_.map("sun");
      light.sun = colorOf(sun);
      const double azimuth = sun.number("azimuth_deg", kDegrees) * M_PI / 180.0,
                   elevation = sun.number("elevation_deg", {0.0, 90.0, "deg"}) * M_PI / 180.0;
      light.to_sun << std::cos(elevation) * std::cos(azimuth), std::cos(elevation) * std::sin(azimuth),
          std::sin(elevation);
      sun.finish();
    }
    if (map_.has("lamps")) {
      for (const YAML::Node& node : map_.sequence("lamps")) {
        const YamlMap lamp(node, map_.file(), "lamp");
        for (const Eigen::Vector3d& offset : readRepeat(lamp))
          light.lamps.push_back({lamp.vector3("position", kMetres) + offset, colorOf(lamp)});
        lamp.finish();
      }
    }
    if (map_.has("changes")) {
      for (const YAML::Node& node : map_.sequence("changes")) {
        const std::vector<double> v = map_.numbers(node, "a change [time, factor]", {0.0, 1e9}, 2, 2);
        if (!light.changes.empty() && !(v[0] > light.changes.back().first))
          map_.fail(node, "the time of a change must be after the one before");
        light.changes.emplace_back(v[0], v[1]);
      }
    }
    map_.finish();
    return light;
  }

 private:
  // `strength` times `color`, which is white by default.
  static Color colorOf(const YamlMap& map) {
    const Color color = map.has("color") ? toColor(map.numbers("color", kRatio, 3, 3)) : Color::Ones();
    return static_cast<float>(map.number("strength", kStrength)) * color;
  }

  const YamlMap& map_;
};

class WorldReader {
 public:
  WorldReader(const std::string& file, std::uint32_t seed) : file_(YamlMap::load(file)), seed_(seed) {}

  World read() {
    file_.ignore("trajectory");
    const Light light = file_.has("light") ? LightReader(file_.map("light")).read() : Light();
    if (file_.has("textures")) {
      for (const auto& entry : file_.map("textures").node()) {
        const std::string name = entry.first.Scalar();
        textures_[name] = readTexture(YamlMap(entry.second, file_.file(), "texture '" + name + "'"));
      }
    }
    if (file_.has("models")) {
      for (const auto& entry : file_.map("models").node()) {
        const std::string name = entry.first.Scalar();
        if (kShapes.count(name)) file_.fail(entry.first, "model '" + name + "' has the name of a shape");
        if (!entry.second.IsSequence())
          file_.fail(entry.second, "model '" + name + "' must be a list of objects");
        models_[name] = entry.second;
      }
    }
    for (const YAML::Node& object : file_.sequence("objects")) {
      readObject(object, Eigen::Isometry3d::Identity(), "", -1, 0);
    }
    file_.finish();
    return World(std::move(shapes_), std::move(motions_), light);
  }

 private:
  Texture readTexture(const YamlMap& map) const {
    Texture texture;
    texture.type = kTextures.at(map.choice("type", keysOf(kTextures)));
    const bool constant = texture.type == Texture::Type::kConstant,
               noise = texture.type == Texture::Type::kNoise, bricks = texture.type == Texture::Type::kBricks,
               facade = texture.type == Texture::Type::kFacade;
    if (!facade) {
      texture.values = map.numbers("values", kRatio,
                                   constant ? 1
                                   : bricks ? 3
                                            : 2,
                                   constant ? 1
                                   : noise  ? 2
                                   : bricks ? 3
                                            : 1000);
      if (map.has("colors")) {
        for (const YAML::Node& node : map.sequence("colors"))
          texture.colors.push_back(toColor(map.numbers(node, "a color [red, green, blue]", kRatio, 3, 3)));
        if (texture.colors.size() != texture.values.size())
          map.fail(map.node("colors"), "colors must be as many as values");
      }
    }
    if (!constant) texture.size = map.number("size", kSizes);
    if (bricks) texture.height = map.number("height", kSizes);
    texture.detail = map.number("detail", kRatio, texture.detail);
    if (texture.type == Texture::Type::kStripes)
      texture.angle = map.number("angle_deg", kDegrees, 0.0) * M_PI / 180.0;
    if (noise || bricks || facade)
      texture.seed = static_cast<std::uint32_t>(map.integer("seed", {0, 1e9}, 0));
    map.finish();
    return texture;
  }

  Texture readReflectivity(const YamlMap& map) const {
    const YAML::Node node = map.node("reflectivity");
    if (node.IsMap()) return readTexture(map.map("reflectivity"));
    if (node.IsScalar()) {
      const auto named = textures_.find(node.Scalar());
      if (named != textures_.end()) return named->second;
      double number;
      if (!YAML::convert<double>::decode(node, number)) map.choice("reflectivity", keysOf(textures_));
    }
    Texture texture;
    texture.values = {map.number("reflectivity", kRatio)};
    return texture;
  }

  void readObject(const YAML::Node& node, const Eigen::Isometry3d& parent, const std::string& parent_name,
                  int motion, int depth) {
    const YamlMap map(node, file_.file(), "object");
    std::vector<std::string> types = keysOf(kShapes);
    types.push_back(kHouses);
    for (const std::string& model : keysOf(models_)) types.push_back(model);
    const std::string type = map.choice("type", types);
    const std::string name = parent_name + map.text("name", type);
    if (depth > kMaxDepth)
      map.fail(node, "model '" + type + "' contains itself, or models are nested too deeply");
    if (depth == 0 && map.has("motion")) {
      motion = static_cast<int>(motions_.size());
      motions_.push_back(readTrajectory(map.map("motion")));
    }
    const Eigen::Isometry3d pose = map.pose();
    const std::vector<Eigen::Vector3d> offsets = readRepeat(map);
    const auto model = models_.find(type);
    std::vector<Shape> shapes;  // poses are in the frame of the object
    if (type == kHouses)
      shapes = readHouses(map);
    else if (model == models_.end())
      shapes = {readShape(map, kShapes.at(type))};
    map.finish();

    for (const Eigen::Vector3d& offset : offsets) {
      const Eigen::Isometry3d placed = parent * Eigen::Translation3d(offset) * pose;
      if (model != models_.end()) {
        for (const YAML::Node& part : model->second) readObject(part, placed, name + "/", motion, depth + 1);
      }
      for (Shape shape : shapes) {
        if (shapes_.size() >= kMaxShapes) map.fail(node, "the world has more than a million shapes");
        shape.name = name;
        shape.pose = placed * shape.pose;
        shape.motion = motion;
        shapes_.push_back(shape);
        shapes_.back().texture.seed += seed_ + static_cast<std::uint32_t>(shapes_.size() - 1);
      }
    }
  }

  // A row of boxes with facades, their fronts in the plane y = 0, from x = 0 on.
  std::vector<Shape> readHouses(const YamlMap& map) const {
    const double length = map.number("length", kSizes), depth = map.number("depth", kSizes, 6.0);
    const std::vector<double> widths = map.numbers("width", kSizes, 2, 2),
                              heights = map.numbers("height", kSizes, 2, 2);
    if (!(widths[1] >= 2.0 * widths[0]))
      map.fail(map.node("width"), "width must be [least, most], most twice least");
    Shape house;
    house.texture.type = Texture::Type::kFacade;
    house.texture.size = map.number("storey", kSizes, 3.0);
    house.texture.seed = static_cast<std::uint32_t>(map.integer("seed", {0, 1e9}, 0));
    std::vector<Shape> houses;
    std::mt19937 random(house.texture.seed + seed_);
    const auto between = [&random](const std::vector<double>& range) {
      return range[0] + (range[1] - range[0]) * (random() / 4294967296.0);
    };
    for (double x = 0.0; x < length - 1e-9;) {
      double width = between(widths);
      if (length - x - width < widths[0]) width = length - x;  // the last one
      house.texture.span = width;
      house.size = {width, depth, between(heights)};
      house.pose = Eigen::Translation3d(x + 0.5 * width, 0.5 * depth, 0.0);
      houses.push_back(house);
      x += width;
    }
    return houses;
  }

  Shape readShape(const YamlMap& map, Shape::Type type) const {
    Shape shape;
    shape.type = type;
    shape.texture = readReflectivity(map);
    if (type == Shape::Type::kRectangle) {
      const std::vector<double> size = map.numbers("size", kSizes, 2, 2);
      shape.size = {size[0], 0.0, size[1]};
    } else if (type == Shape::Type::kBox) {
      shape.size = map.vector3("size", kSizes);
    } else if (type == Shape::Type::kCylinder) {
      const double diameter = 2.0 * map.number("radius", kSizes);
      shape.size = {diameter, diameter, map.number("height", kSizes)};
    }
    shape.texture.span = std::max(1e-3, shape.size.x());
    return shape;
  }

  YamlMap file_;
  std::uint32_t seed_;
  std::map<std::string, Texture> textures_;
  std::map<std::string, YAML::Node> models_;
  std::vector<Shape> shapes_;
  std::vector<Trajectory> motions_;
};

}  // namespace

World loadWorld(const std::string& file, std::uint32_t seed) {
  return WorldReader(file, seed).read();
}

}  // namespace mapping_simulation
