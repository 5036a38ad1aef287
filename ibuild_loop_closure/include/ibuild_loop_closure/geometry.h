// SPDX-License-Identifier: BSD-3-Clause
//
// Whether two images show the same place: do the positions of their matched features agree, and how is one
// camera posed in the other's frame.
#pragma once

#include <Eigen/Geometry>
#include <opencv2/core.hpp>
#include <optional>
#include <vector>

#include "ibuild_loop_closure/features.h"

namespace ibuild_loop_closure {

struct GeometryOptions {
  int max_features = 800;  ///< of an image, the first that were detected; fewer take less time and memory
  int delta = 100;         ///< bits, features nearer than that may match, 1 to 512
  double ratio = 0.9;      ///< of the nearest to the second nearest feature, at most
  double layout_tolerance =
      0.047;  ///< of the image's width: how far a match may be from where the layout has it
  double epipolar_tolerance = 0.005;  ///< of the image's width: the same from its epipolar line
  double spot = 0.008;       ///< of the image's width: features nearer to each other are evidence once
  double min_overlap = 0.5;  ///< share of each image that the other must show, 0 to 1
  double max_scale = 2.5;    ///< between the images, 1 to 100
  int iterations = 100;      ///< of the search for the layout
  int min_inliers = 12;      ///< of the epipolar geometry or of the pose, for an image to be verified
  /// @throws std::invalid_argument that names the option, its value and the allowed range
  void validate() const;
};

/// An image as far as geometry is concerned.
struct View {
  Features features;
  std::vector<float> depths;  ///< m along the optical axis, of each feature, 0: unknown; empty: none known
  cv::Size size;              ///< pixels
};

/// Of a rectified image, pixels.
struct Camera {
  double fx = 0.0, fy = 0.0, cx = 0.0, cy = 0.0;
};

struct RelativePose {
  Eigen::Isometry3d transform = Eigen::Isometry3d::Identity();  ///< pose of the query's camera seen from the
                                                                ///< match's (optical frames, m)
  Eigen::Matrix<double, 6, 6> information = Eigen::Matrix<double, 6, 6>::Zero();  ///< translation first
  int inliers = 0;
};

struct GeometryResult {
  int matches = 0;  ///< features that match by descriptor
  /// -log10 of the number of layouts as good as this one expected by chance: 0 and below says nothing, 4 is
  /// chance once in ten thousand.
  double significance = 0.0;
  double overlap = 0.0;      ///< share of each image that the other shows by the layout
  double scale = 1.0;        ///< of the match's features to the query's by the layout
  int inliers = 0;           ///< of the epipolar geometry or the pose
  bool verified = false;     ///< inliers are at least min_inliers
  std::vector<Match> pairs;  ///< a: feature of the query, b: of the match; those that fit the geometry
  std::optional<RelativePose> pose;  ///< if the match has depths
};

/// Finds the most significant layout: a similarity transform that maps features to within a wide tolerance
/// (a-contrario, as Moisan and Stival 2004 do for epipolar lines). It stands parallax and costs microseconds,
/// so that many candidates can be tried.
GeometryResult checkLayout(const View& query, const View& match, const GeometryOptions& options);

/// The first features of a view.
View firstFeatures(const View& view, std::size_t count);

/// Refines a layout's matches by RANSAC: with depths by the camera's pose, with a camera by the essential
/// matrix, otherwise by the fundamental matrix. Sets inliers, verified, pairs and pose.
void verify(const View& query, const View& match, const std::optional<Camera>& camera,
            const GeometryOptions& options, GeometryResult& result);

}  // namespace ibuild_loop_closure
