// SPDX-License-Identifier: BSD-3-Clause
#include "laser_intensity_calib/fit.h"

#include <Eigen/QR>
#include <algorithm>
#include <map>
#include <stdexcept>
#include <utility>

#include "delaunay.h"

namespace laser_intensity_calib {
namespace {

constexpr float kNan = std::numeric_limits<float>::quiet_NaN();
constexpr double kRadians = M_PI / 180.0;

bool isUsable(const Sample& s) {
  return std::isfinite(s.range) && s.range > 0.0F && std::isfinite(s.intensity) && s.intensity > 0.0F &&
         std::isfinite(s.incidence) && s.incidence >= 0.0F;
}

double medianOf(std::vector<float>& values) {
  const auto middle = values.begin() + values.size() / 2;
  std::nth_element(values.begin(), middle, values.end());
  return *middle;
}

// The usable samples, less the offsets of their lasers.
std::vector<Sample> withoutOffsets(const std::vector<float>& offsets, const std::vector<Sample>& samples) {
  Calibration c;
  c.offsets = offsets;
  std::vector<Sample> kept;
  for (Sample s : samples) {
    s.intensity = c.withoutOffset(s.intensity, s.laser);
    if (isUsable(s)) kept.push_back(s);
  }
  return kept;
}

std::pair<int, int> cellOf(const Sample& s, const FitOptions& options) {
  return {static_cast<int>(s.range / options.range_cell),
          static_cast<int>(s.incidence / options.incidence_cell)};
}

// Neighbouring scans show much the same, so that folds are made of runs of them.
class Folds {
 public:
  Folds(const std::vector<Sample>& samples, int folds) {
    for (const Sample& s : samples) rank_[s.scan] = 0;
    int next = 0;
    for (auto& [scan, rank] : rank_) rank = next++;
    count_ = std::min(folds, next);
    run_ = std::max(1, next / (4 * std::max(1, count_)));
  }
  int count() const { return count_; }
  std::size_t scans() const { return rank_.size(); }
  /// Those of a fold, and all others.
  std::pair<std::vector<Sample>, std::vector<Sample>> split(const std::vector<Sample>& samples,
                                                            int fold) const {
    std::pair<std::vector<Sample>, std::vector<Sample>> parts;
    for (const Sample& s : samples) {
      (rank_.at(s.scan) / run_ % count_ == fold ? parts.first : parts.second).push_back(s);
    }
    return parts;
  }

 private:
  std::map<int, int> rank_;
  int count_, run_;
};

// What is missing, "" if nothing.
template <class Fit>
std::string tryTo(const Fit& fit) {
  try {
    fit();
    return "";
  } catch (const std::invalid_argument& e) {
    return e.what();
  }
}

// The errors of several folds together.
class ErrorSum {
 public:
  void add(const Calibration& calibration, ModelType type, const std::vector<Sample>& samples) {
    for (const Sample& s : samples) {
      ++all_;
      if (!calibration.has(type)) continue;
      const Response f = calibration.at(type, s.range, s.incidence);
      if (f.inside) errors_.push_back(std::abs(s.intensity / f.intensity - 1.0F));
    }
  }
  Residuals residuals() {
    Residuals r;
    if (errors_.empty()) return r;
    double squares = 0.0;
    for (const float e : errors_) squares += static_cast<double>(e) * e;
    r.rms = std::sqrt(squares / static_cast<double>(errors_.size()));
    r.median = medianOf(errors_);
    r.covered = static_cast<double>(errors_.size()) / static_cast<double>(all_);
    return r;
  }

