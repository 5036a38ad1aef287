// SPDX-License-Identifier: BSD-3-Clause
#include <gtest/gtest.h>

#include "pose_graph/trajectory.h"

namespace pose_graph {
namespace {

constexpr std::int64_t kMs = 1'000'000;

TEST(Trajectory, InterpolatesWhatItKept) {
  Trajectory trajectory(100 * kMs, 1000);
  EXPECT_FALSE(trajectory.at(0));
  for (int ms = 0; ms <= 1003; ms += 25) trajectory.add(ms * kMs, planarPose(0.001 * ms, 0.0, 0.002 * ms));
  EXPECT_LE(trajectory.size(), 16u) << "not all 41";
  for (const int ms : {0, 13, 500, 777, 1000}) {
    const auto pose = trajectory.at(ms * kMs);
    ASSERT_TRUE(pose) << ms;
    EXPECT_NEAR(0.001 * ms, pose->translation.x(), 1e-9);
    EXPECT_NEAR(0.002 * ms, pose->yaw(), 1e-9);
  }
  EXPECT_EQ(1000 * kMs, trajectory.last());
  EXPECT_FALSE(trajectory.at(1001 * kMs));
  EXPECT_FALSE(trajectory.at(-1));
}

TEST(Trajectory, DoesNotBridgeGapsNorGoBack) {
  Trajectory trajectory;
  trajectory.add(0, {});
  trajectory.add(3000 * kMs, planarPose(1.0, 0.0, 0.0));
  EXPECT_FALSE(trajectory.at(1000 * kMs));
  EXPECT_TRUE(trajectory.at(1000 * kMs, 3000 * kMs));
  EXPECT_FALSE(trajectory.add(2000 * kMs, {}));
  EXPECT_FALSE(trajectory.add(3000 * kMs, {}));
  EXPECT_EQ(2u, trajectory.size());
}

TEST(Trajectory, IsBounded) {
  Trajectory trajectory(100 * kMs, 100);
  for (int i = 0; i < 1000; ++i) {
    trajectory.add(i * 100 * kMs, planarPose(i, 0.0, 0.0));
    ASSERT_LE(trajectory.size(), 100u);
  }
  EXPECT_NEAR(998.5, trajectory.at(99850 * kMs)->translation.x(), 1e-9) << "the latest stay";
  EXPECT_NEAR(3.0, trajectory.at(300 * kMs, 100'000 * kMs)->translation.x(), 1e-9) << "the first, coarsely";
}

}  // namespace
}  // namespace pose_graph
