// SPDX-License-Identifier: BSD-3-Clause
#include <gtest/gtest.h>

#include <random>

#include "flat_world.h"
#include "intensity_hector_slam/multi_map.h"
#include "intensity_hector_slam/scan_search.h"

namespace intensity_hector_slam {
namespace {

Scanner scanner() {
  Scanner scanner;
  scanner.beams = 181;
  scanner.range_noise = 0.01;
  scanner.reflectivity_noise = 0.02;
  return scanner;
}

MultiMap mapOf(const std::vector<Wall>& walls, const std::vector<Pose>& poses) {
  MapOptions options;
  options.resolution = 0.05;
  MultiMap map(options);
  Scanner fine = scanner();
  fine.beams = 1081;
  for (std::size_t i = 0; i < 3 * poses.size(); ++i) {
    const Pose& pose = poses[i % poses.size()];
    map.update(look(walls, pose, fine, i), pose);
  }
  return map;
}

const std::vector<Pose> kPoses = {{0, 0, 0}, {-2, -1, 2}, {3, 1.5, 4}, {1, -2, -1}};

void expectNear(const Pose& expected, const Pose& pose, double distance = 0.15) {
  EXPECT_LT((pose - expected).head<2>().norm(), distance) << pose.transpose();
  EXPECT_LT(std::abs(wrapAngle(pose.z() - expected.z())), 0.05) << pose.transpose();
}

// Whatever the scan, the region and the channel.
TEST(ScanSearch, FindsTheBestOfAll) {
  const MultiMap map = mapOf(furnishedRoom(), kPoses);
  std::mt19937 random(7);
  std::uniform_real_distribution<double> uniform(-1.0, 1.0);
  SearchOptions options;
  options.min_score = 0.0;
  options.points = 40;
  for (int i = 0; i < 12; ++i) {
    const ScanSearch search(map.level(1), options, i % 2 == 0);
    const Pose pose(3.5 * uniform(random), 2.0 * uniform(random), M_PI * uniform(random));
    Scan scan = look(furnishedRoom(), pose, scanner(), i);
    scan.origin = Eigen::Vector2f(0.2f, 0.1f);
    if (i % 3 == 2) {  // of another world
      for (auto& point : scan.points) point *= 0.7f;
    }
    const SearchRegion region = i % 4 == 3 ? SearchRegion::around(pose, 1.0, 0.5) : SearchRegion{};
    const auto expected = search.bestOfAll(scan, region);
    const auto found = search.optima(scan, region, 1.0, 1);
    ASSERT_EQ(1u, found.size()) << i;
    EXPECT_GT(found[0].score, 0.1) << i;
    EXPECT_DOUBLE_EQ(expected.score, found[0].score) << i;
  }
}

TEST(ScanSearch, FindsTheScanInAllOfTheMap) {
  const MultiMap map = mapOf(furnishedRoom(), kPoses);
  const ScanSearch search(map.level(1), {}, true);
  const Pose pose(2.0, 1.2, 2.5);
  const Scan scan = look(furnishedRoom(), pose, scanner());
  const auto found = search.optima(scan, {}, 0.9, 3);
  ASSERT_EQ(1u, found.size());
  expectNear(pose, found[0].pose);
  EXPECT_GT(search.score(scan, pose), 0.85);
}

// A plain rectangle looks the same after half a turn; what its walls reflect doesn't.
TEST(ScanSearch, TellsPlacesApartByReflectivity) {
  const std::vector<Wall> walls = box({-4.25, -2.75}, {4.25, 2.75});
  const MultiMap map = mapOf(walls, kPoses);
  const Pose pose(1.0, 0.5, 0.3);
  Scanner around = scanner();
  around.angle_min = -M_PI;
  around.angle_max = M_PI;
  const Scan scan = look(walls, pose, around);
  const auto alike = ScanSearch(map.level(1), {}, false).optima(scan, {}, 0.9, 3);
  ASSERT_EQ(2u, alike.size());
  const auto found = ScanSearch(map.level(1), {}, true).optima(scan, {}, 0.9, 3);
  ASSERT_EQ(1u, found.size());
  expectNear(pose, found[0].pose);
}

TEST(ScanSearch, FindsNothingWhereThereIsNothing) {
  EXPECT_TRUE(ScanSearch(MultiMap().level(2), {}, true)
                  .optima(look(furnishedRoom(), Pose::Zero(), scanner()), {}, 0.9, 1)
                  .empty());
  const MultiMap map = mapOf(furnishedRoom(), kPoses);
  const ScanSearch search(map.level(1), {}, true);
  EXPECT_TRUE(search.optima({}, {}, 0.9, 1).empty());
  EXPECT_TRUE(search
                  .optima(look(furnishedRoom(), Pose::Zero(), scanner()),
                          SearchRegion::around({100, 0, 0}, 1.0, 1.0), 0.9, 1)
                  .empty());
}

}  // namespace
}  // namespace intensity_hector_slam
