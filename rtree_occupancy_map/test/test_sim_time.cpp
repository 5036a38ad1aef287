// SPDX-License-Identifier: BSD-3-Clause
//
// A recording that is replayed twice, under simulated time.
#include <rosgraph_msgs/Clock.h>

#include "nodelet_fixture.h"

namespace rtree_occupancy_map {
namespace {

class SimTime : public NodeletTest {
 protected:
  SimTime() : clock_(node_.advertise<rosgraph_msgs::Clock>("/clock", 10)) {}

  void replay(unsigned seed) {
    for (int i = 0; i < 20; ++i) {
      rosgraph_msgs::Clock clock;
      clock.clock = ros::Time(1000.0 + 0.1 * i);
      clock_.publish(clock);
      ASSERT_TRUE(waitFor([&] { return ros::Time::now() == clock.clock; }));
      const auto pose = poseOf(0.3 * i, 0.1, 0.1, 0.05 * i);
      sendPose("sensor", pose, clock.clock);
      publish(makeCloud(roomPoints({4, 3, 1.5}, 200, seed + i)), "sensor", pose, clock.clock);
      spinFor(0.05);
    }
  }

  ros::Publisher clock_;
};

// As /use_sim_time is left true by whoever played a recording.
TEST_F(SimTime, AClockThatStandsIsSaid) {
  ASSERT_TRUE(load());
  const auto summary = [&] {
    std::string text;
    for (const auto& message : diagnostics_.messages) {
      for (const auto& status : message.status) {
        if (status.name.find(name_.substr(1) + ": Nodelet") != std::string::npos) text = status.message;
      }
    }
    return text;
  };
  EXPECT_TRUE(waitFor([&] { return summary() == "/use_sim_time is true, and the clock stands"; }))
      << summary();
  rosgraph_msgs::Clock clock;
  clock.clock = ros::Time(500.0);
  clock_.publish(clock);
  EXPECT_TRUE(waitFor([&] { return summary() == "Running"; })) << summary();
}

TEST_F(SimTime, MapGoesOnWhenARecordingLoops) {
  ASSERT_TRUE(load());
  Recorder<visualization_msgs::MarkerArray> markers(node_, "occupied_cells_vis_array");
  replay(1);
  ASSERT_TRUE(waitForMap(reference_));
  const Voxels before = voxels();
  const std::size_t shown = markers.messages.size();
  EXPECT_GT(shown, 1u);

  // What came before the jump was noticed is still there, and so are the later scans but for the very first,
  // whose transform may be forgotten with those from before the jump.
  replay(100);
  EXPECT_TRUE(waitFor([&] { return markers.messages.size() > shown; }));
  EXPECT_TRUE(waitFor([&] { return std::stoi("0" + diagnostic("Input", "Inserted")) >= 39; }));
  EXPECT_GE(voxels().size(), before.size());
}

}  // namespace
}  // namespace rtree_occupancy_map

int main(int argc, char** argv) {
  ::testing::InitGoogleTest(&argc, argv);
  ros::init(argc, argv, "test_sim_time");
  ros::NodeHandle keep_alive;
  return RUN_ALL_TESTS();
}
