// SPDX-License-Identifier: BSD-3-Clause
#include "observability.h"

#include <Eigen/Eigenvalues>
#include <algorithm>
#include <cmath>

#include "surface.h"

namespace intensity_hector_slam {
namespace {

using Eigen::Matrix3d;
using Eigen::Vector3d;

struct Known {
  SurfacePiece piece;
  Vector3d across, along;  // J, with angles in units of length
  double points;           // on occupied cells
};

// The mean over the pieces, of what each tells about a motion.
double textureAlong(const Vector3d& motion, const Scan& scan, const std::vector<Known>& surface) {
  double sum = 0.0, weights = 0.0;
  for (const Known& known : surface) {
    const double there = texture(scan, known.piece);
    if (std::isnan(there)) continue;
    const double part = known.along.dot(motion), weight = known.points * part * part;
    sum += weight * there;
    weights += weight;
  }
  return weights > 0.0 ? sum / weights : 0.0;
}

}  // namespace

Overlap overlapOf(const GridMap& map, const Beams& beams, const Pose& pose) {
  const double cells = 1.0 / map.resolution();
  const float c = cells * std::cos(pose.z()), s = cells * std::sin(pose.z());
  const float u0 = cells * (pose.x() - map.origin().x()), v0 = cells * (pose.y() - map.origin().y());
  Overlap overlap;
  overlap.occupied.assign(beams.count, 0);
  std::size_t occupied = 0, free = 0;
  for (std::size_t i = 0; i < beams.count; ++i) {
    const float u = c * beams.x[i] - s * beams.y[i] + u0, v = s * beams.x[i] + c * beams.y[i] + v0;
    if (!(u >= 0.0f && v >= 0.0f && u < map.width() && v < map.height())) continue;
    const GridMap::Cell& cell = map.cell(static_cast<int>(u), static_cast<int>(v));
    overlap.occupied[i] = GridMap::isOccupied(cell);
    occupied += overlap.occupied[i];
    free += GridMap::isFree(cell);
  }
  const double n = std::max<std::size_t>(1, beams.count);
  overlap.share_occupied = occupied / n;
  overlap.share_free = free / n;
  return overlap;
}

Observability observe(const Scan& scan, const Overlap& overlap, const Pose& pose, double mean_range,
                      bool uses_occupancy, bool uses_reflectivity, const MatcherOptions& options) {
  std::vector<Known> surface;
  Matrix3d information = Matrix3d::Zero();
  const Eigen::Rotation2Dd rotation(pose.z());
  for (const SurfacePiece& piece : surfacePieces(scan, options.surface_length)) {
    const auto jacobian = [&](const Eigen::Vector2d& direction) {
      const double by_angle = direction.y() * piece.centre.x() - direction.x() * piece.centre.y();
      Vector3d j;
      j << rotation * direction, by_angle / mean_range;
      return j;
    };
    const auto occupied = overlap.occupied.begin();
    const double points = std::count(occupied + piece.begin, occupied + piece.end, 1);
    const Known known{piece, jacobian(piece.normal), jacobian({piece.normal.y(), -piece.normal.x()}), points};
    // Noise turns normals, which looks like information along the surface.
    information += points * (known.across * known.across.transpose() -
                             piece.normal_variance * known.along * known.along.transpose());
    surface.push_back(known);
  }
  const Eigen::SelfAdjointEigenSolver<Matrix3d> solver(information);
  Observability result;
  for (int i = 0; i < 3; ++i) {
    const double share =
        std::max(0.0, solver.eigenvalues()[i]) / std::max(kLeastInformation, solver.eigenvalues().z());
    if (share >= std::max(options.min_observability, options.min_geometry)) continue;
    const Vector3d v = solver.eigenvectors().col(i);
    const bool textured = uses_reflectivity && textureAlong(v, scan, surface) >= options.min_texture;
    if (share >= options.min_observability && !textured) continue;
    result.full = false;
    result.occupancy -= v * v.transpose();
    if (!textured) result.reflectivity -= v * v.transpose();
  }
  if (!uses_occupancy) result.full = result.reflectivity.isIdentity();
  return result;
}

}  // namespace intensity_hector_slam
