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
  if (texture.values.size() < (texture.type == Texture::Type::kNoise ? 2u : 1u))
    fail("too few reflectivity values");
  for (double value : texture.values) {
    if (!(value >= 0.0 && value <= 1.0)) fail("reflectivity must be in [0, 1]");
  }
  if (!(texture.size > 0.0)) fail("texture size must be positive");
  if (shape.motion < -1 || shape.motion >= static_cast<int>(motions)) fail("there is no such motion");
}

}  // namespace

struct World::Data {
  std::vector<Shape> shapes;
  std::vector<Trajectory> motions;
  std::vector<Eigen::Isometry3d> to_shape;  // frame of the body -> frame of the shape
  std::vector<Body> bodies;
};

World::World(std::vector<Shape> shapes, std::vector<Trajectory> motions) {
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
  data_ = std::move(data);
}

const std::vector<Shape>& World::shapes() const {
  return data_->shapes;
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

Scene::Scene(const World& world, double time) : data_(world.data_) {
  to_body_.reserve(data_->motions.size());
  for (const Trajectory& motion : data_->motions) to_body_.push_back(motion.at(time).inverse());
}

Hit Scene::cast(const Ray& ray, double max_range) const {
  double range = max_range;
  int nearest = -1;
  Eigen::Vector3d origin, direction;  // in the frame of the nearest shape
  for (const Body& body : data_->bodies) {
    const bool moves = body.motion >= 0;
    const Eigen::Vector3d o = moves ? to_body_[body.motion] * ray.origin : ray.origin;
    const Eigen::Vector3d d =
        moves ? Eigen::Vector3d(to_body_[body.motion].linear() * ray.direction) : ray.direction;
    const auto test = [&](int index) {
      const Eigen::Isometry3d& to_shape = data_->to_shape[index];
      const Eigen::Vector3d shape_o = to_shape * o, shape_d = to_shape.linear() * d;
      const double distance = intersect(data_->shapes[index], shape_o, shape_d);
      if (!(distance < range)) return;
      range = distance;
      nearest = index;
      origin = shape_o;
      direction = shape_d;
    };
    for (int index : body.unbounded) test(index);
    body.bvh.traverse(o, d, range, [&](int item, double&) { test(body.shapes[item]); });
  }
  Hit hit;
  if (nearest < 0) return hit;
  const Shape& shape = data_->shapes[nearest];
  const SurfacePoint surface = surfaceAt(shape, origin + range * direction);
  hit.range = range;
  hit.reflectivity = shape.texture.at(surface.uv);
  hit.incidence = std::acos(std::min(std::abs(surface.normal.dot(direction)), 1.0));
  hit.shape = nearest;
  return hit;
}

}  // namespace mapping_simulation
