// SPDX-License-Identifier: BSD-3-Clause
#include <gtest/gtest.h>
#include <mapping_common/testing/message_fuzz.h>
#include <mapping_common/testing/nodelet_test.h>
#include <mapping_common/testing/temp_dir.h>
#include <mapping_msgs/EdgeConstraint.h>
#include <mapping_msgs/LoadMap.h>
#include <mapping_msgs/SaveMap.h>
#include <sensor_msgs/Image.h>
#include <sensor_msgs/point_cloud2_iterator.h>
#include <std_srvs/Empty.h>

#include "test_street.h"

namespace intensity_place_recognition {
namespace {

class PlaceRecognitionNodeletTest : public mapping_common::NodeletTest {
 protected:
  PlaceRecognitionNodeletTest()
      : NodeletTest("intensity_place_recognition/PlaceRecognitionNodelet", "place_recognition"),
        clouds_(node_.advertise<sensor_msgs::PointCloud2>("cloud", 10)),
        places_(node_, "places"),
        debug_images_(node_, "place_recognition/debug_image") {
    setParam("beta", 1);
  }

  void start() {
    ASSERT_TRUE(load());
    ASSERT_TRUE(mapping_common::waitFor([this] { return clouds_.getNumSubscribers() > 0; }));
    ASSERT_TRUE(places_.waitForLink());
    ASSERT_TRUE(debug_images_.waitForLink());
  }
  static sensor_msgs::PointCloud2 message(unsigned street, const Eigen::Isometry3d& pose, double stamp) {
    const Cloud points = Street(street).scan(pose);
    sensor_msgs::PointCloud2 cloud;
    cloud.header.stamp.fromSec(stamp);
    cloud.header.frame_id = "velodyne";
    sensor_msgs::PointCloud2Modifier modifier(cloud);
    const auto type = sensor_msgs::PointField::FLOAT32;
    modifier.setPointCloud2Fields(4, "x", 1, type, "y", 1, type, "z", 1, type, "intensity", 1, type);
    modifier.resize(points.size());
    sensor_msgs::PointCloud2Iterator<float> at(cloud, "x");
    for (const pcl::PointXYZI& p : points) {
      at[0] = p.x, at[1] = p.y, at[2] = p.z, at[3] = p.intensity;
      ++at;
    }
    return cloud;
  }
  void publish(const sensor_msgs::PointCloud2& cloud, const std::string& places) {
    clouds_.publish(cloud);
    expectDiagnostic("Places", "Places", places);
  }

