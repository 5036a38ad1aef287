// SPDX-License-Identifier: BSD-3-Clause
#include "observability.h"

#include <Eigen/Eigenvalues>
#include <algorithm>
#include <cmath>

#include "surface.h"

namespace intensity_hector_slam {
namespace {

// Of the noise of points across a surface, what uneven normals make of it along the surface.
constexpr double kUnevenness = 0.2;

using Eigen::Matrix3d;
using Eigen::Vector3d;

struct Known {
  SurfacePiece piece;
  Vector3d across, along;  // J, with angles in units of length
  double share;            // of its points on occupied cells
};

// How far what the pieces tell of a motion is beyond what the noise of their reflectivities would pretend, in
// standard deviations of that: the texture of each piece is about of a chi-squared distribution without any.
double textureAlong(const Vector3d& motion, const Scan& scan, const std::vector<Known>& surface) {
  double sum = 0.0, variance = 0.0;
  for (const Known& known : surface) {
    const double there = texture(scan, known.piece);
    if (std::isnan(there)) continue;
    const double part = known.along.dot(motion), weight = known.share * part * part;
    sum += weight * (there - 1.0);
    variance += 2.0 * weight * weight;
  }
  return variance > 0.0 ? sum / std::sqrt(variance) : 0.0;
}

}  // namespace

Overlap overlapOf(const GridMap& map, const Beams& beams, const Pose& pose) {
  const double cells = 1.0 / map.resolution();
  const float c = cells * std::cos(pose.z()), s = cells * std::sin(pose.z());
  const float u0 = cells * pose.x(), v0 = cells * pose.y();
  std::size_t occupied = 0, free = 0;
  for (std::size_t first = 0; first < beams.count; first += kLanes) {
    const Eigen::Map<const Eigen::Array4f> x(&beams.x[first]), y(&beams.y[first]);
    const auto cells = map.cellsAt(c * x - s * y + u0, s * x + c * y + v0);
    for (std::size_t i = 0; i < std::min<std::size_t>(kLanes, beams.count - first); ++i) {
      occupied += GridMap::isOccupied(*cells[i]);
      free += GridMap::isFree(*cells[i]);
    }
  }
  const double n = std::max<std::size_t>(1, beams.count);
  return {occupied / n, free / n};
}

Observability observe(const Scan& scan, const GridMap& map, const Pose& pose, double mean_range,
                      bool uses_occupancy, bool uses_reflectivity, const MatcherOptions& options) {
  constexpr std::size_t kStride = 3;  // of the points that are looked up
  std::vector<Known> surface;
  double all = 0.0, there = 0.0;
  Matrix3d information = Matrix3d::Zero();
  const Eigen::Rotation2Dd rotation(pose.z());
  const Eigen::Isometry2d to_map = isometry(pose);
  for (const SurfacePiece& piece : surfacePieces(scan, options.surface_length)) {
    const auto jacobian = [&](const Eigen::Vector2d& direction) {
      const double by_angle = direction.y() * piece.centre.x() - direction.x() * piece.centre.y();
      Vector3d j;
      j << rotation * direction, by_angle / mean_range;
      return j;
    };
    double looked_up = 0.0, occupied = 0.0;
    for (std::size_t i = piece.begin; i < piece.end; i += kStride) {
      const GridMap::Cell* const cell = map.find(to_map * scan.points[i].cast<double>());
      looked_up += 1.0;
      occupied += cell && GridMap::isOccupied(*cell);
    }
    const Known known{piece, jacobian(piece.normal), jacobian({piece.normal.y(), -piece.normal.x()}),
                      occupied / looked_up};
    // Noise turns normals, which looks like information along the surface.
    const double points = piece.end - piece.begin;
    all += points;
    there += known.share * points;
    information += known.share * points *
                   (known.across * known.across.transpose() -
                    piece.normal_variance * known.along * known.along.transpose());
    surface.push_back(known);
  }
  const Eigen::SelfAdjointEigenSolver<Matrix3d> solver(information);
  Observability result;
  result.share = all > 0.0 ? there / all : 0.0;
  for (int i = 0; i < 3; ++i) {
    const Vector3d v = solver.eigenvectors().col(i);
    const double tells = std::max(kLeastInformation, solver.eigenvalues()[i]);
    const double pull = kUnevenness / tells;
    const Matrix3d uncertainty = (1.0 / tells + pull * pull * all) * v * v.transpose();
    const double share =
        std::max(0.0, solver.eigenvalues()[i]) / std::max(kLeastInformation, solver.eigenvalues().z());
    if (share >= std::max(options.min_observability, options.min_geometry)) {
      result.uncertainty += uncertainty;
      continue;
    }
    const bool textured = uses_reflectivity && textureAlong(v, scan, surface) >= options.min_texture;
    if (!textured) result.uncertainty += uncertainty;
    if (share >= options.min_observability && !textured) continue;
    result.full = false;
    result.occupancy -= v * v.transpose();
    if (!textured) result.reflectivity -= v * v.transpose();
  }
  if (!uses_occupancy) result.full = result.reflectivity.isIdentity();
  return result;
}

}  // namespace intensity_hector_slam
