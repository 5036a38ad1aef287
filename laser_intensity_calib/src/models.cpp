// SPDX-License-Identifier: BSD-3-Clause
#include "laser_intensity_calib/models.h"

#include <algorithm>
#include <queue>
#include <stdexcept>
#include <tuple>

namespace laser_intensity_calib {
namespace {

constexpr float kNan = std::numeric_limits<float>::quiet_NaN();

// Gives nodes without a value that of the nearest node with one, distances in steps: the sources spread node
// by node, nearest first.
Eigen::ArrayXXf fillFromNearest(const Eigen::ArrayXXf& values) {
  using Candidate = std::tuple<float, int, int, int, int>;  // squared distance, node, source
  std::priority_queue<Candidate, std::vector<Candidate>, std::greater<Candidate>> queue;
  Eigen::ArrayXXf filled = values;
  const auto spread = [&](int row, int column, int source_row, int source_column) {
    for (int r = std::max(0, row - 1); r <= row + 1 && r < filled.rows(); ++r) {
      for (int c = std::max(0, column - 1); c <= column + 1 && c < filled.cols(); ++c) {
        if (!std::isnan(filled(r, c))) continue;
        const float dr = static_cast<float>(r - source_row), dc = static_cast<float>(c - source_column);
        queue.emplace(dr * dr + dc * dc, r, c, source_row, source_column);
      }
    }
  };
  for (int r = 0; r < values.rows(); ++r) {
    for (int c = 0; c < values.cols(); ++c) {
      if (!std::isnan(values(r, c))) spread(r, c, r, c);
    }
  }
  while (!queue.empty()) {
    const auto [distance, row, column, source_row, source_column] = queue.top();
    queue.pop();
    if (!std::isnan(filled(row, column))) continue;
    filled(row, column) = values(source_row, source_column);
    spread(row, column, source_row, source_column);
  }
  return filled;
}

// Node below a coordinate and the share of the next one.
std::pair<int, float> locate(const Axis& axis, float coordinate) {
  const double position = std::clamp((coordinate - axis.min) / axis.step, 0.0, axis.count - 1.0);
  const int below = std::min(static_cast<int>(position), axis.count - 2);
  return {below, static_cast<float>(position - below)};
}

bool isWithin(const Axis& axis, float coordinate) {
  return coordinate >= axis.min - 0.5 * axis.step && coordinate <= axis.max() + 0.5 * axis.step;
}

}  // namespace

RangePolynomial::RangePolynomial(const Interval& range, std::vector<double> coefficients)
    : range_(range), coefficients_(std::move(coefficients)) {
  if (!(range.min > 0.0) || !(range.max > range.min) || !std::isfinite(range.max) || coefficients_.empty()) {
    throw std::invalid_argument("a polynomial needs a coefficient and a range: 0 < min < max");
  }
  constexpr int kChecks = 200;
  for (int i = 0; i <= kChecks; ++i) {
    const double r = range.min + (range.max - range.min) * i / kChecks;
    if (value(r) > 0.0) continue;
    throw std::invalid_argument("the polynomial isn't positive at " + std::to_string(r) + " m");
  }
}

double RangePolynomial::value(double range) const {
  const double t = (2.0 * range - range_.min - range_.max) / (range_.max - range_.min);
  double sum = 0.0;
  for (auto c = coefficients_.rbegin(); c != coefficients_.rend(); ++c) sum = sum * t + *c;
  return sum;
}

Response RangePolynomial::at(float range) const {
  return {static_cast<float>(value(std::clamp<double>(range, range_.min, range_.max))),
          range >= range_.min && range <= range_.max};
}

LookupTable::LookupTable(const Axis& range, const Axis& incidence, const Eigen::ArrayXXf& values)
    : range_(range), incidence_(incidence), values_(values) {
  for (const Axis* axis : {&range, &incidence}) {
    if (!(axis->step > 0.0) || axis->count < 2 || !std::isfinite(axis->max()) || !(axis->min >= 0.0)) {
      throw std::invalid_argument("an axis needs two nodes, a positive step and a start from 0");
    }
  }
  if (values.rows() != range.count || values.cols() != incidence.count) {
    throw std::invalid_argument(std::to_string(values.rows()) + " x " + std::to_string(values.cols()) +
                                " values, expected " + std::to_string(range.count) + " x " +
                                std::to_string(incidence.count));
  }
  if (values.isNaN().all()) throw std::invalid_argument("no value in the table");
  if (!(values.isNaN() || (values > 0.0F && values.isFinite())).all()) {
    throw std::invalid_argument("a value that is neither positive nor NaN");
  }
  filled_ = fillFromNearest(values);
}

Response LookupTable::at(float range, float incidence) const {
  const auto [r, dr] = locate(range_, range);
  const auto [a, da] = locate(incidence_, incidence);
  const float low = filled_(r, a) + da * (filled_(r, a + 1) - filled_(r, a));
  const float high = filled_(r + 1, a) + da * (filled_(r + 1, a + 1) - filled_(r + 1, a));
  const bool inside = isWithin(range_, range) && isWithin(incidence_, incidence) &&
                      !std::isnan(values_(r + (dr > 0.5F), a + (da > 0.5F)));
  return {low + dr * (high - low), inside};
}

bool Calibration::has(ModelType type) const {
  return type == ModelType::kRaw || (type == ModelType::kRange ? !polynomial.empty() : !table.empty());
}

float Calibration::withoutOffset(float intensity, int laser) const {
  if (offsets.empty()) return intensity;
  if (laser < 0 || laser >= static_cast<int>(offsets.size()) || !(intensity > 0.0F)) return kNan;
  return std::isnan(offsets[laser]) ? kNan : std::max(0.0F, intensity - offsets[laser]);
}

Eigen::ArrayXf withoutOffsets(const Calibration& calibration,
                              const Eigen::Ref<const Eigen::ArrayXf>& intensities,
                              const Eigen::Ref<const Eigen::ArrayXi>& lasers) {
  if (calibration.offsets.empty()) return intensities;
  if (lasers.size() != intensities.size()) {
    throw std::invalid_argument(
        "the calibration has an offset for each laser, and what is measured doesn't say its laser (field "
        "ring of a cloud)");
  }
  return intensities.binaryExpr(lasers.cast<float>(), [&calibration](float intensity, float laser) {
    return calibration.withoutOffset(intensity, static_cast<int>(laser));
  });
}

Response Calibration::at(ModelType type, float range, float incidence) const {
  switch (type) {
    case ModelType::kRaw:
      return {static_cast<float>(raw), true};
    case ModelType::kRange:
      return polynomial.at(range);
    case ModelType::kLut:
      break;
  }
  return std::isnan(incidence) ? Response() : table.at(range, incidence);
}

ReflectivityCounts& ReflectivityCounts::operator+=(const ReflectivityCounts& other) {
  valid += other.valid;
  no_return += other.no_return;
  bad_intensity += other.bad_intensity;
  no_incidence += other.no_incidence;
  outside += other.outside;
  return *this;
}

Eigen::ArrayXf reflectivity(const Calibration& calibration, ModelType type, OutsidePolicy policy,
                            const Eigen::Ref<const Eigen::ArrayXf>& ranges,
                            const Eigen::Ref<const Eigen::ArrayXf>& incidence,
                            const Eigen::Ref<const Eigen::ArrayXf>& intensities, ReflectivityCounts* counts) {
  const Eigen::Index n = ranges.size();
  if (intensities.size() != n ||
      (incidence.size() != n && (type == ModelType::kLut || incidence.size() > 0))) {
    throw std::invalid_argument(std::to_string(n) + " ranges, " + std::to_string(incidence.size()) +
                                " angles of incidence and " + std::to_string(intensities.size()) +
                                " intensities, expected as many of each");
  }
  if (!calibration.has(type)) {
    throw std::invalid_argument("the calibration has no model " + toString(type));
  }
  Eigen::ArrayXf result = Eigen::ArrayXf::Constant(n, kNan);
  ReflectivityCounts c;
  for (Eigen::Index i = 0; i < n; ++i) {
    if (!(std::isfinite(ranges[i]) && ranges[i] > 0.0F)) {
      ++c.no_return;
      continue;
    }
    if (!(std::isfinite(intensities[i]) && intensities[i] >= 0.0F)) {
      ++c.bad_intensity;
      continue;
    }
    const Response reference = calibration.at(type, ranges[i], incidence.size() > 0 ? incidence[i] : kNan);
    if (std::isnan(reference.intensity)) {
      ++c.no_incidence;
      continue;
    }
    c.outside += reference.inside ? 0 : 1;
    if (!reference.inside && policy == OutsidePolicy::kDrop) continue;
    result[i] = intensities[i] / reference.intensity;
    ++c.valid;
  }
  if (counts != nullptr) *counts += c;
  return result;
}

}  // namespace laser_intensity_calib
