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

TEST(PlaceFinder, SaysWhyItIsNotSure) {
  PlaceFinder finder;
  const Scan scan = look(roomOf(1), Pose::Zero(), scanner());
  const Place nowhere = finder.find(MultiMap(), scan);
  EXPECT_FALSE(nowhere.sure);
  EXPECT_EQ("nothing in the map is like it", nowhere.why);
}

}  // namespace
}  // namespace intensity_hector_slam
