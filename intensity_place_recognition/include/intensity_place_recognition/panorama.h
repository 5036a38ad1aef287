// SPDX-License-Identifier: BSD-3-Clause
//
// Projections of a cloud to images (thesis, Appendix A): the equirectangular panorama and, from it, the
// rectilinear views that a camera would have.
#pragma once

#include <mapping_common/options.h>
#include <pcl/point_cloud.h>
#include <pcl/point_types.h>

#include <Eigen/Geometry>
#include <cmath>
#include <cstddef>
#include <opencv2/core.hpp>
#include <vector>

namespace intensity_place_recognition {

using Cloud = pcl::PointCloud<pcl::PointXYZI>;

/// Whether a point was measured: it is finite and isn't the sensor itself, as what is no return is in some
/// drivers' clouds, and its intensity is one that can be summed up.
inline bool isMeasured(const pcl::PointXYZI& p) {
  constexpr float kHighestIntensity = 1e12f;  // above any integer of 32 bits
  const float squared = p.getVector3fMap().squaredNorm();
  return squared > 0.0f && std::isfinite(squared) && std::abs(p.intensity) <= kHighestIntensity;
}

struct PanoramaOptions {
  int width = 720, height = 64;
  double min_elevation = -0.4363, max_elevation = 0.2618;
  double min_range = 1.0, max_range = 120.0;

  void describe(mapping_common::OptionList& o) {
    o("width", width, "pixels", "of a whole turn").within(16, 65536);
    o("height", height, "pixels", "").within(4, 32768);
    o("min_elevation", min_elevation, "deg", "of the lowest row").inDegrees().within(-90.0, 90.0);
    o("max_elevation", max_elevation, "deg", "of the highest row").inDegrees().within(-90.0, 90.0);
    o("min_range", min_range, "m", "what is nearer is the robot itself").within(0.0, 100.0);
    o("max_range", max_range, "m", "").above(0.0).atMost(1e5);
    o.require(min_elevation < max_elevation, "max_elevation", "more than min_elevation");
    o.require(min_range < max_range, "max_range", "more than min_range");
  }
};

/// Images of the same size, float. A panorama's middle is forward (x), its left edge backward, and azimuth
/// grows to the left; its uppermost edge is at max_elevation.
struct Panorama {
  PanoramaOptions options;
  cv::Mat1f intensity, range;  ///< means; range in m; 0 where there is nothing
  cv::Mat1b mask;              ///< 255 where a point was seen, 128 where a hole was filled, else 0

  /// Where a point of the sensor's frame is seen; the middle of the first pixel is (0, 0), and x is in
  /// [-0.5, width - 0.5).
  cv::Point2d pixelOf(const Eigen::Vector3d& point) const;
  /// Of length 1, in the sensor's frame.
  Eigen::Vector3d directionOf(const cv::Point2d& pixel) const;
};

/// A.1: adds the points of a cloud one by one, so that one need not have them all at once. What several
/// points of a pixel say is averaged.
class PanoramaBuilder {
 public:
  explicit PanoramaBuilder(const PanoramaOptions& options);
  /// Points that weren't measured, and those outside of the ranges and elevations, are left out.
  void add(const pcl::PointXYZI* points, std::size_t count);
  void add(const Cloud& cloud) { add(cloud.points.data(), cloud.size()); }
  /// That were not left out.
  std::size_t points() const { return points_; }
  /// @param largest_hole rows (and columns) between two seen pixels that are filled linearly from them, first
  ///   from above and below, then from the sides: those of a sparse lidar. 0: none
  Panorama panorama(int largest_hole = 0) const;

 private:
  PanoramaOptions options_;
  struct Pixel {
    float intensity = 0.0f, range = 0.0f;  // means
    int count = 0;
  };
  std::vector<Pixel> pixels_;  // row by row
  std::size_t points_ = 0;
};

Panorama toPanorama(const Cloud& cloud, const PanoramaOptions& options, int largest_hole = 0);

/// The points of a panorama of any size, one for each pixel whose range is positive and finite, at its
/// middle.
/// @param range m @param options whose elevations are those of the images' edges
/// @throws std::invalid_argument if the images differ in size
Cloud toCloud(const cv::Mat1f& intensity, const cv::Mat1f& range, const PanoramaOptions& options);

/// A.2: what a camera would see.
struct RectilinearView {
  int width = 256, height = 256;                                ///< pixels
  double horizontal_fov = 1.5707963, vertical_fov = 1.5707963;  ///< rad, less than pi
  /// Of the camera in the sensor's frame: it looks along its x, with y to its left (REP 103); so front is the
  /// identity, back a half turn about z, and the faces of a cube are quarter turns with fields of view of
  /// pi/2.
  Eigen::Matrix3d rotation = Eigen::Matrix3d::Identity();
};
/// Interpolated between the pixels that were seen or filled. @return range remains the distance, not the
/// depth
Panorama rectilinear(const Panorama& panorama, const RectilinearView& view);

}  // namespace intensity_place_recognition
