// SPDX-License-Identifier: BSD-3-Clause
#include "laser_intensity_calib/statistics.h"

#include <algorithm>
#include <cmath>
#include <limits>

namespace laser_intensity_calib {
namespace {

std::vector<float> sortedFinite(const std::vector<float>& values) {
  std::vector<float> kept;
  std::copy_if(values.begin(), values.end(), std::back_inserter(kept),
               [](float v) { return std::isfinite(v); });
  std::sort(kept.begin(), kept.end());
  return kept;
}

double quantile(const std::vector<float>& sorted, double share) {
  return sorted[static_cast<std::size_t>(share * static_cast<double>(sorted.size() - 1))];
}

double deviation(const std::vector<float>& values, double mean) {
  double squares = 0.0;
  for (const float v : values) squares += (v - mean) * (v - mean);
  return std::sqrt(squares / static_cast<double>(values.size() - 1));
}

double meanOf(const std::vector<float>& values) {
  double sum = 0.0;
  for (const float v : values) sum += v;
  return sum / static_cast<double>(values.size());
}

// Peaks of a curve with the prominence asked for: a peak counts when the curve has dropped by that much
// since.
int countPeaks(const std::vector<double>& curve, double prominence) {
  int peaks = 0;
  bool rising = true;
  double extreme = 0.0;
  for (const double value : curve) {
    if (rising ? value > extreme : value < extreme) extreme = value;
    if (rising && value < extreme - prominence) {
      ++peaks;
      rising = false;
      extreme = value;
    } else if (!rising && value > extreme + prominence) {
      rising = true;
      extreme = value;
    }
  }
  return peaks;
}

}  // namespace

double coefficientOfVariation(const std::vector<float>& values) {
  const std::vector<float> kept = sortedFinite(values);
  if (kept.size() < 2) return std::numeric_limits<double>::quiet_NaN();
  const double mean = meanOf(kept);
  return deviation(kept, mean) / mean;
}

std::vector<double> histogram(const std::vector<float>& values, double min, double max, std::size_t bins) {
  std::vector<double> shares(bins, 0.0);
  const std::vector<float> kept = sortedFinite(values);
  for (const float v : kept) {
    const double position = (v - min) / (max - min) * static_cast<double>(bins);
    const auto bin = static_cast<std::size_t>(std::clamp(position, 0.0, static_cast<double>(bins) - 1.0));
    shares[bin] += 1.0 / static_cast<double>(kept.size());
  }
  return shares;
}

double overlap(const std::vector<float>& a, const std::vector<float>& b) {
  std::vector<float> both = sortedFinite(a);
  const std::size_t finite_a = both.size();
  both.insert(both.end(), b.begin(), b.end());
  both = sortedFinite(both);
  if (finite_a < 2 || both.size() - finite_a < 2) return std::numeric_limits<double>::quiet_NaN();
  const double min = quantile(both, 0.005), max = quantile(both, 0.995);
  const double width =
      2.0 * (quantile(both, 0.75) - quantile(both, 0.25)) * std::cbrt(1.0 / static_cast<double>(both.size()));
  if (!(width > 0.0)) return std::numeric_limits<double>::quiet_NaN();
  const auto bins = static_cast<std::size_t>(std::clamp(std::ceil((max - min) / width), 1.0, 1000.0));
  const std::vector<double> ha = histogram(a, min, max, bins), hb = histogram(b, min, max, bins);
  double shared = 0.0;
  for (std::size_t i = 0; i < bins; ++i) shared += std::min(ha[i], hb[i]);
  return shared;
}

int modes(const std::vector<float>& values) {
  const std::vector<float> sorted = sortedFinite(values);
  if (sorted.size() < 2) return static_cast<int>(sorted.size());
  const double sigma = deviation(sorted, meanOf(sorted));
  const double iqr = quantile(sorted, 0.75) - quantile(sorted, 0.25);
  const double bandwidth = 0.9 * (iqr > 0.0 ? std::min(sigma, iqr / 1.34) : sigma) *
                           std::pow(static_cast<double>(sorted.size()), -0.2);
  if (!(bandwidth > 0.0)) return 1;
  constexpr int kSteps = 4;  // per bandwidth
  constexpr std::size_t kMaxNodes = 20000;
  const double min = quantile(sorted, 0.001) - 4.0 * bandwidth,
               max = quantile(sorted, 0.999) + 4.0 * bandwidth;
  const auto nodes = static_cast<std::size_t>(
      std::min((max - min) / bandwidth * kSteps + 1.0, static_cast<double>(kMaxNodes)));
  const std::vector<double> shares = histogram(sorted, min, max, nodes);
  const double step = (max - min) / static_cast<double>(nodes);
  const int reach = static_cast<int>(std::ceil(4.0 * bandwidth / step));
  std::vector<double> density(nodes, 0.0);
  for (int i = 0; i < static_cast<int>(nodes); ++i) {
    for (int j = std::max(0, i - reach); j <= std::min(i + reach, static_cast<int>(nodes) - 1); ++j) {
      const double z = (i - j) * step / bandwidth;
      density[i] += shares[j] * std::exp(-0.5 * z * z);
    }
  }
  return countPeaks(density, 0.1 * *std::max_element(density.begin(), density.end()));
}

}  // namespace laser_intensity_calib
