// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <mapping_simulation/trajectory.h>

#include <Eigen/Geometry>
#include <cstdint>
#include <limits>
#include <memory>
#include <string>
#include <utility>
#include <vector>

namespace mapping_simulation {

/// Red, green, blue; linear in light, 1: white.
using Color = Eigen::Array3f;

/// A surface as cameras see it.
struct Appearance {
  Color albedo = Color::Zero();  ///< share of the light that it gives back, [0, 1]
  Color glow = Color::Zero();    ///< light of its own
};

/// Reflectivity over a surface, as a function of coordinates (u, v) in m that are fixed to it.
struct Texture {
  enum class Type {
    kConstant,      ///< values[0]
    kCheckerboard,  ///< square cells of width `size`, cell (i, j) has values[(i + j) mod n]
    kStripes,       ///< stripes of width `size`, stripe i has values[i mod n]; i grows along `angle`
    kNoise,         ///< smooth random field between values[0] and values[1], knots `size` apart
    kBricks,  ///< of `size` x `height` in running bond, each between values[0] and values[1], the joints
              ///< values[2]
    kFacade,  ///< front of a house that is `span` wide, u = 0 in the middle; storeys of `size`; its seed
              ///< decides all
  };
  Type type = Type::kConstant;
  std::vector<double> values{0.5};  ///< reflectivity relative to a white diffuse target, [0, 1]
  std::vector<Color> colors;        ///< albedo for cameras, one for each value; empty: grey as the value
  double size = 1.0;                ///< m, > 0
  double height = 0.1;              ///< m, > 0, of bricks
  double span = 1.0;                ///< m, > 0, of a facade
  double angle = 0.0;               ///< rad, of the stripes' sequence against the u axis
  double detail = 0.08;  ///< relative standard deviation of the noise at all scales that cameras see besides
  std::uint32_t seed = 0;  ///< of the noise

  /// Reflectivity for lasers, whose spots average the detail away; that of a facade is its albedo in red.
  double at(const Eigen::Vector2d& uv) const;
  /// What a camera sees around a point. @param footprint width of what it sees as one, m
  Appearance seenAt(const Eigen::Vector2d& uv, double footprint) const;
};

/// A textured surface. Every shape stands on the origin of its own frame:
///   kGround     the infinite plane z = 0;                       (u, v) = (x, y)
///   kRectangle  |x| <= size.x / 2, y = 0, 0 <= z <= size.z;     (u, v) = (x, z)
///   kBox        |x| <= size.x / 2, |y| <= size.y / 2, 0 <= z <= size.z;  the two coordinates along the face
///   kCylinder   axis z, diameter size.x = size.y, 0 <= z <= size.z;      (arc length, z), on the caps (x, y)
/// Rectangles have two sides; boxes and cylinders can be seen from inside, so a box makes a room.
struct Shape {
  enum class Type { kGround, kRectangle, kBox, kCylinder };
  std::string name;
  Type type = Type::kBox;
  Eigen::Vector3d size = Eigen::Vector3d::Ones();  ///< m
  Eigen::Isometry3d pose =
      Eigen::Isometry3d::Identity();  ///< shape frame -> map frame or frame of its motion
  Texture texture;
  int motion = -1;  ///< index into the motions of the world; -1: doesn't move
};

struct Ray {
  Eigen::Vector3d origin;     ///< map frame, m
  Eigen::Vector3d direction;  ///< map frame, unit length
};

/// What a ray meets first.
struct Hit {
  double range = std::numeric_limits<double>::infinity();  ///< m; infinite: nothing
  double reflectivity = 0.0;                               ///< [0, 1]
  double incidence = 0.0;  ///< rad between the ray and the surface normal, [0, pi/2]
  int shape = -1;          ///< index into World::shapes()

  explicit operator bool() const { return shape >= 0; }
};

/// A point of a surface that a ray meets first, as a renderer needs it.
struct SurfacePoint {
  double range = std::numeric_limits<double>::infinity();  ///< m; infinite: nothing
  int shape = -1;                                          ///< index into World::shapes()
  int face = 0;                                        ///< of the shape; (u, v) are continuous over a face
  Eigen::Vector2d uv = Eigen::Vector2d::Zero();        ///< m
  Eigen::Vector3d position = Eigen::Vector3d::Zero();  ///< map frame, m
  Eigen::Vector3d normal = Eigen::Vector3d::Zero();    ///< map frame, unit length, towards the ray's origin

  explicit operator bool() const { return shape >= 0; }
};

/// What cameras see by; scanners bring their own. A white surface in a light of 1 looks white.
struct Light {
  struct Lamp {
    Eigen::Vector3d position;  ///< map frame, m
    Color color;               ///< light 1 m away, head on; falls with the square of the distance
  };
  double ambient = 0.8;                               ///< from all sides, the sky's share a little more
  Color sun = Color::Zero();                          ///< head on; throws shadows, as lamps do
  Eigen::Vector3d to_sun = Eigen::Vector3d::UnitZ();  ///< map frame, unit length
  std::vector<Lamp> lamps;
  std::vector<std::pair<double, double>>
      changes;  ///< rising times (s) and what all light is multiplied with then
};

class Scene;

/// Immutable shapes, some of them on the move. Copies share the data.
class World {
 public:
  /// A motion gives the pose, in the map frame, of the frame that its shapes are placed in.
  /// Throws std::invalid_argument on sizes or textures that make no sense or a motion that isn't there.
  explicit World(std::vector<Shape> shapes, std::vector<Trajectory> motions = {}, Light light = {});

  const std::vector<Shape>& shapes() const;
  const Light& light() const;
  /// Pose of a shape at a time: shape frame -> map frame.
  Eigen::Isometry3d shapePose(int shape, double time) const;

  /// The world at one time. Rays of the same time should share it.
  Scene at(double time) const;
  /// First surface that the ray meets within `max_range` (m).
  Hit cast(const Ray& ray, double time, double max_range = std::numeric_limits<double>::infinity()) const;

 private:
  friend class Scene;
  struct Data;
  std::shared_ptr<const Data> data_;
};

/// A world, frozen.
class Scene {
 public:
  Scene(const World& world, double time);
  /// First surface that the ray meets within `max_range` (m).
  Hit cast(const Ray& ray, double max_range = std::numeric_limits<double>::infinity()) const;

  const Shape& shape(int index) const;
  /// The same surface, for a renderer.
  SurfacePoint look(const Ray& ray) const;
  /// Whether anything is on the first `range` (m) of the ray.
  bool blocked(const Ray& ray, double range) const;
  /// Light that falls onto a surface.
  Color lightAt(const Eigen::Vector3d& position, const Eigen::Vector3d& normal) const;
  /// Light of the sky. @param direction in the map frame, unit length
  Color sky(const Eigen::Vector3d& direction) const;

 private:
  // A shape's surface `range` along a ray, which is given in the frame of the shape.
  struct Nearest {
    int shape = -1;
    double range = 0.0;
    Eigen::Vector3d origin, direction;
  };
  Nearest nearest(const Ray& ray, double max_range) const;

  std::shared_ptr<const World::Data> data_;
  std::vector<Eigen::Isometry3d> to_body_;  // map frame -> frame of each motion
  float brightness_;                        // by Light::changes
};

/// Reads the keys `textures`, `models`, `objects` and `light` of a YAML file (the key `trajectory` may be
/// there too), as the package's README describes them. Every shape has noise of its own: `seed` and the
/// shape's index are added to that of its texture. Throws std::runtime_error that names file, line, key,
/// value and what is allowed.
World loadWorld(const std::string& file, std::uint32_t seed = 0);

}  // namespace mapping_simulation
