// SPDX-License-Identifier: BSD-3-Clause
#include "intensity_place_recognition/pictures.h"

#include <algorithm>
#include <cmath>
#include <opencv2/imgproc.hpp>

#include "intensity_place_recognition/scene_description.h"

namespace intensity_place_recognition {
namespace {

const cv::Scalar kWhite(255, 255, 255), kBlack(0, 0, 0), kGrey(210, 210, 210), kBlue(178, 114, 0);
constexpr int kCaption = 24, kBand = 4;  // pixels
constexpr int kMatrix = 800, kCurve = 400, kMargin = 50;

void write(cv::Mat& picture, const std::string& text, cv::Point at) {
  cv::putText(picture, text, at, cv::FONT_HERSHEY_SIMPLEX, 0.45, kBlack, 1, cv::LINE_AA);
}

}  // namespace

cv::Mat1b toPicture(const Panorama& panorama) {
  cv::Mat1b picture;
  normalizedImage(panorama, Image::kIntensity).convertTo(picture, CV_8U, 255.0);
  return picture;
}

cv::Mat drawPlaces(const cv::Mat1b& query, const cv::Mat1b& match, double yaw, const std::string& caption) {
  // What the match sees at an azimuth, the query sees at one smaller by yaw: further to the right.
  const int shift = static_cast<int>(std::lround(yaw / (2.0 * M_PI) * query.cols));
  cv::Mat1b turned(query.size());
  for (int x = 0; x < query.cols; ++x)
    query.col(((x + shift) % query.cols + query.cols) % query.cols).copyTo(turned.col(x));
  cv::Mat picture(kCaption + match.rows + kBand + query.rows, std::max(match.cols, query.cols), CV_8UC3,
                  kWhite);
  cv::Mat colour;
  cv::cvtColor(match, colour, cv::COLOR_GRAY2BGR);
  colour.copyTo(picture({0, kCaption, match.cols, match.rows}));
  cv::cvtColor(turned, colour, cv::COLOR_GRAY2BGR);
  colour.copyTo(picture({0, kCaption + match.rows + kBand, query.cols, query.rows}));
  write(picture, caption, {6, 16});
  return picture;
}

cv::Mat drawMatrix(const cv::Mat1f& values) {
  double largest = 0.0;
  cv::minMaxLoc(values, nullptr, &largest);
  cv::Mat picture, scaled = cv::max(values, 0.0f) * (255.0 / std::max(largest, 1e-9));
  scaled.convertTo(picture, CV_8U);
  const int factor = std::max(1, kMatrix / std::max(1, values.rows));
  cv::resize(picture, picture, {}, factor, factor, cv::INTER_NEAREST);
  cv::applyColorMap(picture, picture, cv::COLORMAP_VIRIDIS);
  return picture;
}

cv::Mat drawPrecisionRecall(const std::vector<cv::Point2d>& recall_and_precision) {
  cv::Mat picture(kCurve + 2 * kMargin, kCurve + 2 * kMargin, CV_8UC3, kWhite);
  const auto at = [](double x, double y) {
    return cv::Point(kMargin + cvRound(x * kCurve), kMargin + cvRound((1.0 - y) * kCurve));
  };
  for (int i = 0; i <= 5; ++i) {
    const double t = 0.2 * i;
    cv::line(picture, at(t, 0.0), at(t, 1.0), kGrey);
    cv::line(picture, at(0.0, t), at(1.0, t), kGrey);
    const std::string text = i == 5 ? "1" : "0." + std::to_string(2 * i);
    write(picture, text, at(t, 0.0) + cv::Point(-10, 18));
    write(picture, text, at(0.0, t) + cv::Point(-30, 5));
  }
  for (std::size_t i = 1; i < recall_and_precision.size(); ++i) {
    const cv::Point2d &a = recall_and_precision[i - 1], &b = recall_and_precision[i];
    cv::line(picture, at(a.x, a.y), at(b.x, b.y), kBlue, 2, cv::LINE_AA);
  }
  write(picture, "recall", at(0.45, 0.0) + cv::Point(0, 38));
  write(picture, "precision", {8, 30});
  return picture;
}

}  // namespace intensity_place_recognition
