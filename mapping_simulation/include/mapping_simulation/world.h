// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <mapping_simulation/trajectory.h>

#include <Eigen/Geometry>
#include <cstdint>
#include <limits>
#include <memory>
#include <string>
#include <vector>

namespace mapping_simulation {

/// Reflectivity over a surface, as a function of coordinates (u, v) in m that are fixed to it.
struct Texture {
  enum class Type {
    kConstant,      ///< values[0]
    kCheckerboard,  ///< square cells of width `size`, cell (i, j) has values[(i + j) mod n]
    kStripes,       ///< stripes of width `size`, stripe i has values[i mod n]; i grows along `angle`
    kNoise,         ///< smooth random field between values[0] and values[1], knots `size` apart
  };
  Type type = Type::kConstant;
  std::vector<double> values{0.5};  ///< reflectivity relative to a white diffuse target, [0, 1]
  double size = 1.0;                ///< m, > 0
  double angle = 0.0;               ///< rad, of the stripes' sequence against the u axis
  std::uint32_t seed = 0;           ///< of the noise

  double at(const Eigen::Vector2d& uv) const;
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

class Scene;

/// Immutable shapes, some of them on the move. Copies share the data.
class World {
 public:
  /// A motion gives the pose, in the map frame, of the frame that its shapes are placed in.
  /// Throws std::invalid_argument on sizes or textures that make no sense or a motion that isn't there.
  explicit World(std::vector<Shape> shapes, std::vector<Trajectory> motions = {});

  const std::vector<Shape>& shapes() const;
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

 private:
  std::shared_ptr<const World::Data> data_;
  std::vector<Eigen::Isometry3d> to_body_;  // map frame -> frame of each motion
};

/// Reads the keys `textures`, `models` and `objects` of a YAML file (the key `trajectory` may be there too):
///   textures: {NAME: {type: constant | checkerboard | stripes | noise, values: [..], size: m, angle_deg:,
///   seed:}} models:   {NAME: [object, ...]}            parts, in the frame of the object that has NAME for a
///   type objects:  [object, ...]
/// An object is {type:, name:, position: [x, y, z] m, yaw_deg: or rpy_deg: [r, p, y]} and
///   type: ground                               reflectivity
///   type: rectangle, size: [width, height]     reflectivity
///   type: box, size: [x, y, z]                 reflectivity
///   type: cylinder, radius:, height:           reflectivity
///   type: NAME of a model
/// where reflectivity is a number, the name of a texture, or a texture; any object may have
///   repeat: {count:, step: [x, y, z]}          or a list of them for rows and columns
/// and those in `objects` may have
///   motion:                                    as `trajectory`, see loadTrajectory(); the object's own pose
///   is then
///                                              in the moving frame
/// Every shape has noise of its own: its index is added to the seed. Throws std::runtime_error that names
/// file, line, key, value and what is allowed.
World loadWorld(const std::string& file);

}  // namespace mapping_simulation