 private:
  std::size_t all_ = 0;
  std::vector<float> errors_;
};

double medianIntensity(const std::vector<Sample>& samples) {
  std::vector<float> intensities;
  for (const Sample& s : samples) intensities.push_back(s.intensity);
  return medianOf(intensities);
}

std::vector<Sample> nearNormal(const std::vector<Sample>& samples, double limit) {
  std::vector<Sample> kept;
  std::copy_if(samples.begin(), samples.end(), std::back_inserter(kept),
               [limit](const Sample& s) { return s.incidence <= limit; });
  return kept;
}

// The degree with the least error in the scans left out; lower ones first where they are as good.
RangePolynomial bestPolynomial(const std::vector<Sample>& samples, const FitOptions& options) {
  const std::vector<Sample> normal = nearNormal(samples, options.normal_incidence);
  const Folds folds(normal, options.folds);
  int best = 0;
  double best_error = std::numeric_limits<double>::infinity();
  for (int degree = 0; degree <= options.max_degree && folds.count() > 1; ++degree) {
    ErrorSum errors;
    try {
      for (int fold = 0; fold < folds.count(); ++fold) {
        const auto [test, training] = folds.split(normal, fold);
        Calibration c;
        c.polynomial = fitPolynomial(training, degree, options);
        errors.add(c, ModelType::kRange, test);
      }
    } catch (const std::invalid_argument&) {
      continue;  // this degree isn't supported by what is left, or swings below zero
    }
    const Residuals r = errors.residuals();
    if (r.covered > 0.0 && r.rms < 0.99 * best_error) {
      best = degree;
      best_error = r.rms;
    }
  }
  return fitPolynomial(samples, best, options);
}

// Values at the nodes inside of a triangle, by barycentric coordinates.
void rasterise(const std::array<Eigen::Vector3d, 3>& corner, const Axis& range, const Axis& incidence,
               Eigen::ArrayXXf& values) {
  const auto cross = [](const Eigen::Vector2d& a, const Eigen::Vector2d& b) {
    return a.x() * b.y() - a.y() * b.x();
  };
  const Eigen::Vector2d a = corner[0].head<2>(), ab = corner[1].head<2>() - a, ac = corner[2].head<2>() - a;
  const double area = cross(ab, ac);
  if (!(std::abs(area) > 1e-12)) return;
  const auto bounds = [&](int axis_index, const Axis& axis) {
    const auto [low, high] =
        std::minmax({corner[0][axis_index], corner[1][axis_index], corner[2][axis_index]});
    return std::pair<int, int>{
        std::max(0, static_cast<int>(std::ceil((low - axis.min) / axis.step - 1e-9))),
        std::min(axis.count - 1, static_cast<int>(std::floor((high - axis.min) / axis.step + 1e-9)))};
  };
  const auto [r_first, r_last] = bounds(0, range);
  const auto [a_first, a_last] = bounds(1, incidence);
  constexpr double kOnTheEdge = -1e-9;
  for (int r = r_first; r <= r_last; ++r) {
    for (int i = a_first; i <= a_last; ++i) {
      const Eigen::Vector2d p = Eigen::Vector2d(range.at(r), incidence.at(i)) - a;
      const double v = cross(p, ac) / area, w = cross(ab, p) / area, u = 1.0 - v - w;
      if (u < kOnTheEdge || v < kOnTheEdge || w < kOnTheEdge) continue;
      values(r, i) = static_cast<float>(u * corner[0].z() + v * corner[1].z() + w * corner[2].z());
    }
  }
}

}  // namespace

std::vector<Cell> sumUp(const std::vector<Sample>& samples, const FitOptions& options) {
  mapping_common::validate(options);
  std::map<std::pair<int, int>, std::vector<const Sample*>> members;
  for (const Sample& s : samples) {
    if (!isUsable(s)) continue;
    members[cellOf(s, options)].push_back(&s);
  }
  std::vector<Cell> cells;
  for (const auto& [key, list] : members) {
    if (static_cast<int>(list.size()) < options.min_samples) continue;
    Cell cell{0.0, 0.0, 0.0, 0.0, static_cast<int>(list.size())};
    std::vector<float> intensities;
    for (const Sample* s : list) {
      cell.range += s->range / static_cast<double>(list.size());
      cell.incidence += s->incidence / static_cast<double>(list.size());
      intensities.push_back(s->intensity);
    }
    cell.intensity = medianOf(intensities);
    for (float& i : intensities) i = std::abs(i - static_cast<float>(cell.intensity));
    cell.spread = 1.4826 * medianOf(intensities);
    cells.push_back(cell);
  }
  return cells;
}

RangePolynomial fitPolynomial(const std::vector<Sample>& samples, int degree, const FitOptions& options) {
  FitOptions over_range = options;
  over_range.incidence_cell = 0.5 * M_PI;
  const std::vector<Cell> cells = sumUp(nearNormal(samples, options.normal_incidence), over_range);
  if (static_cast<int>(cells.size()) < std::max(2, degree + 1)) {
    throw std::invalid_argument(
        "the range model has " + std::to_string(cells.size()) +
        " distances with enough samples at near normal incidence, a polynomial of degree " +
        std::to_string(degree) + " needs " + std::to_string(std::max(2, degree + 1)));
  }
  const Interval range{cells.front().range, cells.back().range};
  Eigen::MatrixXd powers(cells.size(), degree + 1);
  Eigen::VectorXd intensity(cells.size());
  for (std::size_t i = 0; i < cells.size(); ++i) {
    const double t = (2.0 * cells[i].range - range.min - range.max) / (range.max - range.min);
    for (int k = 0; k <= degree; ++k) powers(i, k) = k == 0 ? 1.0 : powers(i, k - 1) * t;
    intensity[i] = cells[i].intensity;
  }
  const Eigen::VectorXd c = powers.colPivHouseholderQr().solve(intensity);
  return RangePolynomial(range, {c.data(), c.data() + c.size()});
}

LookupTable fitTable(const std::vector<Cell>& cells, const FitOptions& options) {
  mapping_common::validate(options);
  std::vector<Eigen::Vector3d> points;  // range and angle in cells, intensity
  double max_range = 0.0, min_range = std::numeric_limits<double>::infinity(), max_incidence = 0.0;
  for (const Cell& cell : cells) {
    const double r = cell.range / options.range_cell, a = cell.incidence / options.incidence_cell;
    points.emplace_back(r, a, cell.intensity);
    if (a < 1.5) points.emplace_back(r, -a, cell.intensity);
    min_range = std::min(min_range, cell.range);
    max_range = std::max(max_range, cell.range);
    max_incidence = std::max(max_incidence, cell.incidence);
  }
  Eigen::Matrix2Xd plane(2, points.size());
  for (std::size_t i = 0; i < points.size(); ++i) plane.col(i) = points[i].head<2>();
  const std::vector<Triangle> triangles = triangulate(plane);

  const auto axis = [](double min, double max, double step) {
    const int first = static_cast<int>(std::floor(min / step)),
              last = static_cast<int>(std::ceil(max / step));
    return Axis{first * step, step, std::max(2, last - first + 1)};
  };
  const Axis range = axis(min_range, max_range, options.range_step);
  const Axis incidence = axis(0.0, max_incidence, options.incidence_step);
  const Axis range_in_cells{range.min / options.range_cell, range.step / options.range_cell, range.count};
  const Axis incidence_in_cells{0.0, incidence.step / options.incidence_cell, incidence.count};
  Eigen::ArrayXXf values = Eigen::ArrayXXf::Constant(range.count, incidence.count, kNan);
  for (const Triangle& t : triangles) {
    const std::array<Eigen::Vector3d, 3> corner = {points[t[0]], points[t[1]], points[t[2]]};
    double edge = 0.0;
    for (int i = 0; i < 3; ++i) {
      edge = std::max(edge, (corner[i] - corner[(i + 1) % 3]).head<2>().norm());
    }
    if (options.max_edge > 0.0 && edge > options.max_edge) continue;
    rasterise(corner, range_in_cells, incidence_in_cells, values);
  }
  if (values.isNaN().all()) {
    throw std::invalid_argument(
        "no node of the table is between samples: they are too close to a line, or its "
        "steps are too large");
  }
  return LookupTable(range, incidence, values);
}

std::vector<float> fitOffsets(const std::vector<Sample>& samples, const FitOptions& options) {
  mapping_common::validate(options);
  std::map<std::pair<int, int>, std::vector<const Sample*>> cells;
  std::map<int, std::size_t> counts;
  for (const Sample& s : samples) {
    if (!isUsable(s)) continue;
    if (s.laser < 0) throw std::invalid_argument("a laser has the number " + std::to_string(s.laser));
    cells[cellOf(s, options)].push_back(&s);
    ++counts[s.laser];
  }
  if (counts.size() < 2) {
    throw std::invalid_argument("the samples are of one laser: offsets need a cloud with the field ring");
  }
  // Least squares, in turns: the level of each cell, then the offset of each laser. Means, as medians of two
  // kinds of lasers would jump from one to the other.
  std::vector<double> offsets(counts.rbegin()->first + 1, 0.0);
  constexpr int kTurns = 30;
  for (int turn = 0; turn < kTurns; ++turn) {
    std::vector<double> residuals(offsets.size(), 0.0), weights(offsets.size(), 0.0);
    for (const auto& [key, members] : cells) {
      double level = 0.0;
      for (const Sample* s : members)
        level += (s->intensity - offsets[s->laser]) / static_cast<double>(members.size());
      for (const Sample* s : members) {
        residuals[s->laser] += s->intensity - level;
        weights[s->laser] += 1.0;
      }
    }
    for (std::size_t laser = 0; laser < offsets.size(); ++laser) {
      if (weights[laser] > 0.0) offsets[laser] = residuals[laser] / weights[laser];
    }
  }
  double sum = 0.0;
  int known = 0;
  for (std::size_t laser = 0; laser < offsets.size(); ++laser) {
    if (counts[static_cast<int>(laser)] < 10U * options.min_samples) {
      offsets[laser] = kNan;
    } else {
      sum += offsets[laser];
      ++known;
    }
  }
  std::vector<float> result;
  for (const double offset : offsets) result.push_back(static_cast<float>(offset - sum / known));
  return result;
}

Calibration calibrate(const std::vector<Sample>& all, const FitOptions& options,
                      std::vector<std::string>* problems, const std::function<void(double)>& progress) {
  mapping_common::validate(options);
  std::vector<float> offsets;  // few against the samples, so that cross-validation needn't fit them anew
  if (options.offsets) offsets = fitOffsets(all, options);
  const std::vector<Sample> samples = withoutOffsets(offsets, all);
  const Folds folds(samples, options.folds);
  if (folds.count() < 2) {
    throw std::invalid_argument("samples of " + std::to_string(folds.scans()) +
                                " scans, cross-validation needs those of two at least");
  }
  Calibration c;
  c.offsets = offsets;
  c.samples = samples.size();
  c.scans = folds.scans();
  const auto spanOf = [&samples](float Sample::*member) {
    const auto less = [member](const Sample& a, const Sample& b) { return a.*member < b.*member; };
    const auto [min, max] = std::minmax_element(samples.begin(), samples.end(), less);
    return Interval{(*min).*member, (*max).*member};
  };
  c.range = spanOf(&Sample::range);
  c.incidence = spanOf(&Sample::incidence);
  c.raw = medianIntensity(samples);
  const std::string no_range = tryTo([&] { c.polynomial = bestPolynomial(samples, options); });
  const std::string no_table = tryTo([&] { c.table = fitTable(sumUp(samples, options), options); });
  if (!no_range.empty() && !no_table.empty()) throw std::invalid_argument(no_range + "; " + no_table);
  if (problems != nullptr) {
    if (!no_range.empty()) problems->push_back("No range model: " + no_range);
    if (!no_table.empty()) problems->push_back("No table: " + no_table);
  }

  std::array<ErrorSum, kModelTypes.size()> errors;
  const int degree = static_cast<int>(c.polynomial.coefficients().size()) - 1;
  for (int fold = 0; fold < folds.count(); ++fold) {
    const auto [test, training] = folds.split(samples, fold);
    Calibration part;
    part.raw = medianIntensity(training);
    // Without a model, none of the samples counts as covered.
    if (c.has(ModelType::kRange)) tryTo([&] { part.polynomial = fitPolynomial(training, degree, options); });
    if (c.has(ModelType::kLut)) tryTo([&] { part.table = fitTable(sumUp(training, options), options); });
    for (const ModelType type : kModelTypes) errors[static_cast<int>(type)].add(part, type, test);
    if (progress) progress((fold + 1.0) / folds.count());
  }
  for (std::size_t i = 0; i < errors.size(); ++i) c.residuals[i] = errors[i].residuals();
  return c;
}

Residuals residualsOf(const Calibration& calibration, ModelType type, const std::vector<Sample>& samples) {
  ErrorSum errors;
  errors.add(calibration, type, withoutOffsets(calibration.offsets, samples));
  return errors.residuals();
}

}  // namespace laser_intensity_calib
