// SPDX-License-Identifier: BSD-3-Clause
//
// Fits to samples of a known f(r, alpha), cross-validation, coverage, and the triangulation below them.
#include <gtest/gtest.h>

#include <algorithm>

#include "delaunay.h"
#include "laser_intensity_calib/fit.h"
#include "scanner_model.h"

namespace laser_intensity_calib {
namespace {

// -------------------------------------------------------------------------------------------- triangulation

double area(const Eigen::Matrix2Xd& points, const Triangle& t) {
  const Eigen::Vector2d a = points.col(t[1]) - points.col(t[0]), b = points.col(t[2]) - points.col(t[0]);
  return 0.5 * std::abs(a.x() * b.y() - a.y() * b.x());
}

TEST(Delaunay, CoversTheHullAndHasEmptyCircles) {
  std::mt19937 random(1);
  std::uniform_real_distribution<double> uniform;
  Eigen::Matrix2Xd points(2, 104);
  for (int i = 0; i < 100; ++i) points.col(i) << uniform(random), uniform(random);
  points.rightCols(4) << 0, 1, 1, 0, 0, 0, 1, 1;
  double sum = 0.0;
  for (const Triangle& t : triangulate(points)) {
    sum += area(points, t);
    const Eigen::Vector2d a = points.col(t[0]), b = points.col(t[1]) - a, c = points.col(t[2]) - a;
    const double d = 2.0 * (b.x() * c.y() - b.y() * c.x());
    const Eigen::Vector2d centre(a + Eigen::Vector2d(c.y() * b.squaredNorm() - b.y() * c.squaredNorm(),
                                                     b.x() * c.squaredNorm() - c.x() * b.squaredNorm()) /
                                         d);
    const double radius = (points.col(t[0]) - centre).norm();
    for (Eigen::Index i = 0; i < points.cols(); ++i)
      EXPECT_GE((points.col(i) - centre).norm(), radius * (1 - 1e-9));
  }
  EXPECT_NEAR(1.0, sum, 1e-9);
}

TEST(Delaunay, TakesAGridAndDuplicates) {
  Eigen::Matrix2Xd points(2, 37);  // cells of a grid share circles
  for (int i = 0; i < 36; ++i) points.col(i) << i % 6, i / 6;
  points.col(36) = points.col(7);
  double sum = 0.0;
  for (const Triangle& t : triangulate(points)) sum += area(points, t);
  EXPECT_NEAR(25.0, sum, 1e-9);
}

TEST(Delaunay, RejectsPointsOnALine) {
  EXPECT_THROW(triangulate(Eigen::Matrix2Xd(2, 0)), std::invalid_argument);
  EXPECT_THROW(triangulate(Eigen::Matrix2Xd::Random(2, 2)), std::invalid_argument);
  Eigen::Matrix2Xd line(2, 10);
  for (int i = 0; i < 10; ++i) line.col(i) << 0.1 * i, 0.3 * i;
  EXPECT_THROW(triangulate(line), std::invalid_argument);
  EXPECT_THROW(triangulate(Eigen::Matrix2Xd::Ones(2, 10)), std::invalid_argument);
}

// ----------------------------------------------------------------------------------------------------- table

TEST(FitTable, RecoversALinearFunctionExactly) {
  std::vector<Cell> cells;
  std::mt19937 random(2);
  std::uniform_real_distribution<double> uniform;
  for (int i = 0; i < 200; ++i) {
    const double r = 1.0 + 4.0 * uniform(random), a = 1.2 * uniform(random) + 0.1;
    cells.push_back({r, a, 50.0 + 10.0 * r - 20.0 * a, 0.0, 10});
  }
  const LookupTable table = fitTable(cells, FitOptions());
  int inside = 0;
  for (float r = 0.5F; r < 6.0F; r += 0.037F) {
    for (float a = 0.0F; a < 1.5F; a += 0.017F) {
      const Response f = table.at(r, a);
      if (!f.inside) continue;
      ++inside;
      // Cells of the table that the hull cuts have a node that stands for a neighbour.
      if (r < 1.3F || r > 4.7F || a < 0.25F || a > 1.15F) continue;
      EXPECT_NEAR(50.0 + 10.0 * r - 20.0 * a, f.intensity, 1e-2);
    }
  }
  EXPECT_GT(inside, 5000);
  EXPECT_FALSE(table.at(0.5F, 0.5F).inside);
  EXPECT_FALSE(table.at(3.0F, 1.45F).inside);
}

TEST(FitTable, IsClosedAtNormalIncidence) {
  std::vector<Cell> cells;
  for (int r = 1; r < 20; ++r) {
    for (int a = 0; a < 30; ++a) cells.push_back({0.1 * r, (2.0 * a + 1.0) * kRadians, 100.0 - a, 0.0, 10});
  }
  const Response f = fitTable(cells, FitOptions()).at(1.0F, 0.0F);
  EXPECT_TRUE(f.inside);
  EXPECT_NEAR(100.0, f.intensity, 1e-3);
}

TEST(FitTable, LeavesGapsWhereAsked) {
  std::vector<Cell> cells;
  for (int r = 1; r < 40; ++r) {
    for (int a = 0; a < 30; ++a) {
      if (r < 15 || r > 25) cells.push_back({0.1 * r, (2.0 * a + 1.0) * kRadians, 100.0, 0.0, 10});
    }
  }
  FitOptions options;
  EXPECT_TRUE(fitTable(cells, options).at(2.0F, 0.5F).inside);
  const Coverage coverage = coverageOf(cells, fitTable(cells, options), options);
  EXPECT_TRUE(std::any_of(coverage.advice.begin(), coverage.advice.end(), [](const std::string& sentence) {
    return sentence.rfind("Too few samples at 1.5", 0) == 0;
  })) << coverage.map;
  options.max_edge = 3.0;
  EXPECT_FALSE(fitTable(cells, options).at(2.0F, 0.5F).inside);
  EXPECT_TRUE(fitTable(cells, options).at(1.0F, 0.5F).inside);
}

TEST(SumUp, TakesMediansAndLeavesOutWhatIsUseless) {
  FitOptions options;
  options.min_samples = 3;
  const float nan = std::numeric_limits<float>::quiet_NaN();
  std::vector<Sample> samples = {
      {1.01F, 0.01F, 10.0F, 0}, {1.02F, 0.02F, 12.0F, 0}, {1.03F, 0.03F, 900.0F, 1}, {1.04F, nan, 5.0F, 1},
      {1.04F, 0.01F, nan, 1},   {1.04F, 0.01F, 0.0F, 1},  {5.0F, 0.01F, 5.0F, 1}};
  const std::vector<Cell> cells = sumUp(samples, options);
  ASSERT_EQ(1u, cells.size());
  EXPECT_EQ(3, cells[0].samples);
  EXPECT_FLOAT_EQ(12.0F, cells[0].intensity);
  EXPECT_NEAR(1.02, cells[0].range, 1e-6);
  EXPECT_NEAR(0.02, cells[0].incidence, 1e-6);
  EXPECT_NEAR(1.4826 * 2.0, cells[0].spread, 1e-4);
}

// ------------------------------------------------------------------------------------------------
// calibration

TEST(Calibrate, TheTableRecoversTheScannersResponse) {
  const Calibration c = calibrate(observe(0.8, 40, 2500), FitOptions());
  EXPECT_EQ(100000u, c.samples);
  EXPECT_EQ(40u, c.scans);
  // Of another surface, in scans that weren't part of it: Eq. 3.5.
  double squares = 0.0;
  int inside = 0;
  for (const Sample& s : observe(0.4, 1, 5000, 0.0, 99)) {
    const Response f = c.at(ModelType::kLut, s.range, s.incidence);
    if (!f.inside) continue;
    ++inside;
    squares += std::pow(s.intensity / f.intensity / 0.5 - 1.0, 2);
  }
  EXPECT_GT(inside, 4600);
  EXPECT_LT(std::sqrt(squares / inside), 0.025);
}

TEST(Calibrate, CrossValidationTellsTheModelsApart) {
  const Calibration c = calibrate(observe(0.8, 40, 1000), FitOptions());
  const auto rms = [&c](ModelType type) { return c.residuals[static_cast<int>(type)].rms; };
  EXPECT_LT(rms(ModelType::kLut), 0.035) << "noise is 0.02";
  EXPECT_GT(rms(ModelType::kRange), 0.2) << "ignores alpha";
  EXPECT_GT(rms(ModelType::kRaw), 0.3) << "ignores both";
  EXPECT_GT(c.residuals[2].covered, 0.9);
  EXPECT_DOUBLE_EQ(1.0, c.residuals[0].covered);
}

TEST(Calibrate, ThePolynomialFollowsTheRangeAtNormalIncidence) {
  const Calibration c = calibrate(observe(0.8, 40, 1000), FitOptions());
  EXPECT_GE(c.polynomial.coefficients().size(), 5u) << "the near distance effect takes a high degree";
  for (double r = 0.6; r < 5.5; r += 0.1) {
    EXPECT_NEAR(1.0, c.polynomial.value(r) / (0.8 * response(r, 7.5 * kRadians)), 0.08) << r;
  }
}

TEST(Calibrate, ChoosesALowDegreeWhereThatIsAllThereIs) {
  std::vector<Sample> samples = observe(0.8, 20, 1000);
  std::mt19937 random(4);
  std::normal_distribution<float> noise(0.0F, 5.0F);
  for (Sample& s : samples) s.intensity = 100.0F + 10.0F * s.range + noise(random);
  const Calibration c = calibrate(samples, FitOptions());
  EXPECT_EQ(2u, c.polynomial.coefficients().size());
}

TEST(Calibrate, ModelsThatLackSamplesAreLeftOutAndSaid) {
  std::vector<Sample> steep = observe(0.8, 10, 1000);
  for (Sample& s : steep) s.incidence = std::max(s.incidence, 0.5F);
  std::vector<std::string> problems;
  Calibration c = calibrate(steep, FitOptions(), &problems);
  EXPECT_FALSE(c.has(ModelType::kRange));
  EXPECT_TRUE(c.has(ModelType::kLut));
  ASSERT_EQ(1u, problems.size());
  EXPECT_EQ(0u, problems[0].find("No range model: "));
  EXPECT_EQ(0.0, c.residuals[1].covered);

  std::vector<Sample> upright = observe(0.8, 10, 1000);
  for (Sample& s : upright) s.incidence = 0.01F;
  problems.clear();
  c = calibrate(upright, FitOptions(), &problems);
  EXPECT_TRUE(c.has(ModelType::kRange));
  ASSERT_EQ(c.has(ModelType::kLut) ? 0u : 1u, problems.size());
}

TEST(Calibrate, RejectsTooLittle) {
  EXPECT_THROW(calibrate({}, FitOptions()), std::invalid_argument);
  EXPECT_THROW(calibrate(observe(0.8, 1, 1000), FitOptions()), std::invalid_argument) << "one scan";
  EXPECT_THROW(calibrate(observe(0.8, 10, 1), FitOptions()), std::invalid_argument);
  FitOptions options;
  options.range_step = 0.0;
  EXPECT_THROW(calibrate(observe(0.8, 10, 100), options), std::invalid_argument);
}

TEST(Calibrate, IsTheSameForTheSameSamples) {
  const std::vector<Sample> samples = observe(0.8, 10, 1000);
  const Calibration a = calibrate(samples, FitOptions()), b = calibrate(samples, FitOptions());
  EXPECT_TRUE((a.table.values() == b.table.values() || a.table.values().isNaN()).all());
  EXPECT_EQ(a.polynomial.coefficients(), b.polynomial.coefficients());
}

// Lasers that add a constant each, by turns.
std::vector<Sample> observeBy(int lasers, const std::function<float(int)>& offset) {
  std::vector<Sample> samples = observe(0.8, 20, 4000);
  for (std::size_t i = 0; i < samples.size(); ++i) {
    samples[i].laser = static_cast<int>(i) % lasers;
    samples[i].intensity += offset(samples[i].laser);
  }
  return samples;
}

TEST(Offsets, AreFoundAndTakenOff) {
  const auto offset = [](int laser) { return 60.0F * static_cast<float>(laser % 4) - 90.0F; };  // mean 0
  const std::vector<Sample> samples = observeBy(8, offset);
  FitOptions options;
  const Calibration without = calibrate(samples, options);
  options.offsets = true;
  const Calibration with = calibrate(samples, options);
  ASSERT_EQ(8u, with.offsets.size());
  for (int laser = 0; laser < 8; ++laser) EXPECT_NEAR(offset(laser), with.offsets[laser], 5.0) << laser;
  EXPECT_TRUE(without.offsets.empty());
  EXPECT_LT(with.residuals[2].rms, 0.5 * without.residuals[2].rms);
  EXPECT_NEAR(with.residuals[2].rms, residualsOf(with, ModelType::kLut, samples).rms, 0.01)
      << "of raw samples, too";
}

// As on level ground: each laser sees one angle, and the response changes slowly from one to the next.
TEST(Offsets, OfLasersThatSeeOneAngleEachAreThoseAgainstTheirNeighbours) {
  const auto offset = [](int laser) { return laser % 2 == 0 ? 50.0F : -50.0F; };
  std::vector<Sample> samples = observeBy(32, offset);
  std::mt19937 random(5);
  std::uniform_real_distribution<float> uniform(-0.2F, 0.2F);
  for (Sample& s : samples) {
    s.range = 3.0F;
    s.incidence = static_cast<float>((s.laser + uniform(random)) * kRadians);
    s.intensity = static_cast<float>(0.8 * response(s.range, s.incidence)) + offset(s.laser);
  }
  FitOptions options;
  options.incidence_cell = 4.0 * kRadians;
  const std::vector<float> offsets = fitOffsets(samples, options);
  for (int laser = 4; laser < 28; ++laser) EXPECT_NEAR(offset(laser), offsets[laser], 15.0) << laser;
}

TEST(Offsets, NeedSamplesOfEachLaser) {
  std::vector<Sample> samples = observeBy(4, [](int) { return 0.0F; });
  EXPECT_THROW(fitOffsets(observe(0.8, 10, 1000), FitOptions()), std::invalid_argument) << "one laser";
  samples.resize(20);
  for (Sample s : observe(0.8, 10, 1000)) samples.push_back(s), samples.back().laser = 9;
  const std::vector<float> offsets = fitOffsets(samples, FitOptions());
  ASSERT_EQ(10u, offsets.size());
  EXPECT_TRUE(std::isnan(offsets[1])) << "5 samples";
  EXPECT_TRUE(std::isnan(offsets[5])) << "none";
  EXPECT_FLOAT_EQ(0.0F, offsets[9]);
  samples[0].laser = -1;
  EXPECT_THROW(fitOffsets(samples, FitOptions()), std::invalid_argument);
}

TEST(Offsets, AreTakenOffIntensities) {
  Calibration c;
  Eigen::ArrayXf intensities(5);
  intensities << 100.0F, 100.0F, 100.0F, 0.0F, 10.0F;
  Eigen::ArrayXi lasers(5);
  lasers << 0, 1, 2, 0, 0;
  EXPECT_TRUE((withoutOffsets(c, intensities, Eigen::ArrayXi()) == intensities).all()) << "none known";
  c.offsets = {20.0F, std::numeric_limits<float>::quiet_NaN()};
  const Eigen::ArrayXf result = withoutOffsets(c, intensities, lasers);
  EXPECT_FLOAT_EQ(80.0F, result[0]);
  EXPECT_TRUE(std::isnan(result[1])) << "a laser without an offset";
  EXPECT_TRUE(std::isnan(result[2])) << "a laser unheard of";
  EXPECT_TRUE(std::isnan(result[3])) << "below the threshold";
  EXPECT_FLOAT_EQ(0.0F, result[4]);
  EXPECT_THROW(withoutOffsets(c, intensities, Eigen::ArrayXi()), std::invalid_argument);
}

TEST(Coverage, IsSilentWhereAllIsWell) {
  const std::vector<Sample> samples = observe(0.8, 40, 2500);
  const FitOptions options;
  const std::vector<Cell> cells = sumUp(samples, options);
  const Coverage coverage = coverageOf(cells, fitTable(cells, options), options);
  EXPECT_GT(coverage.observed, 0.95);
  EXPECT_TRUE(coverage.advice.empty()) << coverage.advice[0];
}

TEST(Coverage, SaysWhereAnglesAreMissing) {
  std::vector<Sample> samples = observe(0.8, 40, 2500);
  samples.erase(std::remove_if(samples.begin(), samples.end(),
                               [](const Sample& s) { return s.range > 3.0F && s.incidence > 0.5F; }),
                samples.end());
  const FitOptions options;
  const std::vector<Cell> cells = sumUp(samples, options);
  const Coverage coverage = coverageOf(cells, fitTable(cells, options), options);
  EXPECT_TRUE(std::any_of(
      coverage.advice.begin(), coverage.advice.end(),
      [](const std::string& sentence) { return sentence.find("beyond 29 deg") != std::string::npos; }))
      << coverage.map << coverage.advice.size();
}

}  // namespace
}  // namespace laser_intensity_calib
