// SPDX-License-Identifier: BSD-3-Clause
//
// Pictures of matched pairs.
#pragma once

#include <opencv2/core.hpp>
#include <string>
#include <utility>
#include <vector>

namespace ibuild_loop_closure {

/// Fig. 4.19: two images side by side, the match on the left, with lines between some of their matched points
/// (pixels of each).
cv::Mat drawPair(const cv::Mat& query, const cv::Mat& match,
                 const std::vector<std::pair<cv::Point2f, cv::Point2f>>& points, const std::string& caption);

/// Below each other, to the width of the first; empty if there is none.
cv::Mat stack(const std::vector<cv::Mat>& pictures);

}  // namespace ibuild_loop_closure
