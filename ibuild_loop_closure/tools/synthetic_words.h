// SPDX-License-Identifier: BSD-3-Clause
//
// Words that lie as those of real images do, in any number.
#pragma once

#include <array>
#include <random>
#include <vector>

#include "ibuild_loop_closure/descriptor.h"

namespace ibuild_loop_closure {

/// A patch is a few normal numbers, a bit is the sign of a linear function of them, as a bit of BRISK is that
/// of a difference of brightnesses. With 12 numbers as many pairs of words are within 90 and 110 bits of each
/// other as of real images' words, with more there are fewer.
class SyntheticWords {
 public:
  using Patch = std::vector<float>;

  explicit SyntheticWords(unsigned seed, int numbers = 12) : random_(seed) {
    for (Patch& function : functions_) function = patch(numbers);
  }
  /// A new patch.
  Patch patch(int numbers) {
    Patch p(numbers);
    for (float& x : p) x = normal_(random_);
    return p;
  }
  Patch patch() { return patch(static_cast<int>(functions_[0].size())); }
  /// The patch seen again: its word is about 160 * change bits from the first.
  Patch again(Patch p, float change = 0.25f) {
    for (float& x : p) x += change * normal_(random_);
    return p;
  }
  Descriptor word(const Patch& p) const {
    Descriptor d;
    for (std::size_t i = 0; i < functions_.size(); ++i) {
      float sum = 0.0f;
      for (std::size_t k = 0; k < p.size(); ++k) sum += functions_[i][k] * p[k];
      d.bits[i / 64] |= static_cast<std::uint64_t>(sum > 0.0f) << (i % 64);
    }
    return d;
  }
  std::size_t below(std::size_t n) { return random_() % n; }

 private:
  std::mt19937_64 random_;
  std::normal_distribution<float> normal_;
  std::array<Patch, Descriptor::kMaxBits> functions_;
};

}  // namespace ibuild_loop_closure
