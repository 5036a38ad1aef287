// SPDX-License-Identifier: BSD-3-Clause
//
// How long the camera has gone straight ahead: on such a way nothing is passed twice.
#pragma once

#include <optional>
#include <vector>

#include "ibuild_loop_closure/geometry.h"

namespace ibuild_loop_closure {

/// A camera that goes ahead comes back only after it has looked the other way, one that goes back sees images
/// shrink. As long as it does neither, what looks like an earlier image is still in view or looks alike, such
/// as the doors of a corridor.
class StraightRun {
 public:
  /// @param images that came before, of which nothing is known
  explicit StraightRun(int images = 0) : turns_(images), expansions_(images), start_(images) {}

  /// @param motion since the image before; none: it doesn't follow that image, or can't be told
  void add(const std::optional<ImageMotion>& motion);
  /// The first image since which the camera has gone straight ahead.
  int start() const { return start_; }

 private:
  std::vector<double> turns_, expansions_;  // of each image, summed up since the first
  int start_;
};

}  // namespace ibuild_loop_closure
