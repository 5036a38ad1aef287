// SPDX-License-Identifier: BSD-3-Clause
//
// A scanner whose f(r, alpha) is known: near distance effect, compressed range, more than Lambertian and a
// steep fall at grazing angles.
#pragma once

#include <cmath>
#include <random>
#include <vector>

#include "laser_intensity_calib/fit.h"

namespace laser_intensity_calib {

constexpr double kRadians = M_PI / 180.0;

inline double response(double range, double incidence) {
  const double near = 1.0 - std::exp(-range * range / 0.64);
  const double grazing = 1.0 / (1.0 + std::exp((incidence - 1.36) / 0.05));
  return 2000.0 * near / std::sqrt(range) * std::pow(std::cos(incidence), 0.6) * grazing;
}

/// Samples of a surface of the given reflectivity at random places, scan by scan.
inline std::vector<Sample> observe(double reflectivity, int scans, int per_scan, double noise_ratio = 0.02,
                                   unsigned seed = 1) {
  std::mt19937 random(seed);
  std::uniform_real_distribution<double> uniform;
  std::normal_distribution<double> gauss;
  std::vector<Sample> samples;
  for (int scan = 0; scan < scans; ++scan) {
    for (int i = 0; i < per_scan; ++i) {
      const double r = 0.3 + 5.7 * uniform(random), a = 80.0 * kRadians * uniform(random);
      const double intensity = reflectivity * response(r, a) * (1.0 + noise_ratio * gauss(random));
      samples.push_back({static_cast<float>(r), static_cast<float>(a), static_cast<float>(intensity), scan});
    }
  }
  return samples;
}

}  // namespace laser_intensity_calib
