// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <opencv2/core.hpp>
#include <string>
#include <vector>

#include "intensity_place_recognition/panorama.h"

namespace intensity_place_recognition {

/// A panorama's intensities for people to look at, 8 bits, grey.
cv::Mat1b toPicture(const Panorama& panorama);

/// The match above, and below it the query turned so that it looks the same way. @param yaw rad, of the
/// query's sensor seen from the match's
cv::Mat drawPlaces(const cv::Mat1b& query, const cv::Mat1b& match, double yaw, const std::string& caption);

/// Square, in colours from dark (0) to light (the greatest).
cv::Mat drawMatrix(const cv::Mat1f& values);

/// Precision over recall, both 0 to 1.
cv::Mat drawPrecisionRecall(const std::vector<cv::Point2d>& recall_and_precision);

}  // namespace intensity_place_recognition
