// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <array>
#include <cstdint>
#include <string>
#include <vector>

#include "hokuyo_sick_drivers/zf/byte_source.h"

namespace hokuyo_sick_drivers {

/// The data of an E57 file without the checksum (CRC-32C, most significant byte first) that ends each page of
/// 1024 bytes. Offsets are logical: they count data only.
class E57Pages {
 public:
  /// @param verify whether a page with a wrong checksum is an error
  E57Pages(ByteSource& source, bool verify);

  std::uint64_t size() const { return pages_ * kData; }
  /// @throws std::runtime_error that names the page, or beyond the end
  void read(std::uint64_t offset, void* to, std::size_t count);
  /// From a physical offset, which counts checksums, too.
  /// @throws std::runtime_error for one in a checksum or beyond the end
  std::uint64_t toLogical(std::uint64_t physical) const;

  /// Empty, or which pages were found damaged.
  std::string damage() const;

 private:
  static constexpr std::uint64_t kPage = 1024, kData = 1020;
  static constexpr std::uint64_t kBlockPages = 64;

  // Pages read and verified together. The fields of a scan are read each on its own, so several are kept.
  struct Block {
    std::uint64_t number = ~std::uint64_t{0};
    std::uint64_t last_use = 0;
    std::vector<char> data;
  };

  const Block& block(std::uint64_t number);
  void load(Block& block, std::uint64_t number);

  ByteSource& source_;
  bool verify_;
  std::uint64_t pages_, uses_ = 0;
  std::array<Block, 32> blocks_;
  std::vector<char> raw_;
  std::uint64_t first_damaged_ = 0;
  bool damaged_ = false;
};

}  // namespace hokuyo_sick_drivers
