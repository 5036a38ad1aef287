// SPDX-License-Identifier: BSD-3-Clause
#include <dynamic_reconfigure/Reconfigure.h>
#include <mapping_common/testing/nodelet_test.h>
#include <mapping_common/testing/temp_dir.h>
#include <rosgraph_msgs/Log.h>
#include <sensor_msgs/point_cloud2_iterator.h>
#include <std_srvs/Empty.h>
#include <tf2_msgs/TFMessage.h>

#include <cmath>
#include <cstdio>

namespace hokuyo_sick_drivers {
namespace {

using mapping_common::mentions;
using mapping_common::Recorder;
using mapping_common::spinFor;
using mapping_common::waitFor;

const char* const kPtx =
    "2\n2\n0 0 0\n1 0 0\n0 1 0\n0 0 1\n1 0 0 0\n0 1 0 0\n0 0 1 0\n5 6 7 1\n"
    "1 2 3 0.5\n0 0 0 0.5\n4 5 6 0.25\n7 8 9 1\n";

class ZfReaderNodelet : public mapping_common::NodeletTest {
 protected:
  ZfReaderNodelet()
      : NodeletTest("hokuyo_sick_drivers/ZfReaderNodelet", "zf_reader"),
        clouds_(node_, "cloud"),
        poses_(node_, "/tf_static"),
        log_(node_) {
    setParam("rate", 20.0);
    setParam("frame_id", test_);
  }

  void loadFile(const std::string& name, const std::string& bytes) {
    setParam("file", dir_.write(name, bytes));
    loaded_ = load();
  }
  // What it said while it was running.
  std::string fatal() {
    std::string text;
    waitFor([&] {
      for (const auto& message : log_.messages) {
        if (message.level == rosgraph_msgs::Log::FATAL) text = message.msg;
      }
      return !text.empty();
    });
    return text;
  }

