// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <mapping_msgs/EdgeConstraint.h>
#include <sensor_msgs/Image.h>
#include <sensor_msgs/PointCloud2.h>

#include "intensity_place_recognition/place_recognizer.h"

namespace intensity_place_recognition {

/// Points from x, y, z and `intensity_field`, each of any numeric type.
/// @throws std::invalid_argument that says what is malformed, or that there is no such field
Cloud toCloud(const sensor_msgs::PointCloud2& message, const std::string& intensity_field);

/// Points from a panorama of intensities and one of ranges, see PanoramaOptions; what isn't finite is left
/// out.
/// @param range_unit m, of ranges of integers; those of floats are in m
/// @throws std::invalid_argument that says what is malformed
Cloud toCloud(const sensor_msgs::Image& intensity, const sensor_msgs::Image& range, double range_unit,
              const PanoramaOptions& options);

/// The cloud that a place was described from.
struct Origin {
  std::uint32_t cloud = 0;  ///< its number, the id in edges
  ros::Time stamp;          ///< zero where a file brought the place
};

/// @param to the number of the query's cloud, @param header of that cloud
mapping_msgs::EdgeConstraint toEdge(const Registration& registration, const Origin& from, std::uint32_t to,
                                    const std_msgs::Header& header);

}  // namespace intensity_place_recognition
