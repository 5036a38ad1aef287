// SPDX-License-Identifier: BSD-3-Clause
#include <algorithm>
#include <limits>

#include "laser_intensity_calib/incidence.h"

namespace laser_intensity_calib {
namespace {

constexpr float kNan = std::numeric_limits<float>::quiet_NaN();
constexpr double kRadians = M_PI / 180.0;

using Sums = Eigen::Array<double, 5, 1>;

// The straight line through the points of a window.
struct Line {
  double x = 0.0, y = 0.0;                                             // m, the mean of the points
  double xx = 0.0, yy = 0.0, xy = 0.0;                                 // m^2, their covariance
  double variance_of_angle = std::numeric_limits<double>::infinity();  // rad^2

  double largest = 0.0;  // m^2, eigenvalue of the covariance

  // Covariance - largest * identity is a multiple of n n^T: the longer of its rows.
  Eigen::Vector2d normal() const {
    const Eigen::Vector2d n = xx > yy ? Eigen::Vector2d(xy, yy - largest) : Eigen::Vector2d(xx - largest, xy);
    return n.normalized();
  }
};

Line fitLine(const Sums& sums, int count) {
  const Sums mean = sums / count;
  Line line;
  line.x = mean[0];
  line.y = mean[1];
  line.xx = mean[2] - line.x * line.x;
  line.yy = mean[3] - line.y * line.y;
  line.xy = mean[4] - line.x * line.y;
  const double half_trace = 0.5 * (line.xx + line.yy), half_difference = 0.5 * (line.xx - line.yy);
  const double root = std::sqrt(half_difference * half_difference + line.xy * line.xy);
  line.largest = half_trace + root;
  const double smallest = std::max(0.0, half_trace - root);
  // Of the slope of a line with n - 2 degrees of freedom.
  if (line.largest > 0.0) line.variance_of_angle = smallest / (line.largest * (count - 2));
  return line;
}

}  // namespace

ScanIncidence::ScanIncidence(const ScanIncidenceOptions& options)
    : options_(mapping_common::validate(options)) {}

// Runs of beams whose neighbours are no farther apart than on a surface at max_incidence (the adaptive
// breakpoint detector of Borges and Aldon, 2004), and the sums that any window's covariance comes from.
void ScanIncidence::findSegments(const Eigen::Ref<const Eigen::ArrayXf>& ranges, double angle_min,
                                 double angle_increment) {
  const int n = static_cast<int>(ranges.size());
  if (directions_.cols() != n || angle_min != angle_min_ || angle_increment != angle_increment_) {
    const Eigen::ArrayXd angles = angle_min + angle_increment * Eigen::ArrayXd::LinSpaced(n, 0.0, n - 1.0);
    directions_.resize(2, n);
    directions_.row(0) = angles.cos().transpose();
    directions_.row(1) = angles.sin().transpose();
    angle_min_ = angle_min;
    angle_increment_ = angle_increment;
  }
  points_ = directions_.rowwise() * ranges.cast<double>().transpose();

  sums_.resize(5, n + 1);
  sums_.col(0).setZero();
  begin_.setZero(n);
  end_.setZero(n);
  const double stretch = std::abs(angle_increment) / std::cos(options_.max_incidence);
  int begin = 0;
  const auto close = [&](int end) {
    begin_.segment(begin, end - begin) = begin;
    end_.segment(begin, end - begin) = end;
    begin = end;
  };
  bool measured = false;
  for (int i = 0; i < n; ++i) {
    const bool before = measured;
    measured = std::isfinite(ranges[i]) && ranges[i] > 0.0F;
    if (!measured) {
      if (before) close(i);
      begin = i + 1;
      sums_.col(i + 1) = sums_.col(i);
      continue;
    }
    if (before) {
      const double gap = (points_.col(i) - points_.col(i - 1)).matrix().norm();
      if (gap > stretch * std::min(ranges[i], ranges[i - 1]) + 3.0 * options_.range_noise) close(i);
    }
    const double x = points_(0, i), y = points_(1, i);
    sums_.col(i + 1) = sums_.col(i) + (Sums() << x, y, x * x, y * y, x * y).finished();
  }
  if (measured) close(n);
}

const Eigen::ArrayXf& ScanIncidence::estimate(const Eigen::Ref<const Eigen::ArrayXf>& ranges,
                                              double angle_min, double angle_increment) {
  const int n = static_cast<int>(ranges.size());
  incidence_.setConstant(n, kNan);
  findSegments(ranges, angle_min, angle_increment);
  const double max_variance = options_.max_error * options_.max_error;
  for (int i = 0; i < n; ++i) {
    const int begin = begin_[i], end = end_[i];
    if (end - begin < options_.min_window) continue;
    const double beams = options_.min_length / (ranges[i] * std::abs(angle_increment)) + 1.0;
    const int window = static_cast<int>(
        std::min(std::max<double>(std::ceil(beams), options_.min_window), static_cast<double>(end - begin)));
    Line best;
    for (const int back : {window - 1, window / 2, 0}) {
      const int first = std::clamp(i - back, begin, end - window);
      const Line line = fitLine(sums_.col(first + window) - sums_.col(first), window);
      if (line.variance_of_angle < best.variance_of_angle) best = line;
    }
    if (!(best.variance_of_angle <= max_variance)) continue;
    const Eigen::Vector2d normal = best.normal();
    const double cosine = std::abs(normal.dot(directions_.col(i).matrix()));
    const double off = std::abs(normal.dot(points_.col(i).matrix() - Eigen::Vector2d(best.x, best.y)));
    if (off > 3.0 * options_.range_noise * cosine + 1e-6) continue;  // measured along the beam
    incidence_[i] = static_cast<float>(std::acos(std::min(1.0, cosine)));
  }
  return incidence_;
}

}  // namespace laser_intensity_calib
