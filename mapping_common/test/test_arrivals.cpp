// SPDX-License-Identifier: BSD-3-Clause
#include <gtest/gtest.h>
#include <mapping_common/testing/nodelet_test.h>
#include <mapping_common/testing/temp_dir.h>
#include <ros/callback_queue.h>
#include <tf2_msgs/TFMessage.h>

#include <stdexcept>
#include <string>
#include <vector>

#include "mapping_common/arrivals.h"

namespace mapping_common {
namespace {

// All that arrives is handed in, messages are their numbers; transforms come by the topic.
class ArrivalsTest : public ::testing::Test {
 protected:
  ArrivalsTest() : tf_(node_.advertise<tf2_msgs::TFMessage>("/tf", 100)) {
    options_.drops.reasons = {"empty"};
    options_.transforms.target_frame = "map";
  }

  void start() {
    arrivals_ = std::make_unique<Arrivals>(node_, guard_, options_,
                                           [this](const ros::Time& to) { jumps_.push_back(to.toSec()); });
    // Neither this test's publisher nor its listener is at once where the other is.
    ASSERT_TRUE(waitFor([this] { return tf_.getNumSubscribers() > 0; }));
  }
  void add(int number, double stamp, const std::string& frame = "laser", const std::string& sensor = "a") {
    std_msgs::Header header;
    header.stamp = ros::Time(stamp);
    header.frame_id = frame;
    if (!arrivals_->accept(sensor, "Scans", header)) return;
    arrivals_->add(sensor, header, [this, number](const Arrivals::Transforms& transforms) {
      if (number < 0) throw std::invalid_argument("negative");
      if (number == 13) throw std::runtime_error("bad luck");
      ready_.push_back(number);
      last_ = transforms;
    });
  }
  void sendTransform(double stamp, double x, const std::string& parent = "map",
                     const std::string& child = "laser") {
    tf2_msgs::TFMessage message;
    message.transforms.resize(1);
    auto& transform = message.transforms[0];
    transform.header.frame_id = parent;
    transform.header.stamp = ros::Time(stamp);
    transform.child_frame_id = child;
    transform.transform.translation.x = x;
    transform.transform.rotation.w = 1.0;
    tf_.publish(message);
    EXPECT_TRUE(
        waitFor([&] { return arrivals_->queue().buffer().canTransform(parent, child, ros::Time(stamp)); }));
  }
  std::string drops() { return arrivals_->drops().text(); }

