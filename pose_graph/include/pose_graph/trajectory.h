// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstddef>
#include <cstdint>
#include <optional>
#include <vector>

#include "pose_graph/graph.h"

namespace pose_graph {

/// Poses of a front end over time. What they take is bounded: they are thinned, older ones more.
class Trajectory {
 public:
  /// @param spacing ns, between those that are kept, but for the last
  /// @param most that are kept; where there are more, every second one of the older half goes
  explicit Trajectory(std::int64_t spacing = 100'000'000, std::size_t most = 100'000)
      : spacing_(spacing), most_(most) {}

  /// @return false, and nothing happens, where the stamp isn't after the last
  bool add(std::int64_t stamp, const Pose& pose);
  void clear() { samples_.clear(); }

  /// Between two samples that are at most `gap` (ns) apart: linear, of the rotation spherical.
  std::optional<Pose> at(std::int64_t stamp, std::int64_t gap = 1'000'000'000) const;

  /// How fast the body moves around a stamp, by what is known of `around` (ns) before and after it: m/s and
  /// rad/s (a rotation vector's), of its own axes.
  std::optional<Vector6> velocity(std::int64_t stamp, std::int64_t around = 100'000'000) const;

  bool empty() const { return samples_.empty(); }
  std::size_t size() const { return samples_.size(); }
  std::int64_t last() const { return samples_.back().stamp; }

 private:
  struct Sample {
    std::int64_t stamp;
    Pose pose;
  };
  std::int64_t spacing_;
  std::size_t most_;
  std::vector<Sample> samples_;
};

/// A share of the way from one pose to another.
Pose interpolate(const Pose& a, const Pose& b, double share);

}  // namespace pose_graph
