// SPDX-License-Identifier: BSD-3-Clause
//
// Rendered images: each place is a texture of rectangles of its own, seen a little displaced.
#pragma once

#include <opencv2/core.hpp>
#include <opencv2/imgproc.hpp>

namespace ibuild_loop_closure {

/// @param place seed of the texture @param shift pixels that the view is displaced by
inline cv::Mat renderPlace(int place, int shift = 0, cv::Size size = {320, 240}) {
  cv::RNG random(1000 + place);
  cv::Mat image(size.height, size.width + 200, CV_8UC1, cv::Scalar(110));
  for (int i = 0; i < 260; ++i) {
    const cv::Point corner(random.uniform(0, image.cols), random.uniform(0, image.rows));
    const cv::Size extent(random.uniform(4, 40), random.uniform(4, 40));
    cv::rectangle(image, cv::Rect(corner, extent), cv::Scalar(random.uniform(0, 256)), cv::FILLED);
  }
  cv::GaussianBlur(image, image, {3, 3}, 0.8);
  return image(cv::Rect(100 + shift, 0, size.width, size.height)).clone();
}

/// A walk through places, several views of each, so that consecutive images have features in common.
/// @param offset pixels that this walk differs from another by
inline cv::Mat renderWalk(int image, int offset = 0) {
  constexpr int kViews = 4;
  return renderPlace(image / kViews, offset + 6 * (image % kViews));
}

}  // namespace ibuild_loop_closure
