// SPDX-License-Identifier: BSD-3-Clause
//
// Parameters, conversions, key frames: the ROS side without a master.
#include <gtest/gtest.h>

#include <stdexcept>

#include "ibuild_loop_closure/ros/conversions.h"
#include "ibuild_loop_closure/ros/key_frames.h"
#include "test_images.h"

namespace ibuild_loop_closure {
namespace {

TEST(Camera, IsThatOfTheRectifiedImage) {
  sensor_msgs::CameraInfo info;
  EXPECT_FALSE(toCamera(info));
  info.P[0] = 500.0;
  info.P[5] = 501.0;
  info.P[2] = 320.0;
  info.P[6] = 240.0;
  ASSERT_TRUE(toCamera(info));
  EXPECT_EQ(501.0, toCamera(info)->fy);
  EXPECT_EQ(320.0, toCamera(info)->cx);
}

TEST(RightImage, HasABaseline) {
  sensor_msgs::CameraInfo info;
  info.P[0] = 400.0;
  info.P[2] = 318.0;
  EXPECT_THROW(toRightImage(renderPlace(0), info), std::invalid_argument);
  info.P[3] = -48.0;
  EXPECT_DOUBLE_EQ(0.12, toRightImage(renderPlace(0), info).baseline);
  EXPECT_DOUBLE_EQ(318.0, toRightImage(renderPlace(0), info).cx);
}

TEST(Edge, HasATransformIfThereIsAPose) {
  Loop loop;
  loop.query = 20;
  loop.match = 3;
  loop.similarity = 0.5;
  std_msgs::Header header;
  header.stamp = ros::Time(20.0);
  auto edge = toEdge(loop, header, ros::Time(3.0), false);
  EXPECT_FALSE(edge.has_transform);
  EXPECT_EQ(mapping_msgs::EdgeConstraint::LOOP_CLOSURE, edge.type);
  loop.geometry.pose = RelativePose();
  loop.geometry.pose->transform.translation() << 1, 2, 3;
  loop.geometry.pose->information(0, 5) = 7.0;
  edge = toEdge(loop, header, ros::Time(3.0), true);
  EXPECT_TRUE(edge.has_transform);
  EXPECT_EQ(mapping_msgs::EdgeConstraint::PLACE, edge.type);
  EXPECT_EQ(2.0, edge.transform.position.y);
  EXPECT_EQ(7.0, edge.information[5]);
  EXPECT_EQ(20u, edge.to_id);
  EXPECT_EQ(3u, edge.from_id);
}

TEST(KeyFrames, AreSelectedByTimeMotionAndDifference) {
  KeyFrameSelector selector;
  selector.options = {1.0, 0.5, 0.3, 2.0};
  const auto pose = [](double x, double yaw) {
    Eigen::Isometry3d p(Eigen::AngleAxisd(yaw, Eigen::Vector3d::UnitZ()));
    p.translation().x() = x;
    return p;
  };
  EXPECT_TRUE(selector.select(10.0, pose(0, 0), renderPlace(0)));
  EXPECT_FALSE(selector.select(10.5, pose(1, 0), renderPlace(1)));      // time
  EXPECT_FALSE(selector.select(12.0, pose(0.4, 0.2), renderPlace(1)));  // motion
  EXPECT_FALSE(selector.select(12.0, pose(1, 0), renderPlace(0)));      // difference
  EXPECT_TRUE(selector.select(12.0, pose(0, 0.4), renderPlace(1)));
  EXPECT_TRUE(selector.select(14.0, pose(0.6, 0.4), renderPlace(2)));
  EXPECT_FALSE(selector.select(14.1, pose(9, 0), renderPlace(3)));
  selector.reset();
  EXPECT_TRUE(selector.select(14.1, pose(9, 0), renderPlace(3)));
}

}  // namespace
}  // namespace ibuild_loop_closure
