// SPDX-License-Identifier: BSD-3-Clause
//
// Binary descriptors of 512 bits, their Hamming distance and their centroid.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <string>
#include <vector>

namespace ibuild_loop_closure {

/// A descriptor or a visual word, p = 512 bits. It is one cache line.
struct alignas(64) Descriptor {
  static constexpr int kBits = 512;
  std::array<std::uint64_t, kBits / 64> bits{};
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

}  // namespace ibuild_loop_closure
