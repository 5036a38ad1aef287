// SPDX-License-Identifier: BSD-3-Clause
//
// Depth of features from a rectified pair of images, at those features only.
#pragma once

#include <mapping_common/options.h>

#include <opencv2/core.hpp>
#include <vector>

namespace ibuild_loop_closure {

struct StereoOptions {
  int window = 11;
  double min_disparity = 1.0, max_disparity = 0.2;
  double uniqueness = 0.75;
  double max_difference = 12.0;

  void describe(mapping_common::OptionList& o) {
    o("window", window, "pixels", "of the patch that is compared, odd").within(5, 63);
    o("min_disparity", min_disparity, "pixels", "what is farther away than that has no depth")
        .within(0.1, 1000.0);
    o("max_disparity", max_disparity, "", "of the image's width: what is nearer than that is not found")
        .within(0.001, 1.0);
    o("uniqueness", uniqueness, "", "of the best patch's difference to the best elsewhere, at most")
        .within(0.0, 1.0);
    o("max_difference", max_difference, "grey values", "a pixel, of patches that match, contrast removed")
        .within(0.0, 255.0);
    o.require(window % 2 == 1, "window", "an odd number");
  }
};

/// Searches each point's patch along its row of the right image, and what was found the other way round.
/// @param left, right rectified, grey, 8 bits, of one size
/// @param points pixels of the left image
/// @return disparities, pixels, of each point; 0: unknown
std::vector<float> disparitiesAt(const cv::Mat& left, const cv::Mat& right,
                                 const std::vector<cv::Point2f>& points, const StereoOptions& options);

}  // namespace ibuild_loop_closure
