// SPDX-License-Identifier: BSD-3-Clause
#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <random>

#include "laser_intensity_calib/statistics.h"

namespace laser_intensity_calib {
namespace {

std::vector<float> normal(double mean, double sigma, int count, unsigned seed = 1) {
  std::mt19937 random(seed);
  std::normal_distribution<float> gauss(static_cast<float>(mean), static_cast<float>(sigma));
  std::vector<float> values;
  for (int i = 0; i < count; ++i) values.push_back(gauss(random));
  return values;
}

std::vector<float> join(std::vector<float> a, const std::vector<float>& b) {
  a.insert(a.end(), b.begin(), b.end());
  return a;
}

TEST(Statistics, CoefficientOfVariation) {
  EXPECT_NEAR(std::sqrt(2.0) / 2.0, coefficientOfVariation({1.0F, 3.0F}), 1e-9);
  EXPECT_NEAR(0.1, coefficientOfVariation(normal(5.0, 0.5, 100000)), 1e-3);
  EXPECT_TRUE(std::isnan(coefficientOfVariation({1.0F})));
  EXPECT_NEAR(std::sqrt(2.0) / 2.0,
              coefficientOfVariation({1.0F, 3.0F, std::numeric_limits<float>::quiet_NaN()}), 1e-9);
}

TEST(Statistics, HistogramSharesSumToOne) {
  const std::vector<double> h = histogram({-1.0F, 0.1F, 0.6F, 5.0F}, 0.0, 1.0, 2);
  ASSERT_EQ(2u, h.size());
  EXPECT_DOUBLE_EQ(0.5, h[0]);
  EXPECT_DOUBLE_EQ(0.5, h[1]);
}

TEST(Statistics, OverlapOfNormalDistributions) {
  const std::vector<float> a = normal(0.0, 1.0, 50000, 1);
  EXPECT_NEAR(1.0, overlap(a, normal(0.0, 1.0, 50000, 2)), 0.05);
  EXPECT_LT(overlap(a, normal(10.0, 1.0, 50000, 2)), 0.01);
  // Two normal distributions d sigma apart share 2 Phi(-d / 2).
  for (const double d : {1.0, 2.0, 3.0}) {
    EXPECT_NEAR(std::erfc(d / 2.0 / std::sqrt(2.0)), overlap(a, normal(d, 1.0, 50000, 2)), 0.02) << d;
  }
  EXPECT_TRUE(std::isnan(overlap({}, {})));
  EXPECT_TRUE(std::isnan(overlap(a, {})));
  EXPECT_TRUE(std::isnan(overlap({}, a)));
}

TEST(Statistics, ModesAreCounted) {
  EXPECT_EQ(0, modes({}));
  EXPECT_EQ(1, modes({3.0F, 3.0F, 3.0F}));
  for (unsigned seed = 0; seed < 10; ++seed) EXPECT_EQ(1, modes(normal(1.0, 0.1, 5000, seed)));
  EXPECT_EQ(2, modes(join(normal(0.0, 1.0, 5000), normal(5.0, 1.0, 5000))));
  EXPECT_EQ(1, modes(join(normal(0.0, 1.0, 5000), normal(1.0, 1.0, 5000)))) << "one broad one";
  EXPECT_EQ(1, modes(join(normal(0.0, 1.0, 5000), normal(6.0, 1.0, 100)))) << "a bump below a tenth";
  EXPECT_EQ(3, modes(join(join(normal(0.0, 1.0, 5000), normal(6.0, 1.0, 5000)), normal(12.0, 1.0, 5000))));
}

}  // namespace
}  // namespace laser_intensity_calib
