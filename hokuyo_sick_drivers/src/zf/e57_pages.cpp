// SPDX-License-Identifier: BSD-3-Clause
#include "e57_pages.h"

#include <algorithm>
#include <cstring>
#include <stdexcept>

namespace hokuyo_sick_drivers {
namespace {

// kCrcTables[k][b]: what byte b does to a CRC-32C (reflected polynomial 0x82F63B78) k bytes later.
using CrcTables = std::array<std::array<std::uint32_t, 256>, 8>;

constexpr CrcTables makeCrcTables() {
  CrcTables tables{};
  for (std::uint32_t byte = 0; byte < 256; ++byte) {
    std::uint32_t crc = byte;
    for (int i = 0; i < 8; ++i) crc = crc >> 1U ^ ((crc & 1U) != 0 ? 0x82F63B78U : 0U);
    tables[0][byte] = crc;
  }
  for (std::size_t k = 1; k < 8; ++k) {
    for (std::size_t byte = 0; byte < 256; ++byte) {
      const std::uint32_t crc = tables[k - 1][byte];
      tables[k][byte] = crc >> 8U ^ tables[0][crc & 255U];
    }
  }
  return tables;
}
constexpr CrcTables kCrcTables = makeCrcTables();

// Eight bytes at a time ("slicing by 8"), as checksums are most of the work of reading.
std::uint32_t crc32C(const char* bytes, std::size_t size) {
  std::uint32_t crc = ~std::uint32_t{0};
  for (; size >= 8; bytes += 8, size -= 8) {
    std::uint32_t words[2];  // of a little-endian machine
    std::memcpy(words, bytes, sizeof words);
    words[0] ^= crc;
    crc = 0;
    for (unsigned i = 0; i < 8; ++i) crc ^= kCrcTables[7 - i][words[i / 4] >> 8 * (i % 4) & 255U];
  }
  for (; size > 0; ++bytes, --size)
    crc = crc >> 8U ^ kCrcTables[0][(crc ^ static_cast<unsigned char>(*bytes)) & 255U];
  return ~crc;
}

std::uint32_t bigEndian(const char* bytes) {
  std::uint32_t value = 0;
  for (int i = 0; i < 4; ++i) value = value << 8U | static_cast<unsigned char>(bytes[i]);
  return value;
}

}  // namespace

E57Pages::E57Pages(ByteSource& source, bool verify)
    : source_(source), verify_(verify), pages_(source.size() / kPage) {}

void E57Pages::read(std::uint64_t offset, void* to, std::size_t count) {
  if (offset > size() || count > size() - offset) {
    throw std::runtime_error("points to byte " + std::to_string(offset) +
                             " and beyond, but its pages hold only " + std::to_string(size()));
  }
  char* out = static_cast<char*>(to);
  constexpr std::uint64_t kBlockData = kBlockPages * kData;
  while (count > 0) {
    const Block& source = block(offset / kBlockData);
    const std::size_t begin = offset % kBlockData;
    const std::size_t part = std::min(count, source.data.size() - begin);
    std::memcpy(out, source.data.data() + begin, part);
    out += part;
    offset += part;
    count -= part;
  }
}

std::uint64_t E57Pages::toLogical(std::uint64_t physical) const {
  if (physical % kPage >= kData || physical / kPage >= pages_) {
    throw std::runtime_error("has a section at byte " + std::to_string(physical) +
                             ", which is in a checksum or beyond the end");
  }
  return physical / kPage * kData + physical % kPage;
}

std::string E57Pages::damage() const {
  if (!damaged_) return "";
  return "the checksum of page " + std::to_string(first_damaged_) + " (from byte " +
         std::to_string(first_damaged_ * kPage) +
         ") is wrong, maybe those of others, too: points may be, too";
}

const E57Pages::Block& E57Pages::block(std::uint64_t number) {
  Block* oldest = &blocks_[0];
  ++uses_;
  for (Block& candidate : blocks_) {
    if (candidate.number == number) {
      candidate.last_use = uses_;
      return candidate;
    }
    if (candidate.last_use < oldest->last_use) oldest = &candidate;
  }
  load(*oldest, number);
  return *oldest;
}

void E57Pages::load(Block& block, std::uint64_t number) {
  const std::uint64_t first = number * kBlockPages;
  const std::size_t pages = std::min(kBlockPages, pages_ - first);
  raw_.resize(pages * kPage);
  if (source_.read(first * kPage, raw_.data(), raw_.size()) != raw_.size()) {
    throw std::runtime_error("was cut while it was read");
  }
  block.number = ~std::uint64_t{0};
  block.data.resize(pages * kData);
  for (std::size_t i = 0; i < pages; ++i) {
    const char* page = raw_.data() + i * kPage;
    if (crc32C(page, kData) != bigEndian(page + kData)) {
      if (verify_) {
        throw std::runtime_error("is damaged: the checksum of page " + std::to_string(first + i) +
                                 " (from byte " + std::to_string((first + i) * kPage) +
                                 ") is wrong. It can be read all the same without verifying checksums");
      }
      if (!damaged_ || first + i < first_damaged_) first_damaged_ = first + i;
      damaged_ = true;
    }
    std::memcpy(block.data.data() + i * kData, page, kData);
  }
  block.number = number;
  block.last_use = uses_;
}

}  // namespace hokuyo_sick_drivers
