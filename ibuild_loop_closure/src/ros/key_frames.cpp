// SPDX-License-Identifier: BSD-3-Clause
#include "ibuild_loop_closure/ros/key_frames.h"

#include <opencv2/imgproc.hpp>

namespace ibuild_loop_closure {

bool KeyFrameSelector::select(double stamp, const std::optional<Eigen::Isometry3d>& pose,
                              const cv::Mat& image) {
  if (last_stamp_ && stamp - *last_stamp_ < options.min_interval) return false;
  if (options.needsMotion() && pose && last_pose_) {
    const Eigen::Isometry3d moved = last_pose_->inverse() * *pose;
    const bool far = options.min_distance > 0.0 && moved.translation().norm() >= options.min_distance;
    const double angle = Eigen::AngleAxisd(moved.linear()).angle();
    if (!far && !(options.min_angle > 0.0 && angle >= options.min_angle)) return false;
  }
  cv::Mat small;
  cv::resize(image, small, {32, 24}, 0, 0, cv::INTER_AREA);
  if (options.min_difference > 0.0 && !last_image_.empty() && small.type() == last_image_.type()) {
    const double sum = cv::norm(small, last_image_, cv::NORM_L1);
    if (sum < options.min_difference * static_cast<double>(small.total() * small.channels())) return false;
  }
  last_stamp_ = stamp;
  last_pose_ = pose;
  last_image_ = small;
  return true;
}

void KeyFrameSelector::reset() {
  last_stamp_.reset();
  last_pose_.reset();
  last_image_ = cv::Mat();
}

}  // namespace ibuild_loop_closure
