// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstdint>

#ifdef __SSE2__
#include <emmintrin.h>
#endif

namespace rtree_occupancy_map {

/// Sets bit i of out[j * stride] where bit j of in[i] is set, for a matrix of 32 x 32 bits.
inline void transposeInto(const std::uint32_t* in, std::uint32_t* out, int stride) {
  std::uint32_t any = 0;
  for (int i = 0; i < 32; ++i) any |= in[i];
  if (any == 0) return;
#ifdef __SSE2__
  __m128i rows[8];
  for (int k = 0; k < 8; ++k) rows[k] = _mm_loadu_si128(reinterpret_cast<const __m128i*>(in + 4 * k));
  for (int byte = 0; byte < 4; ++byte) {
    if ((any >> 8 * byte & 0xff) == 0) continue;
    // This byte of all 32 numbers, side by side, so that one instruction gathers their highest bits.
    __m128i column[2];
    for (int half = 0; half < 2; ++half) {
      __m128i part[4];
      for (int k = 0; k < 4; ++k) {
        part[k] = _mm_and_si128(_mm_srli_epi32(rows[4 * half + k], 8 * byte), _mm_set1_epi32(0xff));
      }
      column[half] = _mm_packus_epi16(_mm_packs_epi32(part[0], part[1]), _mm_packs_epi32(part[2], part[3]));
    }
    for (int j = 8 * byte + 7; j >= 8 * byte; --j) {
      out[j * stride] |= static_cast<std::uint32_t>(_mm_movemask_epi8(column[0])) |
                         static_cast<std::uint32_t>(_mm_movemask_epi8(column[1])) << 16;
      column[0] = _mm_add_epi8(column[0], column[0]);
      column[1] = _mm_add_epi8(column[1], column[1]);
    }
  }
#else
  for (int i = 0; i < 32; ++i) {
    for (std::uint32_t word = in[i]; word != 0; word &= word - 1) {
      out[__builtin_ctz(word) * stride] |= 1u << i;
    }
  }
#endif
}

}  // namespace rtree_occupancy_map
