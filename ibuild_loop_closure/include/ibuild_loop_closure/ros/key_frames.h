// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Geometry>
#include <opencv2/core.hpp>
#include <optional>

namespace ibuild_loop_closure {

struct KeyFrameOptions {
  double min_interval = 0.5;    ///< s since the last key frame, 0: any
  double min_distance = 0.0;    ///< m moved since then
  double min_angle = 0.0;       ///< rad turned since then; distance or angle will do, both 0: any motion
  double min_difference = 2.0;  ///< mean difference of grey values of small copies, 0 to 255; 0: any
  bool needsMotion() const { return min_distance > 0.0 || min_angle > 0.0; }
  /// @throws std::invalid_argument that names the option, its value and the allowed range
  void validate() const;
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
