// SPDX-License-Identifier: BSD-3-Clause
//
// A pinhole camera that looks at a World.
#pragma once

#include <mapping_simulation/world.h>

#include <Eigen/Geometry>
#include <cstdint>
#include <vector>

namespace mapping_simulation {

/// Pixel (u, v) of the image, counted from the upper left, looks along ((u - cx) / fx, (v - cy) / fy, 1) in
/// the optical frame: x right, y down, z forward (REP 103). No distortion.
struct CameraModel {
  int width = 640, height = 480;                          ///< pixels
  double fx = 400.0, fy = 400.0, cx = 319.5, cy = 239.5;  ///< pixels
  bool color = false;                                     ///< rgb8; else mono8
  int samples = 2;                                        ///< of a pixel, in each direction
  double exposure = 1.0;  ///< white in a light of 1 becomes 255 times this; 0: the image gets a mean of 110
  double noise = 0.0;     ///< standard deviation of a value, in its units of 1 / 255
  double baseline = 0.0;  ///< m to the left camera of a rectified pair, whose right one this is; 0: it isn't

  /// Where a pixel looks: optical frame, unit length.
  Eigen::Vector3d direction(double u, double v) const {
    return Eigen::Vector3d((u - cx) / fx, (v - cy) / fy, 1.0).normalized();
  }
};

struct Image {
  int width = 0, height = 0, channels = 0;  ///< 1: mono, 3: red, green, blue
  std::vector<std::uint8_t> data;           ///< row by row, without gaps
};

/// What the camera sees. @param pose optical frame -> map frame @param seed of the noise @param threads that
/// share the rows, 0: as many as the machine has; the image is the same for any
Image renderImage(const CameraModel& camera, const Scene& scene, const Eigen::Isometry3d& pose,
                  std::uint64_t seed, int threads = 0);

}  // namespace mapping_simulation
