// SPDX-License-Identifier: BSD-3-Clause
#include "ibuild_loop_closure/ros/conversions.h"

#include <cv_bridge/cv_bridge.h>
#include <mapping_common/images.h>
#include <sensor_msgs/image_encodings.h>
#include <tf2_eigen/tf2_eigen.h>

#include <cmath>
#include <cstdint>
#include <stdexcept>
#include <string>

namespace ibuild_loop_closure {
namespace {

namespace encodings = sensor_msgs::image_encodings;

// Of channels without a name, as thermal cameras and some drivers have them.
bool isUnnamed(const std::string& encoding) {
  return encoding.compare(0, 3, "8UC") == 0 || encoding.compare(0, 4, "16UC") == 0;
}

}  // namespace

cv::Mat toImage(const sensor_msgs::Image& message) {
  try {
    mapping_common::requireWhole(message);
    if (isUnnamed(message.encoding)) return toGrey(cv_bridge::toCvCopy(message)->image);
    const bool deep = encodings::bitDepth(message.encoding) == 16;
    return toGrey(cv_bridge::toCvCopy(message, deep ? encodings::MONO16 : encodings::MONO8)->image);
  } catch (const std::exception& e) {  // cv_bridge, OpenCV, image_encodings
    throw std::invalid_argument("the image of encoding '" + message.encoding +
                                "' can't be converted: " + e.what());
  }
}

cv::Mat toImage(const sensor_msgs::CompressedImage& message) {
  cv::Mat image;
  try {
    image = cv_bridge::toCvCopy(message, encodings::MONO8)->image;
  } catch (const std::exception& e) {
    throw std::invalid_argument("the compressed image of format '" + message.format +
                                "' can't be unpacked: " + e.what());
  }
  if (image.empty())
    throw std::invalid_argument("the compressed image of format '" + message.format + "' can't be unpacked");
  return image;
}

cv::Mat toDepth(const sensor_msgs::Image& message) {
  if (message.encoding != encodings::TYPE_16UC1 && message.encoding != encodings::MONO16 &&
      message.encoding != encodings::TYPE_32FC1) {
    throw std::invalid_argument("the depth image's encoding is '" + message.encoding +
                                "', allowed is 16UC1 (mm), 32FC1 (m)");
  }
  try {
    mapping_common::requireWhole(message);
    return cv_bridge::toCvCopy(message)->image;
  } catch (const std::exception& e) {
    throw std::invalid_argument(std::string("the depth image can't be converted: ") + e.what());
  }
}

std::optional<Camera> toCamera(const sensor_msgs::CameraInfo& message) {
  const auto& p = message.P;
  if (!(p[0] > 0.0 && p[5] > 0.0)) return {};
  for (const int i : {0, 2, 5, 6})
    if (!std::isfinite(p[i])) return {};
  return Camera{p[0], p[5], p[2], p[6]};
}

RightImage toRightImage(const cv::Mat& image, const sensor_msgs::CameraInfo& info) {
  const auto& p = info.P;
  const double baseline = p[0] > 0.0 ? -p[3] / p[0] : 0.0;
  if (!(baseline > 0.0) || !std::isfinite(baseline) || !std::isfinite(p[2]))
    throw std::invalid_argument("the right camera_info has no baseline: P(0, 0) is " + std::to_string(p[0]) +
                                ", P(0, 3) is " + std::to_string(p[3]) +
                                ", which has to be -P(0, 0) * baseline");
  return {image, baseline, p[2]};
}

mapping_msgs::EdgeConstraint toEdge(const Loop& loop, const std_msgs::Header& to_header,
                                    const ros::Time& from_stamp, bool other_run) {
  mapping_msgs::EdgeConstraint edge;
  edge.header = to_header;
  edge.to_stamp = to_header.stamp;
  edge.from_stamp = from_stamp;
  edge.to_id = static_cast<std::uint32_t>(loop.query);
  edge.from_id = static_cast<std::uint32_t>(loop.match);
  edge.frame_id = to_header.frame_id;
  edge.type = other_run ? mapping_msgs::EdgeConstraint::PLACE : mapping_msgs::EdgeConstraint::LOOP_CLOSURE;
  edge.similarity = static_cast<float>(loop.similarity);
  edge.transform.orientation.w = 1.0;
  if (loop.geometry.pose) {
    edge.has_transform = true;
    edge.transform = tf2::toMsg(loop.geometry.pose->transform);
    for (int i = 0; i < 36; ++i) edge.information[i] = loop.geometry.pose->information(i / 6, i % 6);
  }
  return edge;
}

}  // namespace ibuild_loop_closure
