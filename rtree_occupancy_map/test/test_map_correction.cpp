// SPDX-License-Identifier: BSD-3-Clause
//
// The nodelet goes on in a map that was made anew, and nothing that came meanwhile is missing.
#include <mapping_common/testing/corrected_map_faults.h>
#include <mapping_msgs/CorrectedMap.h>

#include <algorithm>

#include "nodelet_fixture.h"

namespace rtree_occupancy_map {
namespace {

sensor_msgs::PointCloud2 room(unsigned seed) {
  return makeCloud(roomPoints({4, 3, 1.5}, 1000, seed));
}

mapping_msgs::CorrectedMap correctedMap(const OccupancyMap& map, const std::string& frame,
                                        const ros::Time& stamp, const Eigen::Isometry3d& correction) {
  mapping_msgs::CorrectedMap message;
  message.header.stamp = stamp;
  message.header.frame_id = frame;
  message.correction = tf2::toMsg(correction);
  const std::string bytes = map.toBytes();
  message.data.assign(bytes.begin(), bytes.end());
  return message;
}

// Clouds of a room, of which the first are in the corrected map, and the last came when their poses were
// corrected.
class MapCorrection : public NodeletTest {
 protected:
  void start() {
    corrected_ = node_.advertise<mapping_msgs::CorrectedMap>("corrected_cloud_map", 10);
    ASSERT_TRUE(load());
    ASSERT_TRUE(waitFor([this] { return corrected_.getNumSubscribers() > 0; }));
    ASSERT_TRUE(mapping_common::waitForLink(corrected_));
    for (int i = 0; i < 5; ++i) {
      const std::string sensor = "sensor" + std::to_string(i);
      const Eigen::Isometry3d pose = poseOf(0.7 * i, 0.2 * i, 0.1, 0.2 * i);
      sendStaticPose(sensor, pose);
      publish(room(i), sensor, pose, stamp(i));
      ASSERT_TRUE(waitForMap(reference_)) << i;
      const Eigen::Isometry3d right = i < 4 ? kCorrection * pose : pose;
      (i < 2 ? new_ : direct_).insertScan(toScan(room(i), right, {}).scan);
      if (i != 1) continue;
      const std::string bytes = new_.toBytes();
      direct_ = OccupancyMap::fromBytes(bytes.data(), bytes.data() + bytes.size(), "a copy");
    }
  }
  static ros::Time stamp(int i) { return ros::Time(1000.0 + i); }

  const Eigen::Isometry3d kCorrection = poseOf(0.35, -0.15, 0.05, 0.1);
  ros::Publisher corrected_;
  OccupancyMap new_, direct_;  // of the first two clouds, of all
};

TEST_F(MapCorrection, NothingIsMissingInACorrectedMap) {
  start();
  auto message = correctedMap(new_, map_frame_, stamp(1), kCorrection);
  message.corrected_from = stamp(4);
  corrected_.publish(message);
  EXPECT_TRUE(waitForMap(direct_));
  expectDiagnostic("Map", "Corrected maps taken", "1");
  // It goes on in it.
  const Eigen::Isometry3d pose = poseOf(3.0, 0.0, 0.0);
  sendStaticPose("later", pose);
  send(room(9), "later", stamp(9));
  direct_.insertScan(toScan(room(9), tf2::transformToEigen(transformOf("later", pose, stamp(9))), {}).scan);
  EXPECT_TRUE(waitForMap(direct_));
}

TEST_F(MapCorrection, TheNextCorrectionMovesWhatTheLastOneMoved) {
  start();
  auto message = correctedMap(new_, map_frame_, stamp(1), kCorrection);
  message.corrected_from = stamp(4);
  corrected_.publish(message);
  ASSERT_TRUE(waitForMap(direct_));
  // All but the last cloud is in the next one.
  const Eigen::Isometry3d second = poseOf(0.0, 0.4, 0.0, -0.1);
  OccupancyMap next;
  for (int i = 0; i < 5; ++i) {
    const Eigen::Isometry3d pose = poseOf(0.7 * i, 0.2 * i, 0.1, 0.2 * i);
    next.insertScan(toScan(room(i), second * (i < 4 ? kCorrection * pose : pose), {}).scan);
    if (i == 3) corrected_.publish(correctedMap(next, map_frame_, stamp(3), second));
  }
  EXPECT_TRUE(waitForMap(next));
}

TEST_F(MapCorrection, OthersAreRefusedAndTheMapStays) {
  start();
  int refused = 0;
  const auto expectRefused = [&](const mapping_msgs::CorrectedMap& message) {
    corrected_.publish(message);
    expectDiagnostic("Map", "Corrected maps refused", std::to_string(++refused));
    EXPECT_EQ(voxelsOf(reference_), voxels());
  };
  for (const auto& faulty :
       mapping_common::faultyCopies(correctedMap(new_, map_frame_, stamp(1), kCorrection)))
    expectRefused(faulty);
  Options coarse;
  coarse.resolution = 0.3;
  expectRefused(correctedMap(OccupancyMap(coarse), map_frame_, stamp(1), kCorrection));
  Options other;
  other.prob_hit = 0.8;
  expectRefused(correctedMap(OccupancyMap(other), map_frame_, stamp(1), kCorrection));
  expectDiagnostic("Map", "Corrected maps taken", "0");
}

TEST_F(MapCorrection, SaysWhatFellOut) {
  setParam("corrected_map_memory", 0.03);  // two clouds
  start();
  mapping_common::LogRecorder log(node_);
  ASSERT_TRUE(log.waitForLink());
  corrected_.publish(correctedMap(new_, map_frame_, stamp(0), kCorrection));
  EXPECT_TRUE(log.waitFor("lacks clouds or scans"));
  EXPECT_TRUE(log.waitFor("2 clouds and scans were added"));
}

}  // namespace
}  // namespace rtree_occupancy_map

int main(int argc, char** argv) {
  ::testing::InitGoogleTest(&argc, argv);
  ros::init(argc, argv, "test_map_correction");
  ros::NodeHandle keep_alive;
  return RUN_ALL_TESTS();
}
