// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <vector>

namespace intensity_place_recognition {

/// Numbers the cells of a grid, most of which are empty: those of blocks of 8 x 8 x 8 in which there is
/// something. What cells hold is kept in vectors of `slots()`, which take a fraction of the grid.
class BlockGrid {
 public:
  BlockGrid() = default;
  explicit BlockGrid(const Eigen::Vector3i& size)
      : blocks_((size.cast<unsigned>().array() + (kSide - 1)) / kSide),
        first_(static_cast<std::size_t>(blocks_.x()) * blocks_.y() * blocks_.z(), 0) {}

  /// Of a cell inside of the grid; one of the first block, if its block is empty.
  std::size_t slot(int x, int y, int z) const { return first_[blockOf(x, y, z)] + within(x, y, z); }
  /// The same, where something is put in.
  std::size_t makeSlot(int x, int y, int z) {
    unsigned& first = first_[blockOf(x, y, z)];
    if (first == 0) {
      first = slots_;
      slots_ += kSide * kSide * kSide;
    }
    return first + within(x, y, z);
  }
  std::size_t slots() const { return slots_; }

 private:
  static constexpr unsigned kSide = 8;
  std::size_t blockOf(unsigned x, unsigned y, unsigned z) const {
    return (z / kSide * static_cast<std::size_t>(blocks_.y()) + y / kSide) * blocks_.x() + x / kSide;
  }
  static unsigned within(unsigned x, unsigned y, unsigned z) {
    return (z % kSide * kSide + y % kSide) * kSide + x % kSide;
  }
  Eigen::Matrix<unsigned, 3, 1> blocks_ = Eigen::Matrix<unsigned, 3, 1>::Zero();
  std::vector<unsigned> first_;             // slot of each block; 0: it is empty
  unsigned slots_ = kSide * kSide * kSide;  // of which those of the first block stay empty
};

}  // namespace intensity_place_recognition
