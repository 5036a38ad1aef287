// SPDX-License-Identifier: BSD-3-Clause
#include <opencv2/calib3d.hpp>

#include "ibuild_loop_closure/loop_detector.h"

namespace ibuild_loop_closure {

int estimateDelta(const std::vector<std::pair<Features, Features>>& pairs, int start) {
  constexpr double kTolerance = 3.0;  // pixels
  constexpr double kFalse = 0.05;
  constexpr std::size_t kLeast = 20;  // matches that say something
  // By distance: how many matches, and how many of them are false.
  std::vector<std::size_t> all(start + 1, 0), false_ones(start + 1, 0);
  std::size_t sum = 0;
  for (const auto& [a, b] : pairs) {
    const std::vector<Match> matches = matchDescriptors(a.descriptors, b.descriptors, start);
    if (matches.size() < kLeast) continue;
    std::vector<cv::Point2f> points_a, points_b;
    for (const Match& m : matches) {
      points_a.push_back(a.points[m.a]);
      points_b.push_back(b.points[m.b]);
    }
    cv::Mat mask;
    cv::findFundamentalMat(points_a, points_b, cv::FM_RANSAC, kTolerance, 0.99, mask);
    if (mask.empty()) continue;
    for (std::size_t i = 0; i < matches.size(); ++i) {
      ++all[matches[i].distance];
      ++sum;
      false_ones[matches[i].distance] += mask.at<unsigned char>(static_cast<int>(i)) == 0;
    }
  }
  if (sum < kLeast) return 0;
  std::size_t under = 0, false_under = 0;
  int delta = 0;
  for (int d = 0; d < start; ++d) {  // matches nearer than d + 1
    under += all[d];
    false_under += false_ones[d];
    if (under >= kLeast && static_cast<double>(false_under) <= kFalse * static_cast<double>(under))
      delta = d + 1;
  }
  return delta;
}

}  // namespace ibuild_loop_closure