  mapping_common::TempDir dir_;
  Recorder<sensor_msgs::PointCloud2> clouds_;
  Recorder<tf2_msgs::TFMessage> poses_;
  mapping_common::LogRecorder log_;
};

TEST_F(ZfReaderNodelet, PublishesTheGridAndThePose) {
  loadFile("a.ptx", kPtx);
  ASSERT_TRUE(clouds_.waitForOne());
  sensor_msgs::PointCloud2 cloud = clouds_.messages[0];
  EXPECT_EQ(test_, cloud.header.frame_id);
  EXPECT_EQ(2u, cloud.width);
  EXPECT_EQ(2u, cloud.height);
  EXPECT_FALSE(cloud.is_dense);
  sensor_msgs::PointCloud2ConstIterator<float> x(cloud, "x"), intensity(cloud, "intensity");
  EXPECT_EQ(1.0F, x[0]);
  EXPECT_EQ(0.25F, (intensity + 1)[0]);
  EXPECT_TRUE(std::isnan((x + 2)[0]));
  const auto pose = [&]() -> const geometry_msgs::TransformStamped* {
    for (const auto& message : poses_.messages) {
      for (const auto& transform : message.transforms) {
        if (transform.child_frame_id == test_) return &transform;
      }
    }
    return nullptr;
  };
  ASSERT_TRUE(waitFor([&] { return pose() != nullptr; }));
  EXPECT_EQ("map", pose()->header.frame_id);
  EXPECT_EQ(6.0, pose()->transform.translation.y);
  expectDiagnostic("Scan file", "Published", "1");
  expectDiagnostic("Scan file", "Points", "3");
  expectDiagnostic("Scan file", "Points missing", "1");
  expectDiagnostic("Scan file", "Progress (%)", "100");
}

TEST_F(ZfReaderNodelet, LoopsOverAllScansOnceToldTo) {
  setParam("scan", "all");
  loadFile("a.ptx", std::string(kPtx) + kPtx);
  ASSERT_TRUE(waitFor([&] { return clouds_.messages.size() == 2; }));
  spinFor(0.5);
  EXPECT_EQ(2u, clouds_.messages.size());
  EXPECT_EQ(test_ + "_2", clouds_.messages[1].header.frame_id);
  dynamic_reconfigure::Reconfigure change;
  change.request.config.bools.resize(1);
  change.request.config.bools[0].name = "loop";
  change.request.config.bools[0].value = 1;
  ASSERT_TRUE(ros::service::call(name_ + "/set_parameters", change));
  EXPECT_TRUE(waitFor([&] { return clouds_.messages.size() >= 6; }));
  EXPECT_EQ(test_ + "_1", clouds_.messages[4].header.frame_id);
  EXPECT_LT(clouds_.messages[2].header.stamp, clouds_.messages[4].header.stamp);
}

TEST_F(ZfReaderNodelet, ReadsAllFilesOfAFolderInOneFrameWithoutTheirPoses) {
  dir_.write("b.ptx", std::string(kPtx));
  dir_.write("a.PTX", std::string(kPtx).replace(std::string(kPtx).find("1 2 3"), 5, "9 2 3") + kPtx);
  dir_.write("c.txt", "not a scan");
  setParam("file", dir_.path(""));
  setParam("scan", "all");
  setParam("publish_tf", false);
  ASSERT_TRUE(load());
  ASSERT_TRUE(waitFor([&] { return clouds_.messages.size() == 3; }));
  for (std::size_t i = 0; i < 3; ++i) {
    EXPECT_EQ(test_, clouds_.messages[i].header.frame_id);
    EXPECT_EQ(i == 0 ? 9.0F : 1.0F, *sensor_msgs::PointCloud2ConstIterator<float>(clouds_.messages[i], "x"));
  }
  spinFor(0.3);
  EXPECT_EQ(3u, clouds_.messages.size());
}

TEST_F(ZfReaderNodelet, WaitsForWhoMustNotMissAScan) {
  setParam("wait_for", "/" + test_ + "/ready");
  loadFile("a.ptx", kPtx);
  spinFor(0.5);
  EXPECT_TRUE(clouds_.messages.empty());
  const boost::function<bool(std_srvs::Empty::Request&, std_srvs::Empty::Response&)> answer =
      [](auto&, auto&) { return true; };
  const ros::ServiceServer ready = node_.advertiseService("/" + test_ + "/ready", answer);
  EXPECT_TRUE(clouds_.waitForOne());
}

TEST_F(ZfReaderNodelet, RefusesAFolderWithoutScans) {
  setParam("file", dir_.path(""));
  EXPECT_TRUE(mentions(whyNotLoaded(), {"folder", ".e57"}));
}

TEST_F(ZfReaderNodelet, StopsAtOnceWhileItReads) {
  std::string text;
  for (int i = 0; i < 500000; ++i) text += "1.25 2.5 3.75 0.5\n";
  setParam("loop", true);
  setParam("rate", 100.0);
  loadFile("a.asc", text);
  spinFor(0.05);
  const ros::WallTime start = ros::WallTime::now();
  unload();
  EXPECT_LT((ros::WallTime::now() - start).toSec(), 5.0 * mapping_common::kSlowness);
}

TEST_F(ZfReaderNodelet, SaysWhatIsWrongWithAFile) {
  ASSERT_TRUE(log_.waitForLink());
  loadFile("a.ptx", std::string(kPtx).substr(0, 80));
  ASSERT_TRUE(loaded_);
  EXPECT_TRUE(mentions(fatal(), {"a.ptx", "line "}));
  EXPECT_TRUE(waitFor([&] {
    for (const auto& message : diagnostics_.messages) {
      for (const auto& status : message.status) {
        if (status.level == diagnostic_msgs::DiagnosticStatus::ERROR &&
            mentions(status.message, {"a.ptx", "line "})) {
          return true;
        }
      }
    }
    return false;
  }));
  EXPECT_TRUE(clouds_.messages.empty());
}

TEST_F(ZfReaderNodelet, RefusesAFileThatIsNotThere) {
  setParam("file", std::string("/does/not/exist.e57"));
  EXPECT_TRUE(mentions(whyNotLoaded(), {"/does/not/exist.e57", "No such file"}));
}

TEST_F(ZfReaderNodelet, RefusesNativeFiles) {
  setParam("file", dir_.write("a.zfs", "ZFS"));
  EXPECT_TRUE(mentions(whyNotLoaded(), {"a.zfs", "LaserControl"}));
}

TEST_F(ZfReaderNodelet, RefusesWrongParameters) {
  setParam("file", dir_.write("a.ptx", kPtx));
  const auto reject = [&](const std::string& name, const auto& value, const auto& valid) {
    setParam(name, value);
    EXPECT_TRUE(mentions(whyNotLoaded(), {name.c_str()})) << name;
    setParam(name, valid);
  };
  reject("rate", 0.0, 1.0);
  reject("voxel", -1.0, 0.0);
  reject("intensity", std::string("loud"), std::string("raw"));
  reject("offset", std::string("1 2"), std::string("auto"));
  reject("parent_frame", test_, std::string("map"));
  reject("intensity_max", -1.0, 1.0);
  reject("misspelt", 1, 1);
  EXPECT_FALSE(load());
  ros::param::del(name_ + "/misspelt");
  EXPECT_TRUE(load());
  EXPECT_TRUE(clouds_.waitForOne());
}

}  // namespace
}  // namespace hokuyo_sick_drivers

int main(int argc, char** argv) {
  ::testing::InitGoogleTest(&argc, argv);
  ros::init(argc, argv, "test_zf_reader_nodelet");
  const ros::NodeHandle keep_alive;
  return RUN_ALL_TESTS();
}
