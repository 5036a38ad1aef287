// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <mapping_msgs/EdgeConstraint.h>
#include <sensor_msgs/CameraInfo.h>
#include <sensor_msgs/CompressedImage.h>
#include <sensor_msgs/Image.h>

#include <opencv2/core.hpp>
#include <optional>

#include "ibuild_loop_closure/geometry.h"
#include "ibuild_loop_closure/loop_detector.h"

namespace ibuild_loop_closure {

/// Grey, 8 bits; a message of 16 bits is scaled to its range. Three and four channels without names (8UC3,
/// 16UC4, ...) are taken for BGR and BGRA.
/// @throws std::invalid_argument if the message is empty, its size and its data don't agree or its encoding
/// is unknown
cv::Mat toImage(const sensor_msgs::Image& message);
cv::Mat toImage(const sensor_msgs::CompressedImage& message);
/// 16UC1 (mm) or 32FC1 (m), REP 118. @throws std::invalid_argument as toImage
cv::Mat toDepth(const sensor_msgs::Image& message);

/// Of the rectified image (P); none where it isn't calibrated.
std::optional<Camera> toCamera(const sensor_msgs::CameraInfo& message);

/// The right image of a stereo camera with its calibration, P(0, 3) = -fx * baseline (REP 104).
/// @throws std::invalid_argument if it has no baseline
RightImage toRightImage(const cv::Mat& image, const sensor_msgs::CameraInfo& info);

/// @param to_header of the query's image, @param from_stamp of the match's
mapping_msgs::EdgeConstraint toEdge(const Loop& loop, const std_msgs::Header& to_header,
                                    const ros::Time& from_stamp, bool other_run);

}  // namespace ibuild_loop_closure
