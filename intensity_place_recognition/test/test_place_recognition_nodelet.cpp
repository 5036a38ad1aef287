// SPDX-License-Identifier: BSD-3-Clause
#include <cv_bridge/cv_bridge.h>
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

#include <algorithm>

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

// A robot that stands for hours needs no more memory.
TEST_F(PlaceRecognitionNodeletTest, KeepsAPlaceOnce) {
  start();
  publish(message(1, Street::at(0.0, 0.0, 0.0), 100.0), "1");
  publish(message(2, Street::at(0.0, 0.0, 0.0), 110.0), "2");
  for (unsigned i = 0; i < 4; ++i) {
    clouds_.publish(message(1, Street::at(0.3, 0.2 * i, 1.5 * i), 120.0 + 10.0 * i));
    ASSERT_TRUE(mapping_common::waitFor([&] { return places_.messages.size() > i; }));
    EXPECT_EQ(100.0, places_.messages[i].from_stamp.toSec());
    EXPECT_EQ(0u, places_.messages[i].from_id);
    EXPECT_EQ(2u + i, places_.messages[i].to_id);
  }
  expectDiagnostic("Places", "Places", "2");
  publish(message(3, Street::at(0.0, 0.0, 0.0), 160.0), "3");
  publish(message(2, Street::at(1.5, 0.0, 0.0), 170.0), "4");
  ASSERT_TRUE(mapping_common::waitFor([&] { return places_.messages.size() == 5; }));
  EXPECT_EQ(1u, places_.messages[4].from_id);
  EXPECT_EQ(7u, places_.messages[4].to_id);
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
  expectQuiet("Input", "Clouds (Hz)");
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

class PlaceRecognitionImagesTest : public PlaceRecognitionNodeletTest {
 protected:
  PlaceRecognitionImagesTest()
      : images_(node_.advertise<sensor_msgs::Image>("image", 10)),
        ranges_(node_.advertise<sensor_msgs::Image>("range_image", 10)) {
    setParam("input", "images");
    setParam("range_unit", 0.004);
  }
  struct Pair {
    sensor_msgs::Image image, range;
  };
  static sensor_msgs::Image of16Bits(const cv::Mat1f& values, double unit, const std_msgs::Header& header) {
    cv::Mat1w integers;
    values.convertTo(integers, CV_16U, 1.0 / unit);
    return *cv_bridge::CvImage(header, "mono16", integers).toImageMsg();
  }
  static Pair pair(unsigned street, const Eigen::Isometry3d& pose, double stamp) {
    PanoramaOptions options;
    options.width = 1440;
    const Panorama panorama = toPanorama(Street(street).scan(pose), options);
    std_msgs::Header header;
    header.stamp.fromSec(stamp);
    header.frame_id = "os_sensor";
    double highest = 0.0;
    cv::minMaxLoc(panorama.intensity, nullptr, &highest);
    return {of16Bits(panorama.intensity, highest / 60000.0, header), of16Bits(panorama.range, 0.004, header)};
  }
  void startImages() {
    ASSERT_TRUE(load());
    ASSERT_TRUE(mapping_common::waitFor(
        [this] { return images_.getNumSubscribers() > 0 && ranges_.getNumSubscribers() > 0; }));
    ASSERT_TRUE(places_.waitForLink());
    EXPECT_EQ(0u, clouds_.getNumSubscribers());
  }
  void publish(const Pair& pair, const std::string& places) {
    ranges_.publish(pair.range);
    images_.publish(pair.image);
    expectDiagnostic("Places", "Places", places);
  }
  ros::Publisher images_, ranges_;
};

TEST_F(PlaceRecognitionImagesTest, PublishesPlacesOfPanoramas) {
  startImages();
  const Eigen::Isometry3d first = Street::at(0.0, 0.0, 0.0), again = Street::at(1.0, -0.5, 2.5);
  publish(pair(1, first, 100.0), "1");
  publish(pair(2, first, 110.0), "2");
  // Others come between those that belong together.
  const Pair last = pair(1, again, 120.0);
  images_.publish(last.image);
  images_.publish(pair(2, again, 121.0).image);
  ranges_.publish(last.range);
  expectDiagnostic("Places", "Places", "3");
  ASSERT_TRUE(mapping_common::waitFor([this] { return places_.messages.size() == 1; }));
  const mapping_msgs::EdgeConstraint& edge = places_.messages[0];
  EXPECT_EQ("os_sensor", edge.frame_id);
  EXPECT_EQ(100.0, edge.from_stamp.toSec());
  EXPECT_EQ(120.0, edge.to_stamp.toSec());
  EXPECT_TRUE(edge.has_transform);
  EXPECT_NEAR(1.0, edge.transform.position.x, 0.1);
  EXPECT_NEAR(-0.5, edge.transform.position.y, 0.1);
  EXPECT_NEAR(std::sin(1.25), std::abs(edge.transform.orientation.z), 0.01);
}

TEST_F(PlaceRecognitionImagesTest, DropsImagesThatWontDo) {
  startImages();
  Pair bad = pair(1, Street::at(0.0, 0.0, 0.0), 100.0);
  bad.range.encoding = "rgb8";
  ranges_.publish(bad.range);
  images_.publish(bad.image);
  expectDiagnostic("Input", "Dropped: malformed", "1");
  bad = pair(1, Street::at(0.0, 0.0, 0.0), 102.0);
  bad.range.data.resize(100);
  ranges_.publish(bad.range);
  images_.publish(bad.image);
  expectDiagnostic("Input", "Dropped: malformed", "2");
  bad = pair(1, Street::at(0.0, 0.0, 0.0), 104.0);
  --bad.image.height;  // another size than the range image
  ranges_.publish(bad.range);
  images_.publish(bad.image);
  expectDiagnostic("Input", "Dropped: malformed", "3");
  for (const double stamp : {106.0, 108.0, 110.0})
    images_.publish(pair(1, Street::at(0.0, 0.0, 0.0), stamp).image);
  expectDiagnostic("Input", "Dropped: unpaired", "1");
  publish(pair(1, Street::at(0.0, 0.0, 0.0), 112.0), "1");
}

TEST_F(PlaceRecognitionImagesTest, SurvivesWhateverImagesArrive) {
  startImages();
  const Pair good = pair(1, Street::at(0.0, 0.0, 0.0), 0.0);
  double stamp = 100.0;
  mapping_common::fuzz({"os_sensor", "other"}, [&](mapping_common::MessageFuzz& fuzz) {
    Pair images = good;
    images.image.header.stamp.fromSec(stamp += 2.0);
    images.range.header.stamp = images.image.header.stamp;
    if (fuzz.hit()) {
      images.range.encoding = images.image.encoding = "32FC1";
      for (sensor_msgs::Image* image : {&images.image, &images.range}) {
        image->step = 4 * image->width;
        image->data.resize(std::size_t{image->step} * image->height);
        for (std::size_t i = 0; i + 4 <= image->data.size(); i += 4) {
          const auto value = static_cast<float>(fuzz.number());
          std::copy_n(reinterpret_cast<const std::uint8_t*>(&value), 4, &image->data[i]);
        }
      }
    }
    fuzz.spoil(images.image);
    if (fuzz.hit()) fuzz.spoil(images.range);
    images_.publish(images.image);
    ranges_.publish(images.range);
  });
  expectQuiet("Input", "Images (Hz)");
  expectDiagnostic("Nodelet", "Callbacks that failed", "0");
  std_srvs::Empty reset;
  ASSERT_TRUE(ros::service::call(name_ + "/reset", reset));
  publish(pair(1, Street::at(0.0, 0.0, 0.0), 50.0), "1");
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
