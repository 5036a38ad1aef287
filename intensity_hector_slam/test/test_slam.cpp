// SPDX-License-Identifier: BSD-3-Clause
#include <gtest/gtest.h>

#include <limits>

#include "flat_world.h"
#include "intensity_hector_slam/slam.h"

namespace intensity_hector_slam {
namespace {

constexpr double kPeriod = 0.05;  // s

Scanner noisy() {
  Scanner scanner;
  scanner.beams = 541;
  scanner.range_noise = 0.005;
  scanner.reflectivity_noise = 0.02;
  return scanner;
}

// A round in the room at 0.6 m/s; it begins in the origin.
Pose truthAt(double time) {
  const double angle = 0.4 * time;
  return {1.5 * std::sin(angle), 1.5 - 1.5 * std::cos(angle), angle};
}

std::vector<Wall> room() {
  std::vector<Wall> walls = furnishedRoom();
  for (Wall& wall : walls) {
    wall.from.y() += 1.0;
    wall.to.y() += 1.0;
  }
  return walls;
}

Scan scanAt(double time, unsigned seed = 0) {
  Scan scan = look(room(), truthAt(time), noisy(), static_cast<unsigned>(1000 * time) + seed);
  scan.stamp = 100.0 + time;
  return scan;
}

double errorOf(const Pose& pose, double time) {
  return (pose - truthAt(time)).head<2>().norm();
}

double turnOf(const Pose& pose, double time) {
  return std::abs(wrapAngle(pose.z() - truthAt(time).z()));
}

// Processes scans of [from, to). @return the greatest error, m
double drive(Slam& slam, double from, double to) {
  double greatest = 0.0;
  for (int i = static_cast<int>(std::lround(from / kPeriod)); i < std::lround(to / kPeriod); ++i) {
    greatest = std::max(greatest, errorOf(slam.process(scanAt(kPeriod * i)).pose, kPeriod * i));
  }
  return greatest;
}

class EachCost : public ::testing::TestWithParam<std::string> {
 protected:
  SlamOptions options() const {
    SlamOptions options;
    options.matcher.cost = GetParam();
    return options;
  }
};

TEST_P(EachCost, FollowsARound) {
  Slam slam(options());
  EXPECT_LT(drive(slam, 0.0, 16.0), 0.03);
  EXPECT_LT(turnOf(slam.pose(), 16.0 - kPeriod), 0.01);
}

TEST_P(EachCost, MatchesScansNearTheirGuessOnTheFinestLevelAlone) {
  const auto iterations = [this](double near_distance, double period) {
    SlamOptions near = options();
    near.matcher.near_distance = near_distance;
    Slam slam(near);
    int sum = 0;
    for (int i = 0; i < 60; ++i) {
      const SlamResult result =
          slam.process(scanAt(period * i), compose(Pose(3.0, 1.0, 2.0), truthAt(period * i)));
      sum += result.match.iterations;
      EXPECT_LT(errorOf(result.pose, period * i), 0.03);
    }
    return sum;
  };
  EXPECT_LT(iterations(0.05, kPeriod), 0.6 * iterations(0.0, kPeriod));
  EXPECT_EQ(iterations(0.05, 0.2), iterations(0.0, 0.2)) << "odometry drifts over search_gap";
}

TEST_P(EachCost, FollowsARoundAtALowRate) {
  Slam slam(options());
  double greatest = 0.0;
  for (int i = 0; i < 80; ++i)
    greatest = std::max(greatest, errorOf(slam.process(scanAt(0.2 * i)).pose, 0.2 * i));
  EXPECT_LT(greatest, 0.05);
}

TEST_P(EachCost, MovingObjectsDoNotBreakTheMap) {
  Slam slam(options());
  std::mt19937 random(1);
  double greatest = 0.0;
  for (int i = 0; i < 200; ++i) {
    Scan scan = scanAt(kPeriod * i);
    // People around the robot: 30 % of the beams, in groups that come and go.
    const std::size_t n = scan.points.size();
    for (int person = 0; person < 6; ++person) {
      const std::size_t first = random() % n;
      const float range = 0.6f + 0.8f * (random() % 100) / 100.0f;
      for (std::size_t k = first; k < std::min(n, first + n / 20); ++k) {
        if (scan.points[k].norm() > range) scan.points[k] *= range / scan.points[k].norm();
        scan.reflectivities[k] = 0.3f;
      }
    }
    const SlamResult result = slam.process(scan);
    greatest = std::max(greatest, errorOf(result.pose, kPeriod * i));
  }
  EXPECT_LT(greatest, 0.06);
}

INSTANTIATE_TEST_SUITE_P(Slam, EachCost, ::testing::ValuesIn(mapping_common::namesOf(costs())),
                         [](const auto& info) { return info.param; });

TEST(Slam, SaysWhatBecameOfTheFirstScan) {
  Slam slam;
  slam.setPose({1.0, 2.0, 0.5});
  const SlamResult result = slam.process(scanAt(0.0));
  EXPECT_EQ(Status::kStarted, result.status);
  EXPECT_TRUE(result.map_updated);
  EXPECT_EQ(Pose(1.0, 2.0, 0.5), result.pose);
  EXPECT_EQ(Status::kMatched, slam.process(scanAt(kPeriod)).status);
}

TEST(Slam, EmptyScansAreSaidAndChangeNothing) {
  Slam slam;
  drive(slam, 0.0, 1.0);
  const MultiMap before = slam.map();
  for (int i = 0; i < 3; ++i) {
    Scan empty;
    empty.stamp = 101.0 + kPeriod * i;
    const SlamResult result = slam.process(empty);
    EXPECT_EQ(Status::kEmpty, result.status);
    EXPECT_FALSE(result.map_updated);
    EXPECT_GT(result.covariance(0, 0), 0.5);
    EXPECT_LT(errorOf(result.pose, 1.0 + kPeriod * i), 0.05);  // at constant velocity
  }
  EXPECT_TRUE(before == slam.map());
  EXPECT_LT(drive(slam, 1.15, 3.0), 0.03);
}

TEST(Slam, RejectsScansThatContradictTheMap) {
  Slam slam;
  drive(slam, 0.0, 2.0);
  const std::size_t updates = slam.map().updates();
  Scan foreign = look(box({-1.2, -1.2}, {1.2, 1.2}), Pose::Zero(), noisy());
  for (int i = 0; i < 10; ++i) {
    foreign.stamp = 102.0 + kPeriod * i;
    const SlamResult result = slam.process(foreign);
    EXPECT_EQ(Status::kRejected, result.status);
    EXPECT_TRUE(result.match.searched);
  }
  EXPECT_EQ(updates, slam.map().updates());
  EXPECT_LT(drive(slam, 2.5, 4.0), 0.03);
}

TEST(Slam, SurvivesAPause) {
  Slam slam;
  drive(slam, 0.0, 2.0);
  Scan scan = scanAt(2.0);
  scan.stamp += 10.0;  // it stood still for 10 s
  const SlamResult result = slam.process(scan);
  EXPECT_NEAR(10.0 + kPeriod, result.gap, 1e-6);
  EXPECT_TRUE(result.match.searched);
  EXPECT_LT(errorOf(result.pose, 2.0), 0.03);
}

TEST(Slam, SurvivesATimeJump) {
  Slam slam;
  drive(slam, 0.0, 2.0);
  Scan scan = scanAt(2.0);
  scan.stamp -= 50.0;
  const SlamResult result = slam.process(scan);
  EXPECT_TRUE(result.time_jumped_back);
  EXPECT_EQ(Status::kMatched, result.status);
  EXPECT_LT(errorOf(result.pose, 2.0), 0.03);
  // Standing, it goes on to update the map.
  const std::size_t before = slam.map().updates();
  for (int i = 0; i <= 10; ++i) {
    scan.stamp += 0.1;
    slam.process(scan);
  }
  EXPECT_EQ(before + 2, slam.map().updates());
}

// One scan is matched 0.2 m away, as where people hide a wall: the velocity that this seems doesn't lead on.
TEST(Slam, APoseThatJumpsDoesNotLeadAway) {
  for (const bool limited : {true, false}) {
    SlamOptions options;
    if (!limited) options.max_acceleration = 1e9;
    Slam slam(options);
    drive(slam, 0.0, 2.0);
    Scan jumped = look(room(), truthAt(2.0) + Pose(0.2, 0.0, 0.0), noisy());
    jumped.stamp = 102.0;
    const Pose pose = slam.process(jumped).pose;
    ASSERT_NEAR(0.2, errorOf(pose, 2.0), 0.03);
    const Pose guess = slam.process(scanAt(2.05)).guess;
    if (limited)
      EXPECT_LT(errorOf(guess, 2.05), 0.25);
    else
      EXPECT_GT(errorOf(guess, 2.05), 0.35);
    EXPECT_LT(drive(slam, 2.1, 3.0), 0.04);
  }
}

TEST(Slam, OdometryIsTheFirstGuess) {
  SlamOptions options;
  options.matcher.search = Search::kNever;
  Slam slam(options);
  // Seconds apart, 0.6 m and 0.4 rad in between: nothing but odometry, in a frame of its own, leads there.
  const Pose odometry_frame(3.0, -5.0, 2.0);
  for (int i = 0; i < 15; ++i) {
    const SlamResult result = slam.process(scanAt(i), compose(odometry_frame, truthAt(i)));
    EXPECT_LT(errorOf(result.pose, i), 0.03);
  }
}

TEST(Slam, OdometryThatJumpsIsNoGuess) {
  Slam slam;
  const auto odometryAt = [](double time) { return compose(Pose(3.0, 1.0, 2.0), truthAt(time)); };
  int i = 0;
  for (; i < 20; ++i)
    EXPECT_FALSE(slam.process(scanAt(kPeriod * i), odometryAt(kPeriod * i)).odometry_jumped);
  for (const Pose& jump : {Pose(-7.0, 2.0, 0.0), Pose(0.0, 0.0, 1.5)}) {
    for (const int last = i + 10; i < last; ++i) {
      const SlamResult result = slam.process(scanAt(kPeriod * i), compose(jump, odometryAt(kPeriod * i)));
      EXPECT_EQ(i == last - 10, result.odometry_jumped) << i;
      EXPECT_LT(errorOf(result.pose, kPeriod * i), 0.03) << i;
    }
  }
}

// Wheels that only count: a way back is one forward to them.
TEST(Slam, OdometryMayCountAWayBackAsOneForward) {
  SlamOptions options;
  options.matcher.cost = "occupancy";
  Slam slam(options);
  Pose truth(0.0, 0.0, 0.3), odometry = Pose::Zero();
  for (int i = 0; i < 24; ++i) {
    const double way = i < 8 || i >= 16 ? 0.35 : -0.35;
    if (i > 0) {
      truth = compose(truth, {way, 0.0, 0.0});
      odometry = compose(odometry, {std::abs(way), 0.0, 0.0});
    }
    Scan scan = look(furnishedRoom(), compose({-1.8, -0.6, 0.0}, truth), noisy(), i);
    scan.stamp = 0.7 * i;
    const SlamResult result = slam.process(scan, odometry);
    EXPECT_NE(Status::kRejected, result.status) << i;
    const Pose error = between(between(Pose(0.0, 0.0, 0.3), truth), result.pose);
    EXPECT_LT(error.head<2>().norm(), 0.1) << i;
  }
}

TEST(Slam, InsertsAtPosesThatAreKnown) {
  const Pose start(10.0, -5.0, 0.5);
  SlamOptions options;
  Slam slam(options), matching(options);
  matching.setPose(start);
  for (int i = 0; i < 40; ++i) {
    const Pose pose = compose(start, truthAt(kPeriod * i));
    const SlamResult result = slam.insert(scanAt(kPeriod * i), pose);
    EXPECT_EQ(Status::kGiven, result.status);
    EXPECT_EQ(pose, result.pose);
    matching.process(scanAt(kPeriod * i));
  }
  EXPECT_GE(slam.map().updates(), 4u);  // each half second at least
  EXPECT_LT(slam.map().updates(), 40u);
  Scan again = scanAt(0.0);  // time jumps back
  again.stamp -= 50.0;
  EXPECT_TRUE(slam.insert(again, slam.pose()).map_updated);
  // Who goes on by matching finds where he is.
  EXPECT_EQ(Status::kMatched, slam.process(scanAt(2.0)).status);
  EXPECT_LT((slam.pose() - matching.process(scanAt(2.0)).pose).head<2>().norm(), 0.05);

  Scan empty = scanAt(2.05);
  empty.points.resize(3);
  empty.reflectivities.resize(3);
  const std::size_t before = slam.map().updates();
  EXPECT_EQ(Status::kEmpty, slam.insert(empty, Pose(90.0, 0.0, 0.0)).status);
  EXPECT_EQ(before, slam.map().updates());
}

// One wall alone is in view for less than max_gap: nothing tells how far the body goes along it, but it was
// moving.
TEST(Slam, GoesOnThroughABlindStretch) {
  SlamOptions options;
  options.matcher.cost = "occupancy";
  Slam slam(options);
  const double blind = 2.0, end = 2.6;
  EXPECT_LT(drive(slam, 0.0, blind), 0.03);
  double last = blind;
  for (; last < end; last += kPeriod) {
    Scan scan = scanAt(last);
    Scan wall = scan;
    wall.points.clear();
    wall.reflectivities.clear();
    for (std::size_t i = 0; i < scan.points.size(); ++i) {
      const Eigen::Vector2d seen = transform(truthAt(last), scan.points[i].cast<double>());
      if (std::abs(seen.y() + 1.75) > 0.1 || std::abs(seen.x()) > 3.0) continue;
      wall.points.push_back(scan.points[i]);
      wall.reflectivities.push_back(scan.reflectivities[i]);
    }
    EXPECT_EQ(Status::kUnobservable, slam.process(wall).status);
  }
  last -= kPeriod;
  EXPECT_GT((truthAt(last) - truthAt(blind)).head<2>().norm(), 0.2);
  EXPECT_LT(errorOf(slam.pose(), last), 0.06);
}

TEST(Slam, SearchesAfterALongWay) {
  const double later = 0.9;
  const Pose odometry = compose(truthAt(later), {0.2, -0.15, 0.25});
  for (bool search : {false, true}) {
    SlamOptions options;
    options.matcher.cost = "occupancy";
    if (!search) options.matcher.search_motion_distance = options.matcher.search_motion_angle = 10.0;
    Slam slam(options);
    slam.process(scanAt(0.0), truthAt(0.0));
    const SlamResult result = slam.process(scanAt(later), odometry);
    EXPECT_EQ(search, result.match.searched);
    EXPECT_LT(errorOf(result.pose, later), 0.03);
  }
}

// Odometry slips farther than the iterations on a single level reach, and nothing but the match says so.
TEST(Slam, SearchesWhereAMatchContradictsTheMap) {
  const double later = 4.0;
  const Pose odometry = compose(truthAt(later), {0.28, -0.25, 0.3});
  for (const bool search : {false, true}) {
    SlamOptions options;
    options.matcher.cost = "occupancy";
    options.matcher.search_motion_distance = options.matcher.search_motion_angle = 10.0;
    options.max_speed = options.max_turn_rate = 100.0;
    options.map.levels = 1;
    if (!search) options.matcher.search_contradiction = 1.0;
    Slam slam(options);
    for (int i = 0; i < 80; ++i) slam.process(scanAt(kPeriod * i), truthAt(kPeriod * i));
    const SlamResult result = slam.process(scanAt(later), odometry);
    EXPECT_EQ(Status::kMatched, result.status);
    EXPECT_EQ(search, result.match.searched);
    if (search) {
      EXPECT_LT(errorOf(result.pose, later), 0.03);
    } else {
      EXPECT_GT(errorOf(result.pose, later), 0.2);
      EXPECT_GT(result.match.contradiction, SlamOptions().matcher.search_contradiction);
    }
  }
}

TEST(Slam, DeskewsAFastTurn) {
  // The scanner takes 40 ms for a sweep, the body turns at 1.5 rad/s.
  const auto sweep = [](int k) {
    const Scanner scanner = noisy();
    Scan scan;
    scan.stamp = 0.05 * k;
    for (int i = 0; i < scanner.beams; ++i) {
      Scanner beam = scanner;
      beam.beams = 1;
      beam.angle_min = beam.angle_max =
          scanner.angle_min + (scanner.angle_max - scanner.angle_min) * i / (scanner.beams - 1);
      const double after = 0.04 * i / scanner.beams;
      const Scan one = look(furnishedRoom(), {0.2, 0.1, 1.5 * (scan.stamp + after)}, beam, 1000 * k + i);
      if (one.points.empty()) continue;
      scan.points.push_back(one.points[0]);
      scan.reflectivities.push_back(one.reflectivities[0]);
      scan.times.push_back(static_cast<float>(after));
    }
    return scan;
  };
  Slam slam;
  slam.setPose({0.2, 0.1, 0.0});
  std::vector<Pose> poses;
  for (int k = 0; k < 60; ++k) poses.push_back(slam.process(sweep(k)).pose);
  double greatest = 0.0;
  for (std::size_t k = 20; k < poses.size(); ++k) {
    greatest = std::max(greatest, std::abs(wrapAngle(poses[k].z() - poses[k - 1].z()) - 0.075));
  }
  EXPECT_LT(greatest, 0.006);
  // The first scan went into the map before the velocity was known; it was put right.
  EXPECT_LT(std::abs(wrapAngle(poses.back().z() - 1.5 * 0.05 * 59)), 0.015);
}

TEST(Slam, LocalizesInAMapWithoutChangingIt) {
  Slam mapping;
  drive(mapping, 0.0, 16.0);
  SlamOptions options;
  options.localization = true;
  Slam slam(options);
  slam.setMap(mapping.map(), truthAt(0.0) + Pose(0.15, -0.1, 0.1));
  EXPECT_LT(drive(slam, 0.0, 8.0), 0.04);
  EXPECT_TRUE(mapping.map() == slam.map());
  slam.reset();
  EXPECT_EQ(Status::kRejected, slam.process(scanAt(0.0)).status);
}

TEST(Slam, IsTheSameToTheBit) {
  Slam one, two;
  for (int i = 0; i < 60; ++i) {
    const SlamResult a = one.process(scanAt(kPeriod * i)), b = two.process(scanAt(kPeriod * i));
    ASSERT_EQ(a.pose, b.pose);
    ASSERT_EQ(a.covariance, b.covariance);
  }
  EXPECT_TRUE(one.map() == two.map());
}

TEST(Slam, TheSizeOfTheMapChangesNothing) {
  Slam usual;
  std::vector<Slam> others;
  for (const int size : {16, 777, 4096}) {
    SlamOptions options;
    options.map.size = size;
    options.map.start_x = 0.3;
    others.emplace_back(options);
  }
  for (int i = 0; i < 60; ++i) {
    const SlamResult expected = usual.process(scanAt(kPeriod * i));
    for (Slam& slam : others) {
      const SlamResult result = slam.process(scanAt(kPeriod * i));
      ASSERT_EQ(expected.pose, result.pose);
      ASSERT_EQ(expected.covariance, result.covariance);
    }
  }
  for (const Slam& slam : others) EXPECT_TRUE(usual.map() == slam.map());
}

TEST(Slam, RefusesScansThatAreNone) {
  Slam slam;
  Scan scan = scanAt(0.0);
  scan.reflectivities.pop_back();
  EXPECT_THROW(slam.process(scan), std::invalid_argument);
  scan.reflectivities.clear();
  scan.times = {0.0f};
  EXPECT_THROW(slam.process(scan), std::invalid_argument);
  const Pose before = slam.pose();
  for (const double value : {std::nan(""), HUGE_VAL}) {
    for (int i = 0; i < 3; ++i) {
      Pose pose = Pose::Zero();
      pose[i] = value;
      EXPECT_THROW(slam.process(scanAt(0.0), pose), std::invalid_argument);
      EXPECT_THROW(slam.insert(scanAt(0.0), pose), std::invalid_argument);
      EXPECT_THROW(slam.setPose(pose), std::invalid_argument);
      EXPECT_THROW(slam.reset(pose), std::invalid_argument);
      EXPECT_THROW(slam.setMap(MultiMap(slam.options().map), pose), std::invalid_argument);
    }
    Scan scan = scanAt(0.0);
    scan.stamp = value;
    EXPECT_THROW(slam.process(scan), std::invalid_argument);
  }
  EXPECT_EQ(before, slam.pose());
  scan = scanAt(0.0);
  scan.points[3].x() = std::numeric_limits<float>::infinity();
  EXPECT_THROW(slam.process(scan), std::invalid_argument);
  EXPECT_EQ(0u, slam.map().updates());
}

// A blind stretch, in which the body turns by most of a turn.
TEST(Places, AreFoundAgainAfterABlindStretch) {
  Slam slam;
  drive(slam, 0.0, 5.0);
  for (double time = 5.0; time < 14.0; time += kPeriod) {
    Scan nothing;
    nothing.stamp = 100.0 + time;
    EXPECT_EQ(Status::kEmpty, slam.process(nothing).status);
  }
  const SlamResult result = slam.process(scanAt(14.0));
  ASSERT_TRUE(result.place && result.place->sure) << (result.place ? result.place->why : "");
  EXPECT_EQ(Status::kMatched, result.status);
  EXPECT_LT(errorOf(result.pose, 14.0), 0.03);
  EXPECT_LT(drive(slam, 14.05, 17.0), 0.03);
}

TEST(Places, AreFoundByABodyThatWasPutElsewhere) {
  SlamOptions options;
  Slam slam(options);
  drive(slam, 0.0, 15.0);
  options.localization = true;
  slam.setOptions(options);
  slam.setPose({-2.0, 2.0, 2.5});
  double time = 15.0;
  while (errorOf(slam.process(scanAt(time)).pose, time) > 0.03 && time < 18.0) time += kPeriod;
  EXPECT_LT(drive(slam, time + kPeriod, 20.0), 0.03);

  slam.setLost();  // nobody knows where
  const SlamResult result = slam.process(scanAt(20.0));
  ASSERT_TRUE(result.place && result.place->sure);
  EXPECT_LT(errorOf(result.pose, 20.0), 0.03);
}

// A plain rectangle is the same after half a turn.
TEST(Places, ThatLookAlikeAreNotSure) {
  const std::vector<Wall> walls = box({-4.25, -2.75}, {4.25, 2.75});
  Scanner scanner = noisy();
  scanner.angle_min = -M_PI;
  scanner.angle_max = M_PI;
  for (const std::string cost : {"occupancy", "combined"}) {
    SlamOptions options;
    options.matcher.cost = cost;
    Slam slam(options);
    for (int i = 0; i < 20; ++i) {
      Scan scan = look(walls, {0.05 * i, 0.5, 0.1}, scanner, i);
      scan.stamp = 100.0 + 0.1 * i;
      slam.process(scan);
    }
    slam.setLost();
    Scan scan = look(walls, {1.0, 0.5, 0.3}, scanner, 50);
    scan.stamp = 103.0;
    const SlamResult result = slam.process(scan);
    ASSERT_TRUE(result.place);
    EXPECT_EQ(cost == "combined", result.place->sure) << cost << ": " << result.place->why;
    EXPECT_EQ(cost == "combined" ? Status::kMatched : Status::kRejected, result.status) << cost;
  }
}

// A map that was made anew lacks what came meanwhile.
TEST(CorrectedMap, HasAllScansAndThePoseGoesOn) {
  Slam slam;
  slam.keepScans(100 << 20);
  drive(slam, 0.0, 4.0);
  const InsertedScans all = slam.scansAfter(0.0);
  ASSERT_GT(all.size(), 6u);
  MapCorrection correction;
  correction.stamp = all[all.size() / 2].stamp;
  correction.correction = {0.4, -0.3, 0.5};
  MultiMap direct(slam.options().map), corrected(slam.options().map);
  insertAll(all, correction, direct);
  insertAll({all.begin(), all.begin() + all.size() / 2 + 1}, correction, corrected);

  const Pose before = slam.pose();
  slam.correct(corrected, correction, correction.stamp);
  EXPECT_EQ(compose(correction.correction, before), slam.pose());
  EXPECT_TRUE(direct == slam.map());
  for (double time = 4.0; time < 8.0; time += kPeriod) {
    const SlamResult result = slam.process(scanAt(time));
    EXPECT_EQ(Status::kMatched, result.status);
    EXPECT_LT(errorOf(compose(between(correction.correction, Pose::Zero()), result.pose), time), 0.03);
    // The velocity holds: the first guess is as good as ever.
    EXPECT_LT(between(result.guess, result.pose).head<2>().norm(), 0.02) << time;
  }
  // What is kept is in the new map, for the next one.
  MapCorrection back;
  back.correction = between(correction.correction, Pose::Zero());
  const InsertedScans kept = slam.scansAfter(0.0);
  EXPECT_LT((back.of(kept[1].value.pose, kept[1].stamp) - all[1].value.pose).norm(), 1e-9);
}

TEST(CorrectedMap, GivenPosesMayBeCorrectedAlready) {
  Slam slam;
  slam.keepScans(100 << 20);
  for (int i = 0; i < 40; ++i) slam.insert(scanAt(0.5 * i), truthAt(0.5 * i));
  MapCorrection correction;
  correction.stamp = 105.0;
  correction.correction = {1.0, 0.0, 0.0};
  correction.corrected_from = 110.0;
  slam.correct(MultiMap(slam.options().map), correction, correction.stamp);
  EXPECT_EQ(truthAt(19.5), slam.pose());
  for (const auto& entry : slam.scansAfter(105.0)) {
    const double moved = (entry.value.pose - truthAt(entry.stamp - 100.0)).head<2>().norm();
    EXPECT_NEAR(entry.stamp < 110.0 ? 1.0 : 0.0, moved, 1e-9) << entry.stamp;
  }
}

TEST(CorrectedMap, WithoutMemoryItIsKnownThatScansAreMissing) {
  Slam slam;
  drive(slam, 0.0, 2.0);
  EXPECT_TRUE(slam.scansAfter(0.0).empty());
  EXPECT_FALSE(slam.keepsScansAfter(100.5));
  EXPECT_TRUE(slam.keepsScansAfter(102.0));
  slam.reset();
  EXPECT_TRUE(slam.keepsScansAfter(0.0));
}

}  // namespace
}  // namespace intensity_hector_slam
