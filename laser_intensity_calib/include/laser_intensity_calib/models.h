// SPDX-License-Identifier: BSD-3-Clause
//
// What intensity a scanner reports of the reference surface: I_ref(r, alpha), three models of it
// (thesis, 3.3.2 and 3.5.1), and reflectivity as I_rec / I_ref (Eq. 3.5).
#pragma once

#include <mapping_common/options.h>

#include <Eigen/Core>
#include <array>
#include <cmath>
#include <cstddef>
#include <limits>
#include <string>
#include <vector>

namespace laser_intensity_calib {

/// What intensity the reference surface would have.
enum class ModelType { kRaw, kRange, kLut };
constexpr std::array<ModelType, 3> kModelTypes = {ModelType::kRaw, ModelType::kRange, ModelType::kLut};
constexpr auto choicesOf(ModelType) {
  return mapping_common::choices<ModelType>(
      {{"raw", ModelType::kRaw, "a constant"},
       {"range", ModelType::kRange, "a polynomial in the range"},
       {"lut", ModelType::kLut, "a table over range and angle of incidence"}});
}
inline std::string toString(ModelType type) {
  return mapping_common::nameOf(type);
}

/// What becomes of a measurement at a range or angle at which the reference surface wasn't seen.
enum class OutsidePolicy { kDrop, kClamp };
constexpr auto choicesOf(OutsidePolicy) {
  return mapping_common::choices<OutsidePolicy>(
      {{"drop", OutsidePolicy::kDrop, "it has no reflectivity (NaN)"},
       {"clamp", OutsidePolicy::kClamp, "it gets that of the nearest range and angle at which it was"}});
}

/// The value of a model and whether the calibration covers the place. Outside, it is that of the nearest
/// place inside.
struct Response {
  float intensity = std::numeric_limits<float>::quiet_NaN();
  bool inside = false;
};

struct Interval {
  double min = 0.0, max = 0.0;
};

/// f(r), a polynomial in r scaled from `range` to [-1, 1].
class RangePolynomial {
 public:
  RangePolynomial() = default;
  /// @param range m, within which it holds
  /// @param coefficients of 1, t, t^2 ...
  /// @throws std::invalid_argument if there is no range, no coefficient, or if it isn't positive all over it
  RangePolynomial(const Interval& range, std::vector<double> coefficients);

  const Interval& range() const { return range_; }
  const std::vector<double>& coefficients() const { return coefficients_; }
  bool empty() const { return coefficients_.empty(); }

  double value(double range) const;
  Response at(float range) const;

 private:
  Interval range_;
  std::vector<double> coefficients_;
};

/// Evenly spaced nodes.
struct Axis {
  double min = 0.0, step = 1.0;
  int count = 0;

  double at(int i) const { return min + i * step; }
  double max() const { return at(count - 1); }
};

/// f(r, alpha) at the nodes of a fine grid, NaN where the reference surface wasn't seen. Between nodes it is
/// interpolated linearly along both axes; a place is inside if the nearest node has a value.
class LookupTable {
 public:
  LookupTable() = default;
  /// @param range m
  /// @param incidence rad
  /// @param values one row for each range, one column for each angle; positive or NaN
  /// @throws std::invalid_argument that says what doesn't fit
  LookupTable(const Axis& range, const Axis& incidence, const Eigen::ArrayXXf& values);

  const Axis& range() const { return range_; }
  const Axis& incidence() const { return incidence_; }
  const Eigen::ArrayXXf& values() const { return values_; }
  bool empty() const { return values_.size() == 0; }

  Response at(float range, float incidence) const;

 private:
  Axis range_, incidence_;
  Eigen::ArrayXXf values_;
  Eigen::ArrayXXf filled_;  // nodes without a value have that of the nearest one
};

/// How well a model tells intensities of the reference surface in scans that it wasn't fitted to: of
/// I / f - 1.
struct Residuals {
  double rms = 0.0;
  double median = 0.0;   ///< of its absolute
  double covered = 0.0;  ///< share of the samples that the model covers, the others aren't counted above
};

/// All that is known of how a scanner sees the reference surface.
struct Calibration {
  std::string scanner, reference;  ///< as the user calls them
  std::string date;                ///< ISO 8601
  std::string source;              ///< where the samples come from
  std::size_t samples = 0, scans = 0;
  Interval range, incidence;   ///< m, rad, of the samples
  double raw = 1.0;            ///< median intensity
  std::vector<float> offsets;  ///< what each laser of a scanner adds to its intensities; empty: nothing
  RangePolynomial polynomial;
  LookupTable table;
  std::array<Residuals, kModelTypes.size()> residuals;

  bool has(ModelType type) const;
  /// Intensity less the offset of its laser, 0 at least. With offsets, NaN for a laser that has none, and for
  /// 0, which lasers report below their threshold.
  float withoutOffset(float intensity, int laser) const;
  /// NaN if the model needs the angle of incidence and that is NaN.
  Response at(ModelType type, float range, float incidence) const;
};

/// What became of the measurements.
struct ReflectivityCounts {
  std::size_t valid = 0;          ///< have a reflectivity
  std::size_t no_return = 0;      ///< range not finite or not positive
  std::size_t bad_intensity = 0;  ///< intensity not finite or negative, or of a laser without an offset
  std::size_t no_incidence = 0;   ///< the model needs the angle of incidence, which is not known
  std::size_t outside = 0;        ///< not covered by the calibration: dropped, or among the valid if clamped

  ReflectivityCounts& operator+=(const ReflectivityCounts& other);
};

/// Intensities less the offsets of their lasers, see Calibration::withoutOffset.
/// @param lasers the number of each, empty where they aren't known
/// @throws std::invalid_argument if the calibration has offsets and the lasers aren't known
Eigen::ArrayXf withoutOffsets(const Calibration& calibration,
                              const Eigen::Ref<const Eigen::ArrayXf>& intensities,
                              const Eigen::Ref<const Eigen::ArrayXi>& lasers);

/// Reflectivity relative to the reference surface (Eq. 3.5), NaN where there is none.
/// @param ranges m; intensities as the scanner gives them, without offsets; incidence rad, maybe empty for
/// models that don't
///   need it
/// @throws std::invalid_argument if sizes differ or the calibration has no such model
Eigen::ArrayXf reflectivity(const Calibration& calibration, ModelType type, OutsidePolicy policy,
                            const Eigen::Ref<const Eigen::ArrayXf>& ranges,
                            const Eigen::Ref<const Eigen::ArrayXf>& incidence,
                            const Eigen::Ref<const Eigen::ArrayXf>& intensities,
                            ReflectivityCounts* counts = nullptr);

}  // namespace laser_intensity_calib
