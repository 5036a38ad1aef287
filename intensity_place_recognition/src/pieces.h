// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>
#include <cmath>
#include <cstdint>
#include <unordered_set>

namespace intensity_place_recognition {

/// Counts the cubes of 2 m that points are in.
class Pieces {
 public:
  void add(const Eigen::Vector3f& point) {
    const auto cell = [](float v) {
      return static_cast<std::uint64_t>(static_cast<std::int64_t>(std::floor(v / kSize)) + (1 << 20));
    };
    cells_.insert((cell(point.x()) << 42) | (cell(point.y()) << 21) | cell(point.z()));
  }
  int count() const { return static_cast<int>(cells_.size()); }

 private:
  static constexpr float kSize = 2.0f;  // m
  std::unordered_set<std::uint64_t> cells_;
};

}  // namespace intensity_place_recognition
