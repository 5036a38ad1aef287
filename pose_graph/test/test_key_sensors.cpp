// SPDX-License-Identifier: BSD-3-Clause
#include <gtest/gtest.h>

#include "pose_graph/key_sensors.h"

namespace pose_graph {
namespace {

constexpr std::int64_t kMs = 1'000'000;

// A key pose each second from 1 s on, and the front end's poses between, up to a time.
OnlineGraph graphUpTo(int ms) {
  OnlineGraph graph;
  for (int s = 2; 1000 * s <= ms; ++s) {
    Measurement step;
    step.from_stamp = (s - 1) * 1000 * kMs;
    step.to_stamp = s * 1000 * kMs;
    step.source = "edges";
    step.transform = planarPose(0.5, 0.0, 0.0);
    graph.add(step);
  }
  for (int t = 1000; t <= ms; t += 50) graph.addFrontEndPose(t * kMs, planarPose(5e-4 * t, 0.0, 0.0));
  return graph;
}

KeyData named(const std::string& name) {
  KeyData data;
  data.data = name;
  return data;
}

struct Sensors : KeySensors {
  void add(DataKind kind, int ms, int until_ms, const std::string& name) {
    KeySensors::add(kind, ms * kMs, until_ms * kMs, [name](const Trajectory&) { return named(name); });
  }
};

TEST(KeySensors, TakesTheScanOfAKeyPoseAlone) {
  Sensors sensors;
  for (const int ms : {1950, 1975, 2000, 2025, 2050})
    sensors.add(DataKind::kScan, ms, ms, std::to_string(ms));
  const OnlineGraph graph = graphUpTo(3000);
  const auto picked = sensors.take(graph);
  ASSERT_EQ(1u, picked.size());
  EXPECT_EQ("2000", picked[0].data);
  EXPECT_EQ(2000 * kMs, picked[0].stamp);
  EXPECT_LT(picked[0].sensor.translation.norm(), 1e-9);
  EXPECT_TRUE(sensors.has(DataKind::kScan, 1));
  EXPECT_TRUE(sensors.take(graph).empty());
}

TEST(KeySensors, WaitsUntilTheFrontEndKnowsAllOfTheSweep) {
  Sensors sensors;
  sensors.add(DataKind::kScan, 3000, 3025, "scan");
  sensors.add(DataKind::kCloud, 2900, 3400, "cloud");
  EXPECT_TRUE(sensors.take(graphUpTo(3000)).empty());
  auto picked = sensors.take(graphUpTo(3050));
  ASSERT_EQ(1u, picked.size());
  EXPECT_EQ("scan", picked[0].data);
  picked = sensors.take(graphUpTo(3400));
  ASSERT_EQ(1u, picked.size());
  EXPECT_EQ("cloud", picked[0].data);
  EXPECT_NEAR(-0.05, picked[0].sensor.translation.x(), 1e-6) << "of where it was seen from the key pose";
}

TEST(KeySensors, DoesNotWaitForEver) {
  Sensors sensors;
  sensors.add(DataKind::kCloud, 2000, 999000, "far");
  EXPECT_TRUE(sensors.take(graphUpTo(3000)).empty());
  sensors.add(DataKind::kCloud, 13000, 13000, "later");  // by whose stamp the other is 11 s old
  const auto picked = sensors.take(graphUpTo(3000));
  ASSERT_EQ(1u, picked.size());
  EXPECT_EQ("far", picked[0].data) << "with what there is";
}

}  // namespace
}  // namespace pose_graph
