// SPDX-License-Identifier: BSD-3-Clause
//
// What the nodelet makes of its input before it is mapped: sweeps of a sensor that moves, and several
// sensors.
#include <rosgraph_msgs/Log.h>

#include <cmath>
#include <string>
#include <vector>

#include "nodelet_fixture.h"

namespace rtree_occupancy_map {
namespace {

using sensor_msgs::PointField;

class MappingInput : public NodeletTest {
 protected:
  // Points whose times go over 0.1 s.
  static sensor_msgs::PointCloud2 sweep(unsigned seed) {
    std::vector<std::vector<double>> points;
    for (const auto& p : roomPoints({4, 3, 1.5}, 1000, seed))
      points.push_back({p.x(), p.y(), p.z(), 1e5 * static_cast<double>(points.size())});
    constexpr std::uint8_t kFloat = PointField::FLOAT32;
    return makeCloud({{"x", kFloat}, {"y", kFloat}, {"z", kFloat}, {"t", PointField::UINT32}}, points);
  }
};

TEST_F(MappingInput, UndistortsWithTransformsUntilTheEndOfTheSweep) {
  setParam("undistort", true);
  ASSERT_TRUE(load());
  const ros::Time stamp(1000.0);
  const auto poseAt = [](double time) { return poseOf(3.0 * time, 0, 0, 1.5 * time); };
  auto cloud = sweep(1);
  send(cloud, "sensor", stamp);
  SensorPath path;
  for (int i = 0; i <= 4; ++i) {
    spinFor(0.05);
    expectDiagnostic("Input", "Inserted", "0");  // until tf knows where the sweep ended
    sendPose("sensor", poseAt(0.025 * i), stamp + ros::Duration(0.025 * i));
    path.add(0.025 * i, poseAt(0.025 * i));
  }
  cloud.header.stamp = stamp;
  reference_.insertScan(toScan(cloud, path, path, {}).scan);
  expectDiagnostic("Input", "Inserted", "1");
  // tf's poses are interpolated anew, which rounds a few points into the next voxel.
  const Voxels expected = voxelsOf(reference_), actual = voxels();
  std::size_t equal = 0;
  for (const auto& [voxel, probability] : expected) {
    const auto same = actual.find(voxel);
    equal += same != actual.end() && same->second == probability;
  }
  EXPECT_GT(equal, 0.995 * expected.size());
  EXPECT_LT(actual.size(), 1.005 * expected.size());
  // It isn't the map of a sensor that stands still.
  OccupancyMap still;
  still.insertScan(toScan(cloud, poseAt(0.0), {}).scan);
  EXPECT_NE(voxelsOf(still), actual);
}

TEST_F(MappingInput, SaysThatCloudsHaveNoTime) {
  setParam("undistort", true);
  ASSERT_TRUE(load());
  mapping_common::LogRecorder log(node_);
  ASSERT_TRUE(log.waitForLink());
  sendStaticPose("sensor", poseOf(0, 0, 0));
  send(makeCloud({{1, 2, 0.5}}), "sensor");
  expectDiagnostic("Input", "Dropped: malformed", "1");
  EXPECT_TRUE(log.waitFor("no field t, time, timestamp"));
}

TEST_F(MappingInput, TwoSensorsOfWhichOneIsLateLoseNothing) {
  setParam("cloud_topics", std::vector<std::string>{"front/points", "rear/points"});
  cloud_topic_ = "front/points";
  ASSERT_TRUE(load());
  ros::Publisher rear = node_.advertise<sensor_msgs::PointCloud2>("rear/points", 100);
  ASSERT_TRUE(waitFor([&] { return rear.getNumSubscribers() > 0; }));
  // Both at 10 Hz; the rear one's clouds and transforms come by a slow link, 1.5 s after they were measured.
  constexpr int kClouds = 30, kLate = 15;
  std::vector<sensor_msgs::PointCloud2> sent;
  const auto pose = [](int i, bool is_front) {
    return poseOf(0.1 * i, is_front ? 0 : 0.4, 0, is_front ? 0 : M_PI);
  };
  const auto sendOne = [&](ros::Publisher& publisher, int i, bool is_front) {
    auto cloud = makeCloud(roomPoints({4, 3, 1.5}, 300, i + (is_front ? 0 : 1000)));
    cloud.header.frame_id = frame(is_front ? "front" : "rear");
    cloud.header.stamp = ros::Time(1000.0 + 0.1 * i);
    publisher.publish(cloud);
    sendPose(is_front ? "front" : "rear", pose(i, is_front), cloud.header.stamp);
  };
  for (int i = 0; i < kClouds + kLate; ++i) {
    if (i < kClouds) sendOne(clouds_, i, true);
    if (i >= kLate) sendOne(rear, i - kLate, false);
    spinFor(0.02);
  }
  expectDiagnostic("Input", "Inserted", std::to_string(2 * kClouds));
  expectDiagnostic("Input", "Points mapped", std::to_string(2 * kClouds * 300));
  expectDiagnostic("Input", "Dropped: no transform", "0");
  EXPECT_NE("", diagnostic("Input", "Clouds of rear/points (Hz)"));
}

TEST_F(MappingInput, TheGroundOnlyClears) {
  setParam("filter_ground", true);
  setParam("base_frame_id", frame("base"));
  ASSERT_TRUE(load());
  const auto sensor = poseOf(1, 2, 2.5), base = poseOf(1, 2, 1.0);
  sendStaticPose("base", base);  // first, as a cloud waits for its sensor's alone
  sendStaticPose("sensor", sensor);
  std::vector<Eigen::Vector3f> points;
  for (int i = 0; i < 2000; ++i) {  // the ground of the base is 1.5 m below the sensor
    const float angle = 0.01F * static_cast<float>(i), range = 2.0F + 0.003F * static_cast<float>(i);
    points.emplace_back(range * std::cos(angle), range * std::sin(angle), -1.5F);
  }
  for (int i = 0; i < 100; ++i) points.emplace_back(3.0F, 0.03F * static_cast<float>(i), -0.75F);
  send(makeCloud(points), "sensor");
  expectDiagnostic("Input", "Points that only clear: the ground", "2000");
  const auto occupied = cellsInBox(100.0, true).cells;
  EXPECT_FALSE(occupied.empty());
  for (const MapCell& cell : occupied) EXPECT_GT(cell.min.z, 1.3);
  EXPECT_FALSE(cellsInBox(100.0, false).cells.empty());
}

TEST_F(MappingInput, ForgetsByTheStampsOfClouds) {
  setParam("decay_time", 9.0);
  ASSERT_TRUE(load());
  sendStaticPose("sensor", poseOf(0.1, 0.1, 0.1));
  for (int i = 0; i < 5; ++i) send(makeCloud({{3, 0, 0}}), "sensor", ros::Time(1000.0 + 0.1 * i));
  expectDiagnostic("Input", "Inserted", "5");
  EXPECT_EQ(1u, cellsInBox(100.0, true).cells.size());
  send(makeCloud({{0, 3, 0}}), "sensor", ros::Time(1011.0));
  EXPECT_TRUE(waitFor([&] {
    const auto cells = cellsInBox(100.0, true).cells;
    return cells.size() == 1 && cells[0].max.y > 3.0;
  }));
}

TEST_F(MappingInput, SeveralTopicsInOneString) {
  setParam("cloud_topics", std::string("cloud_in, more/points"));
  ASSERT_TRUE(load());  // cloud_in is subscribed
  ros::Publisher more = node_.advertise<sensor_msgs::PointCloud2>("more/points", 1);
  EXPECT_TRUE(waitFor([&] { return more.getNumSubscribers() > 0; }));
}

}  // namespace
}  // namespace rtree_occupancy_map

int main(int argc, char** argv) {
  ::testing::InitGoogleTest(&argc, argv);
  ros::init(argc, argv, "test_mapping_input");
  ros::NodeHandle keep_alive;
  return RUN_ALL_TESTS();
}
