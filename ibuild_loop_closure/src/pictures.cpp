// SPDX-License-Identifier: BSD-3-Clause
#include "ibuild_loop_closure/pictures.h"

#include <algorithm>
#include <opencv2/imgproc.hpp>

namespace ibuild_loop_closure {
namespace {

const cv::Scalar kWhite(255, 255, 255), kBlack(0, 0, 0), kRed(0, 0, 220), kGreen(60, 180, 60);
constexpr int kCaption = 28;        // pixels
constexpr std::size_t kLines = 40;  // about; more hide the images

cv::Mat inColor(const cv::Mat& image) {
  cv::Mat color = image;
  if (color.depth() != CV_8U) cv::normalize(image, color, 0, 255, cv::NORM_MINMAX, CV_8U);
  if (color.channels() == 1) cv::cvtColor(color, color, cv::COLOR_GRAY2BGR);
  if (color.channels() == 4) cv::cvtColor(color, color, cv::COLOR_BGRA2BGR);
  return color;
}

}  // namespace

cv::Mat drawPair(const cv::Mat& query, const cv::Mat& match,
                 const std::vector<std::pair<cv::Point2f, cv::Point2f>>& points, const std::string& caption) {
  const cv::Mat left = inColor(match), right = inColor(query);
  cv::Mat picture(std::max(left.rows, right.rows) + kCaption, left.cols + right.cols, CV_8UC3, kWhite);
  left.copyTo(picture({0, kCaption, left.cols, left.rows}));
  right.copyTo(picture({left.cols, kCaption, right.cols, right.rows}));
  const std::size_t step = std::max<std::size_t>(1, points.size() / kLines);
  for (std::size_t i = 0; i < points.size(); i += step) {
    const auto& [q, m] = points[i];
    const cv::Point from = m + cv::Point2f(0, kCaption),
                    to = q + cv::Point2f(static_cast<float>(left.cols), kCaption);
    cv::line(picture, from, to, kGreen, 1, cv::LINE_AA);
    cv::circle(picture, from, 2, kRed, -1, cv::LINE_AA);
    cv::circle(picture, to, 2, kRed, -1, cv::LINE_AA);
  }
  cv::putText(picture, caption, {8, 19}, cv::FONT_HERSHEY_SIMPLEX, 0.5, kBlack, 1, cv::LINE_AA);
  return picture;
}

cv::Mat stack(const std::vector<cv::Mat>& pictures) {
  std::vector<cv::Mat> rows;
  for (const cv::Mat& picture : pictures) {
    const double factor = static_cast<double>(pictures[0].cols) / picture.cols;
    cv::Mat row;
    cv::resize(picture, row, {pictures[0].cols, std::max(1, cvRound(factor * picture.rows))}, 0, 0,
               cv::INTER_AREA);
    rows.push_back(row);
  }
  cv::Mat all;
  if (!rows.empty()) cv::vconcat(rows, all);
  return all;
}

}  // namespace ibuild_loop_closure
