// SPDX-License-Identifier: BSD-3-Clause
#include "ibuild_loop_closure/word_index.h"

#include <algorithm>
#include <array>

#include "ibuild_loop_closure/graph_index.h"

namespace ibuild_loop_closure {

std::unique_ptr<WordIndex> makeIndex(const IndexOptions& options) {
  mapping_common::validate(options);
  if (options.type == IndexType::kLinear) return std::make_unique<LinearIndex>(options.nearest);
  return std::make_unique<GraphIndex>(options);
}

FoundWord LinearIndex::find(const Descriptor& descriptor, int delta) const {
  if (nearest_) {
    const Nearest nearest = nearestOf(descriptor, words_.data(), words_.size());
    return nearest.distance < delta ? FoundWord{static_cast<int>(nearest.index), nearest.distance}
                                    : FoundWord{};
  }
  constexpr std::size_t kBlock = 256;
  std::array<std::uint16_t, kBlock> distances;
  for (std::size_t first = 0; first < words_.size(); first += kBlock) {
    const std::size_t count = std::min(kBlock, words_.size() - first);
    hammingDistances(descriptor, words_.data() + first, count, distances.data());
    for (std::size_t i = 0; i < count; ++i) {
      if (distances[i] < delta) return {static_cast<int>(first + i), distances[i]};
    }
  }
  return {};
}

}  // namespace ibuild_loop_closure
