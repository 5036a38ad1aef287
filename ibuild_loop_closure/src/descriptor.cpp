// SPDX-License-Identifier: BSD-3-Clause
#include "ibuild_loop_closure/descriptor.h"

#include <algorithm>
#include <stdexcept>
#include <string>

#if defined(__x86_64__) && defined(__GNUC__)
#include <immintrin.h>
#define IBUILD_X86 1
#pragma GCC diagnostic ignored "-Wmaybe-uninitialized"  // GCC's own _mm512_reduce_add_epi64
#endif

namespace ibuild_loop_closure {
namespace {

// Words are one after another (const Descriptor*) or anywhere (const Descriptor* const*).
template <class Words>
using Kernel = void (*)(const Descriptor&, Words, std::size_t, std::uint16_t*);

inline const Descriptor& at(const Descriptor* words, std::size_t i) {
  return words[i];
}
inline const Descriptor& at(const Descriptor* const* words, std::size_t i) {
  return *words[i];
}

// Bits set in a word of 64, by adding neighbouring fields of 1, 2 and 4 bits, then all bytes.
int countBits(std::uint64_t x) {
  x -= (x >> 1) & 0x5555555555555555u;
  x = (x & 0x3333333333333333u) + ((x >> 2) & 0x3333333333333333u);
  x = (x + (x >> 4)) & 0x0f0f0f0f0f0f0f0fu;
  return static_cast<int>((x * 0x0101010101010101u) >> 56);
}

template <class Words>
void portable(const Descriptor& query, Words words, std::size_t count, std::uint16_t* distances) {
  for (std::size_t i = 0; i < count; ++i) {
    int sum = 0;
    for (std::size_t k = 0; k < query.bits.size(); ++k)
      sum += countBits(query.bits[k] ^ at(words, i).bits[k]);
    distances[i] = static_cast<std::uint16_t>(sum);
  }
}

#ifdef IBUILD_X86

template <class Words>
__attribute__((target("popcnt"))) void popcount(const Descriptor& query, Words words, std::size_t count,
                                                std::uint16_t* distances) {
  for (std::size_t i = 0; i < count; ++i) {
    long long sum = 0;
    for (std::size_t k = 0; k < query.bits.size(); ++k)
      sum += _mm_popcnt_u64(query.bits[k] ^ at(words, i).bits[k]);
    distances[i] = static_cast<std::uint16_t>(sum);
  }
}

// Bits set in each byte: two look-ups of four bits each.
__attribute__((target("avx2"))) inline __m256i countBytes(__m256i x) {
  const __m256i table = _mm256_setr_epi8(0, 1, 1, 2, 1, 2, 2, 3, 1, 2, 2, 3, 2, 3, 3, 4, 0, 1, 1, 2, 1, 2, 2,
                                         3, 1, 2, 2, 3, 2, 3, 3, 4);
  const __m256i low = _mm256_set1_epi8(0x0f);
  const __m256i a = _mm256_shuffle_epi8(table, _mm256_and_si256(x, low));
  const __m256i b = _mm256_shuffle_epi8(table, _mm256_and_si256(_mm256_srli_epi16(x, 4), low));
  return _mm256_add_epi8(a, b);
}

template <class Words>
__attribute__((target("avx2"))) void avx2(const Descriptor& query, Words words, std::size_t count,
                                          std::uint16_t* distances) {
  const auto* q = reinterpret_cast<const __m256i*>(query.bits.data());
  const __m256i q0 = _mm256_loadu_si256(q), q1 = _mm256_loadu_si256(q + 1);
  for (std::size_t i = 0; i < count; ++i) {
    const auto* w = reinterpret_cast<const __m256i*>(at(words, i).bits.data());
    const __m256i bytes = _mm256_add_epi8(countBytes(_mm256_xor_si256(q0, _mm256_loadu_si256(w))),
                                          countBytes(_mm256_xor_si256(q1, _mm256_loadu_si256(w + 1))));
    const __m256i sums = _mm256_sad_epu8(bytes, _mm256_setzero_si256());
    const __m128i halves = _mm_add_epi64(_mm256_castsi256_si128(sums), _mm256_extracti128_si256(sums, 1));
    distances[i] = static_cast<std::uint16_t>(_mm_cvtsi128_si64(halves) + _mm_extract_epi64(halves, 1));
  }
}

template <class Words>
__attribute__((target("avx512f,avx512vpopcntdq"))) void avx512(const Descriptor& query, Words words,
                                                               std::size_t count, std::uint16_t* distances) {
  const __m512i q = _mm512_loadu_si512(query.bits.data());
  for (std::size_t i = 0; i < count; ++i) {
    const __m512i bits = _mm512_xor_si512(q, _mm512_loadu_si512(at(words, i).bits.data()));
    distances[i] = static_cast<std::uint16_t>(_mm512_reduce_add_epi64(_mm512_popcnt_epi64(bits)));
  }
}

#endif

template <class Words>
Kernel<Words> functionOf(HammingKernel kernel) {
  switch (kernel) {
#ifdef IBUILD_X86
    case HammingKernel::kPopcount:
      return popcount<Words>;
    case HammingKernel::kAvx2:
      return avx2<Words>;
    case HammingKernel::kAvx512:
      return avx512<Words>;
#endif
    default:
      return portable<Words>;
  }
}

template <class Words>
void fastest(const Descriptor& query, Words words, std::size_t count, std::uint16_t* distances) {
  static const Kernel<Words> kernel = functionOf<Words>(supportedKernels().back());
  kernel(query, words, count, distances);
}

template <class Words>
void checked(const Descriptor& query, Words words, std::size_t count, std::uint16_t* distances,
             HammingKernel kernel) {
  for (HammingKernel supported : supportedKernels()) {
    if (supported == kernel) return functionOf<Words>(kernel)(query, words, count, distances);
  }
  throw std::invalid_argument(std::string("this processor has no ") + kernelName(kernel));
}

}  // namespace

Descriptor centroid(const std::vector<Descriptor>& descriptors) {
  if (descriptors.empty()) throw std::invalid_argument("there is no centroid of no descriptors");
  Descriptor result;
  for (int i = 0; i < Descriptor::kMaxBits; ++i) {
    const std::uint64_t bit = std::uint64_t{1} << (i % 64);
    std::size_t set = 0;
    for (const Descriptor& d : descriptors) set += (d.bits[i / 64] & bit) != 0;
    if (2 * set >= descriptors.size()) result.bits[i / 64] |= bit;
  }
  return result;
}

Descriptor centroid(const Descriptor& a, const Descriptor& b) {
  Descriptor result;
  for (std::size_t k = 0; k < a.bits.size(); ++k) result.bits[k] = a.bits[k] | b.bits[k];
  return result;
}

const std::vector<HammingKernel>& supportedKernels() {
  static const std::vector<HammingKernel> kernels = [] {
    std::vector<HammingKernel> found = {HammingKernel::kPortable};
#ifdef IBUILD_X86
    if (__builtin_cpu_supports("popcnt")) found.push_back(HammingKernel::kPopcount);
    if (__builtin_cpu_supports("avx2")) found.push_back(HammingKernel::kAvx2);
    if (__builtin_cpu_supports("avx512vpopcntdq")) found.push_back(HammingKernel::kAvx512);
#endif
    return found;
  }();
  return kernels;
}

const char* kernelName(HammingKernel kernel) {
  switch (kernel) {
    case HammingKernel::kPopcount:
      return "popcount";
    case HammingKernel::kAvx2:
      return "AVX2";
    case HammingKernel::kAvx512:
      return "AVX-512";
    default:
      return "portable";
  }
}

int hamming(const Descriptor& a, const Descriptor& b) {
  std::uint16_t distance;
  hammingDistances(a, &b, 1, &distance);
  return distance;
}

void hammingDistances(const Descriptor& query, const Descriptor* words, std::size_t count,
                      std::uint16_t* distances) {
  fastest(query, words, count, distances);
}

void hammingDistances(const Descriptor& query, const Descriptor* const* words, std::size_t count,
                      std::uint16_t* distances) {
  fastest(query, words, count, distances);
}

void hammingDistances(const Descriptor& query, const Descriptor* words, std::size_t count,
                      std::uint16_t* distances, HammingKernel kernel) {
  checked(query, words, count, distances, kernel);
}

void hammingDistances(const Descriptor& query, const Descriptor* const* words, std::size_t count,
                      std::uint16_t* distances, HammingKernel kernel) {
  checked(query, words, count, distances, kernel);
}

Nearest nearestOf(const Descriptor& query, const Descriptor* words, std::size_t count) {
  Nearest nearest;
  constexpr std::size_t kBlock = 256;
  std::array<std::uint16_t, kBlock> distances;
  for (std::size_t first = 0; first < count; first += kBlock) {
    const std::size_t n = std::min(kBlock, count - first);
    hammingDistances(query, words + first, n, distances.data());
    for (std::size_t i = 0; i < n; ++i) {
      if (distances[i] >= nearest.second) continue;
      if (distances[i] < nearest.distance) {
        nearest.second = nearest.distance;
        nearest.distance = distances[i];
        nearest.index = first + i;
      } else {
        nearest.second = distances[i];
      }
    }
  }
  return nearest;
}

std::vector<Match> matchDescriptors(const std::vector<Descriptor>& a, const std::vector<Descriptor>& b,
                                    int delta, double ratio) {
  std::vector<Match> matches;
  if (b.empty()) return matches;
  // Signed 16 bits: their minima take one instruction for eight on any x86-64.
  std::vector<std::int16_t> distances(b.size()), nearest_to_b(b.size(), Descriptor::kMaxBits + 1);
  const auto minimum = [&distances] {
    std::int16_t least = Descriptor::kMaxBits + 1;
    for (std::int16_t d : distances) least = std::min(least, d);
    return least;
  };
  for (std::size_t i = 0; i < a.size(); ++i) {
    hammingDistances(a[i], b.data(), b.size(), reinterpret_cast<std::uint16_t*>(distances.data()));
    for (std::size_t j = 0; j < b.size(); ++j) nearest_to_b[j] = std::min(nearest_to_b[j], distances[j]);
    const std::int16_t least = minimum();
    if (least >= delta) continue;
    const auto at = std::find(distances.begin(), distances.end(), least);
    if (ratio < 1.0) {
      *at = Descriptor::kMaxBits + 1;
      if (least >= ratio * minimum()) continue;
    }
    matches.push_back({static_cast<int>(i), static_cast<int>(at - distances.begin()), least});
  }
  std::vector<char> taken(b.size(), 0);
  const auto not_mutual = [&](const Match& m) {
    if (m.distance > nearest_to_b[m.b] || taken[m.b]) return true;
    taken[m.b] = 1;
    return false;
  };
  matches.erase(std::remove_if(matches.begin(), matches.end(), not_mutual), matches.end());
  return matches;
}

}  // namespace ibuild_loop_closure
