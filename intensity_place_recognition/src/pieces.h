// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>
#include <cmath>
#include <cstdint>
#include <vector>

namespace intensity_place_recognition {

/// The number of the cube of so many m that a point is in, from 1.
inline std::uint64_t cubeOf(const Eigen::Vector3f& point, float size) {
  const auto cell = [size](float v) {
    return static_cast<std::uint64_t>(static_cast<std::int64_t>(std::floor(v / size)) + (1 << 20));
  };
  return (cell(point.x()) << 42) | (cell(point.y()) << 21) | cell(point.z());
}

/// Counts the cubes of 2 m that points are in.
class Pieces {
 public:
  /// @param most points that will be added
  explicit Pieces(std::size_t most) {
    std::size_t slots = 16;
    while (slots < 2 * most) slots *= 2;
    cubes_.resize(slots, 0);
  }
  void add(const Eigen::Vector3f& point) {
    constexpr float kSize = 2.0f;  // m
    const std::uint64_t cube = cubeOf(point, kSize);
    std::size_t at = cube * 0x9e3779b97f4a7c15u >> 32;  // Fibonacci hashing (Knuth 1998, 6.4)
    for (;; ++at) {
      at &= cubes_.size() - 1;
      if (cubes_[at] == cube) return;
      if (cubes_[at] == 0) break;
    }
    cubes_[at] = cube;
    ++count_;
  }
  int count() const { return count_; }

 private:
  std::vector<std::uint64_t> cubes_;  // 0: none
  int count_ = 0;
};

}  // namespace intensity_place_recognition
