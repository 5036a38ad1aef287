// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <mapping_common/parameters.h>

#include <string>

#include "ibuild_loop_closure/loop_detector.h"
#include "ibuild_loop_closure/ros/key_frames.h"

namespace ibuild_loop_closure {

/// See config/loop_closure.yaml.
struct LoopClosureParameters {
  LoopDetectorOptions detector;
  KeyFrameOptions key_frames;
  std::string image_transport = "raw";
  std::string fixed_frame = "odom";
  std::string vocabulary_file, save_on_shutdown;
  bool use_depth = false, use_stereo = false, debug_image = true;
  double transform_timeout = 0.5;  ///< s
  int queue_size = 5;
};

/// @throws std::invalid_argument that names the parameter, its value and the allowed range
LoopClosureParameters readLoopClosureParameters(mapping_common::Parameters& parameters);

}  // namespace ibuild_loop_closure
