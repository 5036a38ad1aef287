// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <mapping_common/options.h>

#include <Eigen/Geometry>
#include <opencv2/core.hpp>
#include <optional>

namespace ibuild_loop_closure {

struct KeyFrameOptions {
  double min_interval = 0.5;
  double min_distance = 0.0, min_angle = 0.0;
  double min_difference = 2.0;
  bool needsMotion() const { return min_distance > 0.0 || min_angle > 0.0; }

  void describe(mapping_common::OptionList& o) {
    o("min_interval", min_interval, "s", "since the last").within(0.0, 1e6).dynamic();
    o("min_distance", min_distance, "m", "moved since the last, 0: any").within(0.0, 1e6).dynamic();
    o("min_angle", min_angle, "rad", "turned since the last, in place of the distance, 0: any")
        .within(0.0, 3.15)
        .dynamic();
    o("min_difference", min_difference, "grey values",
      "mean difference from the last, of small copies: a standing camera is left out. 0: any")
        .within(0.0, 255.0)
        .dynamic();
  }
};

/// Which images of a camera are compared: all conditions must hold.
class KeyFrameSelector {
 public:
  KeyFrameOptions options;

  /// @param stamp s @param pose of the camera in a fixed frame, as far as motion counts
  bool select(double stamp, const std::optional<Eigen::Isometry3d>& pose, const cv::Mat& image);
  /// The next image is a key frame.
  void reset();

 private:
  std::optional<double> last_stamp_;
  std::optional<Eigen::Isometry3d> last_pose_;
  cv::Mat last_image_;
};

}  // namespace ibuild_loop_closure
