// SPDX-License-Identifier: BSD-3-Clause
#include "ibuild_loop_closure/ros/parameters.h"

namespace ibuild_loop_closure {

LoopClosureParameters readLoopClosureParameters(const mapping_common::Parameters& parameters) {
  const std::vector<std::string> others = {"debug_image/"};  // image_transport's
  LoopClosureParameters p;
  parameters.read(p, others);
  if (p.method == Method::kFull) return p;
  p = {};
  p.detector = LoopDetectorOptions::thesis();
  parameters.read(p, others);
  return p;
}

}  // namespace ibuild_loop_closure
