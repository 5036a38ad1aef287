// SPDX-License-Identifier: BSD-3-Clause
//
// Renders textured rectangles in space as a pinhole camera sees them.
#pragma once

#include <Eigen/Geometry>
#include <memory>
#include <opencv2/core.hpp>
#include <vector>

namespace ibuild_loop_closure {

/// A picture of a surface, at all the resolutions that distances ask for.
class Texture {
 public:
  /// @param bgra CV_8UC4, colours multiplied by alpha @param resolution pixels per m
  Texture(const cv::Mat& bgra, double resolution);
  float width() const { return levels_[0].cols / resolution_; }   ///< m
  float height() const { return levels_[0].rows / resolution_; }  ///< m
  /// Colour around a point. @param x, y m from the upper left corner @param extent m that it is averaged over
  cv::Vec4f at(float x, float y, float extent) const;

 private:
  float resolution_;
  std::vector<cv::Mat> levels_;  // each half as fine as the one before
};

struct Surface {
  Eigen::Vector3d corner;       ///< upper left, world, m
  Eigen::Vector3d right, down;  ///< of the texture, unit vectors in the world
  std::shared_ptr<const Texture> texture;
};

struct Pinhole {
  cv::Size size;  ///< pixels
  double focal_length, cx, cy;
};

/// @param pose of the camera in the world, x right, y down, z forward (REP 103, optical frame); the world's z
/// is up
/// @return CV_8UC3
cv::Mat render(const std::vector<Surface>& surfaces, const Pinhole& camera, const Eigen::Isometry3d& pose);

}  // namespace ibuild_loop_closure
