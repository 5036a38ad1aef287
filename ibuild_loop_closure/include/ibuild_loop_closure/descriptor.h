// SPDX-License-Identifier: BSD-3-Clause
//
// Binary descriptors, their Hamming distance, their centroid and what matches between two sets of them.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <string>
#include <vector>

namespace ibuild_loop_closure {

/// A descriptor or a visual word. It is one cache line, p = 512 bits; of shorter descriptors the last ones
/// are 0, which changes neither distances nor centroids.
struct alignas(64) Descriptor {
  static constexpr int kMaxBits = 512;
  std::array<std::uint64_t, kMaxBits / 64> bits{};
  bool operator==(const Descriptor& other) const { return bits == other.bits; }
};

/// Eq. 4.1 over any number of descriptors: a bit is set where at least half of them have it set.
/// @throws std::invalid_argument if there is none
Descriptor centroid(const std::vector<Descriptor>& descriptors);
/// The same for two, which is their bitwise or.
Descriptor centroid(const Descriptor& a, const Descriptor& b);

/// How distances are computed; all give the same.
enum class HammingKernel { kPortable, kPopcount, kAvx2, kAvx512 };

/// Those that this processor has, the fastest last. kPortable is always there.
const std::vector<HammingKernel>& supportedKernels();
const char* kernelName(HammingKernel kernel);

int hamming(const Descriptor& a, const Descriptor& b);

/// distances[i] = H(query, words[i]) for i < count.
void hammingDistances(const Descriptor& query, const Descriptor* words, std::size_t count,
                      std::uint16_t* distances);
/// The same of words at different places.
void hammingDistances(const Descriptor& query, const Descriptor* const* words, std::size_t count,
                      std::uint16_t* distances);
/// Both with a given kernel. @throws std::invalid_argument if the processor doesn't have it
void hammingDistances(const Descriptor& query, const Descriptor* words, std::size_t count,
                      std::uint16_t* distances, HammingKernel kernel);
void hammingDistances(const Descriptor& query, const Descriptor* const* words, std::size_t count,
                      std::uint16_t* distances, HammingKernel kernel);

struct Match {
  int a = 0, b = 0;  ///< indices into the two sets
  int distance = 0;  ///< bits
  bool operator==(const Match& o) const { return a == o.a && b == o.b && distance == o.distance; }
};

/// Pairs that are each other's nearest, nearer than `delta`. By index of a.
/// @param ratio a's nearest must also be nearer than this times its second nearest; 1: no such test
std::vector<Match> matchDescriptors(const std::vector<Descriptor>& a, const std::vector<Descriptor>& b,
                                    int delta, double ratio = 1.0);

/// Smallest and second smallest distance.
struct Nearest {
  std::size_t index = 0;
  int distance = Descriptor::kMaxBits + 1, second = Descriptor::kMaxBits + 1;
};
Nearest nearestOf(const Descriptor& query, const Descriptor* words, std::size_t count);

}  // namespace ibuild_loop_closure
