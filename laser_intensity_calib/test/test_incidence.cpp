// SPDX-License-Identifier: BSD-3-Clause
//
// Angles of incidence against exact planes and corners, with and without noise.
#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <cmath>
#include <random>
#include <vector>

#include "laser_intensity_calib/incidence.h"

namespace laser_intensity_calib {
namespace {

constexpr double kRadians = M_PI / 180.0;
constexpr float kNan = std::numeric_limits<float>::quiet_NaN();
constexpr float kInf = std::numeric_limits<float>::infinity();
constexpr double kIncrement = 0.25 * kRadians;

// A wall in the plane of the scan: the points p with n . p = distance, n at `normal_angle`.
struct Wall {
  double normal_angle, distance;
  double rangeAt(double angle) const {
    const double cosine = std::cos(angle - normal_angle);
    return cosine > 1e-3 ? distance / cosine : kInf;
  }
  double incidenceAt(double angle) const { return std::abs(angle - normal_angle); }
};

double angleOf(int beam) {
  return -0.75 * M_PI + beam * kIncrement;
}
constexpr int kBeams = 1081;

// The nearest of the walls, with noise.
Eigen::ArrayXf rangesOf(const std::vector<Wall>& walls, double noise = 0.0, unsigned seed = 1) {
  std::mt19937 random(seed);
  std::normal_distribution<double> gauss(0.0, 1.0);
  Eigen::ArrayXf ranges(kBeams);
  for (int i = 0; i < kBeams; ++i) {
    double range = kInf;
    for (const Wall& wall : walls) range = std::min(range, wall.rangeAt(angleOf(i)));
    ranges[i] = range < 30.0 ? static_cast<float>(range + noise * gauss(random)) : kInf;
  }
  return ranges;
}

const Eigen::ArrayXf& estimate(ScanIncidence& incidence, const Eigen::ArrayXf& ranges) {
  return incidence.estimate(ranges, angleOf(0), kIncrement);
}

TEST(ScanIncidence, IsExactOnAWall) {
  for (const double distance : {0.5, 2.0, 10.0}) {
    for (const double normal : {0.0, 0.7, -1.5}) {
      const Wall wall{normal, distance};
      ScanIncidence incidence;
      const Eigen::ArrayXf result = estimate(incidence, rangesOf({wall}));
      int known = 0;
      for (int i = 0; i < kBeams; ++i) {
        if (std::isnan(result[i])) continue;
        ++known;
        ASSERT_NEAR(wall.incidenceAt(angleOf(i)), result[i], 1e-3) << i;
      }
      EXPECT_GT(known, 250) << distance << ' ' << normal;
    }
  }
}

TEST(ScanIncidence, KeepsTheSidesOfACornerApart) {
  const Wall left{0.5 * M_PI, 2.0}, front{0.0, 3.0};
  const double corner = std::atan2(2.0, 3.0);
  ScanIncidence incidence;
  const Eigen::ArrayXf result = estimate(incidence, rangesOf({left, front}));
  for (int i = 0; i < kBeams; ++i) {
    const double angle = angleOf(i);
    if (std::abs(angle) > 0.5 * M_PI || std::isnan(result[i])) continue;
    if (std::abs(angle - corner) < 1.01 * kIncrement) continue;  // on the edge itself
    const Wall& wall = angle > corner ? left : front;
    if (wall.incidenceAt(angle) > 80.0 * kRadians) continue;
    EXPECT_NEAR(wall.incidenceAt(angle), result[i], 0.5 * kRadians) << i;
  }
  EXPECT_FALSE(result.segment(540, 200).isNaN().any());
}

TEST(ScanIncidence, DoesNotMixTheSidesOfAStep) {
  Eigen::ArrayXf ranges = rangesOf({{0.0, 2.0}});
  const Eigen::ArrayXf behind = rangesOf({{0.0, 2.6}});
  ranges.tail(540) = behind.tail(540);
  ScanIncidence incidence;
  const Eigen::ArrayXf result = estimate(incidence, ranges);
  for (int i = 500; i < 580; ++i) EXPECT_NEAR(std::abs(angleOf(i)), result[i], 1e-3) << i;
}

TEST(ScanIncidence, IsUnbiasedAndAsGoodAsItsErrorUnderNoise) {
  const Wall wall{0.3, 3.0};
  ScanIncidenceOptions options;
  options.min_length = 0.3;
  ScanIncidence incidence(options);
  double sum = 0.0, squares = 0.0;
  int known = 0, all = 0;
  for (unsigned seed = 0; seed < 20; ++seed) {
    const Eigen::ArrayXf result = estimate(incidence, rangesOf({wall}, 0.01, seed));
    for (int i = 0; i < kBeams; ++i) {
      const double truth = wall.incidenceAt(angleOf(i));
      if (truth < 15.0 * kRadians || truth > 60.0 * kRadians) continue;
      ++all;
      if (std::isnan(result[i])) continue;
      ++known;
      sum += result[i] - truth;
      squares += std::pow(result[i] - truth, 2);
    }
  }
  EXPECT_GT(known, 0.95 * all);
  EXPECT_NEAR(0.0, sum / known, 0.3 * kRadians);
  EXPECT_LT(std::sqrt(squares / known), 3.0 * kRadians);
}

TEST(ScanIncidence, IsUnknownWhereNoNormalIs) {
  ScanIncidence incidence;
  std::mt19937 random(1);
  std::uniform_real_distribution<float> anywhere(1.0F, 10.0F);
  Eigen::ArrayXf clutter(kBeams);
  for (int i = 0; i < kBeams; ++i) clutter[i] = anywhere(random);
  EXPECT_GT(estimate(incidence, clutter).isNaN().count(), 0.99 * kBeams);

  EXPECT_TRUE(estimate(incidence, Eigen::ArrayXf::Constant(kBeams, kInf)).isNaN().all());
  EXPECT_TRUE(estimate(incidence, Eigen::ArrayXf::Constant(kBeams, kNan)).isNaN().all());
  EXPECT_TRUE(estimate(incidence, Eigen::ArrayXf::Zero(kBeams)).isNaN().all());
  EXPECT_EQ(0, estimate(incidence, Eigen::ArrayXf()).size());
  EXPECT_TRUE(incidence.estimate(Eigen::ArrayXf::Constant(2, 1.0F), 0.0, 0.01).isNaN().all());

  Eigen::ArrayXf pole = Eigen::ArrayXf::Constant(kBeams, kInf);
  pole.segment(500, 4).setConstant(2.0F);
  EXPECT_TRUE(estimate(incidence, pole).isNaN().all()) << "fewer beams than a window";
}

TEST(ScanIncidence, IsUnknownWhereTheNoiseIsTooLargeForTheWindow) {
  ScanIncidenceOptions options;
  options.min_length = 0.02;  // 7 beams, 26 mm long, with a noise of 15 mm
  ScanIncidence incidence(options);
  const Eigen::ArrayXf ranges = rangesOf({{0.0, 1.0}}, 0.015);
  EXPECT_GT(estimate(incidence, ranges).segment(500, 80).isNaN().count(), 64);
  options.min_length = 0.4;
  incidence = ScanIncidence(options);
  EXPECT_LT(estimate(incidence, ranges).segment(500, 80).isNaN().count(), 8);
}

TEST(ScanIncidence, LeavesOutAMixedPixel) {
  Eigen::ArrayXf ranges = rangesOf({{0.0, 2.0}});
  ranges[560] += 0.1F;
  ScanIncidence incidence;
  const Eigen::ArrayXf result = estimate(incidence, ranges);
  EXPECT_TRUE(std::isnan(result[560]));
  EXPECT_FALSE(std::isnan(result[540]));
}

TEST(ScanIncidence, TakesScansOfEitherSenseAndChangingSize) {
  const Eigen::ArrayXf ranges = rangesOf({{0.4, 2.0}});
  ScanIncidence incidence;
  const Eigen::ArrayXf forward = estimate(incidence, ranges);
  const Eigen::ArrayXf backward = incidence.estimate(ranges.reverse(), -angleOf(0), -kIncrement);
  for (int i = 0; i < kBeams; ++i) {
    if (std::isnan(forward[i])) continue;
    EXPECT_NEAR(forward[i], backward[kBeams - 1 - i], 2e-3) << i;
  }
  const Eigen::ArrayXf part = incidence.estimate(ranges.segment(500, 100), angleOf(500), kIncrement);
  EXPECT_NEAR(forward[550], part[50], 1e-3);
}

TEST(ScanIncidence, RejectsOptionsByName) {
  ScanIncidenceOptions options;
  options.min_window = 2;
  try {
    ScanIncidence incidence(options);
    FAIL();
  } catch (const std::invalid_argument& e) {
    EXPECT_STREQ("min_window is 2, allowed is 3 to 1000", e.what());
  }
}

// ------------------------------------------------------------------------------------------------- clouds

// Points of a plane, seen along beams through a grid of angles.
Eigen::Matrix3Xf planeSeenFrom(const Eigen::Vector3d& viewpoint, const Eigen::Vector3d& normal,
                               double distance, double noise = 0.0) {
  std::mt19937 random(3);
  std::normal_distribution<double> gauss(0.0, 1.0);
  std::vector<Eigen::Vector3f> points;
  for (int row = -15; row <= 15; ++row) {
    for (int column = -40; column <= 40; ++column) {
      const double azimuth = column * kRadians, elevation = row * kRadians;
      const Eigen::Vector3d beam(std::cos(elevation) * std::cos(azimuth),
                                 std::cos(elevation) * std::sin(azimuth), std::sin(elevation));
      const double range = (distance - normal.dot(viewpoint)) / normal.dot(beam);
      if (range > 0.0 && range < 20.0) {
        points.push_back((viewpoint + (range + noise * gauss(random)) * beam).cast<float>());
      }
    }
  }
  return Eigen::Map<Eigen::Matrix3Xf>(points.data()->data(), 3, static_cast<Eigen::Index>(points.size()));
}

double trueIncidence(const Eigen::Vector3f& point, const Eigen::Vector3d& viewpoint,
                     const Eigen::Vector3d& normal) {
  return std::acos(std::abs(normal.dot((point.cast<double>() - viewpoint).normalized())));
}

TEST(CloudIncidence, IsExactOnAPlane) {
  const Eigen::Vector3d normal = Eigen::Vector3d(1.0, 0.5, 0.3).normalized();
  const Eigen::Matrix3Xf points = planeSeenFrom(Eigen::Vector3d::Zero(), normal, 3.0);
  CloudIncidenceOptions options;
  options.radius = 2.0;
  const Eigen::ArrayXf result = cloudIncidence(points, Eigen::Matrix3Xf::Zero(3, 1), options);
  ASSERT_LT(result.isNaN().count(), 0.05 * points.cols());
  for (Eigen::Index i = 0; i < points.cols(); ++i) {
    if (std::isnan(result[i])) continue;
    ASSERT_NEAR(trueIncidence(points.col(i), Eigen::Vector3d::Zero(), normal), result[i], 2e-3) << i;
  }
}

TEST(CloudIncidence, StandsNoise) {
  const Eigen::Vector3d normal = Eigen::Vector3d(1.0, 0.2, 0.1).normalized();
  const Eigen::Matrix3Xf points = planeSeenFrom(Eigen::Vector3d::Zero(), normal, 3.0, 0.005);
  CloudIncidenceOptions options;
  options.neighbors = 40;
  const Eigen::ArrayXf result = cloudIncidence(points, Eigen::Matrix3Xf::Zero(3, 1), options);
  double squares = 0.0;
  int known = 0;
  for (Eigen::Index i = 0; i < points.cols(); ++i) {
    const double truth = trueIncidence(points.col(i), Eigen::Vector3d::Zero(), normal);
    if (std::isnan(result[i]) || truth < 15.0 * kRadians) continue;
    squares += std::pow(result[i] - truth, 2);
    ++known;
  }
  EXPECT_GT(known, 1000);
  EXPECT_LT(std::sqrt(squares / known), 3.0 * kRadians);
}

TEST(CloudIncidence, TakesAViewpointForEachPoint) {
  // A wall at y = 2, swept by a scanner that drives along x: each point is seen at right angles to the way.
  std::vector<Eigen::Vector3f> points, viewpoints;
  for (int step = 0; step < 40; ++step) {
    for (int beam = -30; beam <= 30; ++beam) {
      const double x = 0.05 * step, elevation = 1.5 * beam * kRadians;
      viewpoints.emplace_back(x, 0.0, 1.0);
      points.emplace_back(x, 2.0, 1.0 + 2.0 * std::tan(elevation));
    }
  }
  const auto n = static_cast<Eigen::Index>(points.size());
  const Eigen::Map<Eigen::Matrix3Xf> p(points.data()->data(), 3, n), v(viewpoints.data()->data(), 3, n);
  const Eigen::ArrayXf result = cloudIncidence(p, v);
  for (Eigen::Index i = 0; i < n; ++i) {
    if (std::isnan(result[i])) continue;
    ASSERT_NEAR(std::abs(1.5 * (i % 61 - 30)) * kRadians, result[i], 2e-3);
  }
  EXPECT_LT(result.isNaN().count(), 0.1 * n);
  EXPECT_FLOAT_EQ(2.0F, cloudRanges(p, v)[30]);
  EXPECT_THROW(cloudIncidence(p, v.leftCols(2)), std::invalid_argument);
}

TEST(CloudIncidence, IsUnknownOnALineAndWhereThereIsNothing) {
  Eigen::Matrix3Xf line(3, 100);
  for (int i = 0; i < 100; ++i) line.col(i) << 3.0F, 0.02F * i, 0.0F;
  EXPECT_TRUE(cloudIncidence(line, Eigen::Matrix3Xf::Zero(3, 1)).isNaN().all());
  EXPECT_TRUE(
      cloudIncidence(Eigen::Matrix3Xf::Constant(3, 5, kNan), Eigen::Matrix3Xf::Zero(3, 1)).isNaN().all());
  EXPECT_EQ(0, cloudIncidence(Eigen::Matrix3Xf(3, 0), Eigen::Matrix3Xf::Zero(3, 1)).size());
  EXPECT_TRUE(
      cloudIncidence(Eigen::Matrix3Xf::Random(3, 200) * 3.0F, Eigen::Matrix3Xf::Zero(3, 1)).isNaN().count() >
      150);
}

TEST(CloudIncidence, PointsInfinitelyFarHaveNoneAndChangeNone) {
  Eigen::Matrix3Xf points(3, 31 * 31);
  for (int i = 0; i < points.cols(); ++i) points.col(i) << 3.0F, 0.05F * (i % 31 - 15), 0.05F * (i / 31 - 15);
  const Eigen::Matrix3Xf sensor = Eigen::Matrix3Xf::Zero(3, 1);
  const Eigen::ArrayXf near = cloudIncidence(points, sensor);
  ASSERT_FALSE(near.isNaN().any());
  for (const float far : {1e25F, 3e38F, -3e38F}) {
    Eigen::Matrix3Xf more(3, points.cols() + 3);
    more << points, Eigen::Vector3f(far, 0.0F, 0.0F), Eigen::Vector3f(far, far, far),
        Eigen::Vector3f(3.0F, far, 0.0F);
    const Eigen::ArrayXf result = cloudIncidence(more, sensor);
    EXPECT_TRUE((result.head(points.cols()) == near).all()) << far;
    EXPECT_TRUE(result.tail(3).isNaN().all()) << far << ": " << result.tail(3).transpose();
  }
}

TEST(CloudIncidence, TakesTheOrderOfAnOrganisedCloud) {
  // 31 rows of 81 columns: a wall at 3 m with a doorway in it, and another behind.
  Eigen::Matrix3Xf points(3, 31 * 81);
  for (int i = 0; i < points.cols(); ++i) {
    const int row = i / 81 - 15, column = i % 81 - 40;
    const float wall = std::abs(column) < 10 ? 5.0F : 3.0F;
    points.col(i) = wall * Eigen::Vector3f(1.0F, std::tan(column * kRadians), std::tan(row * kRadians));
  }
  points.col(1000).setConstant(kNan);
  const Eigen::Matrix3Xf sensor = Eigen::Matrix3Xf::Zero(3, 1);
  const Eigen::ArrayXf result = cloudIncidence(points, sensor, CloudIncidenceOptions(), 81);
  for (int i = 0; i < points.cols(); ++i) {
    if (i == 1000) continue;
    ASSERT_NEAR(trueIncidence(points.col(i), Eigen::Vector3d::Zero(), Eigen::Vector3d::UnitX()), result[i],
                2e-3)
        << i;
  }
  EXPECT_TRUE(std::isnan(result[1000]));
  EXPECT_THROW(cloudIncidence(points, sensor, CloudIncidenceOptions(), 80), std::invalid_argument);
}

TEST(CloudIncidence, AVoxelLeafBringsInTheNextRing) {
  // Rings 0.3 m apart with a point every 2 cm: the nearest 12 points are of one ring.
  std::vector<Eigen::Vector3f> points;
  for (int ring = 0; ring < 6; ++ring) {
    for (int i = 0; i < 300; ++i) points.emplace_back(4.0F, 0.02F * i - 3.0F, 0.3F * ring);
  }
  const Eigen::Map<Eigen::Matrix3Xf> p(points.data()->data(), 3, static_cast<Eigen::Index>(points.size()));
  CloudIncidenceOptions options;
  options.radius = 1.0;
  EXPECT_GT(cloudIncidence(p, Eigen::Matrix3Xf::Zero(3, 1), options).isNaN().count(), 0.9 * p.cols());
  options.leaf = 0.3;
  const Eigen::ArrayXf result = cloudIncidence(p, Eigen::Matrix3Xf::Zero(3, 1), options);
  EXPECT_LT(result.isNaN().count(), 0.1 * p.cols());
  EXPECT_NEAR(std::atan2(0.01, 4.0), result[149], 5e-3);
}

}  // namespace
}  // namespace laser_intensity_calib
