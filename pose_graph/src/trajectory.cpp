// SPDX-License-Identifier: BSD-3-Clause
#include "pose_graph/trajectory.h"

#include <algorithm>

namespace pose_graph {

bool Trajectory::add(std::int64_t stamp, const Pose& pose) {
  if (!samples_.empty() && stamp <= last()) return false;
  const std::size_t n = samples_.size();
  if (n >= 2 && stamp - samples_[n - 2].stamp < spacing_) {
    samples_.back() = {stamp, pose};
    return true;
  }
  samples_.push_back({stamp, pose});
  if (samples_.size() <= most_) return true;
  const std::size_t half = samples_.size() / 2;
  std::size_t kept = 0;
  for (std::size_t i = 0; i < samples_.size(); ++i)
    if (i >= half || i % 2 == 0) samples_[kept++] = samples_[i];
  samples_.resize(kept);
  return true;
}

std::optional<Pose> Trajectory::at(std::int64_t stamp, std::int64_t gap) const {
  const auto after =
      std::lower_bound(samples_.begin(), samples_.end(), stamp,
                       [](const Sample& sample, std::int64_t time) { return sample.stamp < time; });
  if (after == samples_.end()) return std::nullopt;
  if (after->stamp == stamp) return after->pose;
  if (after == samples_.begin()) return std::nullopt;
  const auto before = after - 1;
  const std::int64_t apart = after->stamp - before->stamp;
  if (apart > gap) return std::nullopt;
  return interpolate(before->pose, after->pose, static_cast<double>(stamp - before->stamp) / apart);
}

std::optional<Vector6> Trajectory::velocity(std::int64_t stamp, std::int64_t around) const {
  const auto here = at(stamp);
  if (!here) return std::nullopt;
  auto from = at(stamp - around), to = at(stamp + around);
  const std::int64_t time = (from ? around : 0) + (to ? around : 0);
  if (time == 0) return std::nullopt;
  const auto seen = [&](const std::optional<Pose>& pose) -> Vector6 {
    if (!pose) return Vector6::Zero();
    const Pose relative = here->inverse() * *pose;
    const Eigen::AngleAxisd turn(relative.rotation);
    Vector6 motion;
    motion << relative.translation, turn.angle() * turn.axis();
    return motion;
  };
  return (seen(to) - seen(from)) / (1e-9 * static_cast<double>(time));
}

Pose interpolate(const Pose& a, const Pose& b, double share) {
  return {a.translation + share * (b.translation - a.translation), a.rotation.slerp(share, b.rotation)};
}

}  // namespace pose_graph
