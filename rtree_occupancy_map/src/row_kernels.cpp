// SPDX-License-Identifier: BSD-3-Clause
#include "row_kernels.h"

#include "beam_tracer.h"

#if defined(__x86_64__) && defined(__GNUC__)
#define HAS_AVX512_KERNELS
#define AVX512 __attribute__((target("avx512f,popcnt")))
#include <immintrin.h>
#endif

namespace rtree_occupancy_map {
namespace {

// What a voxel has been and what becomes of it is looked up, as there is no foreseeing it for a branch.
void updatePortably(RowUpdate& row, std::uint32_t hit, std::uint32_t miss, const LogOddsModel& model) {
  const float settled_at[] = {model.prior, model.min, model.max}, updates[] = {0.0F, model.miss, model.hit};
  const std::uint32_t low = row.low, high = row.high, between = row.between;
  const float* in = row.in;
  float* out = row.out;
  std::uint32_t new_low = low & ~hit, new_high = high & ~miss;
  const std::uint32_t all = between | hit | miss;
  forEachBit(all, [&](int z) {
    const auto bit = [z](std::uint32_t word) { return word >> z & 1; };
    const float* before = bit(between) != 0 ? in : &settled_at[bit(low) | bit(high) << 1];
    in += bit(between);
    const float log_odds = *before + updates[bit(miss) | bit(hit) << 1];
    const std::uint32_t is_low = log_odds <= model.min, is_high = log_odds >= model.max;
    *out = log_odds;
    out += 1 - static_cast<int>(is_low | is_high);
    new_low |= is_low << z;
    new_high |= is_high << z;
  });
  row = {new_low, new_high, all & ~(new_low | new_high), in, out};
}

void unpackPortably(const BlockRows& rows, const float* in, float* out) {
  for (int row = 0; row < kBlockRows; ++row) {
    forEachBit(rows[row], [&](int z) { out[row * kBlockSize + z] = *in++; });
  }
}

std::uint32_t equalPortably(std::uint32_t mask, const float* a, const float* b) {
  std::uint32_t equal = 0;
  forEachBit(mask, [&](int z) { equal |= static_cast<std::uint32_t>(a[z] == b[z]) << z; });
  return equal;
}

// Which voxels of a row are in `rows` together with the next one along x, y and z.
inline std::array<std::uint32_t, 3> pairsIn(const BlockRows& rows, int row) {
  return {row % kBlockSize < kBlockSize - 1 ? rows[row] & rows[row + 1] : 0,
          row < kBlockRows - kBlockSize ? rows[row] & rows[row + kBlockSize] : 0, rows[row] & rows[row] >> 1};
}

void linkPortably(const BlockRows& rows, const float* log_odds, std::array<BlockRows, 3>& linked) {
  for (int row = 0; row < kBlockRows; ++row) {
    if (rows[row] == 0) continue;
    const float* here = log_odds + row * kBlockSize;
    const auto [x, y, z] = pairsIn(rows, row);
    linked[0][row] = equalPortably(x, here, here + kBlockSize);
    linked[1][row] = equalPortably(y, here, here + kBlockRows);
    linked[2][row] = equalPortably(z, here, here + 1);
  }
}

void toVoxelsPortably(const float* coordinates, std::size_t count, double inverse_resolution, int* voxels) {
  for (std::size_t i = 0; i < count; ++i) voxels[i] = toVoxelCoordinate(coordinates[i], inverse_resolution);
}

constexpr RowKernels kPortable = {updatePortably, unpackPortably, linkPortably, toVoxelsPortably};

#ifdef HAS_AVX512_KERNELS

constexpr int kLanes = 16;

AVX512 void updateAvx512(RowUpdate& row, std::uint32_t hit, std::uint32_t miss, const LogOddsModel& model) {
  const __m512 prior = _mm512_set1_ps(model.prior), min = _mm512_set1_ps(model.min),
               max = _mm512_set1_ps(model.max);
  const std::uint32_t all = row.between | hit | miss;
  std::uint32_t is_low = 0, is_high = 0;
  for (int z = 0; z < kBlockSize; z += kLanes) {
    const auto between = static_cast<__mmask16>(row.between >> z), todo = static_cast<__mmask16>(all >> z);
    __m512 log_odds = _mm512_mask_mov_ps(prior, static_cast<__mmask16>(row.low >> z), min);
    log_odds = _mm512_mask_mov_ps(log_odds, static_cast<__mmask16>(row.high >> z), max);
    log_odds = _mm512_mask_expandloadu_ps(log_odds, between, row.in);
    row.in += _mm_popcnt_u32(between);
    __m512 change = _mm512_maskz_mov_ps(static_cast<__mmask16>(miss >> z), _mm512_set1_ps(model.miss));
    change = _mm512_mask_mov_ps(change, static_cast<__mmask16>(hit >> z), _mm512_set1_ps(model.hit));
    log_odds = _mm512_add_ps(log_odds, change);
    const __mmask16 low = _mm512_mask_cmp_ps_mask(todo, log_odds, min, _CMP_LE_OQ),
                    high = _mm512_mask_cmp_ps_mask(todo, log_odds, max, _CMP_GE_OQ);
    is_low |= static_cast<std::uint32_t>(low) << z;
    is_high |= static_cast<std::uint32_t>(high) << z;
    const auto kept = static_cast<__mmask16>(todo & ~(low | high));
    _mm512_storeu_ps(row.out, _mm512_maskz_compress_ps(kept, log_odds));
    row.out += _mm_popcnt_u32(kept);
  }
  row.low = (row.low & ~hit) | is_low;
  row.high = (row.high & ~miss) | is_high;
  row.between = all & ~(row.low | row.high);
}

AVX512 void unpackAvx512(const BlockRows& rows, const float* in, float* out) {
  for (int row = 0; row < kBlockRows; ++row) {
    if (rows[row] == 0) continue;
    for (int z = 0; z < kBlockSize; z += kLanes) {
      const auto mask = static_cast<__mmask16>(rows[row] >> z);
      _mm512_storeu_ps(out + row * kBlockSize + z, _mm512_maskz_expandloadu_ps(mask, in));
      in += _mm_popcnt_u32(mask);
    }
  }
}

AVX512 inline std::uint32_t equalAvx512(std::uint32_t mask, const float* a, const float* b) {
  if (mask == 0) return 0;
  std::uint32_t equal = 0;
  for (int z = 0; z < kBlockSize; z += kLanes) {
    const __mmask16 half = _mm512_cmp_ps_mask(_mm512_loadu_ps(a + z), _mm512_loadu_ps(b + z), _CMP_EQ_OQ);
    equal |= static_cast<std::uint32_t>(half) << z;
  }
  return equal & mask;
}

AVX512 void linkAvx512(const BlockRows& rows, const float* log_odds, std::array<BlockRows, 3>& linked) {
  for (int row = 0; row < kBlockRows; ++row) {
    if (rows[row] == 0) continue;
    const float* here = log_odds + row * kBlockSize;
    const auto [x, y, z] = pairsIn(rows, row);
    linked[0][row] = equalAvx512(x, here, here + kBlockSize);
    linked[1][row] = equalAvx512(y, here, here + kBlockRows);
    linked[2][row] = equalAvx512(z, here, here + 1);
  }
}

AVX512 void toVoxelsAvx512(const float* coordinates, std::size_t count, double inverse_resolution,
                           int* voxels) {
  constexpr std::size_t kDoubles = 8;
  const __m512d inverse = _mm512_set1_pd(inverse_resolution), least = _mm512_set1_pd(kMinVoxel),
                most = _mm512_set1_pd(kMaxVoxel);
  std::size_t i = 0;
  for (; i + kDoubles <= count; i += kDoubles) {
    // The masked forms, as gcc warns of the undefined values in the others.
    const __m512d coordinate = _mm512_maskz_cvtps_pd(0xff, _mm256_loadu_ps(coordinates + i));
    const __m512d c = _mm512_mul_pd(coordinate, inverse);
    const __mmask8 from_least = _mm512_cmp_pd_mask(c, least, _CMP_GE_OQ);
    const __mmask8 inside = _mm512_mask_cmp_pd_mask(from_least, c, most, _CMP_LT_OQ);
    const __m512d down =
        _mm512_mask_roundscale_pd(most, inside, c, _MM_FROUND_TO_NEG_INF | _MM_FROUND_NO_EXC);
    const __m256i v = _mm512_maskz_cvttpd_epi32(0xff, down);
    _mm256_storeu_si256(reinterpret_cast<__m256i*>(voxels + i), v);
  }
  toVoxelsPortably(coordinates + i, count - i, inverse_resolution, voxels + i);
}

constexpr RowKernels kAvx512 = {updateAvx512, unpackAvx512, linkAvx512, toVoxelsAvx512};

#endif

}  // namespace

const RowKernels& portableRowKernels() {
  return kPortable;
}

const RowKernels& rowKernels() {
#ifdef HAS_AVX512_KERNELS
  static const bool has_avx512 = __builtin_cpu_supports("avx512f") && __builtin_cpu_supports("popcnt");
  if (has_avx512) return kAvx512;
#endif
  return kPortable;
}

}  // namespace rtree_occupancy_map
