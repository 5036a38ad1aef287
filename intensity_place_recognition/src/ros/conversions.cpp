// SPDX-License-Identifier: BSD-3-Clause
#include "intensity_place_recognition/ros/conversions.h"

#include <cv_bridge/cv_bridge.h>
#include <mapping_common/cloud_fields.h>
#include <mapping_common/images.h>
#include <sensor_msgs/image_encodings.h>

#include <algorithm>
#include <boost/algorithm/string/join.hpp>
#include <stdexcept>
#include <vector>

namespace intensity_place_recognition {

using mapping_common::CloudField;

Cloud toCloud(const sensor_msgs::PointCloud2& message, const std::string& intensity_field) {
  const CloudField x = CloudField::requireFloat(message, "x"), y = CloudField::requireFloat(message, "y"),
                   z = CloudField::requireFloat(message, "z"),
                   i = CloudField::require(message, intensity_field);
  Cloud cloud;
  mapping_common::visitPoints(message, [&](const std::uint8_t* point, std::size_t) {
    pcl::PointXYZI p;
    p.getVector3fMap() << x(point), y(point), z(point);
    p.intensity = i(point);
    cloud.push_back(p);
  });
  return cloud;
}

Cloud toCloud(const sensor_msgs::Image& intensity, const sensor_msgs::Image& range, double range_unit,
              const PanoramaOptions& options) {
  const auto floats = [](const sensor_msgs::Image& image, const std::string& what, double unit,
                         const std::vector<std::string>& encodings) {
    if (std::find(encodings.begin(), encodings.end(), image.encoding) == encodings.end())
      throw std::invalid_argument("the encoding of the image of " + what + " is '" + image.encoding +
                                  "', allowed is " + boost::algorithm::join(encodings, ", "));
    try {
      mapping_common::requireWhole(image);
      const cv::Mat values = cv_bridge::toCvCopy(image)->image;
      cv::Mat1f result;
      values.convertTo(result, CV_32F, values.depth() == CV_32F ? 1.0 : unit);
      return result;
    } catch (const std::exception& e) {  // cv_bridge, OpenCV
      throw std::invalid_argument("the image of " + what + " can't be converted: " + e.what());
    }
  };
  namespace encodings = sensor_msgs::image_encodings;
  return toCloud(
      floats(intensity, "intensities", 1.0,
             {encodings::MONO8, encodings::MONO16, encodings::TYPE_8UC1, encodings::TYPE_16UC1,
              encodings::TYPE_32FC1}),
      floats(range, "ranges", range_unit, {encodings::MONO16, encodings::TYPE_16UC1, encodings::TYPE_32FC1}),
      options);
}

mapping_msgs::EdgeConstraint toEdge(const Registration& registration, const Origin& from, std::uint32_t to,
                                    const std_msgs::Header& header) {
  mapping_msgs::EdgeConstraint edge;
  edge.header = header;
  edge.from_stamp = from.stamp;
  edge.to_stamp = header.stamp;
  edge.from_id = from.cloud;
  edge.to_id = to;
  edge.frame_id = header.frame_id;
  edge.type = mapping_msgs::EdgeConstraint::PLACE;
  edge.has_transform = true;
  const Eigen::Isometry3d& pose = registration.pose;
  const Eigen::Quaterniond q(pose.rotation());
  edge.transform.position.x = pose.translation().x();
  edge.transform.position.y = pose.translation().y();
  edge.transform.position.z = pose.translation().z();
  edge.transform.orientation.x = q.x();
  edge.transform.orientation.y = q.y();
  edge.transform.orientation.z = q.z();
  edge.transform.orientation.w = q.w();
  const Matrix6 information = informationAtQuery(registration);
  for (int r = 0; r < 6; ++r)
    for (int c = 0; c < 6; ++c) edge.information[6 * r + c] = information(r, c);
  edge.similarity = static_cast<float>(std::clamp(registration.score, 0.0, 1.0));
  return edge;
}

}  // namespace intensity_place_recognition
