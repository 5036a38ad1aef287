// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <mapping_common/parameters.h>

#include <string>

#include "ibuild_loop_closure/loop_detector.h"
#include "ibuild_loop_closure/ros/key_frames.h"

namespace ibuild_loop_closure {

enum class Method { kFull, kThesis };
constexpr auto choicesOf(Method) {
  return mapping_common::choices<Method>({{"full", Method::kFull, "as below"},
                                          {"thesis", Method::kThesis,
                                           "section 4.4 to the letter. Its features, index and checks are "
                                           "then the defaults of what isn't set here: leave "
                                           "the rest of this file out"}});
}

struct LoopClosureParameters {
  std::string image_transport = "raw";
  bool use_depth = false, use_stereo = false;
  int queue_size = 5;
  std::string fixed_frame = "odom";
  std::string vocabulary_file, save_on_shutdown;
  bool debug_image = true;
  double transform_timeout = 0.5;
  KeyFrameOptions key_frames;
  Method method = Method::kFull;
  LoopDetectorOptions detector;

  void describe(mapping_common::OptionList& o) {
    o.section("the input");
    o("image_transport", image_transport, "", "with compressed, the topic is <image>/compressed")
        .oneOf({"raw", "compressed"});
    o("use_depth", use_depth, "",
      "true: images wait for the depth image of their time; loops then have a transform");
    o("use_stereo", use_stereo, "",
      "true: images wait for the right image of their time, both rectified; instead of depth");
    o("queue_size", queue_size, "", "images that wait; the oldest is dropped").within(1, 1000);
    o("transform_timeout", transform_timeout, "s",
      "that an image waits for its transform, by the stamps of later ones")
        .within(0.0, 10.0);
    o("fixed_frame", fixed_frame, "", "frame that motion is measured in, where key frames depend on it");
    o("vocabulary_file", vocabulary_file, "",
      "path of a vocabulary to start with; its delta and index replace those below");
    o("save_on_shutdown", save_on_shutdown, "",
      "path that the vocabulary is written to at the end. Empty: don't");
    o("debug_image", debug_image, "",
      "true: keeps small copies of key frames (some 10 kB each) and publishes matched pairs");
    o.group("key_frames", "an image is compared if all of these hold", key_frames);
    o.section("the method");
    o("method", method, "", "");
    detector.describe(o);
    o.require(!use_depth || !use_stereo, "use_stereo", "false with use_depth");
  }
};

/// @throws std::invalid_argument as Parameters::read
LoopClosureParameters readLoopClosureParameters(const mapping_common::Parameters& parameters);

}  // namespace ibuild_loop_closure
