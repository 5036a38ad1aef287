// SPDX-License-Identifier: BSD-3-Clause
//
// The nodelet on rendered images: a walk through places, twice.
#include <cv_bridge/cv_bridge.h>
#include <mapping_common/testing/message_fuzz.h>
#include <mapping_common/testing/nodelet_test.h>
#include <mapping_common/testing/temp_dir.h>
#include <mapping_msgs/EdgeConstraint.h>
#include <mapping_msgs/LoadMap.h>
#include <mapping_msgs/SaveMap.h>
#include <rosgraph_msgs/Log.h>
#include <sensor_msgs/CameraInfo.h>
#include <sensor_msgs/CompressedImage.h>
#include <sensor_msgs/Image.h>
#include <std_srvs/Empty.h>

#include <algorithm>

#include "test_images.h"

namespace ibuild_loop_closure {
namespace {

using mapping_common::Recorder;
using mapping_common::spinFor;
using mapping_common::waitFor;
using mapping_msgs::EdgeConstraint;

constexpr int kWalk = 24;  // images

class LoopClosure : public mapping_common::NodeletTest {
 protected:
  LoopClosure()
      : mapping_common::NodeletTest("ibuild_loop_closure/LoopClosureNodelet", "loop_closure"),
        edges_(node_, "loop_closures") {
    ros::param::del(name_);
    setParam("key_frames/min_interval", 0.0);
    setParam("key_frames/min_difference", 0.0);
    setParam("queue_size", 100);
  }
  bool load() {
    if (!mapping_common::NodeletTest::load()) return false;
    images_ = node_.advertise<sensor_msgs::Image>("image", 100);
    compressed_ = node_.advertise<sensor_msgs::CompressedImage>("image/compressed", 100);
    depths_ = node_.advertise<sensor_msgs::Image>("depth", 100);
    infos_ = node_.advertise<sensor_msgs::CameraInfo>("camera_info", 1, true);
    return waitFor([this] {
      return images_.getNumSubscribers() + compressed_.getNumSubscribers() > 0 &&
             infos_.getNumSubscribers() > 0;
    });
  }
  cv_bridge::CvImage message(const cv::Mat& image, double stamp, const char* encoding = "mono8") const {
    std_msgs::Header header;
    header.stamp = ros::Time(stamp);
    header.frame_id = "camera";
    return {header, encoding, image};
  }
  void send(const cv::Mat& image, double stamp) { images_.publish(message(image, stamp).toImageMsg()); }
  // Image i of the walk that goes round after kWalk images, at 100 s + i.
  void walk(int first, int last) {
    for (int i = first; i < last; ++i) {
      send(renderWalk(i % kWalk, i < kWalk ? 0 : 3), 100.0 + i);
      spinFor(0.01);
    }
  }
  int keyFrames() const { return std::stoi("0" + diagnostic("Loop closure", "Key frames")); }
  bool waitForKeyFrames(int count) {
    return waitFor([&] { return keyFrames() == count; });
  }
  // For as many as two walks have at least.
  bool waitForLoops() {
    return waitFor([this] { return edges_.messages.size() >= kWalk / 2u; });
  }
  // Of a camera that stands or goes sideways.
  void expectTransforms() {
    const auto haveTransforms = [this] {
      return std::count_if(edges_.messages.begin(), edges_.messages.end(),
                           [](const EdgeConstraint& edge) { return edge.has_transform; });
    };
    EXPECT_TRUE(waitFor([&] { return haveTransforms() > kWalk / 4; }))
        << haveTransforms() << " of " << edges_.messages.size();
    for (const EdgeConstraint& edge : edges_.messages) {
      if (!edge.has_transform) continue;
      EXPECT_NEAR(0.0, edge.transform.position.z, 0.1);
      EXPECT_NEAR(1.0, edge.transform.orientation.w, 0.01);
      EXPECT_GT(edge.information[0], 0.0);
    }
  }
  template <class Service>
  typename Service::Response callWithPath(const std::string& service, const std::string& path) {
    Service call;
    call.request.path = path;
    EXPECT_TRUE(ros::service::call(name_ + "/" + service, call));
    EXPECT_FALSE(call.response.message.empty());
    return call.response;
  }
  ros::Publisher images_, compressed_, depths_, infos_;
  Recorder<EdgeConstraint> edges_;
};

TEST_F(LoopClosure, PublishesLoops) {
  ASSERT_TRUE(load());
  Recorder<sensor_msgs::Image> debug(node_, name_ + "/debug_image");
  walk(0, 2 * kWalk);
  ASSERT_TRUE(waitForKeyFrames(2 * kWalk));
  ASSERT_TRUE(waitForLoops()) << edges_.messages.size();
  for (const EdgeConstraint& edge : edges_.messages) {
    EXPECT_EQ(EdgeConstraint::LOOP_CLOSURE, edge.type);
    EXPECT_NEAR(edge.to_id - kWalk, edge.from_id, 4);
    EXPECT_EQ(ros::Time(100.0 + edge.to_id), edge.to_stamp);
    EXPECT_EQ(ros::Time(100.0 + edge.from_id), edge.from_stamp);
    EXPECT_EQ(edge.to_stamp, edge.header.stamp);
    EXPECT_EQ("camera", edge.frame_id);
    EXPECT_FALSE(edge.has_transform);
    EXPECT_GT(edge.similarity, 0.0f);
    EXPECT_LE(edge.similarity, 1.0f);
  }
  // That of the second walk's first image came once the next ones confirmed it.
  EXPECT_EQ(static_cast<unsigned>(kWalk), edges_.messages[0].to_id);
  EXPECT_TRUE(waitFor([&] { return !debug.messages.empty(); }));
  EXPECT_EQ(640u, debug.messages[0].width);
  expectDiagnostic("Input", "Dropped: malformed", "0");
}

TEST_F(LoopClosure, SaysEachLoop) {
  mapping_common::LogRecorder log(node_);
  ASSERT_TRUE(load());
  ASSERT_TRUE(log.waitForLink());
  walk(0, 2 * kWalk);
  ASSERT_TRUE(waitForKeyFrames(2 * kWalk));
  EXPECT_TRUE(waitFor([&] {
    const std::size_t loops = log.count("shows the place of image");
    return loops > 0 && loops == edges_.messages.size();
  })) << edges_.messages.size();
}

TEST_F(LoopClosure, TakesCompressedImages) {
  setParam("image_transport", "compressed");
  ASSERT_TRUE(load());
  for (int i = 0; i < 2 * kWalk; ++i) {
    compressed_.publish(message(renderWalk(i % kWalk, i < kWalk ? 0 : 3), 100.0 + i).toCompressedImageMsg());
    spinFor(0.01);
  }
  ASSERT_TRUE(waitForKeyFrames(2 * kWalk));
  EXPECT_TRUE(waitForLoops()) << edges_.messages.size();
}

TEST_F(LoopClosure, GivesATransformWithDepth) {
  setParam("use_depth", true);
  ASSERT_TRUE(load());
  sensor_msgs::CameraInfo info;
  info.P[0] = info.P[5] = 300.0;
  info.P[2] = 160.0;
  info.P[6] = 120.0;
  infos_.publish(info);
  ASSERT_TRUE(waitFor([&] { return diagnostic("Input", "Camera calibrated") == "True"; }));
  const cv::Mat depth(240, 320, CV_16UC1, cv::Scalar(2000));
  for (int i = 0; i < 2 * kWalk; ++i) {
    depths_.publish(message(depth, 100.0 + i, "16UC1").toImageMsg());
    send(renderWalk(i % kWalk, i < kWalk ? 0 : 3), 100.0 + i);
    spinFor(0.01);
  }
  // The synchronizer keeps the last pair until it sees a later one.
  ASSERT_TRUE(waitForLoops()) << edges_.messages.size();
  expectTransforms();
}

TEST_F(LoopClosure, GivesATransformWithStereo) {
  setParam("use_stereo", true);
  ASSERT_TRUE(load());
  ros::Publisher rights = node_.advertise<sensor_msgs::Image>("right/image", 100);
  ros::Publisher right_infos = node_.advertise<sensor_msgs::CameraInfo>("right/camera_info", 1, true);
  sensor_msgs::CameraInfo info;
  info.P[0] = info.P[5] = 300.0;
  info.P[2] = 160.0;
  info.P[6] = 120.0;
  infos_.publish(info);
  right_infos.publish(info);  // of no stereo camera
  ASSERT_TRUE(waitFor([&] { return rights.getNumSubscribers() > 0; }));
  expectDiagnostic("Input", "Camera calibrated", "True");
  expectDiagnostic("Input", "Right camera calibrated", "True");
  double stamp = 100.0;
  const auto sendPair = [&](int i) {
    const int offset = i < kWalk ? 0 : 3;
    rights.publish(message(renderWalk(i % kWalk, offset + 15), stamp).toImageMsg());  // a wall 2 m away
    send(renderWalk(i % kWalk, offset), stamp);
    stamp += 1.0;
    spinFor(0.01);
  };
  sendPair(0);
  expectDiagnostic("Input", "Dropped: malformed", "1");
  info.P[3] = -300.0 * 0.1;
  right_infos.publish(info);
  ASSERT_TRUE(waitFor([&] {  // until it has arrived
    sendPair(0);
    return keyFrames() > 0;
  }));
  std_srvs::Empty reset;
  ASSERT_TRUE(ros::service::call(name_ + "/reset", reset));
  edges_.messages.clear();
  for (int i = 0; i < 2 * kWalk; ++i) sendPair(i);
  ASSERT_TRUE(waitForLoops()) << edges_.messages.size();
  expectTransforms();
}

TEST_F(LoopClosure, SurvivesBadImages) {
  ASSERT_TRUE(load());
  send(renderWalk(0), 100.0);
  sensor_msgs::Image bad;
  bad.header.stamp = ros::Time(101.0);
  images_.publish(bad);  // empty
  bad = *message(renderWalk(1), 102.0).toImageMsg();
  bad.data.resize(100);  // truncated
  images_.publish(bad);
  bad = *message(renderWalk(1), 103.0).toImageMsg();
  bad.encoding = "nonsense";
  images_.publish(bad);
  expectDiagnostic("Input", "Dropped: malformed", "3");
  send(renderWalk(1), 104.0);
  send(renderWalk(2), 103.5);  // late
  expectDiagnostic("Input", "Dropped: out of order", "1");
  send(cv::Mat(240, 320, CV_8UC1, cv::Scalar(0)), 105.0);
  send(renderPlace(0, 0, {200, 100}), 106.0);
  EXPECT_TRUE(waitForKeyFrames(4));
}

TEST_F(LoopClosure, ExtremeStampsAreCountedAndEndNothing) {
  ASSERT_TRUE(load());
  for (const std::uint32_t second : {4000000000U, 1000000000U, 4294967295U}) {
    sensor_msgs::Image image = *message(renderWalk(0), 0.0).toImageMsg();
    image.header.stamp = ros::Time(second, 999999999U);
    images_.publish(image);
  }
  expectDiagnostic("Input", "Dropped: malformed", "2");
  EXPECT_TRUE(waitForKeyFrames(1));
  expectDiagnostic("Nodelet", "Callbacks that failed", "0");
}

TEST_F(LoopClosure, TakesChannelsWithoutNames) {
  ASSERT_TRUE(load());
  cv::Mat grey = renderWalk(0), deep, bgr;
  grey.convertTo(deep, CV_16U, 64.0);
  cv::cvtColor(grey, bgr, cv::COLOR_GRAY2BGR);
  images_.publish(message(grey, 100.0, "8UC1").toImageMsg());
  images_.publish(message(deep, 101.0, "16UC1").toImageMsg());
  images_.publish(message(bgr, 102.0, "8UC3").toImageMsg());
  EXPECT_TRUE(waitForKeyFrames(3));
  expectDiagnostic("Input", "Dropped: malformed", "0");
}

class LoopClosureFuzz : public LoopClosure {
 protected:
  void fuzz() {
    ASSERT_TRUE(load());
    auto rights = node_.advertise<sensor_msgs::Image>("right/image", 100);
    auto compressed_rights = node_.advertise<sensor_msgs::CompressedImage>("right/image/compressed", 100);
    auto right_infos = node_.advertise<sensor_msgs::CameraInfo>("right/camera_info", 1);
    auto tf = node_.advertise<tf2_msgs::TFMessage>("/tf", 100);
    const auto moved = [](double stamp) {
      tf2_msgs::TFMessage message;
      message.transforms.resize(1);
      message.transforms[0].header.stamp = ros::Time(stamp);
      message.transforms[0].header.frame_id = "odom";
      message.transforms[0].child_frame_id = "camera";
      message.transforms[0].transform.translation.x = 10.0 * stamp;
      message.transforms[0].transform.rotation.w = 1.0;
      return message;
    };
    Recorder<sensor_msgs::Image> debug(node_, name_ + "/debug_image");
    double time = 100.0;
    mapping_common::fuzz({"camera", "other"}, [&](mapping_common::MessageFuzz& fuzz) {
      time += 0.02;
      const cv::Mat place = renderPlace(static_cast<int>(time) % 10, 0, {64, 48});
      switch (fuzz.pick<int>({0, 0, 0, 1, 2})) {
        case 0: {
          sensor_msgs::Image image = *message(place, time).toImageMsg();
          sensor_msgs::Image depth =
              *message(cv::Mat(48, 64, CV_32FC1, cv::Scalar(2.0)), time, "32FC1").toImageMsg();
          sensor_msgs::CompressedImage compressed = *message(place, time).toCompressedImageMsg();
          fuzz.spoil(image);
          fuzz.spoil(depth);
          fuzz.spoil(compressed);
          // Pairs, but for the worst.
          if (fuzz.pick<int>({0, 1}) == 0) {
            image.header.stamp = depth.header.stamp = compressed.header.stamp = ros::Time(time);
          }
          depths_.publish(depth);
          rights.publish(image);
          compressed_rights.publish(compressed);
          compressed_.publish(compressed);
          return images_.publish(image);
        }
        case 1: {
          tf2_msgs::TFMessage transforms = moved(time);
          fuzz.spoil(transforms);
          return tf.publish(transforms);
        }
        default: {
          sensor_msgs::CameraInfo info;
          info.P[0] = info.P[5] = 60.0;
          info.P[2] = 32.0;
          info.P[6] = 24.0;
          right_infos.publish(info);
          fuzz.spoil(info);
          right_infos.publish(info);
          return infos_.publish(info);
        }
      }
    });
    expectDiagnostic("Input", "Images (Hz)", "0.0");
    expectDiagnostic("Nodelet", "Callbacks that failed", "0");
    std_srvs::Empty empty;
    ASSERT_TRUE(ros::service::call(name_ + "/reset", empty));
    const cv::Mat depth(240, 320, CV_16UC1, cv::Scalar(2000));
    sensor_msgs::CameraInfo info;
    info.P[0] = info.P[5] = 300.0;
    infos_.publish(info);
    info.P[3] = -30.0;
    right_infos.publish(info);
    // The first may come before the calibrations, or be taken for late ones as time jumped back.
    int i = 0;
    EXPECT_TRUE(waitFor([&] {
      const cv::Mat image = renderWalk(i % kWalk);
      tf.publish(moved(2000.0 + i));
      depths_.publish(message(depth, 2000.0 + i, "16UC1").toImageMsg());
      rights.publish(message(image, 2000.0 + i).toImageMsg());
      compressed_.publish(message(image, 2000.0 + i).toCompressedImageMsg());
      compressed_rights.publish(message(image, 2000.0 + i).toCompressedImageMsg());
      send(image, 2000.0 + i);
      ++i;
      return keyFrames() >= 5;
    }));
  }
};

TEST_F(LoopClosureFuzz, ImagesSurvive) {
  fuzz();
}

TEST_F(LoopClosureFuzz, CompressedImagesSurvive) {
  setParam("image_transport", "compressed");
  fuzz();
}

TEST_F(LoopClosureFuzz, DepthSurvives) {
  setParam("use_depth", true);
  fuzz();
}

TEST_F(LoopClosureFuzz, StereoSurvives) {
  setParam("use_stereo", true);
  fuzz();
}

TEST_F(LoopClosureFuzz, CompressedDepthSurvives) {
  setParam("image_transport", "compressed");
  setParam("use_depth", true);
  fuzz();
}

TEST_F(LoopClosureFuzz, CompressedStereoSurvives) {
  setParam("image_transport", "compressed");
  setParam("use_stereo", true);
  fuzz();
}

TEST_F(LoopClosureFuzz, MotionSurvives) {
  setParam("key_frames/min_distance", 1.0);
  setParam("key_frames/min_angle", 0.1);
  fuzz();
}

TEST_F(LoopClosure, SelectsKeyFrames) {
  setParam("key_frames/min_interval", 0.5);
  setParam("key_frames/min_difference", 2.0);
  ASSERT_TRUE(load());
  send(renderWalk(0), 100.0);
  send(renderWalk(4), 100.3);  // too early
  send(renderWalk(0), 101.0);  // the same
  send(renderWalk(8), 102.0);
  EXPECT_TRUE(waitForKeyFrames(2));
}

TEST_F(LoopClosure, WaitsForMotion) {
  setParam("key_frames/min_distance", 1.0);
  setParam("fixed_frame", "nowhere");
  ASSERT_TRUE(load());
  send(renderWalk(0), 100.0);
  expectDiagnostic("Input", "Waiting for transforms", "1");
  send(renderWalk(1), 100.6);
  expectDiagnostic("Input", "Dropped: no transform", "1");
}

TEST_F(LoopClosure, GoesOnWhenTimeJumpsBack) {
  ASSERT_TRUE(load());
  walk(0, kWalk);
  ASSERT_TRUE(waitForKeyFrames(kWalk));
  walk(0, kWalk);  // the same recording again
  ASSERT_TRUE(waitForKeyFrames(2 * kWalk));
  EXPECT_GE(edges_.messages.size(), kWalk / 2u);
  expectDiagnostic("Input", "Dropped: out of order", "0");
}

TEST_F(LoopClosure, SavesLoadsAndResets) {
  const mapping_common::TempDir dir;
  ASSERT_TRUE(load());
  walk(0, kWalk);
  ASSERT_TRUE(waitForKeyFrames(kWalk));
  EXPECT_FALSE(callWithPath<mapping_msgs::SaveMap>("save_vocabulary", "relative").success);
  EXPECT_TRUE(callWithPath<mapping_msgs::SaveMap>("save_vocabulary", dir.path("v")).success);
  std_srvs::Empty empty;
  EXPECT_TRUE(ros::service::call(name_ + "/reset", empty));
  EXPECT_TRUE(waitForKeyFrames(0));
  dir.write("broken", "nonsense");
  EXPECT_FALSE(callWithPath<mapping_msgs::LoadMap>("load_vocabulary", dir.path("broken")).success);
  EXPECT_TRUE(callWithPath<mapping_msgs::LoadMap>("load_vocabulary", dir.path("v")).success);
  EXPECT_TRUE(waitForKeyFrames(kWalk));
  walk(kWalk, 2 * kWalk);
  ASSERT_TRUE(waitForKeyFrames(2 * kWalk));
  ASSERT_GE(edges_.messages.size(), kWalk / 2u);
  EXPECT_EQ(EdgeConstraint::PLACE, edges_.messages[0].type);  // of another run
}

TEST_F(LoopClosure, DoesNotStartWithABadParameter) {
  setParam("delta", 1000);
  EXPECT_FALSE(load());
  ros::param::del(name_ + "/delta");
  setParam("dleta", 70);
  EXPECT_FALSE(load());
  ros::param::del(name_ + "/dleta");
  EXPECT_TRUE(load());
}

}  // namespace
}  // namespace ibuild_loop_closure

int main(int argc, char** argv) {
  ::testing::InitGoogleTest(&argc, argv);
  ros::init(argc, argv, "test_loop_closure_nodelet");
  ros::NodeHandle keep_alive;
  return RUN_ALL_TESTS();
}
