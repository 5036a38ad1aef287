// SPDX-License-Identifier: BSD-3-Clause
#include "ibuild_loop_closure/word_index.h"

#include <algorithm>
#include <array>
#include <queue>
#include <stdexcept>

#include "checks.h"
#include "ibuild_loop_closure/features.h"

namespace ibuild_loop_closure {
namespace {

constexpr int kClusteringRounds = 3;

// For each word the number of its part, by k-medians in Hamming space, started from words at equal steps.
std::vector<int> cluster(const std::vector<Descriptor>& words, int parts, std::vector<Descriptor>& centres) {
  centres.clear();
  for (int c = 0; c < parts; ++c) {
    const Descriptor& start = words[c * words.size() / parts];
    if (std::find(centres.begin(), centres.end(), start) == centres.end()) centres.push_back(start);
  }
  std::vector<int> part(words.size());
  for (int round = 0;; ++round) {
    for (std::size_t i = 0; i < words.size(); ++i) {
      part[i] = static_cast<int>(nearestOf(words[i], centres.data(), centres.size()).index);
    }
    if (round == kClusteringRounds) return part;
    std::vector<std::vector<Descriptor>> members(centres.size());
    for (std::size_t i = 0; i < words.size(); ++i) members[part[i]].push_back(words[i]);
    for (std::size_t c = 0; c < centres.size(); ++c) {
      if (!members[c].empty()) centres[c] = centroid(members[c]);
    }
  }
}

}  // namespace

void IndexOptions::validate() const {
  checkRange("branching", branching, 2, 64);
  checkRange("leaf_size", leaf_size, branching + 1, 100000);
  checkRange("max_checks", max_checks, 1, 100000000);
}

std::unique_ptr<WordIndex> makeIndex(const IndexOptions& options) {
  options.validate();
  if (options.type == IndexType::kLinear) return std::make_unique<LinearIndex>(options.nearest);
  return std::make_unique<TreeIndex>(options);
}

// ------------------------------------------------------------------------------------------------ linear

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

// -------------------------------------------------------------------------------------------------- tree

TreeIndex::TreeIndex(const IndexOptions& options) : options_(options), nodes_(1) {
  options_.validate();
}

void TreeIndex::add(const Descriptor& word) {
  std::int32_t at = 0;
  while (!nodes_[at].leaf) {
    const Node& node = nodes_[at];
    at = node.ids[nearestOf(word, node.entries.data(), node.entries.size()).index];
  }
  Node& leaf = nodes_[at];
  places_.push_back({at, static_cast<std::int32_t>(leaf.entries.size())});
  leaf.entries.push_back(word);
  leaf.ids.push_back(static_cast<std::int32_t>(places_.size() - 1));
  // A leaf whose words don't differ enough to be divided is tried again at each power of two.
  const std::size_t size = leaf.entries.size();
  if (size == static_cast<std::size_t>(options_.leaf_size) ||
      (size > static_cast<std::size_t>(options_.leaf_size) && (size & (size - 1)) == 0)) {
    split(at);
  }
}

void TreeIndex::split(std::int32_t leaf) {
  std::vector<Descriptor> centres;
  const std::vector<int> part = cluster(nodes_[leaf].entries, options_.branching, centres);
  std::vector<Node> parts(centres.size());
  const Node old = nodes_[leaf];
  for (std::size_t i = 0; i < part.size(); ++i) {
    parts[part[i]].entries.push_back(old.entries[i]);
    parts[part[i]].ids.push_back(old.ids[i]);
  }
  const auto used =
      std::count_if(parts.begin(), parts.end(), [](const Node& n) { return !n.entries.empty(); });
  if (used < 2) return;
  Node& inner = nodes_[leaf];
  inner.leaf = false;
  inner.entries.clear();
  inner.ids.clear();
  for (std::size_t c = 0; c < parts.size(); ++c) {
    if (parts[c].entries.empty()) continue;
    const auto id = static_cast<std::int32_t>(nodes_.size());
    nodes_[leaf].entries.push_back(centres[c]);
    nodes_[leaf].ids.push_back(id);
    parts[c].parent = leaf;
    for (std::size_t slot = 0; slot < parts[c].ids.size(); ++slot) {
      places_[parts[c].ids[slot]] = {id, static_cast<std::int32_t>(slot)};
    }
    nodes_.push_back(std::move(parts[c]));
  }
}

FoundWord TreeIndex::find(const Descriptor& descriptor, int delta) const {
  struct Branch {
    int distance;
    std::int32_t node;
    bool operator<(const Branch& o) const { return distance > o.distance; }
  };
  std::priority_queue<Branch> open;
  open.push({0, 0});
  FoundWord best;
  best.distance = delta;
  std::vector<std::uint16_t> distances;
  for (int checks = 0; !open.empty() && checks < options_.max_checks;) {
    const Node& node = nodes_[open.top().node];
    open.pop();
    distances.resize(node.entries.size());
    hammingDistances(descriptor, node.entries.data(), node.entries.size(), distances.data());
    for (std::size_t i = 0; i < distances.size(); ++i) {
      if (!node.leaf) {
        open.push({distances[i], node.ids[i]});
      } else if (distances[i] < best.distance ||
                 (distances[i] == best.distance && best.word >= 0 && node.ids[i] < best.word)) {
        best = {node.ids[i], distances[i]};
      }
    }
    if (node.leaf) checks += static_cast<int>(node.entries.size());
  }
  return best.word < 0 ? FoundWord{} : best;
}

const Descriptor& TreeIndex::word(std::size_t index) const {
  const Place& place = places_[index];
  return nodes_[place.leaf].entries[place.slot];
}

TreeIndex::Shape TreeIndex::shape() const {
  Shape shape;
  shape.parents.reserve(nodes_.size());
  shape.centres.resize(nodes_.size());
  for (const Node& node : nodes_) {
    shape.parents.push_back(node.parent);
    for (std::size_t i = 0; !node.leaf && i < node.ids.size(); ++i)
      shape.centres[node.ids[i]] = node.entries[i];
  }
  shape.leaves.reserve(places_.size());
  for (const Place& place : places_) shape.leaves.push_back(place.leaf);
  return shape;
}

void TreeIndex::restore(const Shape& shape, const std::vector<Descriptor>& words) {
  const std::size_t count = shape.parents.size();
  if (count == 0 || shape.parents[0] != -1 || shape.centres.size() != count ||
      shape.leaves.size() != words.size())
    throw std::runtime_error("its tree has no root or not all words");
  std::vector<Node> nodes(count);
  for (std::size_t i = 1; i < count; ++i) {
    const std::int32_t parent = shape.parents[i];
    if (parent < 0 || parent >= static_cast<std::int32_t>(i)) throw std::runtime_error("its tree isn't one");
    nodes[i].parent = parent;
    nodes[parent].leaf = false;
    nodes[parent].entries.push_back(shape.centres[i]);
    nodes[parent].ids.push_back(static_cast<std::int32_t>(i));
  }
  std::vector<Place> places;
  places.reserve(words.size());
  for (std::size_t i = 0; i < words.size(); ++i) {
    const std::int32_t leaf = shape.leaves[i];
    if (leaf < 0 || leaf >= static_cast<std::int32_t>(count) || !nodes[leaf].leaf)
      throw std::runtime_error("its tree has a word outside of its leaves");
    places.push_back({leaf, static_cast<std::int32_t>(nodes[leaf].entries.size())});
    nodes[leaf].entries.push_back(words[i]);
    nodes[leaf].ids.push_back(static_cast<std::int32_t>(i));
  }
  nodes_ = std::move(nodes);
  places_ = std::move(places);
}

}  // namespace ibuild_loop_closure
