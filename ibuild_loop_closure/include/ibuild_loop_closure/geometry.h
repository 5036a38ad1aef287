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
  int max_features = 800;
  int delta = 100;
  double ratio = 0.9;
  double layout_tolerance = 0.047, epipolar_tolerance = 0.005;
  double spot = 0.008;
  double min_overlap = 0.5;
  double max_scale = 2.5;
  int iterations = 100;
  int min_inliers = 12;

  void describe(mapping_common::OptionList& o) {
    o("max_features", max_features, "",
      "of an image that are kept, the first that were detected: 72 bytes each")
        .within(8, 100000);
    o("delta", delta, "bits", "features nearer than that may match").within(1, Descriptor::kMaxBits);
    o("ratio", ratio, "", "of the nearest to the second nearest feature, at most").within(0.1, 1.0);
    o("layout_tolerance", layout_tolerance, "",
      "of the image's width: how far features may be from where the layout has them; parallax")
        .within(0.001, 0.5);
    o("epipolar_tolerance", epipolar_tolerance, "",
      "of the image's width: how far from their epipolar line or their projection")
        .within(0.0001, 0.1);
    o("spot", spot, "",
      "of the image's width: features nearer to each other than that are evidence only once")
        .within(0.0, 0.5);
    o("min_overlap", min_overlap, "",
      "share of each image that the other must show: views of one thing from far and near are no loop")
        .within(0.0, 1.0);
    o("max_scale", max_scale, "", "between the two images, at most").within(1.0, 100.0);
    o("iterations", iterations, "", "of the search for the layout").within(1, 100000);
    o("min_inliers", min_inliers, "", "of the epipolar geometry or of the pose, for a pair to be verified")
        .within(8, 10000);
  }
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
  /// Of the error in the axes of the query's camera, translation first: 1/m^2, 1/rad^2.
  Eigen::Matrix<double, 6, 6> information = Eigen::Matrix<double, 6, 6>::Zero();
  int inliers = 0;
};

/// Where a layout puts the query's image in the match's.
struct Placement {
  double scale = 1.0, rotation = 0.0;  ///< rad
  cv::Point2d shift;                   ///< of the middle, widths of the match's image
};

struct GeometryResult {
  int matches = 0;  ///< features that match by descriptor
  /// -log10 of the number of layouts as good as this one expected by chance: 0 and below says nothing, 4 is
  /// chance once in ten thousand.
  double significance = 0.0;
  double overlap = 0.0;      ///< share of each image that the other shows by the layout
  Placement placement;       ///< by the layout
  int inliers = 0;           ///< of the epipolar geometry or the pose
  bool verified = false;     ///< inliers are at least min_inliers
  std::vector<Match> pairs;  ///< a: feature of the query, b: of the match; those that fit the geometry
  std::optional<RelativePose> pose;  ///< if the match has depths
};

/// Finds the most significant layout: a similarity transform that maps features to within a wide tolerance
/// (a-contrario, as Moisan and Stival 2004 do for epipolar lines). It stands parallax and costs microseconds,
/// so that many candidates can be tried.
/// @param like that of a pair before or after this one in a track: only layouts that are like it are sought.
/// Chance makes few of those, so that fewer features do.
GeometryResult checkLayout(const View& query, const View& match, const GeometryOptions& options,
                           const std::optional<Placement>& like = {});

/// How the image of a camera moved, as far as it is a similarity transform.
struct ImageMotion {
  double turn = 0.0;       ///< of what is in the image's middle, widths of the image: to the left is positive
  double expansion = 0.0;  ///< logarithm of the scale, positive where the camera goes ahead
};
/// @param matches a: feature of the view, b: of the last image
/// @return none if the matches don't fit one
std::optional<ImageMotion> motionSince(const Features& last, const View& view,
                                       const std::vector<Match>& matches, const GeometryOptions& options);

/// The first features of a view.
View firstFeatures(const View& view, std::size_t count);

/// Refines a layout's matches by RANSAC: with depths by the camera's pose, with a camera by the essential
/// matrix, otherwise by the fundamental matrix. Sets inliers, verified, pairs and pose.
void verify(const View& query, const View& match, const std::optional<Camera>& camera,
            const GeometryOptions& options, GeometryResult& result);

}  // namespace ibuild_loop_closure
