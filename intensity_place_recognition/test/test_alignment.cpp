// SPDX-License-Identifier: BSD-3-Clause
#include <gtest/gtest.h>

#include <cmath>
#include <random>

#include "intensity_place_recognition/alignment.h"
#include "intensity_place_recognition/ground_plan.h"
#include "intensity_place_recognition/registration.h"
#include "test_street.h"

namespace intensity_place_recognition {
namespace {

Shape shapeOf(unsigned street, const Eigen::Isometry3d& pose) {
  const Cloud cloud = Street(street).scan(pose);
  const PanoramaOptions options;
  return Shape(cloud, toPanorama(cloud, options, 4), ShapeOptions());
}

std::vector<std::pair<float, float>> correlated(double correlation, std::size_t count, double changed) {
  std::mt19937 random(5);
  std::normal_distribution<double> normal;
  std::vector<std::pair<float, float>> pairs;
  for (std::size_t i = 0; i < count; ++i) {
    const double x = normal(random), noise = normal(random);
    double y = correlation * x + std::sqrt(1.0 - correlation * correlation) * noise;
    if (static_cast<double>(i) < changed * static_cast<double>(count)) y = normal(random);
    pairs.emplace_back(static_cast<float>(x), static_cast<float>(3.0 + 7.0 * y));
  }
  return pairs;
}

TEST(Correlation, FallsWithThePartThatChanged) {
  for (const double correlation : {-0.6, 0.0, 0.5, 0.9})
    EXPECT_NEAR(correlation, correlationOf(correlated(correlation, 20000, 0.0)), 0.03);
  EXPECT_NEAR(0.81, correlationOf(correlated(0.9, 20000, 0.1)), 0.03);
  EXPECT_EQ(0.0, correlationOf({}));
  EXPECT_EQ(0.0, correlationOf({{1.0f, 1.0f}, {1.0f, 2.0f}, {1.0f, 3.0f}, {1.0f, 4.0f}}));
}

// Of many draws of uncorrelated pairs, the evidence for a correlation is about standard normal.
TEST(Evidence, IsInStandardDeviations) {
  std::mt19937 random(2);
  std::normal_distribution<float> normal;
  const int draws = 2000, pieces = 150;
  double squares = 0.0, differences = 0.0;
  for (int i = 0; i < draws; ++i) {
    Correlation drawn[2];
    for (Correlation& c : drawn) {
      std::vector<std::pair<float, float>> pairs;
      for (int k = 0; k < pieces; ++k) pairs.emplace_back(normal(random), normal(random));
      c = {correlationOf(pairs), pieces};
    }
    squares += std::pow(evidence(drawn[0], 0.0), 2);
    differences += std::pow(evidence(drawn[0], drawn[1]), 2);
  }
  EXPECT_NEAR(1.0, std::sqrt(squares / draws), 0.1);
  EXPECT_NEAR(1.0, std::sqrt(differences / draws), 0.1);
  EXPECT_GT(evidence({0.6, 400}, 0.3), evidence({0.6, 100}, 0.3));
  EXPECT_LT(evidence({0.3, 100}, {0.6, 100}), 0.0);
}

TEST(PatchGrid, FindsTheNearest) {
  const Shape shape = shapeOf(1, Street::at(0.0, 0.0, 0.3));
  const PatchGrid grid(shape);
  const PatchField field(shape);
  std::mt19937 random(3);
  std::uniform_real_distribution<float> uniform(-25.0f, 25.0f), height(-2.5f, 5.0f);
  int found = 0;
  for (int i = 0; i < 3000; ++i) {
    const Eigen::Vector3f point(uniform(random), uniform(random), height(random));
    float squared = 1e9f;
    for (const Patch& p : shape.patches()) squared = std::min(squared, (p.point - point).squaredNorm());
    const Patch* nearest = grid.nearest(point, 0.5f);
    EXPECT_EQ(squared < 0.25f, nearest != nullptr);
    if (nearest) {
      EXPECT_EQ(squared, (nearest->point - point).squaredNorm());
    }
    found += nearest != nullptr;
    const Patch* about = field.nearest(point);
    const float cell = 0.5f * std::sqrt(3.0f) * PatchField::kCell;  // from its middle to its corner
    if (std::sqrt(squared) < PatchField::kReach - cell) {
      ASSERT_NE(nullptr, about);
    }
    if (about) {
      EXPECT_LE((about->point - point).norm(), std::sqrt(squared) + 2.0f * cell);
    }
  }
  EXPECT_GT(found, 50);
  EXPECT_EQ(nullptr, grid.nearest(Eigen::Vector3f::Constant(NAN), 0.5f));
  EXPECT_EQ(nullptr, field.nearest(Eigen::Vector3f::Constant(NAN)));
  EXPECT_EQ(nullptr, PatchGrid(Shape()).nearest(Eigen::Vector3f::Zero(), 0.5f));
  EXPECT_EQ(nullptr, PatchField(Shape()).nearest(Eigen::Vector3f::Zero()));
}

TEST(GroundPlan, FindsTheShiftThatAlignmentMakesAPose) {
  for (unsigned seed = 1; seed <= 4; ++seed) {
    const Eigen::Isometry3d at = Street::at(0.0, 0.0, 0.1), again = Street::at(3.0, -1.5, 0.1 + 0.7 * seed);
    const Shape place = shapeOf(seed, at), query = shapeOf(seed, again);
    const Eigen::Isometry3d expected = at.inverse() * again;
    const double yaw = 0.7 * seed + 0.02;
    const GroundPlan plan(query, yaw), there(place, 0.0);
    const GroundPlan::Shift rough = plan.roughShift(there, 6.0f),
                            shift = plan.bestShifts(there, 6.0f, 3).at(0);
    EXPECT_NEAR(expected.translation().x(), rough.x, 2.0) << seed;
    EXPECT_NEAR(expected.translation().y(), rough.y, 2.0) << seed;
    EXPECT_NEAR(expected.translation().x(), shift.x, 0.7) << seed;
    EXPECT_NEAR(expected.translation().y(), shift.y, 0.7) << seed;
    const GroundPlan elsewhere(shapeOf(seed + 10, at), 0.0);
    EXPECT_GT(rough.correlation, plan.roughShift(elsewhere, 6.0f).correlation);
    EXPECT_GT(shift.correlation, plan.bestShifts(elsewhere, 6.0f, 1).at(0).correlation);

    Eigen::Isometry3d guess(Eigen::AngleAxisd(yaw, Eigen::Vector3d::UnitZ()));
    guess.translation() << shift.x, shift.y, 0.0;
    const Alignment alignment = Aligner(query)(place, guess);
    const Eigen::Isometry3d error = expected.inverse() * alignment.pose;
    EXPECT_LT(error.translation().norm(), 0.2) << seed;
    EXPECT_LT(Eigen::AngleAxisd(error.linear()).angle(), 0.01) << seed;
    EXPECT_GT(alignment.fit, 0.5) << seed;
    EXPECT_GT(alignment.intensity.value, 0.4) << seed;
  }
}

TEST(GroundPlan, IsBestWhereItIs) {
  const Shape shape = shapeOf(2, Street::at(0.0, 0.0, 0.0));
  const GroundPlan plan(shape, 0.0);
  for (const GroundPlan::Shift& shift : {plan.roughShift(plan, 6.0f), plan.bestShifts(plan, 6.0f, 1).at(0)}) {
    EXPECT_NEAR(0.0, shift.x, 0.1);
    EXPECT_NEAR(0.0, shift.y, 0.1);
    EXPECT_LT(shift.correlation, 1.001f);
  }
  EXPECT_GT(plan.bestShifts(plan, 6.0f, 1).at(0).correlation, 0.9f);
  EXPECT_TRUE(GroundPlan().empty());
}

TEST(GroundPlan, IsTheSameTurnedByHalfATurn) {
  const GroundPlan place(shapeOf(2, Street::at(0.0, 0.0, 0.0)), 0.0);
  const Shape query = shapeOf(2, Street::at(1.0, 0.5, 0.7 + M_PI));
  const auto expected = GroundPlan(query, 0.7 + M_PI).bestShifts(place, 6.0f, 5),
             found = GroundPlan(query, 0.7).halfTurned().bestShifts(place, 6.0f, 5);
  ASSERT_EQ(expected.size(), found.size());
  for (std::size_t i = 0; i < found.size(); ++i) {
    EXPECT_NEAR(expected[i].correlation, found[i].correlation, 1e-4);
    EXPECT_NEAR(expected[i].x, found[i].x, 1e-2);
    EXPECT_NEAR(expected[i].y, found[i].y, 1e-2);
  }
}

// Near walls move in the image where the sensor does; how they are turned stays.
TEST(WallDirections, TellTheYawWhereverTheSensorIs) {
  for (unsigned seed = 1; seed <= 6; ++seed) {
    const double yaw = 0.9 * seed;
    const WallDirections place(shapeOf(seed, Street::at(0.0, 0.0, 0.3))),
        query(shapeOf(seed, Street::at(3.0, -2.0, 0.3 + yaw)));
    for (const double error : {-0.12, -0.03, 0.08})
      EXPECT_NEAR(0.0, std::remainder(query.bestYaw(place, yaw + error, 0.14) - yaw, 2.0 * M_PI), 0.02)
          << seed;
  }
}

// Nothing says how far along it a tunnel was entered, and the covariance doesn't pretend to know.
TEST(Registrar, IsUnsureAlongATunnel) {
  std::mt19937 random(4);
  std::normal_distribution<float> noise(0.0f, 0.01f);
  std::uniform_real_distribution<float> along(-30.0f, 30.0f), across(-4.0f, 4.0f), up(-1.8f, 3.0f);
  const auto tunnel = [&] {
    Cloud cloud;
    for (int i = 0; i < 60000; ++i) {
      pcl::PointXYZI p;
      p.intensity = up(random);
      if (i % 3 == 0)
        p.getVector3fMap() << along(random), across(random), -1.8f + noise(random);
      else
        p.getVector3fMap() << along(random), (i % 3 == 1 ? 4.0f : -4.0f) + noise(random), up(random);
      cloud.push_back(p);
    }
    return Shape(cloud, toPanorama(cloud, {}, 4), ShapeOptions());
  };
  const Shape query = tunnel(), match = tunnel();
  const Registration found = Registrar(query, {})(match, Street::at(0.1, 0.1, 0.01));
  const Eigen::Matrix<double, 6, 1> deviations = found.covariance.diagonal().cwiseSqrt();
  EXPECT_GT(deviations[0], 0.2);
  EXPECT_LT(deviations[1], 0.02);
  EXPECT_LT(deviations[2], 0.02);
  EXPECT_LT(deviations.tail<3>().maxCoeff(), 0.01);
}

}  // namespace
}  // namespace intensity_place_recognition
