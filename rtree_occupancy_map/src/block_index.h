// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstdint>
#include <vector>

#include "rtree_occupancy_map/occupancy_map.h"

namespace rtree_occupancy_map {

/// Block coordinates in one number.
inline std::uint64_t keyOf(const Block& b) {
  const auto u = [](int c) { return static_cast<std::uint64_t>(c + (1 << 15)); };
  return u(b[0]) | u(b[1]) << 20 | u(b[2]) << 40;
}

/// Numbers blocks in the order in which they come. Open addressing, since a scan asks very often.
class BlockIndex {
 public:
  BlockIndex() { clear(); }

  void clear() {
    blocks_.clear();
    table_.assign(table_.empty() ? 1 << 10 : table_.size(), Bucket());
  }

  std::size_t size() const { return blocks_.size(); }
  const Block& operator[](std::size_t number) const { return blocks_[number]; }

  /// The number of a block; size() before the call if it is new.
  std::uint32_t numberOf(const Block& block) {
    Bucket& bucket = find(keyOf(block));
    if (bucket.key != kFree) return bucket.number;
    const auto number = static_cast<std::uint32_t>(blocks_.size());
    bucket = {keyOf(block), number};
    blocks_.push_back(block);
    if (2 * blocks_.size() > table_.size()) grow();
    return number;
  }

 private:
  static constexpr std::uint64_t kFree = ~std::uint64_t{0};
  struct Bucket {
    std::uint64_t key = kFree;
    std::uint32_t number = 0;
  };

  Bucket& find(std::uint64_t key) {
    const std::size_t last = table_.size() - 1;
    std::size_t i = (key * 0x9e3779b97f4a7c15ULL >> 20) & last;
    while (table_[i].key != key && table_[i].key != kFree) i = (i + 1) & last;
    return table_[i];
  }
  void grow() {
    table_.assign(2 * table_.size(), Bucket());
    for (std::uint32_t i = 0; i < blocks_.size(); ++i) find(keyOf(blocks_[i])) = {keyOf(blocks_[i]), i};
  }

  std::vector<Block> blocks_;
  std::vector<Bucket> table_;  // a power of two
};

}  // namespace rtree_occupancy_map
