// SPDX-License-Identifier: BSD-3-Clause
#include <mapping_simulation/world.h>

#include <algorithm>
#include <cmath>
#include <stdexcept>

#include "bvh.h"
#include "shape_geometry.h"

namespace mapping_simulation {
namespace {

// The shapes that share a motion; those that don't move are a body, too.
struct Body {
  int motion = -1;
  std::vector<int> shapes;
  std::vector<int> unbounded;
  Bvh bvh;  // over `shapes`
};

Eigen::AlignedBox3d boundsOf(const Shape& shape) {
  const Eigen::Vector3d half(0.5 * shape.size.x(), 0.5 * shape.size.y(), 0.0);
  const Eigen::AlignedBox3d local(-half, half + Eigen::Vector3d(0.0, 0.0, shape.size.z()));
  Eigen::AlignedBox3d bounds;
  for (int i = 0; i < 8; ++i)
    bounds.extend(shape.pose * local.corner(static_cast<Eigen::AlignedBox3d::CornerType>(i)));
  const Eigen::Vector3d margin = Eigen::Vector3d::Constant(1e-6);  // a rectangle has no depth
  return Eigen::AlignedBox3d(bounds.min() - margin, bounds.max() + margin);
}

void check(const Shape& shape, std::size_t motions) {
  const auto fail = [&](const char* what) {
    throw std::invalid_argument("shape '" + shape.name + "': " + what);
  };
  const bool flat = shape.type == Shape::Type::kRectangle;
  if (shape.type != Shape::Type::kGround && !(shape.size.allFinite() && shape.size.x() > 0.0 &&
                                              (flat || shape.size.y() > 0.0) && shape.size.z() > 0.0)) {
    fail("sizes must be positive");
  }
  const Texture& texture = shape.texture;
  const std::size_t least = texture.type == Texture::Type::kNoise    ? 2
                            : texture.type == Texture::Type::kBricks ? 3
                                                                     : 1;
  if (texture.values.size() < least) fail("too few reflectivity values");
  if (!texture.colors.empty() && texture.colors.size() != texture.values.size())
    fail("as many colors as values are needed");
  if (!(texture.height > 0.0 && texture.span > 0.0 && texture.detail >= 0.0))
    fail("height, span and detail of a texture must be positive");
  for (double value : texture.values) {
    if (!(value >= 0.0 && value <= 1.0)) fail("reflectivity must be in [0, 1]");
  }
  if (!(texture.size > 0.0)) fail("texture size must be positive");
  if (shape.motion < -1 || shape.motion >= static_cast<int>(motions)) fail("there is no such motion");
}

float brightnessAt(const Light& light, double time) {
  const auto& changes = light.changes;
  if (changes.empty()) return 1.0f;
  const auto next = std::upper_bound(changes.begin(), changes.end(), time,
                                     [](double t, const auto& change) { return t < change.first; });
  if (next == changes.begin()) return static_cast<float>(changes.front().second);
  if (next == changes.end()) return static_cast<float>(changes.back().second);
  const auto before = std::prev(next);
  const double share = (time - before->first) / (next->first - before->first);
  return static_cast<float>((1.0 - share) * before->second + share * next->second);
}

}  // namespace

struct World::Data {
  std::vector<Shape> shapes;
  std::vector<Trajectory> motions;
  std::vector<Eigen::Isometry3d> to_shape;  // frame of the body -> frame of the shape
  std::vector<Body> bodies;
  Light light;
};

World::World(std::vector<Shape> shapes, std::vector<Trajectory> motions, Light light) {
  auto data = std::make_shared<Data>();
  data->bodies.resize(motions.size() + 1);
  std::vector<std::vector<Eigen::AlignedBox3d>> bounds(data->bodies.size());
  for (std::size_t i = 0; i < shapes.size(); ++i) {
    check(shapes[i], motions.size());
    if (shapes[i].type == Shape::Type::kRectangle) shapes[i].size.y() = 0.0;
    data->to_shape.push_back(shapes[i].pose.inverse());
    Body& body = data->bodies[shapes[i].motion + 1];
    if (shapes[i].type == Shape::Type::kGround) {
      body.unbounded.push_back(static_cast<int>(i));
    } else {
      body.shapes.push_back(static_cast<int>(i));
      bounds[shapes[i].motion + 1].push_back(boundsOf(shapes[i]));
    }
  }
  for (std::size_t b = 0; b < data->bodies.size(); ++b) {
    data->bodies[b].motion = static_cast<int>(b) - 1;
    data->bodies[b].bvh = Bvh(bounds[b]);
  }
  data->shapes = std::move(shapes);
  data->motions = std::move(motions);
  data->light = std::move(light);
  data_ = std::move(data);
}

const std::vector<Shape>& World::shapes() const {
  return data_->shapes;
}

const Light& World::light() const {
  return data_->light;
}

Eigen::Isometry3d World::shapePose(int shape, double time) const {
  const Shape& s = data_->shapes.at(shape);
  return s.motion < 0 ? s.pose : data_->motions[s.motion].at(time) * s.pose;
}

Scene World::at(double time) const {
  return Scene(*this, time);
}

Hit World::cast(const Ray& ray, double time, double max_range) const {
  return at(time).cast(ray, max_range);
}

Scene::Scene(const World& world, double time)
    : data_(world.data_), brightness_(brightnessAt(data_->light, time)) {
  to_body_.reserve(data_->motions.size());
  for (const Trajectory& motion : data_->motions) to_body_.push_back(motion.at(time).inverse());
}

Scene::Nearest Scene::nearest(const Ray& ray, double max_range) const {
  Nearest nearest;
  nearest.range = max_range;
  for (const Body& body : data_->bodies) {
    const bool moves = body.motion >= 0;
    const Eigen::Vector3d o = moves ? to_body_[body.motion] * ray.origin : ray.origin;
    const Eigen::Vector3d d =
        moves ? Eigen::Vector3d(to_body_[body.motion].linear() * ray.direction) : ray.direction;
    const auto test = [&](int index) {
      const Eigen::Isometry3d& to_shape = data_->to_shape[index];
      const Eigen::Vector3d shape_o = to_shape * o, shape_d = to_shape.linear() * d;
      const double distance = intersect(data_->shapes[index], shape_o, shape_d);
      if (distance < nearest.range) nearest = {index, distance, shape_o, shape_d};
    };
    for (int index : body.unbounded) test(index);
    body.bvh.traverse(o, d, nearest.range, [&](int item, double&) { test(body.shapes[item]); });
  }
  return nearest;
}

Hit Scene::cast(const Ray& ray, double max_range) const {
  const Nearest n = nearest(ray, max_range);
  Hit hit;
  if (n.shape < 0) return hit;
  const Shape& shape = data_->shapes[n.shape];
  const FacePoint surface = surfaceAt(shape, n.origin + n.range * n.direction);
  hit.range = n.range;
  hit.reflectivity = shape.texture.at(surface.uv);
  hit.incidence = std::acos(std::min(std::abs(surface.normal.dot(n.direction)), 1.0));
  hit.shape = n.shape;
  return hit;
}

const Shape& Scene::shape(int index) const {
  return data_->shapes[index];
}

SurfacePoint Scene::look(const Ray& ray) const {
  const Nearest n = nearest(ray, std::numeric_limits<double>::infinity());
  if (n.shape < 0) return {};
  const Shape& shape = data_->shapes[n.shape];
  const FacePoint surface = surfaceAt(shape, n.origin + n.range * n.direction);
  Eigen::Vector3d normal = data_->to_shape[n.shape].linear().transpose() * surface.normal;
  if (shape.motion >= 0) normal = to_body_[shape.motion].linear().transpose() * normal;
  if (normal.dot(ray.direction) > 0.0) normal = -normal;
  return {n.range, n.shape, surface.face, surface.uv, ray.origin + n.range * ray.direction, normal};
}

bool Scene::blocked(const Ray& ray, double range) const {
  return nearest(ray, range).shape >= 0;
}

Color Scene::lightAt(const Eigen::Vector3d& position, const Eigen::Vector3d& normal) const {
  constexpr double kClear = 1e-4;  // m, off the surface itself
  const Light& light = data_->light;
  // Between 0.7 and 1 of the ambient light, so that the faces of a box can be told apart.
  const double sky = 0.85 + 0.15 * normal.dot(Eigen::Vector3d(0.36, 0.48, 0.8));
  Color sum = Color::Constant(static_cast<float>(light.ambient * sky));
  const auto add = [&](const Color& color, const Eigen::Vector3d& to, double distance) {
    const double cosine = normal.dot(to);
    if (cosine > 0.0 && cosine * color.maxCoeff() > 1e-3f &&
        !blocked({position + kClear * normal, to}, distance))
      sum += static_cast<float>(cosine) * color;
  };
  if (light.sun.maxCoeff() > 0.0f) add(light.sun, light.to_sun, std::numeric_limits<double>::infinity());
  for (const Light::Lamp& lamp : light.lamps) {
    const Eigen::Vector3d to = lamp.position - position;
    const double distance = std::max(to.norm(), 0.01);
    add(lamp.color / static_cast<float>(distance * distance), to / distance, distance);
  }
  return brightness_ * sum;
}

Color Scene::sky(const Eigen::Vector3d& direction) const {
  const float height = static_cast<float>(std::clamp(2.0 * direction.z(), 0.0, 1.0));
  const Color horizon(0.98f, 1.02f, 1.05f), zenith(0.6f, 0.78f, 1.0f);
  return brightness_ * static_cast<float>(data_->light.ambient) *
         ((1.0f - height) * horizon + height * zenith);
}

}  // namespace mapping_simulation
