// SPDX-License-Identifier: BSD-3-Clause
//
// The first byte says what follows: the bytes, or a frame of zstd, with its checksum, of the shuffled bytes.
#include "mapping_common/compression.h"

#include <zstd.h>

#include <memory>
#include <stdexcept>

namespace mapping_common {
namespace {

constexpr char kPlain = 0, kShuffled = 1;
constexpr int kLevel = 1;
constexpr std::size_t kMost = std::size_t{1} << 31;

struct Free {
  void operator()(ZSTD_CCtx* context) const { ZSTD_freeCCtx(context); }
};

// As 4 rows of a quarter each; what is left over comes last.
template <bool kBack>
std::string shuffle(const std::string& bytes) {
  std::string out = bytes;
  const std::size_t rows = bytes.size() / 4;
  for (std::size_t i = 0; i < 4; ++i) {
    for (std::size_t k = 0; k < rows; ++k) {
      const std::size_t here = 4 * k + i, there = i * rows + k;
      out[kBack ? here : there] = bytes[kBack ? there : here];
    }
  }
  return out;
}

}  // namespace

std::string compress(const std::string& bytes) {
  const std::string shuffled = shuffle<false>(bytes);
  std::string out(1 + ZSTD_compressBound(bytes.size()), kShuffled);
  const std::unique_ptr<ZSTD_CCtx, Free> context(ZSTD_createCCtx());
  ZSTD_CCtx_setParameter(context.get(), ZSTD_c_compressionLevel, kLevel);
  ZSTD_CCtx_setParameter(context.get(), ZSTD_c_checksumFlag, 1);
  const std::size_t size =
      ZSTD_compress2(context.get(), &out[1], out.size() - 1, shuffled.data(), shuffled.size());
  if (ZSTD_isError(size) != 0 || size >= bytes.size()) return kPlain + bytes;
  out.resize(1 + size);
  return out;
}

std::string decompress(const std::string& stored, std::size_t size) {
  if (!stored.empty() && stored[0] == kPlain && stored.size() - 1 == size) return stored.substr(1);
  if (stored.empty() || stored[0] != kShuffled || size > kMost)
    throw std::runtime_error("the size of data is wrong");
  std::string out(size, '\0');
  const std::size_t read = ZSTD_decompress(&out[0], size, stored.data() + 1, stored.size() - 1);
  if (ZSTD_isError(read) != 0 || read != size) throw std::runtime_error("compressed data are damaged");
  return shuffle<true>(out);
}

}  // namespace mapping_common
