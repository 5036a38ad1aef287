// SPDX-License-Identifier: BSD-3-Clause
//
// The three models, what they give outside, and reflectivity.
#include <gtest/gtest.h>

#include <random>

#include "laser_intensity_calib/models.h"

namespace laser_intensity_calib {
namespace {

constexpr float kNan = std::numeric_limits<float>::quiet_NaN();
constexpr float kInf = std::numeric_limits<float>::infinity();

// f = 100 + 10 r + alpha on nodes 1, 2, 3 m and 0, 1 rad; none at 3 m, 1 rad.
LookupTable smallTable() {
  Eigen::ArrayXXf values(3, 2);
  values << 110, 111, 120, 121, 130, kNan;
  return LookupTable({1.0, 1.0, 3}, {0.0, 1.0, 2}, values);
}

TEST(LookupTable, IsLinearBetweenNodes) {
  const LookupTable table = smallTable();
  EXPECT_FLOAT_EQ(110.0F, table.at(1.0F, 0.0F).intensity);
  EXPECT_FLOAT_EQ(115.5F, table.at(1.5F, 0.5F).intensity);
  EXPECT_TRUE(table.at(1.5F, 0.5F).inside);
  EXPECT_TRUE(table.at(2.6F, 0.4F).inside) << "the nearest node has a value";
}

TEST(LookupTable, ClampsToTheNearestOutside) {
  const LookupTable table = smallTable();
  EXPECT_FALSE(table.at(2.9F, 0.9F).inside) << "the nearest node has none";
  EXPECT_FALSE(table.at(0.2F, 0.0F).inside);
  EXPECT_FLOAT_EQ(110.0F, table.at(0.2F, 0.0F).intensity);
  EXPECT_FALSE(table.at(9.0F, 0.0F).inside);
  EXPECT_FLOAT_EQ(130.0F, table.at(9.0F, 0.0F).intensity);
  const float corner = table.at(3.0F, 1.0F).intensity;  // two nodes are as near
  EXPECT_TRUE(corner == 130.0F || corner == 121.0F) << corner;
}

TEST(LookupTable, FillsFromTheNearestNodeOfAll) {
  std::mt19937 random(5);
  Eigen::ArrayXXf values = Eigen::ArrayXXf::Constant(30, 40, kNan);
  for (int i = 0; i < 25; ++i) values(random() % 30, random() % 40) = static_cast<float>(1 + i);
  const LookupTable table({1.0, 1.0, 30}, {0.0, 1.0, 40}, values);
  for (int r = 0; r < 30; ++r) {
    for (int a = 0; a < 40; ++a) {
      int nearest = 1 << 20, given = 1 << 20;
      const float value = table.at(1.0F + r, a).intensity;
      for (int r2 = 0; r2 < 30; ++r2) {
        for (int a2 = 0; a2 < 40; ++a2) {
          if (std::isnan(values(r2, a2))) continue;
          const int distance = (r - r2) * (r - r2) + (a - a2) * (a - a2);
          nearest = std::min(nearest, distance);
          if (values(r2, a2) == value) given = std::min(given, distance);
        }
      }
      EXPECT_LE(std::sqrt(given), std::sqrt(nearest) + 0.5) << r << ' ' << a;
    }
  }
}

TEST(LookupTable, RejectsWhatIsNoTable) {
  const Eigen::ArrayXXf ones = Eigen::ArrayXXf::Ones(2, 2);
  const Axis axis{0.0, 1.0, 2};
  EXPECT_NO_THROW(LookupTable(axis, axis, ones));
  EXPECT_THROW(LookupTable({0.0, 1.0, 3}, axis, ones), std::invalid_argument);
  EXPECT_THROW(LookupTable({0.0, 0.0, 2}, axis, ones), std::invalid_argument);
  EXPECT_THROW(LookupTable({-1.0, 1.0, 2}, axis, ones), std::invalid_argument);
  EXPECT_THROW(LookupTable({0.0, kNan, 2}, axis, ones), std::invalid_argument);
  EXPECT_THROW(LookupTable(axis, axis, -ones), std::invalid_argument);
  EXPECT_THROW(LookupTable(axis, axis, kInf * ones), std::invalid_argument);
  EXPECT_THROW(LookupTable(axis, axis, kNan * ones), std::invalid_argument);
}

TEST(RangePolynomial, EvaluatesAndClamps) {
  const RangePolynomial p({1.0, 3.0}, {10.0, 2.0, -1.0});  // t = r - 2
  EXPECT_DOUBLE_EQ(10.0, p.value(2.0));
  EXPECT_DOUBLE_EQ(11.0, p.value(3.0));
  EXPECT_TRUE(p.at(3.0F).inside);
  EXPECT_FALSE(p.at(3.5F).inside);
  EXPECT_FLOAT_EQ(11.0F, p.at(99.0F).intensity);
  EXPECT_THROW(RangePolynomial({1.0, 3.0}, {0.0, 1.0}), std::invalid_argument) << "not positive";
  EXPECT_THROW(RangePolynomial({3.0, 3.0}, {1.0}), std::invalid_argument);
  EXPECT_THROW(RangePolynomial({1.0, 3.0}, {}), std::invalid_argument);
  EXPECT_THROW(RangePolynomial({1.0, 3.0}, {kNan}), std::invalid_argument);
}

Calibration calibration() {
  Calibration c;
  c.raw = 200.0;
  c.polynomial = RangePolynomial({1.0, 3.0}, {100.0});
  c.table = smallTable();
  return c;
}

TEST(Reflectivity, IsIntensityOverThatOfTheReference) {
  Eigen::ArrayXf ranges(2), incidence(2), intensities(2);
  ranges << 1.0F, 2.0F;
  incidence << 0.0F, 1.0F;
  intensities << 55.0F, 242.0F;
  const auto of = [&](ModelType type) {
    return reflectivity(calibration(), type, OutsidePolicy::kDrop, ranges, incidence, intensities);
  };
  EXPECT_FLOAT_EQ(0.275F, of(ModelType::kRaw)[0]);
  EXPECT_FLOAT_EQ(2.42F, of(ModelType::kRange)[1]);
  EXPECT_FLOAT_EQ(0.5F, of(ModelType::kLut)[0]);
  EXPECT_FLOAT_EQ(2.0F, of(ModelType::kLut)[1]);
}

TEST(Reflectivity, CountsWhatHasNone) {
  Eigen::ArrayXf ranges(7), incidence(7), intensities(7);
  ranges << 1.0F, kInf, kNan, -1.0F, 2.0F, 2.0F, 5.0F;
  incidence << 0.0F, 0.0F, 0.0F, 0.0F, kNan, 0.0F, 0.0F;
  intensities << 55.0F, 1.0F, 1.0F, 1.0F, 1.0F, -1.0F, 65.0F;
  ReflectivityCounts counts;
  Eigen::ArrayXf result = reflectivity(calibration(), ModelType::kLut, OutsidePolicy::kDrop, ranges,
                                       incidence, intensities, &counts);
  EXPECT_EQ(1u, counts.valid);
  EXPECT_EQ(3u, counts.no_return);
  EXPECT_EQ(1u, counts.no_incidence);
  EXPECT_EQ(1u, counts.bad_intensity);
  EXPECT_EQ(1u, counts.outside);
  EXPECT_EQ(6, result.isNaN().count());

  result = reflectivity(calibration(), ModelType::kLut, OutsidePolicy::kClamp, ranges, incidence, intensities,
                        &counts);
  EXPECT_FLOAT_EQ(0.5F, result[6]);
  EXPECT_EQ(3u, counts.valid) << "both calls together";
  result = reflectivity(calibration(), ModelType::kRange, OutsidePolicy::kDrop, ranges, Eigen::ArrayXf(),
                        intensities);
  EXPECT_FLOAT_EQ(0.01F, result[4]) << "needs no angle";
}

TEST(Reflectivity, RejectsWhatDoesNotFit) {
  const Eigen::ArrayXf two = Eigen::ArrayXf::Ones(2), three = Eigen::ArrayXf::Ones(3);
  const auto call = [](const Calibration& c, ModelType type, const auto& a, const auto& b, const auto& i) {
    reflectivity(c, type, OutsidePolicy::kDrop, a, b, i);
  };
  EXPECT_THROW(call(calibration(), ModelType::kLut, two, two, three), std::invalid_argument);
  EXPECT_THROW(call(calibration(), ModelType::kLut, two, Eigen::ArrayXf(), two), std::invalid_argument);
  EXPECT_THROW(call(Calibration(), ModelType::kLut, two, two, two), std::invalid_argument);
  EXPECT_THROW(call(Calibration(), ModelType::kRange, two, two, two), std::invalid_argument);
  EXPECT_NO_THROW(call(Calibration(), ModelType::kRaw, two, two, two));
}

TEST(Names, AreReadAsWritten) {
  for (const ModelType type : kModelTypes)
    EXPECT_EQ(type, mapping_common::valueOf<ModelType>(toString(type)));
  EXPECT_THROW(mapping_common::valueOf<ModelType>("lambert"), std::invalid_argument);
}

}  // namespace
}  // namespace laser_intensity_calib