  ros::Publisher clouds_;
  mapping_common::Recorder<mapping_msgs::EdgeConstraint> places_;
  mapping_common::Recorder<sensor_msgs::Image> debug_images_;
};

TEST_F(PlaceRecognitionNodeletTest, PublishesPlacesAndKeepsThemInFiles) {
  start();
  const Eigen::Isometry3d first = Street::at(0.0, 0.0, 0.0), again = Street::at(1.0, -0.5, 2.5);
  publish(message(1, first, 100.0), "1");
  publish(message(2, first, 110.0), "2");
  publish(message(2, again, 110.5), "2");  // too soon
  publish(message(1, again, 120.0), "3");
  ASSERT_TRUE(mapping_common::waitFor([this] { return places_.messages.size() == 1; }));
  const mapping_msgs::EdgeConstraint& edge = places_.messages[0];
  EXPECT_EQ(mapping_msgs::EdgeConstraint::PLACE, edge.type);
  EXPECT_EQ("velodyne", edge.frame_id);
  EXPECT_EQ(100.0, edge.from_stamp.toSec());
  EXPECT_EQ(120.0, edge.to_stamp.toSec());
  EXPECT_EQ(edge.to_stamp, edge.header.stamp);
  EXPECT_TRUE(edge.has_transform);
  EXPECT_NEAR(1.0, edge.transform.position.x, 0.1);
  EXPECT_NEAR(-0.5, edge.transform.position.y, 0.1);
  EXPECT_NEAR(std::sin(1.25), std::abs(edge.transform.orientation.z), 0.01);
  for (int i = 0; i < 6; ++i) EXPECT_GT(edge.information[7 * i], 0.0);
  EXPECT_TRUE(mapping_common::waitFor([this] { return debug_images_.messages.size() == 1; }));

  const mapping_common::TempDir dir;
  mapping_msgs::SaveMap save;
  save.request.path = dir.path("a.places");
  ASSERT_TRUE(ros::service::call(name_ + "/save_places", save));
  EXPECT_TRUE(save.response.success) << save.response.message;
  mapping_msgs::LoadMap load;
  load.request.path = dir.write("broken.places", "PLACEDB1 and nothing else");
  ASSERT_TRUE(ros::service::call(name_ + "/load_places", load));
  EXPECT_FALSE(load.response.success);
  expectDiagnostic("Places", "Places", "3");
  load.request.path = save.request.path;
  ASSERT_TRUE(ros::service::call(name_ + "/load_places", load));
  EXPECT_TRUE(load.response.success) << load.response.message;
  publish(message(2, again, 130.0), "4");
  ASSERT_TRUE(mapping_common::waitFor([this] { return places_.messages.size() == 2; }));
  EXPECT_TRUE(places_.messages[1].from_stamp.isZero());
  EXPECT_EQ(1u, places_.messages[1].from_id);
}

TEST_F(PlaceRecognitionNodeletTest, DropsCloudsThatWontDo) {
  start();
  sensor_msgs::PointCloud2 cloud = message(1, Street::at(0.0, 0.0, 0.0), 100.0);
  cloud.fields.pop_back();  // intensity
  ASSERT_EQ(3u, cloud.fields.size());
  clouds_.publish(cloud);
  expectDiagnostic("Input", "Dropped: malformed", "1");
  cloud = message(1, Street::at(0.0, 0.0, 0.0), 102.0);  // empty
  cloud.data.clear();
  cloud.width = 0;
  cloud.row_step = 0;
  clouds_.publish(cloud);
  expectDiagnostic("Input", "Dropped: malformed", "2");
  publish(message(1, Street::at(0.0, 0.0, 0.0), 104.0), "1");
}

TEST_F(PlaceRecognitionNodeletTest, SurvivesWhateverArrives) {
  setParam("panorama/min_range", 0.0);
  start();
  const sensor_msgs::PointCloud2 good = message(1, Street::at(0.0, 0.0, 0.0), 0.0);
  double stamp = 100.0;
  mapping_common::fuzz({"velodyne", "other"}, [&](mapping_common::MessageFuzz& fuzz) {
    sensor_msgs::PointCloud2 cloud = good;
    cloud.header.stamp.fromSec(stamp += 2.0);
    fuzz.spoil(cloud);
    clouds_.publish(cloud);
  });
  expectDiagnostic("Input", "Clouds (Hz)", "0.0");
  expectDiagnostic("Nodelet", "Callbacks that failed", "0");
  std_srvs::Empty reset;
  ASSERT_TRUE(ros::service::call(name_ + "/reset", reset));
  // Time jumps back, and all that comes then is new.
  publish(message(1, Street::at(0.0, 0.0, 0.0), 50.0), "1");
  publish(message(2, Street::at(0.0, 0.0, 0.0), 55.0), "2");
  publish(message(1, Street::at(1.0, -0.5, 2.5), 60.0), "3");
  EXPECT_TRUE(mapping_common::waitFor(
      [this] { return !places_.messages.empty() && places_.messages.back().to_stamp.toSec() == 60.0; }));
}

TEST_F(PlaceRecognitionNodeletTest, RefusesWrongParameters) {
  setParam("description/type", "sift");
  EXPECT_NE(std::string::npos, whyNotLoaded().find("'sift', allowed is polar | hog | gist"));
}

}  // namespace
}  // namespace intensity_place_recognition

int main(int argc, char** argv) {
  testing::InitGoogleTest(&argc, argv);
  ros::init(argc, argv, "test_place_recognition_nodelet");
  ros::NodeHandle node;
  return RUN_ALL_TESTS();
}
