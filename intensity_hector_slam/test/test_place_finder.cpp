// SPDX-License-Identifier: BSD-3-Clause
#include <gtest/gtest.h>

#include <random>

#include "flat_world.h"
#include "intensity_hector_slam/place_finder.h"

namespace intensity_hector_slam {
namespace {

constexpr int kSeeds = 50;

// Walls with doors, as in an office; another seed gives others.
Wall wallWithDoors(const Eigen::Vector2d& from, const Eigen::Vector2d& to, unsigned seed) {
  return {from, to, [seed](double at) {
            std::minstd_rand random(seed + 7919u * static_cast<unsigned>(at / 0.9));
            random.discard(10);
            return random() % 3 == 0 ? 0.3 : 0.65;
          }};
}

// Rooms of one shape, that differ only in where their walls are dark.
std::vector<Wall> roomOf(unsigned seed) {
  std::vector<Wall> walls;
  const std::vector<Eigen::Vector2d> corners = {{-3, -2.5}, {3.5, -2.5}, {3.5, 1.0},
                                                {2.0, 1.0}, {2.0, 2.5},  {-3, 2.5}};
  for (std::size_t i = 0; i < corners.size(); ++i) {
    walls.push_back(wallWithDoors(corners[i], corners[(i + 1) % corners.size()], 100 * seed + i));
  }
  return walls;
}

Scanner scanner() {
  Scanner scanner;
  scanner.beams = 541;
  scanner.range_noise = 0.01;
  scanner.reflectivity_noise = 0.03;
  return scanner;
}

MultiMap mapOf(const std::vector<Wall>& walls) {
  MapOptions options;
  options.resolution = 0.05;
  MultiMap map(options);
  for (unsigned i = 0; i < 8; ++i) {
    const Pose pose(-1.5 + 0.4 * i, -0.5 + 0.1 * i, 0.8 * i);
    map.update(look(walls, pose, scanner(), i), pose);
  }
  return map;
}

struct Count {
  int right = 0, wrong = 0, unsure = 0;
};

// Scans at random poses of a room, sought in the map of the same or of another.
Count seek(const std::string& cost, bool same) {
  MatcherOptions matcher;
  matcher.cost = cost;
  PlaceFinder finder({}, matcher);
  Count count;
  for (unsigned seed = 1; seed <= kSeeds; ++seed) {
    const MultiMap map = mapOf(roomOf(seed));
    finder.forget();
    std::mt19937 random(seed);
    std::uniform_real_distribution<double> uniform(-1.0, 1.0);
    const Pose pose(1.5 * uniform(random), 1.2 * uniform(random), M_PI * uniform(random));
    const Place place =
        finder.find(map, look(roomOf(same ? seed : seed + kSeeds), pose, scanner(), 99 + seed));
    const Pose error = between(pose, place.pose);
    const bool is_right = same && error.head<2>().norm() < 0.1 && std::abs(error.z()) < 0.05;
    ++(place.sure ? (is_right ? count.right : count.wrong) : count.unsure);
  }
  return count;
}

TEST(PlaceFinder, FindsTheRoom) {
  for (const std::string cost : {"occupancy", "combined"}) {
    const Count count = seek(cost, true);
    EXPECT_EQ(0, count.wrong) << cost;
    EXPECT_GE(count.right, kSeeds * 9 / 10) << cost << ", unsure " << count.unsure;
  }
}

// By geometry it is the same room; by what its walls reflect it never is.
TEST(PlaceFinder, TakesNoRoomForAnotherThatReflectsOtherwise) {
  EXPECT_GE(seek("occupancy", false).wrong, kSeeds * 9 / 10);
  EXPECT_EQ(0, seek("combined", false).wrong);
}

// Most beams pass close by the walls for metres.
TEST(PlaceFinder, FindsScansAlongWalls) {
  std::vector<Wall> walls = box({-9, -0.9}, {9, 0.9});
  for (const double x : {-8.0, -5.5, -4.7, 0.6, 2.9, 6.6}) {
    const std::vector<Wall> locker = box({x, 0.5}, {x + 0.5, 0.9});
    walls.insert(walls.end(), locker.begin(), locker.end());
  }
  MapOptions options;
  options.resolution = 0.05;
  MultiMap map(options);
  for (int i = 0; i <= 32; ++i) {
    const Pose pose(-8.0 + 0.5 * i, -0.2, i % 2 == 0 ? 0.0 : M_PI);
    map.update(look(walls, pose, scanner(), i), pose);
  }
  PlaceFinder finder;
  int sure = 0;
  for (int i = 0; i < 12; ++i) {
    const Pose pose(-6.6 + 1.1 * i, -0.3 + 0.02 * i, 0.3 * (i % 3 - 1) + (i % 2) * M_PI);
    const Place place = finder.find(map, look(walls, pose, scanner(), 500 + i));
    const Pose error = between(pose, place.pose);
    EXPECT_TRUE(!place.sure || error.head<2>().norm() < 0.1) << i << ": " << error.transpose();
    sure += place.sure;
  }
  EXPECT_GE(sure, 10);
}

// A map knows nothing of rooms that it doesn't have, though some of their corners are like its own.
TEST(PlaceFinder, TakesNoOtherRoomForOneInTheMap) {
  const MultiMap map = mapOf(furnishedRoom());
  PlaceFinder finder;
  for (unsigned seed = 1; seed <= 10; ++seed) {
    const Place place = finder.find(map, look(roomOf(seed), {0.3, -0.2 * seed, 0.6 * seed}, scanner(), seed));
    EXPECT_FALSE(place.sure) << seed << ": " << place.score;
  }
}

TEST(PlaceFinder, IsNotSureOfACornerAlone) {
  const MultiMap map = mapOf(roomOf(1));
  Scanner narrow = scanner();
  narrow.angle_min = -0.3;
  narrow.angle_max = 0.3;
  const Place place = PlaceFinder().find(map, look(roomOf(1), {0.5, 0.0, 0.8}, narrow));
  EXPECT_FALSE(place.sure);
  EXPECT_NE(std::string::npos, place.why.find("too little")) << place.why;
}

TEST(PlaceFinder, SaysWhyItIsNotSure) {
  PlaceFinder finder;
  const Scan scan = look(roomOf(1), Pose::Zero(), scanner());
  const Place nowhere = finder.find(MultiMap(), scan);
  EXPECT_FALSE(nowhere.sure);
  EXPECT_EQ("nothing in the map is like it", nowhere.why);
}

}  // namespace
}  // namespace intensity_hector_slam
