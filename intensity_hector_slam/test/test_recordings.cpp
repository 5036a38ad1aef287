// SPDX-License-Identifier: BSD-3-Clause
//
// Recordings of real scanners.
#include <gtest/gtest.h>
#include <mapping_common/testing/recordings.h>

#include <cmath>
#include <fstream>
#include <map>
#include <sstream>

#include "intensity_hector_slam/ros/bag_runner.h"

namespace intensity_hector_slam {
namespace {

using mapping_common::findRecording;
using mapping_common::withoutRecording;

BagResult run(const std::string& bag, const SlamParameters& parameters) {
  BagOptions options;
  options.bag = bag;
  options.scan_topic = "scan";
  return runBag(options, parameters);
}

// A hand-held scanner along a hallway of 1.5 m, without odometry.
TEST(Recordings, HallwayWithoutOdometryIsConsistent) {
  const std::string name = "rosbags_2d/hallway_rplidar.bag", bag = findRecording(name);
  if (bag.empty()) GTEST_SKIP() << withoutRecording(name);
  SlamParameters parameters;
  parameters.slam.matcher.cost = "occupancy";
  const BagResult result = run(bag, parameters);
  ASSERT_EQ(881u, result.entries.size());
  double contradiction = 0.0, overlap = 0.0;
  for (const auto& entry : result.entries) {
    EXPECT_NE(Status::kRejected, entry.result.status);
    EXPECT_NE(Status::kEmpty, entry.result.status);
    contradiction += entry.result.match.contradiction / result.entries.size();
    overlap += entry.result.match.overlap / result.entries.size();
  }
  EXPECT_LT(contradiction, 0.1);
  EXPECT_GT(overlap, 0.85);
}

// A drive of 71 m along a street. The reference is of scan matching in 3D, which has errors of its own.
TEST(Recordings, StreetIsFollowedWithEachCost) {
  const std::string name = "laser2d_intensity_street/street154.bag", bag = findRecording(name);
  const std::string reference_name = "laser2d_intensity_street/street154_reference.txt";
  if (bag.empty() || findRecording(reference_name).empty()) GTEST_SKIP() << withoutRecording(name);
  std::map<long, Pose> reference;  // by tenths of a second
  std::ifstream file(findRecording(reference_name));
  for (std::string line; std::getline(file, line);) {
    double time;
    Pose pose;
    if (std::istringstream(line) >> time >> pose.x() >> pose.y() >> pose.z()) {
      reference[std::lround(10.0 * (time + 1000.0))] = pose;
    }
  }
  for (const std::string& cost : mapping_common::namesOf(costs())) {
    SlamParameters parameters;
    parameters.slam.map.resolution = 0.2;
    parameters.slam.map.size = 512;
    parameters.slam.matcher.cost = cost;
    parameters.scan.max_range = 80.0;
    const BagResult result = run(bag, parameters);
    ASSERT_EQ(154u, result.entries.size());
    double greatest = 0.0, turn = 0.0;
    for (const auto& entry : result.entries) {
      EXPECT_NE(Status::kRejected, entry.result.status);
      const auto expected = reference.find(std::lround(10.0 * entry.stamp));
      ASSERT_NE(reference.end(), expected);
      const Pose error = between(expected->second, entry.result.pose);
      greatest = std::max(greatest, error.head<2>().norm());
      turn = std::max(turn, std::abs(error.z()));
    }
    EXPECT_LT(greatest, 0.3) << cost;
    EXPECT_LT(turn, 0.02) << cost;
  }
}

}  // namespace
}  // namespace intensity_hector_slam
