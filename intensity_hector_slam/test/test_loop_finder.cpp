// SPDX-License-Identifier: BSD-3-Clause
#include <gtest/gtest.h>

#include <Eigen/LU>
#include <algorithm>
#include <random>

#include "flat_world.h"
#include "intensity_hector_slam/loop_finder.h"

namespace intensity_hector_slam {
namespace {

// A ring of corridors, 20 m x 12 m outside and 2 m wide, with niches on the south side alone.
std::vector<Wall> ring(bool striped = true) {
  std::vector<Wall> walls = box({0, 0}, {20, 12}, striped);
  for (const Wall& wall : box({2, 2}, {18, 10}, striped)) walls.push_back(wall);
  return walls;
}
std::vector<Wall> furnishedRing() {
  std::vector<Wall> walls = ring();
  std::mt19937 random(3);
  std::uniform_real_distribution<double> uniform(0.0, 1.0);
  for (int i = 0; i < 14; ++i) {  // cupboards along the outer walls
    const double at = 2.5 + 15.0 * uniform(random), size = 0.3 + 0.7 * uniform(random);
    const double y = i % 2 == 0 ? 0.0 : 11.7;
    for (const Wall& wall : box({at, y}, {at + size, y + 0.3})) walls.push_back(wall);
  }
  for (int i = 0; i < 6; ++i) {
    const double at = 2.5 + 7.0 * uniform(random), x = i % 2 == 0 ? 0.0 : 19.7;
    for (const Wall& wall : box({x, at}, {x + 0.3, at + 0.6})) walls.push_back(wall);
  }
  return walls;
}

// Around the ring, a pose each half metre.
std::vector<Pose> wayAround(double length) {
  const std::vector<Eigen::Vector2d> corners = {{1, 1}, {19, 1}, {19, 11}, {1, 11}};
  std::vector<Pose> poses;
  for (double at = 0.0; at < length; at += 0.5) {
    double left = std::fmod(at + 6.0, 56.0);
    std::size_t side = 0;
    for (; left >= (side % 2 == 0 ? 18.0 : 10.0); ++side) left -= side % 2 == 0 ? 18.0 : 10.0;
    const Eigen::Vector2d direction = (corners[(side + 1) % 4] - corners[side]).normalized();
    const Eigen::Vector2d position = corners[side] + left * direction;
    poses.push_back({position.x(), position.y(), std::atan2(direction.y(), direction.x())});
  }
  return poses;
}

Scanner scanner() {
  Scanner scanner;
  scanner.beams = 361;
  scanner.range_noise = 0.01;
  scanner.reflectivity_noise = 0.02;
  return scanner;
}

const Drift kDrift = {0.02, 0.004, 0.02};

// Key poses with edges that drift, as a front end without loops would make them. The one to `jump` is off by
// 8 cm, and says so.
struct Drive {
  std::vector<Edge> loops;
  std::vector<Pose> truth;
  LoopFinder::Counts counts;
};
Drive driveThrough(const std::vector<Wall>& walls, const std::vector<Pose>& way, const std::string& cost,
                   unsigned seed, const LoopOptions& options = {}, std::size_t jump = 0) {
  SlamOptions slam;
  slam.matcher.cost = cost;
  LoopFinder finder(options, slam);
  std::mt19937 random(seed);
  std::normal_distribution<double> normal;
  Drive drive{{}, way, {}};
  KeyPose last;
  for (std::size_t i = 0; i < way.size(); ++i) {
    KeyPose key{static_cast<std::uint32_t>(i), 1.0 * i, way[i]};
    std::optional<Edge> edge;
    if (i > 0) {
      const double root = std::sqrt(0.5);
      const Pose truth = between(way[i - 1], way[i]);
      Pose error = root * Pose(kDrift.distance * normal(random), kDrift.distance * normal(random),
                               kDrift.angle * normal(random));
      Eigen::Matrix3d covariance = Eigen::Matrix3d::Zero();
      covariance.diagonal() << 0.5 * std::pow(kDrift.distance, 2), 0.5 * std::pow(kDrift.distance, 2),
          0.5 * std::pow(kDrift.angle, 2);
      if (i == jump) {
        error.y() += 0.08;
        covariance(1, 1) += 0.08 * 0.08;
      }
      edge = Edge{last, key, truth + error, covariance.inverse()};
    }
    for (const Edge& loop : finder.add(key, look(walls, way[i], scanner(), 100 * seed + i), edge))
      drive.loops.push_back(loop);
    last = key;
  }
  drive.counts = finder.counts();
  return drive;
}

std::size_t countWrong(const Drive& drive) {
  std::size_t wrong = 0;
  for (const Edge& loop : drive.loops) {
    const Pose truth = between(drive.truth[loop.from.id], drive.truth[loop.to.id]);
    const Pose error = between(truth, loop.transform);
    wrong += error.head<2>().norm() > 0.15 || std::abs(error.z()) > 0.05;
  }
  return wrong;
}

TEST(LoopFinder, ClosesTheLoop) {
  for (const std::string cost : {"occupancy", "combined"}) {
    const Drive drive = driveThrough(furnishedRing(), wayAround(70.0), cost, 1);
    ASSERT_GE(drive.loops.size(), 3u) << cost;
    EXPECT_EQ(0u, countWrong(drive)) << cost;
    EXPECT_EQ(drive.loops.size(), drive.counts.loops);
    for (const Edge& loop : drive.loops) {
      EXPECT_EQ(EdgeType::kLoopClosure, loop.type);
      EXPECT_EQ(drive.truth[loop.to.id], loop.to.pose);
      EXPECT_GT(loop.to.id, loop.from.id + 80);  // around the ring, not along the chain
      EXPECT_GE(loop.similarity, SearchOptions().min_score);
      EXPECT_LE(loop.similarity, 1.0);
      const Pose error = between(between(drive.truth[loop.from.id], drive.truth[loop.to.id]), loop.transform);
      EXPECT_LT(error.dot(loop.information * error), 30.0) << cost;  // of a chi squared with 3 degrees
    }
  }
}

TEST(LoopFinder, TiesAPoseBehindAJumpAtOnce) {
  const auto loopsTo = [](std::size_t jump) {
    std::vector<std::size_t> ids;
    for (const Edge& loop : driveThrough(furnishedRing(), wayAround(70.0), "combined", 1, {}, jump).loops)
      ids.push_back(loop.to.id);
    return ids;
  };
  const std::vector<std::size_t> without = loopsTo(0);
  ASSERT_GE(without.size(), 2u);
  const std::size_t next = without[1] + 1;
  EXPECT_EQ(0, std::count(without.begin(), without.end(), next)) << "loops are loop_spacing apart";
  const std::vector<std::size_t> with = loopsTo(next);
  EXPECT_EQ(1, std::count(with.begin(), with.end(), next));
}

// Nothing along a corridor without any texture tells where in it the robot is.
TEST(LoopFinder, FindsNoneWhereThePoseIsNotObservable) {
  std::vector<Wall> walls = {{{-50, -1}, {50, -1}}, {{-50, 1}, {50, 1}}};
  std::vector<Pose> way;
  for (int i = 0; i < 40; ++i) way.push_back({0.5 * i, 0, 0});
  for (int i = 0; i < 40; ++i) way.push_back({19.5 - 0.5 * i, 0, M_PI});
  for (const std::string cost : {"occupancy", "combined"}) {
    const Drive drive = driveThrough(walls, way, cost, 2);
    EXPECT_GT(drive.counts.searches, 0u);
    EXPECT_TRUE(drive.loops.empty()) << cost;
  }
}

TEST(LoopFinder, FindsNoneWhereTheRobotWasNot) {
  std::vector<Pose> way = wayAround(70.0);
  way.resize(80);  // not yet around
  EXPECT_TRUE(driveThrough(furnishedRing(), way, "combined", 3).loops.empty());
}

// Walls with doors, that differ from seed to seed in where they are dark alone.
std::vector<Wall> roomOf(unsigned seed) {
  const std::vector<Eigen::Vector2d> corners = {{-3, -2.5}, {3.5, -2.5}, {3.5, 1.0},
                                                {2.0, 1.0}, {2.0, 2.5},  {-3, 2.5}};
  std::vector<Wall> walls;
  for (std::size_t i = 0; i < corners.size(); ++i) {
    const unsigned wall = 100 * seed + i;
    walls.push_back({corners[i], corners[(i + 1) % corners.size()], [wall](double at) {
                       std::minstd_rand random(wall + 7919u * static_cast<unsigned>(at / 0.9));
                       random.discard(10);
                       return random() % 3 == 0 ? 0.3 : 0.65;
                     }});
  }
  return walls;
}

// Through a room, 15 m away and back, by odometry that is off by a metre, into the same room or another.
struct Rooms {
  int with_loops = 0, wrong = 0;  // seeds
};
Rooms driveBetweenRooms(const std::string& cost, bool same, unsigned seeds) {
  SlamOptions slam;
  slam.matcher.cost = cost;
  Rooms rooms;
  for (unsigned seed = 1; seed <= seeds; ++seed) {
    LoopFinder finder({}, slam);
    std::mt19937 random(seed);
    std::normal_distribution<double> normal(0.0, 0.5);
    std::vector<Pose> truth;
    std::size_t loops = 0, wrong = 0;
    KeyPose last;
    const auto add = [&](const Pose& pose, const Scan& scan, double deviation, const Pose& error) {
      const KeyPose key{static_cast<std::uint32_t>(truth.size()), 1.0 * truth.size(), pose};
      std::optional<Edge> edge;
      const double d = deviation * deviation, a = 0.01 * d;
      const Eigen::Matrix3d covariance = Eigen::Vector3d(d, d, a).asDiagonal();
      if (!truth.empty()) edge = Edge{last, key, between(truth.back(), pose) + error, covariance.inverse()};
      truth.push_back(pose);
      last = key;
      for (const Edge& loop : finder.add(key, scan, edge)) {
        const Pose off = between(between(truth[loop.from.id], truth[loop.to.id]), loop.transform);
        ++loops;
        wrong += !same || off.head<2>().norm() > 0.15 || std::abs(off.z()) > 0.05;
      }
    };
    for (const bool again : {false, true}) {
      const std::vector<Wall> room = roomOf(!again || same ? seed : seed + seeds);
      for (int i = 0; i < 6; ++i) {
        const Pose pose(-1.5 + 0.5 * i, -0.6 + 0.2 * i + 0.3 * again, 0.4);
        const bool entered = again && i == 0;
        const Pose error = entered ? Pose(normal(random), normal(random), 0.0) : Pose(0, 0, 0);
        add(pose, look(room, pose, scanner(), 50 * seed + 10 * again + i), entered ? 0.7 : 0.01, error);
      }
      if (!again) add({15.0, 0.0, 0.0}, {}, 0.7, Pose::Zero());
    }
    rooms.with_loops += loops > 0;
    rooms.wrong += wrong > 0;
  }
  return rooms;
}

// By geometry it is the same room; by what its walls reflect it never is.
TEST(LoopFinder, TakesNoRoomForAnotherThatReflectsOtherwise) {
  constexpr unsigned kSeeds = 50;
  EXPECT_GE(driveBetweenRooms("occupancy", false, kSeeds).wrong, 45);
  EXPECT_EQ(0, driveBetweenRooms("combined", false, kSeeds).wrong);
  const Rooms same = driveBetweenRooms("combined", true, kSeeds);
  EXPECT_GE(same.with_loops, 45);
  EXPECT_EQ(0, same.wrong);
}

TEST(LoopFinder, ConnectsNoPartsOfABrokenChain) {
  const std::vector<Pose> way = wayAround(70.0);
  LoopFinder finder;
  for (std::size_t i = 0; i < way.size(); ++i) {
    const KeyPose key{static_cast<std::uint32_t>(i), 1.0 * i, way[i]};
    std::optional<Edge> edge;
    if (i > 0 && i != 60) {
      edge = Edge{{key.id - 1, i - 1.0, way[i - 1]},
                  key,
                  between(way[i - 1], way[i]),
                  1e4 * Eigen::Matrix3d::Identity()};
    }
    for (const Edge& loop : finder.add(key, look(furnishedRing(), way[i], scanner(), i), edge))
      EXPECT_GE(loop.from.id, 60u);
  }
}

TEST(LoopFinder, ForgetsTheOldestBeyondItsMemory) {
  LoopOptions options;
  options.memory = 0.1;
  const Drive drive = driveThrough(furnishedRing(), wayAround(70.0), "combined", 1, options);
  EXPECT_GT(drive.counts.forgotten, 80u);
  EXPECT_TRUE(drive.loops.empty());
}

TEST(LoopFinder, SaysWhatIsWrong) {
  LoopOptions options;
  options.submap_length = 20.0;
  EXPECT_THROW(LoopFinder{options}, std::invalid_argument);
  LoopFinder finder;
  const KeyPose key;
  EXPECT_THROW(finder.add(key, {}, Edge{key, key}), std::invalid_argument);
}

}  // namespace
}  // namespace intensity_hector_slam
