// SPDX-License-Identifier: BSD-3-Clause
//
// For tests of nodelets: messages whose fields are extreme, in random combinations that a seed gives again.
#pragma once

#include <geometry_msgs/PoseStamped.h>
#include <geometry_msgs/PoseWithCovarianceStamped.h>
#include <gtest/gtest.h>
#include <mapping_common/testing/nodelet_test.h>
#include <mapping_msgs/CorrectedMap.h>
#include <mapping_msgs/EdgeConstraint.h>
#include <sensor_msgs/CameraInfo.h>
#include <sensor_msgs/CompressedImage.h>
#include <sensor_msgs/Image.h>
#include <sensor_msgs/LaserScan.h>
#include <sensor_msgs/PointCloud2.h>
#include <std_msgs/String.h>
#include <tf2_msgs/TFMessage.h>

#include <cstdlib>
#include <functional>
#include <limits>
#include <random>
#include <string>
#include <vector>

namespace mapping_common {

/// Each `spoil` takes a message that may be good and makes some of its fields, or all, extreme.
class MessageFuzz {
 public:
  /// @param frames that messages have, beside odd ones
  MessageFuzz(unsigned seed, std::vector<std::string> frames) : random_(seed), frames_(std::move(frames)) {}

  /// Another message: how many of its fields will be extreme.
  void next() { share_ = pick<double>({0.05, 0.2, 0.5, 1.0}); }

  template <class T>
  T pick(const std::vector<T>& values) {
    return values[random_() % values.size()];
  }
  /// Whether a field is to be extreme.
  bool hit() { return std::uniform_real_distribution<>()(random_) < share_; }

  double number() {
    using Limits = std::numeric_limits<double>;
    const double values[] = {0.0,
                             -0.0,
                             1.0,
                             -1.0,
                             Limits::quiet_NaN(),
                             Limits::infinity(),
                             -Limits::infinity(),
                             Limits::max(),
                             Limits::lowest(),
                             Limits::denorm_min(),
                             1e-30,
                             3e38,
                             -3e38,
                             1e9,
                             1e5,
                             1000.0,
                             30.0,
                             0.3};
    return values[random_() % std::size(values)];
  }
  std::uint32_t size() {
    return pick<std::uint32_t>({0, 1, 2, 3, 4, 12, 16, 1000, 65535, 65536, 1U << 30, (1U << 31) - 1, 1U << 31,
                                ~0U, static_cast<std::uint32_t>(random_())});
  }

  template <class Number>
  void spoilNumber(Number& value) {
    if (hit()) value = static_cast<Number>(number());
  }
  void spoilSize(std::uint32_t& value) {
    if (hit()) value = size();
  }
  /// Their number, which stays below 10,000, and each of them.
  template <class Number>
  void spoilNumbers(std::vector<Number>& values) {
    if (hit()) values.resize(pick<std::size_t>({0, 1, 2, values.size() / 2, values.size() + 1, 9999}));
    for (Number& value : values) spoilNumber(value);
  }
  void spoilBytes(std::vector<std::uint8_t>& bytes) {
    if (hit()) bytes.resize(pick<std::size_t>({0, 1, 2, bytes.size() / 2, bytes.size() + 1, 100000}));
    for (int i = 0; i < 10 && !bytes.empty(); ++i) {
      if (hit()) bytes[random_() % bytes.size()] = static_cast<std::uint8_t>(random_());
    }
  }
  void spoilFrame(std::string& frame) {
    if (!hit()) return;
    frame =
        pick<std::string>({"", "/", "//", "nowhere", std::string(10000, 'a'), std::string("a\0b", 3), "ä b"});
    if (random_() % 2 == 0) frame = pick(frames_);
  }
  void spoilStamp(ros::Time& stamp) {
    if (!hit()) return;
    stamp.sec = pick<std::uint32_t>({0, 1, 100, 1000000000, 2000000000, (1U << 31) - 61, (1U << 31) - 1,
                                     1U << 31, 4000000000U, ~0U - 1, ~0U, ros::Time::now().sec});
    stamp.nsec = pick<std::uint32_t>({0, 1, 999999999, 1000000000, 1U << 31, ~0U});
  }

