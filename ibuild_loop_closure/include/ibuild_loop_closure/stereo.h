// SPDX-License-Identifier: BSD-3-Clause
//
// Depth of features from a rectified pair of images, at those features only.
#pragma once

#include <opencv2/core.hpp>
#include <vector>

namespace ibuild_loop_closure {

struct StereoOptions {
  int window = 11;               ///< of the patch that is compared, pixels, odd, 5 to 63
  double min_disparity = 1.0;    ///< pixels: nearer to 0, points are too far away for a depth
  double max_disparity = 0.2;    ///< of the image's width, 0 to 1: nearer points aren't found
  double uniqueness = 0.75;      ///< of the best patch's difference to the best elsewhere, at most, 0 to 1
  double max_difference = 12.0;  ///< of two patches that match, grey values a pixel, contrast removed
  /// @throws std::invalid_argument that names the option, its value and the allowed range
  void validate() const;
};

/// Searches each point's patch along its row of the right image, and what was found the other way round.
/// @param left, right rectified, grey, 8 bits, of one size
/// @param points pixels of the left image
/// @return disparities, pixels, of each point; 0: unknown
std::vector<float> disparitiesAt(const cv::Mat& left, const cv::Mat& right,
                                 const std::vector<cv::Point2f>& points, const StereoOptions& options);

}  // namespace ibuild_loop_closure
