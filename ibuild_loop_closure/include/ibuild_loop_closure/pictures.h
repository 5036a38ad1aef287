// SPDX-License-Identifier: BSD-3-Clause
//
// Pictures of what was found: pairs, similarities, trajectory, curves.
#pragma once

#include <Eigen/Geometry>
#include <opencv2/core.hpp>
#include <string>
#include <utility>
#include <vector>

#include "ibuild_loop_closure/evaluation.h"

namespace ibuild_loop_closure {

/// Fig. 4.19: two images side by side, lines between their matched points (pixels of each).
cv::Mat drawPair(const cv::Mat& query, const cv::Mat& match,
                 const std::vector<std::pair<cv::Point2f, cv::Point2f>>& points, const std::string& caption);

/// Below each other, to the width of the first; empty if there is none.
cv::Mat stack(const std::vector<cv::Mat>& pictures);

/// Rows are queries, bright is similar. Scaled by the greatest value; at most `max_size` pixels wide.
cv::Mat drawSimilarities(const std::vector<std::vector<double>>& rows, int max_size = 1200);

/// Fig. 4.18: the path from above (the plane of its two widest axes), accepted loops in red.
cv::Mat drawTrajectory(const std::vector<Eigen::Isometry3d>& poses, const std::vector<Proposal>& loops);

/// Fig. 4.17: precision (0 to 1) over recall.
struct NamedCurve {
  std::string name;
  std::vector<CurvePoint> points;
};
cv::Mat drawCurves(const std::vector<NamedCurve>& curves);

}  // namespace ibuild_loop_closure
