// SPDX-License-Identifier: BSD-3-Clause
#include "ibuild_loop_closure/pictures.h"

#include <algorithm>
#include <opencv2/imgproc.hpp>

namespace ibuild_loop_closure {
namespace {

const cv::Scalar kWhite(255, 255, 255), kBlack(0, 0, 0), kGrey(200, 200, 200), kRed(0, 0, 220),
    kGreen(60, 180, 60);
constexpr int kCaption = 28;  // pixels

cv::Mat inColor(const cv::Mat& image) {
  cv::Mat color = image;
  if (color.depth() != CV_8U) cv::normalize(image, color, 0, 255, cv::NORM_MINMAX, CV_8U);
  if (color.channels() == 1) cv::cvtColor(color, color, cv::COLOR_GRAY2BGR);
  if (color.channels() == 4) cv::cvtColor(color, color, cv::COLOR_BGRA2BGR);
  return color;
}

void write(cv::Mat& picture, const std::string& text, cv::Point at, const cv::Scalar& color = kBlack) {
  cv::putText(picture, text, at, cv::FONT_HERSHEY_SIMPLEX, 0.5, color, 1, cv::LINE_AA);
}

}  // namespace

cv::Mat drawPair(const cv::Mat& query, const cv::Mat& match,
                 const std::vector<std::pair<cv::Point2f, cv::Point2f>>& points, const std::string& caption) {
  const cv::Mat left = inColor(match), right = inColor(query);
  cv::Mat picture(std::max(left.rows, right.rows) + kCaption, left.cols + right.cols, CV_8UC3, kWhite);
  left.copyTo(picture({0, kCaption, left.cols, left.rows}));
  right.copyTo(picture({left.cols, kCaption, right.cols, right.rows}));
  for (const auto& [q, m] : points) {
    const cv::Point from = m + cv::Point2f(0, kCaption),
                    to = q + cv::Point2f(static_cast<float>(left.cols), kCaption);
    cv::line(picture, from, to, kGreen, 1, cv::LINE_AA);
    cv::circle(picture, from, 2, kRed, -1, cv::LINE_AA);
    cv::circle(picture, to, 2, kRed, -1, cv::LINE_AA);
  }
  write(picture, caption, {8, 19});
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

cv::Mat drawSimilarities(const std::vector<std::vector<double>>& rows, int max_size) {
  const int size = static_cast<int>(rows.size());
  cv::Mat values = cv::Mat::zeros(std::max(1, size), std::max(1, size), CV_32F);
  for (int i = 0; i < size; ++i) {
    for (std::size_t j = 0; j < rows[i].size(); ++j)
      values.at<float>(i, static_cast<int>(j)) = static_cast<float>(rows[i][j]);
  }
  if (size > max_size) cv::resize(values, values, {max_size, max_size}, 0, 0, cv::INTER_AREA);
  double most = 0.0;
  cv::minMaxLoc(values, nullptr, &most);
  cv::Mat grey, color;
  values.convertTo(grey, CV_8U, most > 0.0 ? 255.0 / most : 1.0);
  cv::applyColorMap(grey, color, cv::COLORMAP_VIRIDIS);
  return color;
}

cv::Mat drawTrajectory(const std::vector<Eigen::Isometry3d>& poses, const std::vector<Proposal>& loops) {
  constexpr int kSize = 900, kMargin = 40;
  cv::Mat picture(kSize, kSize, CV_8UC3, kWhite);
  if (poses.empty()) return picture;
  Eigen::Vector3d low = poses[0].translation(), high = low;
  for (const Eigen::Isometry3d& pose : poses) {
    low = low.cwiseMin(pose.translation());
    high = high.cwiseMax(pose.translation());
  }
  int narrow = 0;
  (high - low).minCoeff(&narrow);
  const int x = narrow == 0 ? 1 : 0, y = narrow == 2 ? 1 : 2;
  const double extent = std::max({1e-9, (high - low)[x], (high - low)[y]});
  const auto pixel = [&](int i) {
    const Eigen::Vector3d p = (poses[i].translation() - low) * ((kSize - 2 * kMargin) / extent);
    return cv::Point(kMargin + cvRound(p[x]), kSize - kMargin - cvRound(p[y]));
  };
  for (int i = 1; i < static_cast<int>(poses.size()); ++i) {
    cv::line(picture, pixel(i - 1), pixel(i), kBlack, 1, cv::LINE_AA);
  }
  for (const Proposal& loop : loops) {
    if (!loop.accepted) continue;
    cv::line(picture, pixel(loop.query), pixel(loop.match), kRed, 1, cv::LINE_AA);
    cv::circle(picture, pixel(loop.query), 3, kRed, -1, cv::LINE_AA);
  }
  return picture;
}

cv::Mat drawCurves(const std::vector<NamedCurve>& curves) {
  constexpr int kSize = 600, kLeft = 60, kTop = 20, kLegend = 320;
  static const cv::Scalar kColors[] = {{180, 119, 31},  {14, 127, 255}, {44, 160, 44},   {40, 39, 214},
                                       {189, 103, 148}, {75, 86, 140},  {194, 119, 227}, {127, 127, 127}};
  cv::Mat picture(kSize + kTop + 50, kLeft + kSize + kLegend, CV_8UC3, kWhite);
  const auto pixel = [](double recall, double precision) {
    return cv::Point(kLeft + cvRound(recall * kSize), kTop + cvRound((1.0 - precision) * kSize));
  };
  for (int i = 0; i <= 10; i += 2) {
    cv::line(picture, pixel(0.1 * i, 0), pixel(0.1 * i, 1), kGrey);
    cv::line(picture, pixel(0, 0.1 * i), pixel(1, 0.1 * i), kGrey);
    const std::string label = cv::format("%.1f", 0.1 * i);
    write(picture, label, pixel(0.1 * i, 0) + cv::Point(-12, 20));
    write(picture, label, pixel(0, 0.1 * i) + cv::Point(-36, 5));
  }
  write(picture, "recall", pixel(0.45, 0) + cv::Point(0, 40));
  write(picture, "precision", {4, 14});
  int row = 0;
  for (const NamedCurve& curve : curves) {
    const cv::Scalar& color = kColors[row % 8];
    for (std::size_t i = 1; i < curve.points.size(); ++i) {
      const PrecisionRecall &a = curve.points[i - 1].at, &b = curve.points[i].at;
      cv::line(picture, pixel(a.recall(), a.precision()), pixel(b.recall(), b.precision()), color, 2,
               cv::LINE_AA);
    }
    write(picture, curve.name, {kLeft + kSize + 15, kTop + 20 + 22 * row++}, color);
  }
  return picture;
}

}  // namespace ibuild_loop_closure
