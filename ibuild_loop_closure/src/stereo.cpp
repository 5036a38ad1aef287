// SPDX-License-Identifier: BSD-3-Clause
#include "ibuild_loop_closure/stereo.h"

#include <algorithm>
#include <cstdint>
#include <cstdlib>
#include <opencv2/imgproc.hpp>
#include <string>

namespace ibuild_loop_closure {
namespace {

// Gradients along the row: they hardly depend on either camera's exposure.
cv::Mat gradientsOf(const cv::Mat& image) {
  cv::Mat gradients;
  cv::Sobel(image, gradients, CV_8U, 1, 0, 3, 0.25, 128.0);
  return gradients;
}

// Sums of absolute differences between the patch around `at` and those around at + (d, 0), first <= d <=
// last.
void compare(const cv::Mat& from, const cv::Mat& to, cv::Point at, int first, int last, int half,
             std::vector<int>& differences) {
  const std::size_t count = last - first + 1;
  differences.assign(count, 0);
  std::vector<std::uint16_t> of_row(count);
  for (int y = at.y - half; y <= at.y + half; ++y) {
    const unsigned char* patch = from.ptr(y) + at.x - half;
    const unsigned char* row = to.ptr(y) + at.x - half + first;
    std::fill(of_row.begin(), of_row.end(), std::uint16_t{0});
    for (int x = 0; x <= 2 * half; ++x) {
      const int value = patch[x];
      for (std::size_t d = 0; d < count; ++d)
        of_row[d] = static_cast<std::uint16_t>(of_row[d] + std::abs(value - row[d + x]));
    }
    for (std::size_t d = 0; d < count; ++d) differences[d] += of_row[d];
  }
}

// Index of the least difference to a fraction, of lines of one slope on both sides (sums of absolute
// differences are V-shaped); -1 where it is at an end, or is not unique.
double bestOf(const std::vector<int>& differences, double uniqueness) {
  const auto least = std::min_element(differences.begin(), differences.end());
  const auto at = static_cast<int>(least - differences.begin());
  const auto count = static_cast<int>(differences.size());
  if (at == 0 || at + 1 >= count) return -1.0;
  for (int i = 0; i < count; ++i) {
    if (std::abs(i - at) > 2 && *least >= uniqueness * differences[i]) return -1.0;
  }
  const double before = differences[at - 1] - *least, after = differences[at + 1] - *least;
  return at + 0.5 * (before - after) / std::max({before, after, 1.0});
}

}  // namespace

std::vector<float> disparitiesAt(const cv::Mat& left, const cv::Mat& right,
                                 const std::vector<cv::Point2f>& points, const StereoOptions& options) {
  const cv::Mat gradients_left = gradientsOf(left), gradients_right = gradientsOf(right);
  const int half = options.window / 2, farthest = cvCeil(options.max_disparity * left.cols);
  const double most = options.max_difference * options.window * options.window;
  std::vector<float> disparities(points.size(), 0.0f);
  std::vector<int> differences;
  for (std::size_t i = 0; i < points.size(); ++i) {
    const cv::Point at(cvRound(points[i].x), cvRound(points[i].y));
    // One pixel more on both sides, so that a minimum has neighbours.
    const int first = std::max(-farthest - 1, half - at.x), last = std::min(1, left.cols - 1 - half - at.x);
    if (at.y < half || at.y + half >= left.rows || at.x < half || last < 1 || last - first < 2) continue;
    compare(gradients_left, gradients_right, at, first, last, half, differences);
    const double found = bestOf(differences, options.uniqueness);
    if (found < 0.0) continue;
    const int whole = cvRound(found);
    if (differences[whole] > most) continue;
    const double disparity = -(first + found);
    if (disparity < options.min_disparity) continue;

    const cv::Point back(at.x + first + whole, at.y);
    const int back_first = std::max(-1, half - back.x),
              back_last = std::min(farthest + 1, left.cols - 1 - half - back.x);
    compare(gradients_right, gradients_left, back, back_first, back_last, half, differences);
    const auto least = std::min_element(differences.begin(), differences.end());
    if (std::abs(back.x + back_first + static_cast<int>(least - differences.begin()) - at.x) > 1) continue;
    disparities[i] = static_cast<float>(disparity);
  }
  return disparities;
}

}  // namespace ibuild_loop_closure
