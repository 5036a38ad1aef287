// SPDX-License-Identifier: BSD-3-Clause
#include <gtest/gtest.h>

#include <Eigen/Cholesky>
#include <Eigen/Eigenvalues>
#include <Eigen/LU>
#include <cmath>
#include <string>
#include <utility>

#include "flat_world.h"
#include "intensity_hector_slam/scan_matcher.h"

namespace intensity_hector_slam {
namespace {

// A map from scans at true poses around the origin.
MultiMap mapOf(const std::vector<Wall>& walls, const Scanner& scanner, int scans = 30, double reach = 0.4) {
  MultiMap map;
  for (int i = 0; i < scans; ++i) {
    const Pose pose(reach * std::sin(0.7 * i), 0.3 * std::cos(1.1 * i), 0.3 * i);
    map.update(look(walls, pose, scanner, 100 + i), pose);
  }
  return map;
}

Scanner noisy() {
  Scanner scanner;
  scanner.range_noise = 0.005;
  scanner.reflectivity_noise = 0.02;
  return scanner;
}

MatcherOptions optionsOf(const std::string& cost) {
  MatcherOptions options;
  options.cost = cost;
  return options;
}

TEST(ScanMatcher, GradientIsThatOfTheCost) {
  const MultiMap map = mapOf(furnishedRoom(), noisy(), 10);
  Scan scan = look(furnishedRoom(), Pose(0.1, -0.2, 0.4), noisy(), 5);
  scan.reflectivities[7] = std::nanf("");
  for (const RobustKernel kernel :
       {RobustKernel::kNone, RobustKernel::kHuber, RobustKernel::kCauchy, RobustKernel::kTukey}) {
    for (const std::string& cost : mapping_common::namesOf(costs())) {
      MatcherOptions options = optionsOf(cost);
      options.robust_kernel = kernel;
      options.reflectivity_weight = 2.0;
      ScanMatcher matcher(options);
      const Pose pose(0.113, -0.187, 0.393);
      const GridMap& level = map.level(2);
      const auto at = matcher.linearize(level, scan, pose);
      const Eigen::Vector3d gradient = at.occupancy.gradient + at.gain() * at.reflectivity.gradient;
      const Eigen::Vector3d steps(1e-4, 1e-4, 2e-5);
      for (int i = 0; i < 3; ++i) {
        const Pose step = steps[i] * Pose::Unit(i);
        const double rise = at.costOf(matcher.linearize(level, scan, pose + step)) -
                            at.costOf(matcher.linearize(level, scan, pose - step));
        // Half the cost's descent. The interpolation has kinks, which some beams cross, and shares of beams
        // that count change.
        const double share = cost == "occupancy" ? 0.03 : 0.2;
        EXPECT_NEAR(gradient[i], -0.5 * rise / (2.0 * steps[i]), share * gradient.norm() + 1.0)
            << cost << " of kernel " << static_cast<int>(kernel) << ", direction " << i;
      }
    }
  }
}

// A wall that is 10 cm thick, of which the map has one side, comes into view from the other.
TEST(ScanMatcher, TheOtherSideOfAWallIsntMatchedToTheFirst) {
  std::vector<Wall> walls = box({-3.5, 0.0}, {-0.5, 0.1}, false);
  walls.push_back({{-3.5, -4.0}, {-3.5, 4.0}});
  for (const Wall& wall : box({1.0, -1.0}, {1.4, -0.6}, false)) walls.push_back(wall);
  Scanner scanner = noisy();
  scanner.max_range = 4.0;
  MultiMap map;
  for (int i = 0; i < 20; ++i) {
    const Pose pose(0.1 * std::sin(0.7 * i), 1.2 - 0.05 * i, 0.3 * i);
    map.update(look(walls, pose, scanner, 100 + i), pose);
  }
  const auto error = [&](FirstGuess is) {
    double sum = 0.0;
    for (int seed = 0; seed < 10; ++seed) {
      const Pose truth(-0.1, -0.25, 0.3 * seed);
      ScanMatcher matcher(optionsOf("occupancy"));
      const Match match = matcher.match(map, look(walls, truth, scanner, seed), truth, false, is);
      sum += std::abs(match.pose.y() - truth.y());
    }
    return sum / 10.0;
  };
  EXPECT_LT(error(FirstGuess::kSure), 0.03);
  EXPECT_GT(error(FirstGuess::kFar), 2.0 * error(FirstGuess::kSure))
      << "the test is of a wall that isn't mistaken for its other side";
}

TEST(ScanMatcher, FindsDisplacements) {
  const std::vector<Wall> walls = furnishedRoom();
  const MultiMap map = mapOf(walls, noisy());
  const Pose truth(0.3, -0.2, 0.5);
  const Scan scan = look(walls, truth, noisy(), 7);
  for (const std::string& cost : mapping_common::namesOf(costs())) {
    ScanMatcher matcher(optionsOf(cost));
    for (const Pose& displacement :
         {Pose(0.08, -0.06, 0.05), Pose(-0.1, 0.05, -0.08), Pose(0.0, 0.12, 0.0)}) {
      const Match match = matcher.match(map, scan, truth + displacement);
      EXPECT_LT((match.pose - truth).head<2>().norm(), 0.006) << cost;
      EXPECT_LT(std::abs(match.pose.z() - truth.z()), 0.003) << cost;
      EXPECT_EQ(3, match.observable);
      EXPECT_LT(match.contradiction, 0.05);
      EXPECT_GT(match.overlap, 0.9);
    }
  }
}

TEST(ScanMatcher, SearchFindsLargeDisplacements) {
  const std::vector<Wall> walls = furnishedRoom();
  const MultiMap map = mapOf(walls, noisy());
  const Pose truth(0.3, -0.2, 0.5), guess = truth + Pose(0.28, -0.25, 0.3);
  const Scan scan = look(walls, truth, noisy(), 7);
  for (const std::string& cost : mapping_common::namesOf(costs())) {
    const Match match = ScanMatcher(optionsOf(cost)).match(map, scan, guess, true);
    EXPECT_TRUE(match.searched);
    EXPECT_LT((match.pose - truth).head<2>().norm(), 0.006) << cost;
  }
}

TEST(ScanMatcher, RobustWeightLeavesMovingObjectsOut) {
  const std::vector<Wall> walls = furnishedRoom();
  const MultiMap map = mapOf(walls, noisy());
  const Pose truth(0.1, 0.1, 0.2);
  Scan scan = look(walls, truth, noisy(), 3);
  // A third of the beams ends 12 cm in front of where it should: people stand along the walls.
  for (std::size_t i = 0; i < scan.points.size(); ++i) {
    if (i / 40 % 3 == 0) scan.points[i] *= 1.0f - 0.12f / scan.points[i].norm();
  }
  const auto errorWith = [&](RobustKernel kernel) {
    MatcherOptions options = optionsOf("occupancy");
    options.robust_kernel = kernel;
    options.robust_scale = 0.3;
    return (ScanMatcher(options).match(map, scan, truth + Pose(0.03, -0.02, 0.01)).pose - truth).norm();
  };
  for (const RobustKernel kernel : {RobustKernel::kHuber, RobustKernel::kCauchy, RobustKernel::kTukey}) {
    EXPECT_LT(errorWith(kernel), 0.01);
    EXPECT_LT(errorWith(kernel), errorWith(RobustKernel::kNone));
  }
}

// People walk along with the robot: to it they seem to stand where the map has them. What tells the 10 cm
// that it went is the far end of the hall, and the stripes on its sides.
TEST(ScanMatcher, PeopleNearByDoNotHoldThePose) {
  const auto hall = [](const Pose& robot) {
    std::vector<Wall> walls = box({-2.0, -1.8}, {5.0, 1.8});
    for (const double bearing : {-0.5, 0.5, 1.1}) {
      const Eigen::Vector2d person = transform(robot, {0.9 * std::cos(bearing), 0.9 * std::sin(bearing)}),
                            half(0.15, 0.15);
      for (const Wall& side : box(person - half, person + half, false)) walls.push_back(side);
    }
    return walls;
  };
  const Pose truth(0.1, 0.0, 0.0);
  MultiMap map;
  for (unsigned seed = 1; seed <= 5; ++seed)
    map.update(look(hall(Pose::Zero()), Pose::Zero(), noisy(), seed), Pose::Zero());
  const Scan scan = look(hall(truth), truth, noisy(), 9);
  for (const std::string& cost : mapping_common::namesOf(costs())) {
    MatcherOptions options = optionsOf(cost);
    for (const Pose& guess : {Pose(0.0, 0.0, 0.0), truth})
      EXPECT_NEAR(truth.x(), ScanMatcher(options).match(map, scan, guess).pose.x(), 0.015) << cost;
    options.coarse_spacing = 0.0;
    EXPECT_NEAR(0.0, ScanMatcher(options).match(map, scan, truth).pose.x(), 0.01) << cost;
  }
}

std::vector<Wall> corridor(bool striped) {
  if (striped) return {stripes({-50.0, -1.1}, {50.0, -1.1}, 5), stripes({-50.0, 1.1}, {50.0, 1.1}, 6)};
  return {{{-50.0, -1.1}, {50.0, -1.1}}, {{-50.0, 1.1}, {50.0, 1.1}}};
}

Scanner shortSighted(int beams, double range_noise) {
  Scanner scanner = noisy();
  scanner.max_range = 8.0;
  scanner.beams = beams;
  scanner.range_noise = range_noise;
  return scanner;
}

// Fig. 3.1: without reflectivity the position along the corridor is unknown, and said to be.
TEST(ScanMatcher, KnowsWhatACorridorDoesNotTell) {
  const Pose truth(0.1, 0.05, 0.02), guess = truth + Pose(0.07, 0.03, 0.01);
  for (const Scanner& scanner :
       {shortSighted(1081, 0.005), shortSighted(1081, 0.02), shortSighted(271, 0.01)}) {
    const MultiMap map = mapOf(corridor(false), scanner, 150, 5.0);
    for (unsigned seed = 1; seed <= 10; ++seed) {
      const Scan scan = look(corridor(false), truth, scanner, seed);
      for (const std::string& cost : mapping_common::namesOf(costs())) {
        const MatcherOptions options = optionsOf(cost);
        const Match match = ScanMatcher(options).match(map, scan, guess);
        const std::string at = cost + ", seed " + std::to_string(seed);
        EXPECT_EQ(2, match.observable) << at;
        EXPECT_NEAR(guess.x(), match.pose.x(), 0.005) << at;
        EXPECT_NEAR(truth.y(), match.pose.y(), 0.008) << at;
        EXPECT_NEAR(truth.z(), match.pose.z(), 0.005) << at;
        EXPECT_NEAR(options.unobservable_distance, std::sqrt(match.covariance(0, 0)), 0.02) << at;
        EXPECT_LT(std::sqrt(match.covariance(1, 1)), 0.02) << at;
      }
    }
  }
}

TEST(ScanMatcher, ReflectivityTellsWhereAlongACorridor) {
  const Pose truth(0.1, 0.05, 0.02), guess = truth + Pose(0.07, 0.03, 0.01);
  for (const Scanner& scanner : {shortSighted(1081, 0.005), shortSighted(1081, 0.02)}) {
    const MultiMap map = mapOf(corridor(true), scanner, 150, 5.0);
    for (unsigned seed = 1; seed <= 10; ++seed) {
      const Scan scan = look(corridor(true), truth, scanner, seed);
      for (const char* cost : {"reflectivity", "combined", "auto"}) {
        const Match match = ScanMatcher(optionsOf(cost)).match(map, scan, guess);
        EXPECT_EQ(3, match.observable) << cost << ", seed " << seed;
        EXPECT_LT((match.pose - truth).head<2>().norm(), 0.025) << cost << ", seed " << seed;
        EXPECT_LT(std::sqrt(match.covariance(0, 0)), 0.05) << cost << ", seed " << seed;
      }
      EXPECT_EQ(2, ScanMatcher(optionsOf("occupancy")).match(map, scan, guess).observable);
    }
  }
}

// Walls and doors that differ as little as two paints, oblique to the cells: between the cells of the wall
// and those beside it, which have no reflectivity, R must not change.
TEST(ScanMatcher, DoorsOfLittleContrastTell) {
  const auto doors = [](double reflectivity) {
    std::vector<Wall> walls;
    for (const double y : {-1.6, 1.6}) {
      const double spacing = y < 0.0 ? 4.5 : 6.3;
      walls.push_back({{-40.0, y}, {40.0, y}, [=](double at) {
                         return std::fmod(at, spacing) < 0.9 ? reflectivity : 0.6;
                       }});
    }
    return walls;
  };
  Scanner scanner = noisy();
  scanner.range_noise = 0.01;
  scanner.max_range = 7.0;
  const Pose turned(0.0, 0.0, 0.37);  // of the corridor in the map
  for (const double reflectivity : {0.5, 0.6}) {
    MultiMap map;
    for (unsigned i = 0; i < 20; ++i) {
      const Pose pose(0.2 * i, 0.2 * std::sin(i), 0.3 * i);
      map.update(look(doors(reflectivity), pose, scanner, 100 + i), compose(turned, pose));
    }
    const Pose in_corridor(2.0, 0.05, 0.02), truth = compose(turned, in_corridor),
                                             guess = compose(turned, in_corridor + Pose(0.06, 0.01, 0.0));
    for (unsigned seed = 1; seed <= 10; ++seed) {
      const Scan scan = look(doors(reflectivity), in_corridor, scanner, seed);
      for (const char* cost : {"reflectivity", "combined"}) {
        const Match match = ScanMatcher(optionsOf(cost)).match(map, scan, guess);
        const std::string at = std::string(cost) + ", seed " + std::to_string(seed);
        EXPECT_EQ(reflectivity < 0.6 ? 3 : 2, match.observable) << at;
        const Pose expected =
            reflectivity < 0.6 ? truth : compose(turned, in_corridor + Pose(0.06, 0.0, 0.0));
        EXPECT_LT((match.pose - expected).head<2>().norm(), 0.015) << at;
        EXPECT_NEAR(truth.z(), match.pose.z(), 0.003) << at;
      }
    }
  }
}

// A door frame of 10 cm on each side, a hall, few beams: all tell the whole pose.
TEST(ScanMatcher, KnowsWhatRoomsTell) {
  std::vector<Wall> doors;
  for (const double y : {-1.1, 1.1}) {
    const double frame = y > 0.0 ? 1.0 : -1.0;
    doors.push_back({{-50.0, y}, {0.8, y}});
    doors.push_back({{0.8, y}, {0.8, frame}});
    doors.push_back({{0.8, frame}, {1.9, frame}});
    doors.push_back({{1.9, frame}, {1.9, y}});
    doors.push_back({{1.9, y}, {50.0, y}});
  }
  Scanner sparse = noisy();
  sparse.beams = 181;
  sparse.angle_min = -0.5 * M_PI;
  sparse.angle_max = 0.5 * M_PI;
  sparse.range_noise = 0.01;
  const std::vector<Wall> hall = box({-12.0, -9.0}, {12.0, 9.0}, false);
  const std::pair<std::vector<Wall>, Scanner> cases[] = {{furnishedRoom(), noisy()},
                                                         {furnishedRoom(), sparse},
                                                         {hall, noisy()},
                                                         {hall, sparse},
                                                         {doors, shortSighted(1081, 0.005)}};
  for (const auto& [walls, scanner] : cases) {
    const MultiMap map = mapOf(walls, scanner, 60);
    for (unsigned seed = 1; seed <= 10; ++seed) {
      const Pose truth(0.02 * seed, 0.05, 0.3 * seed);
      for (const std::string& cost : mapping_common::namesOf(costs())) {
        const Match match = ScanMatcher(optionsOf(cost)).match(map, look(walls, truth, scanner, seed), truth);
        EXPECT_EQ(3, match.observable)
            << cost << ", seed " << seed << ", case " << (&walls - &cases[0].first);
      }
    }
  }
}

// In a map from true poses, about a third of the errors is beyond one sigma, but hardly any beyond three.
TEST(ScanMatcher, CovarianceIsHonest) {
  const std::pair<std::vector<Wall>, Scanner> cases[] = {{furnishedRoom(), noisy()},
                                                         {corridor(true), shortSighted(1081, 0.005)}};
  for (const auto& [walls, scanner] : cases) {
    const MultiMap map = mapOf(walls, scanner, 150, 0.5);
    for (const char* cost : {"reflectivity", "combined"}) {
      ScanMatcher matcher(optionsOf(cost));
      int all = 0, within[3] = {};
      for (unsigned seed = 1; seed <= 50; ++seed) {
        const Pose truth(0.4 * std::sin(seed), 0.3 * std::sin(2.3 * seed), 0.1 * std::sin(seed));
        const Match match =
            matcher.match(map, look(walls, truth, scanner, seed), truth + Pose(0.02, -0.01, 0.005));
        const Eigen::Vector3d error = match.covariance.llt().matrixL().solve(match.pose - truth);
        for (int axis = 0; axis < 3; ++axis) {
          ++all;
          for (int i = 0; i < 3; ++i) within[i] += std::abs(error[axis]) <= i + 1.0;
        }
      }
      EXPECT_GT(within[0], 0.45 * all) << cost;
      EXPECT_LT(within[0], 0.9 * all) << cost;
      EXPECT_GT(within[1], 0.75 * all) << cost;
      EXPECT_GT(within[2], 0.9 * all) << cost;
    }
  }
}

TEST(ScanMatcher, AutoTrustsReflectivityWhereItIsKnownAndDense) {
  const std::vector<Wall> walls = furnishedRoom();
  const MultiMap map = mapOf(walls, noisy());
  ScanMatcher matcher(optionsOf("auto"));
  Scan scan = look(walls, Pose::Zero(), noisy(), 3);
  EXPECT_EQ("combined", matcher.match(map, scan, Pose::Zero()).cost);
  Scan unknown = scan;
  unknown.reflectivities.clear();
  EXPECT_EQ("occupancy", matcher.match(map, unknown, Pose::Zero()).cost);
  Scanner sparse = noisy();
  sparse.beams = 91;
  EXPECT_EQ("occupancy", matcher.match(map, look(walls, Pose::Zero(), sparse, 3), Pose::Zero()).cost);
}

// What isn't known along a corridor leaves what is known across it as it is.
TEST(ScanMatcher, CovarianceIsPositiveDefiniteWhereADirectionIsUnobservable) {
  std::vector<Wall> walls = corridor(false);
  for (Wall& wall : walls) {
    for (Eigen::Vector2d* end : {&wall.from, &wall.to}) *end = Eigen::Rotation2Dd(0.57) * *end;
  }
  const Scanner scanner = shortSighted(1081, 0.005);
  const MultiMap map = mapOf(walls, scanner, 150, 0.3);
  MatcherOptions options = optionsOf("occupancy");
  options.unobservable_distance = 100.0;
  for (unsigned seed = 1; seed <= 20; ++seed) {
    const Pose truth(0.2 * std::sin(seed), 0.2 * std::sin(2.3 * seed), 1.5 * std::sin(seed));
    const Match match = ScanMatcher(options).match(map, look(walls, truth, scanner, seed), truth);
    EXPECT_EQ(2, match.observable);
    const Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d> solver(match.covariance);
    EXPECT_GT(solver.eigenvalues()[0], 1e-9) << seed;
    EXPECT_LT(solver.eigenvalues()[1], 1e-5) << seed;
    EXPECT_NEAR(1e4, solver.eigenvalues()[2], 100.0) << seed;
  }
}

TEST(ScanMatcher, AnUnknownMapTellsNothing) {
  const Pose guess(1.0, 2.0, 0.3);
  const Match match = ScanMatcher().match(MultiMap(), look(furnishedRoom(), Pose::Zero(), {}), guess);
  EXPECT_EQ(0, match.observable);
  EXPECT_LT((match.pose - guess).norm(), 1e-12);
  EXPECT_TRUE(match.covariance.allFinite());
}

TEST(MatcherOptions, SayWhatIsWrong) {
  MatcherOptions options;
  options.robust_scale = 0.0;
  EXPECT_THROW(ScanMatcher{options}, std::invalid_argument);
}

}  // namespace
}  // namespace intensity_hector_slam