  void spoil(std_msgs::Header& header) {
    spoilSize(header.seq);
    spoilStamp(header.stamp);
    spoilFrame(header.frame_id);
  }
  void spoil(sensor_msgs::LaserScan& scan) {
    spoil(scan.header);
    for (float* value : {&scan.angle_min, &scan.angle_max, &scan.angle_increment, &scan.time_increment,
                         &scan.scan_time, &scan.range_min, &scan.range_max})
      spoilNumber(*value);
    spoilNumbers(scan.ranges);
    spoilNumbers(scan.intensities);
  }
  void spoil(sensor_msgs::PointCloud2& cloud) {
    spoil(cloud.header);
    for (std::uint32_t* value : {&cloud.height, &cloud.width, &cloud.point_step, &cloud.row_step})
      spoilSize(*value);
    if (hit()) cloud.fields.resize(pick<std::size_t>({0, 1, cloud.fields.size() + 1, 100}));
    for (sensor_msgs::PointField& field : cloud.fields) {
      if (hit())
        field.name = pick<std::string>({"x", "y", "z", "intensity", "reflectivity", "ring", "vp_x", ""});
      spoilSize(field.offset);
      spoilSize(field.count);
      if (hit()) field.datatype = static_cast<std::uint8_t>(random_() % 3 == 0 ? random_() : random_() % 10);
    }
    if (hit()) cloud.is_bigendian = 1;
    if (hit()) cloud.is_dense = static_cast<std::uint8_t>(random_());
    const bool of_floats = hit();
    spoilBytes(cloud.data);
    for (std::size_t i = 0; of_floats && i + 4 <= cloud.data.size(); i += 4) {
      if (!hit()) continue;
      const auto value = static_cast<float>(number());
      std::copy_n(reinterpret_cast<const std::uint8_t*>(&value), 4, &cloud.data[i]);
    }
  }
  void spoil(sensor_msgs::Image& image) {
    spoil(image.header);
    for (std::uint32_t* value : {&image.height, &image.width, &image.step}) spoilSize(*value);
    if (hit()) {
      image.encoding = pick<std::string>({"",      "mono8",       "mono16",       "bgr8",
                                          "rgba8", "bgr16",       "rgba16",       "8UC1",
                                          "8UC2",  "8UC3",        "8UC4",         "8UC64",
                                          "16UC1", "16SC1",       "32FC1",        "32SC4",
                                          "64FC1", "bayer_rggb8", "bayer_grbg16", "yuv422",
                                          "8UC",   "8UC999",      "nonsense",     std::string(10000, 'x')});
    }
    if (hit()) image.is_bigendian = 1;
    spoilBytes(image.data);
  }
  void spoil(sensor_msgs::CompressedImage& image) {
    spoil(image.header);
    if (hit())
      image.format = pick<std::string>({"", "png", "jpeg", "mono8; jpeg compressed bgr8", "nonsense"});
    spoilBytes(image.data);
  }
  void spoil(sensor_msgs::CameraInfo& info) {
    spoil(info.header);
    spoilSize(info.height);
    spoilSize(info.width);
    spoilNumbers(info.D);
    for (double& value : info.K) spoilNumber(value);
    for (double& value : info.R) spoilNumber(value);
    for (double& value : info.P) spoilNumber(value);
    if (hit())
      info.distortion_model = pick<std::string>({"", "plumb_bob", "equidistant", std::string(10000, 'd')});
    for (std::uint32_t* value : {&info.binning_x, &info.binning_y, &info.roi.x_offset, &info.roi.y_offset,
                                 &info.roi.height, &info.roi.width})
      spoilSize(*value);
    if (hit()) info.roi.do_rectify = 1;
  }
  void spoil(tf2_msgs::TFMessage& message) {
    for (geometry_msgs::TransformStamped& transform : message.transforms) {
      spoil(transform.header);
      spoilFrame(transform.child_frame_id);
      auto& t = transform.transform.translation;
      auto& r = transform.transform.rotation;
      for (double* value : {&t.x, &t.y, &t.z, &r.x, &r.y, &r.z, &r.w}) spoilNumber(*value);
    }
  }
  void spoil(geometry_msgs::Pose& pose) {
    auto& p = pose.position;
    auto& q = pose.orientation;
    for (double* value : {&p.x, &p.y, &p.z, &q.x, &q.y, &q.z, &q.w}) spoilNumber(*value);
  }
  void spoil(geometry_msgs::PoseStamped& message) {
    spoil(message.header);
    spoil(message.pose);
  }
  void spoil(geometry_msgs::PoseWithCovarianceStamped& message) {
    spoil(message.header);
    spoil(message.pose.pose);
    for (double& value : message.pose.covariance) spoilNumber(value);
  }
  void spoil(mapping_msgs::EdgeConstraint& edge) {
    spoil(edge.header);
    spoilStamp(edge.from_stamp);
    spoilStamp(edge.to_stamp);
    spoilSize(edge.from_id);
    spoilSize(edge.to_id);
    spoilFrame(edge.frame_id);
    if (hit()) edge.type = pick<std::uint8_t>({0, 1, 2, 3, 255});
    if (hit()) edge.has_transform = pick<std::uint8_t>({0, 1});
    spoil(edge.transform);
    for (double& value : edge.information) spoilNumber(value);
    spoilNumber(edge.similarity);
  }
  void spoil(mapping_msgs::CorrectedMap& map) {
    spoil(map.header);
    spoil(map.correction);
    spoilStamp(map.corrected_from);
    spoilBytes(map.data);
  }
  void spoil(std_msgs::String& message) {
    if (hit()) message.data = pick<std::string>({"", "reset", std::string(100000, 'r')});
  }

 private:
  std::mt19937 random_;
  std::vector<std::string> frames_;
  double share_ = 0.5;
};

/// Publishes for 3 s, or as many as the environment variable NODELET_FUZZ_SECONDS says, with the seed
/// NODELET_FUZZ_SEED or else 1.
/// @param publish one of the nodelet's topics, at random
inline void fuzz(const std::vector<std::string>& frames, const std::function<void(MessageFuzz&)>& publish) {
  const char *seconds = std::getenv("NODELET_FUZZ_SECONDS"), *seed = std::getenv("NODELET_FUZZ_SEED");
  const ros::WallTime end = ros::WallTime::now() + ros::WallDuration(seconds ? std::atof(seconds) : 3.0);
  MessageFuzz messages(seed ? static_cast<unsigned>(std::atoi(seed)) : 1, frames);
  int count = 0;
  for (; ros::WallTime::now() < end; ++count) {
    messages.next();
    publish(messages);
    if (count % 4 == 0) spinFor(0.005);
    if (count % 100 == 0) {
      ASSERT_TRUE(ros::service::exists("/manager/load_nodelet", false)) << "after " << count << " messages";
    }
  }
  std::cout << count << " messages" << std::endl;
  ASSERT_TRUE(ros::service::waitForService("/manager/load_nodelet", ros::Duration(60.0)));
}

}  // namespace mapping_common