  ros::NodeHandle node_;
  ros::Publisher tf_;
  Arrivals::Options options_;
  std::shared_ptr<CallbackGuard> guard_ = std::make_shared<CallbackGuard>("/test");
  std::unique_ptr<Arrivals> arrivals_;
  std::vector<int> ready_;
  std::vector<double> jumps_;
  Arrivals::Transforms last_;
};

using Numbers = std::vector<int>;

TEST_F(ArrivalsTest, WaitForTransformsByTheirStamps) {
  start();
  sendTransform(100.0, 1.0);
  add(0, 100.2);
  add(1, 100.4);
  EXPECT_EQ(2u, arrivals_->queue().waiting());
  sendTransform(100.3, 4.0);
  EXPECT_EQ(Numbers{0}, ready_);
  EXPECT_NEAR(3.0, last_.message.translation().x(), 1e-6);
  add(2, 100.8);
  EXPECT_EQ(2u, arrivals_->queue().waiting());
  add(3, 100.9);  // by now the second has waited for half a second
  EXPECT_EQ(2u, arrivals_->queue().waiting());
  sendTransform(101.0, 4.0);
  EXPECT_EQ((Numbers{0, 2, 3}), ready_);
  EXPECT_EQ("1 no transform, 0 malformed, 0 time jump, 0 empty", drops());
}

TEST_F(ArrivalsTest, ASensorWithoutTransformsDoesNotHoldUpOthers) {
  start();
  sendTransform(100.0, 1.0);
  add(0, 100.0, "nowhere");
  add(1, 100.0);
  EXPECT_EQ(Numbers{1}, ready_);
  EXPECT_EQ(1u, arrivals_->queue().waiting());
  add(2, 2000000000.0, "nowhere", "b");  // and its stamps say nothing about those of others
  add(3, 100.1);
  EXPECT_EQ(3u, arrivals_->queue().waiting());
  sendTransform(100.1, 1.0);
  EXPECT_EQ((Numbers{1, 3}), ready_);
}

TEST_F(ArrivalsTest, WhatWaitsIsBounded) {
  options_.transforms.most = 10;
  start();
  for (int i = 0; i < 100; ++i) add(i, 100.0, "frame" + std::to_string(i % 20));
  EXPECT_EQ(10u, arrivals_->queue().waiting());
  EXPECT_EQ("90 no transform, 0 malformed, 0 time jump, 0 empty", drops());
}

TEST_F(ArrivalsTest, TransformsMustBeKnownAsLongAsASweepTakes) {
  options_.transforms.tolerance = 0.1;
  start();
  sendTransform(100.0, 1.0);
  add(0, 100.0);
  EXPECT_TRUE(ready_.empty());
  sendTransform(100.1, 1.0);
  EXPECT_EQ(Numbers{0}, ready_);
}

TEST_F(ArrivalsTest, ASecondTransformIsWaitedFor) {
  options_.transforms.other_target = "/map";  // as older ones have it
  options_.transforms.other_source = "lidar";
  options_.transforms.needs_other = true;
  start();
  add(0, 100.0, "map");
  EXPECT_TRUE(ready_.empty());
  sendTransform(100.0, 7.0, "map", "lidar");
  EXPECT_EQ(Numbers{0}, ready_);
  EXPECT_EQ(0.0, last_.message.translation().x());
  ASSERT_TRUE(last_.other);
  EXPECT_EQ(7.0, last_.other->translation().x());
}

TEST_F(ArrivalsTest, MalformedOnesAreCountedAndFailuresEndNothing) {
  start();
  sendTransform(100.0, 1.0);
  add(0, 100.0, "");
  add(-1, 100.0);
  add(13, 100.0);
  add(1, 4294967295.0);
  add(2, 4294967290.0, "nowhere");
  add(3, 100.0);
  EXPECT_EQ(Numbers{3}, ready_);
  EXPECT_EQ("0 no transform, 4 malformed, 0 time jump, 0 empty", drops());
  EXPECT_EQ(1u, guard_->exceptions());
  EXPECT_EQ("bad luck", guard_->lastException());
  EXPECT_EQ(6u, arrivals_->received());
}

TEST_F(ArrivalsTest, TimeThatJumpsBackIsNoticedOnce) {
  start();
  sendTransform(200.0, 1.0);
  add(0, 200.0);
  add(1, 200.1);
  add(2, 200.1, "laser", "b");
  add(3, 100.0, "laser", "b");
  add(4, 100.0);
  EXPECT_EQ(std::vector<double>{100.0}, jumps_);
  EXPECT_EQ("0 no transform, 0 malformed, 2 time jump, 0 empty", drops());
  sendTransform(100.0, 5.0);
  EXPECT_EQ((Numbers{0, 4, 3}), ready_);
  EXPECT_EQ(5.0, last_.message.translation().x());
}

TEST_F(ArrivalsTest, TransformsOfAFarFutureAreLeftOutAlone) {
  start();
  tf2_msgs::TFMessage message;
  message.transforms.resize(2);
  for (auto& transform : message.transforms) {
    transform.header.frame_id = "map";
    transform.transform.rotation.w = 1.0;
  }
  message.transforms[0].child_frame_id = "laser";
  message.transforms[1].child_frame_id = "wheel";
  message.transforms[1].header.stamp = ros::Time(200.0);
  for (const std::uint32_t sec : {~0U, 4000000000U, 1U << 31, ~0U}) {
    message.transforms[0].header.stamp = ros::Time(sec, 999999999);
    tf_.publish(message);
  }
  EXPECT_TRUE(
      waitFor([&] { return arrivals_->queue().buffer().canTransform("map", "wheel", ros::Time(200.0)); }));
  sendTransform(200.0, 1.0);
  add(0, 200.0);
  EXPECT_EQ(Numbers{0}, ready_);
  EXPECT_EQ(0u, guard_->exceptions());
}

TEST_F(ArrivalsTest, ALateSensorLosesNothing) {
  start();
  for (int i = 0; i < 30; ++i) sendTransform(98.0 + 0.2 * i, 1.0);
  for (int i = 0; i < 20; ++i) {
    add(100 + i, 100.0 + 0.1 * i);
    add(200 + i, 98.5 + 0.1 * i);  // under the same name
  }
  EXPECT_EQ(40u, ready_.size());
  EXPECT_TRUE(jumps_.empty());
}

TEST_F(ArrivalsTest, OrderMayBeAskedFor) {
  options_.in_order = true;
  options_.transforms = {};
  arrivals_ = std::make_unique<Arrivals>(node_, guard_, options_, [](const ros::Time&) {});
  add(0, 100.0, "");
  add(1, 99.9, "");
  add(2, 100.1, "");
  EXPECT_EQ((Numbers{0, 2}), ready_);
  EXPECT_EQ("0 no transform, 0 malformed, 0 time jump, 1 out of order, 0 empty", drops());
}

// tf2 appends its words to what stands there.
TEST_F(ArrivalsTest, TfsReasonIsASentenceOfItsOwn) {
  std::string why;
  tf2_ros::Buffer().canTransform("a", "b", ros::Time(1.0), &why);
  ASSERT_TRUE(mentions(why, {"canTransform: "}));
  std::string reason;
  TransformQueue::Options options;
  options.target_frame = "map";
  options.most = 0;
  TransformQueue queue(node_, options, [&](const std::string& text) { reason = text; });
  std_msgs::Header header;
  header.frame_id = "laser";
  queue.add("a", header, false, [](const TransformQueue::Transforms&) { ADD_FAILURE(); });
  EXPECT_EQ(std::string::npos, reason.find("canTransform")) << reason;
  EXPECT_EQ(0u, reason.find("tf says \"")) << reason;
  EXPECT_EQ('"', reason.back());
}

TEST(CallbackGuard, ExceptionsEndThere) {
  CallbackGuard guard("/test");
  EXPECT_TRUE(guard.run([] {}));
  EXPECT_FALSE(guard.run([] { throw std::runtime_error("no"); }));
  EXPECT_FALSE(guard.run([] { throw 1; }));
  EXPECT_EQ(2u, guard.exceptions());
  EXPECT_TRUE(mentions(guard.lastException(), {"nothing"}));
}

TEST(CallbackGuard, GuardsAQueue) {
  struct Failing : ros::CallbackInterface {
    CallResult call() override { throw std::runtime_error("no"); }
  };
  ros::CallbackQueue inner;
  const auto guard = std::make_shared<CallbackGuard>("/test");
  GuardedQueue queue(inner, guard);
  for (int i = 0; i < 3; ++i) queue.addCallback(boost::make_shared<Failing>(), 1);
  inner.callAvailable();
  EXPECT_EQ(3u, guard->exceptions());
  queue.addCallback(boost::make_shared<Failing>(), 1);
  queue.removeByID(1);
  EXPECT_TRUE(inner.isEmpty());
}

TEST(CallbackGuard, HoldsCallbacksBack) {
  struct Counting : ros::CallbackInterface {
    Counting(int number, Numbers& called) : number_(number), called_(called) {}
    CallResult call() override {
      called_.push_back(number_);
      return Success;
    }
    int number_;
    Numbers& called_;
  };
  Numbers called;
  ros::CallbackQueue inner;
  GuardedQueue queue(inner, std::make_shared<CallbackGuard>("/test"));
  const auto add = [&](int number, std::uint64_t owner) {
    queue.addCallback(boost::make_shared<Counting>(number, called), owner);
  };
  queue.hold();
  for (int i = 0; i < 6; ++i) add(i, i % 3);
  inner.callAvailable();
  EXPECT_TRUE(called.empty());
  queue.removeByID(1);
  queue.release();
  add(6, 1);
  inner.callAvailable();
  EXPECT_EQ((Numbers{0, 2, 3, 5, 6}), called);
}

TEST(Drops, AreCountedByReason) {
  Drops drops({"/test", "Lost a scan", "Lost", {"no transform", "malformed"}});
  drops.add("no transform", "", 3);
  drops.add("malformed", "it is short");
  EXPECT_EQ("3 no transform, 1 malformed", drops.text());
  EXPECT_EQ(4u, drops.recent());
  drops.endReport();
  EXPECT_EQ(0u, drops.recent());
  diagnostic_updater::DiagnosticStatusWrapper status;
  drops.addTo(status);
  ASSERT_EQ(2u, status.values.size());
  EXPECT_EQ("Lost: malformed", status.values[1].key);
  EXPECT_EQ("1", status.values[1].value);
}

}  // namespace
}  // namespace mapping_common

int main(int argc, char** argv) {
  testing::InitGoogleTest(&argc, argv);
  ros::init(argc, argv, "test_arrivals");
  ros::NodeHandle keep_alive;
  return RUN_ALL_TESTS();
}
