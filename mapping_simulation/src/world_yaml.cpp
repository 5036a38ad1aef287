// SPDX-License-Identifier: BSD-3-Clause
#include <mapping_simulation/world.h>
#include <mapping_simulation/yaml_map.h>

#include <cmath>
#include <map>

#include "trajectory_yaml.h"

namespace mapping_simulation {
namespace {

const std::map<std::string, Shape::Type> kShapes{{"ground", Shape::Type::kGround},
                                                 {"rectangle", Shape::Type::kRectangle},
                                                 {"box", Shape::Type::kBox},
                                                 {"cylinder", Shape::Type::kCylinder}};
const std::map<std::string, Texture::Type> kTextures{{"constant", Texture::Type::kConstant},
                                                     {"checkerboard", Texture::Type::kCheckerboard},
                                                     {"stripes", Texture::Type::kStripes},
                                                     {"noise", Texture::Type::kNoise}};
constexpr Limits kSizes{1e-4, 1e5, "m"};
constexpr int kMaxDepth = 8;  // of models within models
constexpr std::size_t kMaxShapes = 1000000;

template <typename Values>
std::vector<std::string> keysOf(const Values& values) {
  std::vector<std::string> keys;
  for (const auto& entry : values) keys.push_back(entry.first);
  return keys;
}

class WorldReader {
 public:
  explicit WorldReader(const std::string& file) : file_(YamlMap::load(file)) {}

  World read() {
    file_.ignore("trajectory");
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
    return World(std::move(shapes_), std::move(motions_));
  }

 private:
  Texture readTexture(const YamlMap& map) const {
    Texture texture;
    texture.type = kTextures.at(map.choice("type", keysOf(kTextures)));
    const bool constant = texture.type == Texture::Type::kConstant,
               noise = texture.type == Texture::Type::kNoise;
    texture.values = map.numbers("values", kRatio, constant ? 1 : 2, constant ? 1 : noise ? 2 : 1000);
    if (!constant) texture.size = map.number("size", kSizes);
    if (texture.type == Texture::Type::kStripes)
      texture.angle = map.number("angle_deg", kDegrees, 0.0) * M_PI / 180.0;
    if (noise) texture.seed = static_cast<std::uint32_t>(map.integer("seed", {0, 1e9}, 0));
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

  // Offsets of the copies of an object, in the frame that it is placed in.
  std::vector<Eigen::Vector3d> readRepeat(const YamlMap& map) const {
    std::vector<Eigen::Vector3d> offsets{Eigen::Vector3d::Zero()};
    if (!map.has("repeat")) return offsets;
    const bool several = map.node("repeat").IsSequence();
    const std::vector<YAML::Node> repeats =
        several ? map.sequence("repeat") : std::vector{map.node("repeat")};
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

  void readObject(const YAML::Node& node, const Eigen::Isometry3d& parent, const std::string& parent_name,
                  int motion, int depth) {
    const YamlMap map(node, file_.file(), "object");
    std::vector<std::string> types = keysOf(kShapes);
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
    Shape shape;
    if (model == models_.end()) shape = readShape(map, kShapes.at(type));
    map.finish();

    for (const Eigen::Vector3d& offset : offsets) {
      const Eigen::Isometry3d placed = parent * Eigen::Translation3d(offset) * pose;
      if (model != models_.end()) {
        for (const YAML::Node& part : model->second) readObject(part, placed, name + "/", motion, depth + 1);
      } else {
        if (shapes_.size() >= kMaxShapes) map.fail(node, "the world has more than a million shapes");
        shape.name = name;
        shape.pose = placed;
        shape.motion = motion;
        shapes_.push_back(shape);
        shapes_.back().texture.seed += static_cast<std::uint32_t>(shapes_.size() - 1);
      }
    }
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
    return shape;
  }

  YamlMap file_;
  std::map<std::string, Texture> textures_;
  std::map<std::string, YAML::Node> models_;
  std::vector<Shape> shapes_;
  std::vector<Trajectory> motions_;
};

}  // namespace

World loadWorld(const std::string& file) {
  return WorldReader(file).read();
}

}  // namespace mapping_simulation
