// SPDX-License-Identifier: BSD-3-Clause
//
// Parameters, conversions, key frames: the ROS side without a master.
#include <gtest/gtest.h>
#include <yaml-cpp/yaml.h>

#include <stdexcept>

#include "ibuild_loop_closure/ros/conversions.h"
#include "ibuild_loop_closure/ros/key_frames.h"
#include "ibuild_loop_closure/ros/parameters.h"
#include "test_images.h"

namespace ibuild_loop_closure {
namespace {

XmlRpc::XmlRpcValue toXmlRpc(const YAML::Node& node) {
  XmlRpc::XmlRpcValue value;
  if (node.IsMap()) {
    for (const auto& member : node) value[member.first.as<std::string>()] = toXmlRpc(member.second);
    return value;
  }
  int integer;
  double number;
  bool boolean;
  if (node.Tag() == "!") return {node.as<std::string>()};  // quoted
  if (YAML::convert<int>::decode(node, integer)) return {integer};
  if (YAML::convert<double>::decode(node, number)) return {number};
  if (YAML::convert<bool>::decode(node, boolean)) return XmlRpc::XmlRpcValue(boolean);
  return {node.as<std::string>()};
}

TEST(Parameters, OfTheShippedFileAreTheDefaults) {
  const YAML::Node file = YAML::LoadFile(PACKAGE_DIR "/config/loop_closure.yaml");
  mapping_common::Parameters shipped(toXmlRpc(file)), none(XmlRpc::XmlRpcValue{});
  const LoopClosureParameters a = readLoopClosureParameters(shipped), b = readLoopClosureParameters(none);
  EXPECT_NO_THROW(shipped.rejectUnknown());
  std::size_t values = 0;
  for (const auto& member : file) values += member.second.IsMap() ? member.second.size() : 1;
  EXPECT_EQ(none.names().size(), values);  // all are in it
  EXPECT_EQ(a.detector.delta, b.detector.delta);
  EXPECT_EQ(a.detector.tracking_delta, b.detector.tracking_delta);
  EXPECT_EQ(a.detector.beta, b.detector.beta);
  EXPECT_EQ(a.detector.candidates, b.detector.candidates);
  EXPECT_EQ(a.detector.features.max_features, b.detector.features.max_features);
  EXPECT_EQ(a.detector.features.threshold, b.detector.features.threshold);
  EXPECT_EQ(a.detector.features.size, b.detector.features.size);
  EXPECT_EQ(a.detector.index.links, b.detector.index.links);
  EXPECT_EQ(a.detector.index.insert_breadth, b.detector.index.insert_breadth);
  EXPECT_EQ(a.detector.index.search_breadth, b.detector.index.search_breadth);
  EXPECT_EQ(a.detector.geometry.max_features, b.detector.geometry.max_features);
  EXPECT_EQ(a.detector.geometry.layout_tolerance, b.detector.geometry.layout_tolerance);
  EXPECT_EQ(a.detector.geometry.min_inliers, b.detector.geometry.min_inliers);
  EXPECT_EQ(a.detector.tracks.open_significance, b.detector.tracks.open_significance);
  EXPECT_EQ(a.detector.geometry.min_overlap, b.detector.geometry.min_overlap);
  EXPECT_EQ(a.detector.geometry.spot, b.detector.geometry.spot);
  EXPECT_EQ(a.detector.stereo.uniqueness, b.detector.stereo.uniqueness);
  EXPECT_EQ(a.detector.max_remaining, b.detector.max_remaining);
  EXPECT_EQ(a.detector.verified, b.detector.verified);
  EXPECT_EQ(a.detector.step, b.detector.step);
  EXPECT_EQ(a.detector.tracks.memory, b.detector.tracks.memory);
  EXPECT_EQ(a.key_frames.min_interval, b.key_frames.min_interval);
  EXPECT_EQ(a.key_frames.min_difference, b.key_frames.min_difference);
  EXPECT_EQ(a.fixed_frame, b.fixed_frame);
  EXPECT_EQ(a.queue_size, b.queue_size);
}

TEST(Parameters, MethodSetsTheDefaults) {
  XmlRpc::XmlRpcValue values;
  values["method"] = "thesis";
  values["features"]["threshold"] = 40;
  mapping_common::Parameters p(values);
  const LoopClosureParameters m = readLoopClosureParameters(p);
  EXPECT_FALSE(m.detector.geometric_check);
  EXPECT_EQ(IndexType::kLinear, m.detector.index.type);
  EXPECT_EQ(Detector::kBrisk, m.detector.features.detector);
  EXPECT_EQ(40, m.detector.features.threshold);
}

TEST(Parameters, DepthAndStereoExcludeEachOther) {
  XmlRpc::XmlRpcValue values;
  values["use_depth"] = true;
  values["use_stereo"] = true;
  mapping_common::Parameters p(values);
  EXPECT_THROW(readLoopClosureParameters(p), std::invalid_argument);
}

TEST(Parameters, OutOfRangeAreRejectedByName) {
  XmlRpc::XmlRpcValue values;
  values["geometry"]["ratio"] = 2.0;
  mapping_common::Parameters p(values);
  try {
    readLoopClosureParameters(p);
    FAIL();
  } catch (const std::invalid_argument& e) {
    EXPECT_NE(std::string::npos, std::string(e.what()).find("~geometry/ratio is 2, allowed is 0.1 to 1"));
  }
}

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
