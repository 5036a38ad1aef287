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

double hash(std::int64_t x, std::int64_t y, std::uint32_t seed) {  // [0, 1)
  std::uint64_t h = static_cast<std::uint64_t>(x) * 0x9E3779B97F4A7C15u ^
                    static_cast<std::uint64_t>(y) * 0xC2B2AE3D27D4EB4Fu ^ (seed + 1ull) * 0x165667B19E3779F9u;
  h = (h ^ (h >> 31)) * 0xBF58476D1CE4E5B9u;
  h = (h ^ (h >> 29)) * 0x94D049BB133111EBu;
  return static_cast<double>((h ^ (h >> 32)) >> 11) * 0x1p-53;
}

std::size_t modulo(double cell, std::size_t n) {
  return std::min(static_cast<std::size_t>(cell - std::floor(cell / n) * n), n - 1);
}

}  // namespace

double Texture::at(const Eigen::Vector2d& uv) const {
  switch (type) {
    case Type::kConstant:
      return values[0];
    case Type::kCheckerboard:
      return values[modulo(std::floor(uv.x() / size) + std::floor(uv.y() / size), values.size())];
    case Type::kStripes:
      return values[modulo(std::floor((uv.x() * std::cos(angle) + uv.y() * std::sin(angle)) / size),
                           values.size())];
    case Type::kNoise:
      break;
  }
  const double u = std::floor(uv.x() / size), v = std::floor(uv.y() / size);
  const auto i = static_cast<std::int64_t>(u), j = static_cast<std::int64_t>(v);
  const auto smooth = [](double s) { return s * s * (3.0 - 2.0 * s); };
  const double s = smooth(uv.x() / size - u), t = smooth(uv.y() / size - v);
  const double weight = (1.0 - t) * ((1.0 - s) * hash(i, j, seed) + s * hash(i + 1, j, seed)) +
                        t * ((1.0 - s) * hash(i, j + 1, seed) + s * hash(i + 1, j + 1, seed));
  return values[0] + weight * (values[1] - values[0]);
}

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

SurfacePoint surfaceAt(const Shape& shape, const Eigen::Vector3d& p) {
  const Eigen::Vector3d half = 0.5 * shape.size;
  switch (shape.type) {
    case Shape::Type::kGround:
      return {Eigen::Vector3d::UnitZ(), p.head<2>()};
    case Shape::Type::kRectangle:
      return {Eigen::Vector3d::UnitY(), {p.x(), p.z()}};
    case Shape::Type::kBox: {
      int axis;
      ((p - Eigen::Vector3d(0.0, 0.0, half.z())).cwiseAbs() - half).maxCoeff(&axis);
      return {Eigen::Vector3d::Unit(axis), {p[axis == 0 ? 1 : 0], p[axis == 2 ? 1 : 2]}};
    }
    case Shape::Type::kCylinder:
      break;
  }
  const double radius = p.head<2>().norm();
  if (std::abs(p.z() - half.z()) - half.z() > radius - half.x())
    return {Eigen::Vector3d::UnitZ(), p.head<2>()};
  return {Eigen::Vector3d(p.x(), p.y(), 0.0) / radius, {half.x() * std::atan2(p.y(), p.x()), p.z()}};
}

}  // namespace mapping_simulation
