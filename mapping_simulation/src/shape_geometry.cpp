// SPDX-License-Identifier: BSD-3-Clause
#include "shape_geometry.h"

#include <algorithm>
#include <cmath>

namespace mapping_simulation {
namespace {

constexpr double kInfinity = std::numeric_limits<double>::infinity();
constexpr double kNearest = 1e-9;  // m, nearer crossings are the surface that the ray starts on

// Part of a ray inside a convex body.
struct Interval {
  double in;
  double out;
};

Interval operator&(const Interval& a, const Interval& b) {
  return {std::max(a.in, b.in), std::min(a.out, b.out)};
}

Interval slab(double origin, double direction, double min, double max) {
  if (direction == 0.0)
    return origin < min || origin > max ? Interval{kInfinity, 0.0} : Interval{-kInfinity, kInfinity};
  const double a = (min - origin) / direction, b = (max - origin) / direction;
  return {std::min(a, b), std::max(a, b)};
}

Interval tube(const Eigen::Vector2d& origin, const Eigen::Vector2d& direction, double radius) {
  const double a = direction.squaredNorm(), c = origin.squaredNorm() - radius * radius;
  if (a == 0.0) return c > 0.0 ? Interval{kInfinity, 0.0} : Interval{-kInfinity, kInfinity};
  const double b = origin.dot(direction), discriminant = b * b - a * c;
  if (discriminant < 0.0) return {kInfinity, 0.0};
  const double root = std::sqrt(discriminant);
  return {(-b - root) / a, (-b + root) / a};
}

double firstCrossing(const Interval& inside) {
  if (inside.in > inside.out) return kInfinity;
  if (inside.in > kNearest) return inside.in;
  return inside.out > kNearest ? inside.out : kInfinity;
}

}  // namespace

double intersect(const Shape& shape, const Eigen::Vector3d& o, const Eigen::Vector3d& d) {
  const Eigen::Vector3d half = 0.5 * shape.size;
  switch (shape.type) {
    case Shape::Type::kGround: {
      const double t = -o.z() / d.z();
      return t > kNearest ? t : kInfinity;  // also for 0 / 0
    }
    case Shape::Type::kRectangle: {
      const double t = -o.y() / d.y();
      const double z = o.z() + t * d.z();
      return t > kNearest && std::abs(o.x() + t * d.x()) <= half.x() && z >= 0.0 && z <= shape.size.z()
                 ? t
                 : kInfinity;
    }
    case Shape::Type::kBox:
      return firstCrossing(slab(o.x(), d.x(), -half.x(), half.x()) & slab(o.y(), d.y(), -half.y(), half.y()) &
                           slab(o.z(), d.z(), 0.0, shape.size.z()));
    case Shape::Type::kCylinder:
      return firstCrossing(tube(o.head<2>(), d.head<2>(), half.x()) &
                           slab(o.z(), d.z(), 0.0, shape.size.z()));
  }
  return kInfinity;
}

FacePoint surfaceAt(const Shape& shape, const Eigen::Vector3d& p) {
  const Eigen::Vector3d half = 0.5 * shape.size;
  switch (shape.type) {
    case Shape::Type::kGround:
      return {Eigen::Vector3d::UnitZ(), p.head<2>()};
    case Shape::Type::kRectangle:
      return {Eigen::Vector3d::UnitY(), {p.x(), p.z()}};
    case Shape::Type::kBox: {
      int axis;
      ((p - Eigen::Vector3d(0.0, 0.0, half.z())).cwiseAbs() - half).maxCoeff(&axis);
      return {Eigen::Vector3d::Unit(axis), {p[axis == 0 ? 1 : 0], p[axis == 2 ? 1 : 2]}, axis};
    }
    case Shape::Type::kCylinder:
      break;
  }
  const double radius = p.head<2>().norm();
  if (std::abs(p.z() - half.z()) - half.z() > radius - half.x())
    return {Eigen::Vector3d::UnitZ(), p.head<2>()};
  return {Eigen::Vector3d(p.x(), p.y(), 0.0) / radius,
          {half.x() * std::atan2(p.y(), p.x()), p.z()},
          p.y() < 0.0 ? 1 : 2};
}

}  // namespace mapping_simulation
