// SPDX-License-Identifier: BSD-3-Clause
#include "ibuild_loop_closure/straight_run.h"

#include <algorithm>
#include <cmath>

namespace ibuild_loop_closure {
namespace {

constexpr double kTurn = 1.0;       // widths of the image, well below the 180 degrees of a way back
constexpr double kShrinking = 0.1;  // logarithm of a scale, beyond what the single ones add up to by error

}  // namespace

void StraightRun::add(const std::optional<ImageMotion>& motion) {
  const std::size_t image = turns_.size();
  turns_.push_back(motion && image > 0 ? turns_.back() + motion->turn : 0.0);
  expansions_.push_back(motion && image > 0 ? expansions_.back() + motion->expansion : 0.0);
  if (!motion) start_ = static_cast<int>(image);
  double left = turns_[image], right = left, least = expansions_[image];
  for (std::size_t i = image; i-- > static_cast<std::size_t>(start_);) {
    left = std::min(left, turns_[i]);
    right = std::max(right, turns_[i]);
    least = std::min(least, expansions_[i]);
    if (right - left > kTurn || expansions_[i] - least > kShrinking) start_ = static_cast<int>(i) + 1;
  }
}

}  // namespace ibuild_loop_closure
