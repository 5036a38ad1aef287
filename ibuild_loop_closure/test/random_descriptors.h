// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <random>
#include <vector>

#include "ibuild_loop_closure/descriptor.h"

namespace ibuild_loop_closure {

inline Descriptor randomDescriptor(std::mt19937_64& random) {
  Descriptor d;
  for (auto& bits : d.bits) bits = random();
  return d;
}

inline std::vector<Descriptor> randomDescriptors(std::size_t count, unsigned seed = 1) {
  std::mt19937_64 random(seed);
  std::vector<Descriptor> descriptors;
  for (std::size_t i = 0; i < count; ++i) descriptors.push_back(randomDescriptor(random));
  return descriptors;
}

/// The first `count` bits from `first` on differ.
inline Descriptor flip(Descriptor d, int count, int first = 0) {
  for (int i = first; i < first + count; ++i) d.bits[i / 64] ^= std::uint64_t{1} << (i % 64);
  return d;
}

}  // namespace ibuild_loop_closure
