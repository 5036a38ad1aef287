// SPDX-License-Identifier: BSD-3-Clause
#include "ibuild_loop_closure/graph_index.h"

#include <algorithm>
#include <stdexcept>

namespace ibuild_loop_closure {
namespace {

constexpr int kMostLayers = 12;

// The words that a search has met: a hash table that stays in the cache.
class Met {
 public:
  explicit Met(std::size_t expected) {
    while (slots_.size() < 2 * expected) slots_.resize(2 * slots_.size());
    std::fill(slots_.begin(), slots_.end(), -1);
  }
  /// @return whether it is the first time
  bool insert(std::int32_t word) {
    if (2 * count_ >= slots_.size()) grow();
    std::int32_t& slot = slots_[slotOf(word)];
    if (slot == word) return false;
    slot = word;
    ++count_;
    return true;
  }

 private:
  std::size_t slotOf(std::int32_t word) const {
    const std::size_t mask = slots_.size() - 1;
    std::size_t slot = (static_cast<std::uint64_t>(word) * 0x9e3779b97f4a7c15u >> 32) & mask;
    while (slots_[slot] != -1 && slots_[slot] != word) slot = (slot + 1) & mask;
    return slot;
  }
  void grow() {
    std::vector<std::int32_t> old(2 * slots_.size(), -1);
    old.swap(slots_);
    for (std::int32_t word : old) {
      if (word != -1) slots_[slotOf(word)] = word;
    }
  }
  std::vector<std::int32_t> slots_ = std::vector<std::int32_t>(64);
  std::size_t count_ = 0;
};

}  // namespace

template <class T>
void GraphIndex::Rows<T>::push_back(const T& value) {
  if (size_ % kBlock == 0) blocks_.emplace_back(kBlock * width_);
  T* row = (*this)[size_++];
  std::fill(row, row + width_, value);
}

GraphIndex::GraphIndex(const IndexOptions& options)
    : options_(mapping_common::validate(options)), words_(1), finest_(2 * options.links) {}

// One in `links` words of a layer is in the next coarser one.
int GraphIndex::layersOf(std::size_t word) const {
  std::uint64_t bits = (word + 1) * 0x9e3779b97f4a7c15u;  // SplitMix64
  bits = (bits ^ (bits >> 30)) * 0xbf58476d1ce4e5b9u;
  bits = (bits ^ (bits >> 27)) * 0x94d049bb133111ebu;
  bits ^= bits >> 31;
  int layers = 1;
  for (const auto share = static_cast<std::uint64_t>(options_.links);
       layers < kMostLayers && bits % share == 0; bits /= share) {
    ++layers;
  }
  return layers;
}

const std::int32_t* GraphIndex::linksOf(std::int32_t word, int layer) const {
  return layer == 0 ? finest_[word] : &coarser_[coarser_at_[word] + (layer - 1) * options_.links];
}

std::int32_t* GraphIndex::linksOf(std::int32_t word, int layer) {
  return const_cast<std::int32_t*>(static_cast<const GraphIndex*>(this)->linksOf(word, layer));
}

void GraphIndex::append(const Descriptor& word) {
  const int layers = layersOf(size());
  words_.push_back(word);
  finest_.push_back(-1);
  coarser_at_.push_back(static_cast<std::int32_t>(coarser_.size()));
  coarser_.resize(coarser_.size() + (layers - 1) * options_.links, -1);
}

// Of the words around one the nearest in each direction: none that is nearer to one already chosen.
std::vector<std::int32_t> GraphIndex::spread(const std::vector<Near>& sorted, int most) const {
  std::vector<std::int32_t> chosen;
  std::vector<const Descriptor*> words;
  std::vector<std::uint16_t> distances(most);
  for (const Near& near : sorted) {
    if (static_cast<int>(chosen.size()) == most) break;
    const Descriptor& word = *words_[near.word];
    hammingDistances(word, words.data(), words.size(), distances.data());
    if (std::any_of(distances.begin(), distances.begin() + words.size(),
                    [&](int d) { return d < near.distance; }))
      continue;
    chosen.push_back(near.word);
    words.push_back(&word);
  }
  return chosen;
}

void GraphIndex::link(std::int32_t from, std::int32_t to, int layer) {
  const int most = maxLinks(layer);
  std::int32_t* links = linksOf(from, layer);
  std::int32_t* end = std::find(links, links + most, -1);
  if (end != links + most) {
    *end = to;
    return;
  }
  std::vector<Near> around;
  for (std::int32_t* l = links; l != end; ++l) {
    around.push_back({*l, hamming(*words_[from], *words_[*l]), false});
  }
  around.push_back({to, hamming(*words_[from], *words_[to]), false});
  std::sort(around.begin(), around.end());
  const std::vector<std::int32_t> chosen = spread(around, most);
  std::fill(std::copy(chosen.begin(), chosen.end(), links), end, -1);
}

// The nearest words of a layer, sorted, as many as `breadth`: those not yet expanded are, the nearest first.
std::vector<GraphIndex::Near> GraphIndex::searchLayer(const Descriptor& query, int layer, std::size_t breadth,
                                                      std::vector<Near> from) const {
  const int most = maxLinks(layer);
  Met met(16 * breadth);
  std::vector<const Descriptor*> words(most);
  std::vector<std::int32_t> fresh(most);
  std::vector<std::uint16_t> distances(most);
  std::vector<Near> nearest = std::move(from);
  nearest.reserve(breadth + 1);
  for (Near& near : nearest) {
    near.expanded = false;
    met.insert(near.word);
  }
  for (std::size_t i = 0; i < nearest.size();) {
    if (nearest[i].expanded) {
      ++i;
      continue;
    }
    nearest[i].expanded = true;
    std::size_t count = 0;
    const std::int32_t* links = linksOf(nearest[i].word, layer);
    for (const std::int32_t* l = links; l != links + most && *l != -1; ++l) {
      if (!met.insert(*l)) continue;
      fresh[count] = *l;
      words[count] = words_[*l];
      __builtin_prefetch(words[count++]);
    }
    hammingDistances(query, words.data(), count, distances.data());
    for (std::size_t k = 0; k < count; ++k) {
      const Near near{fresh[k], distances[k], false};
      if (nearest.size() == breadth && !(near < nearest.back())) continue;
      const auto at = std::upper_bound(nearest.begin(), nearest.end(), near);
      i = std::min(i, static_cast<std::size_t>(at - nearest.begin()));
      nearest.insert(at, near);
      __builtin_prefetch(linksOf(near.word, layer));  // it may be next
      if (nearest.size() > breadth) nearest.pop_back();
    }
  }
  return nearest;
}

// For each of the finest layers what is nearest there.
std::vector<std::vector<GraphIndex::Near>> GraphIndex::search(const Descriptor& query, int layers,
                                                              std::size_t breadth) const {
  std::vector<std::vector<Near>> found(layers);
  std::vector<Near> from = {{entry_, hamming(query, *words_[entry_]), false}};
  for (int layer = layersOf(entry_) - 1; layer >= 0; --layer) {
    from = searchLayer(query, layer, layer < layers ? breadth : 1, std::move(from));
    if (layer < layers) found[layer] = from;
  }
  return found;
}

void GraphIndex::add(const Descriptor& word) {
  const auto id = static_cast<std::int32_t>(size());
  const int layers = layersOf(size());
  if (id == 0) {
    append(word);
    entry_ = 0;
    return;
  }
  const auto found = search(word, layers, options_.insert_breadth);
  append(word);
  if (found[0].front().distance == 0) return;
  for (int layer = 0; layer < layers; ++layer) {
    const std::vector<std::int32_t> chosen = spread(found[layer], options_.links);
    std::copy(chosen.begin(), chosen.end(), linksOf(id, layer));
    for (std::int32_t neighbour : chosen) link(neighbour, id, layer);
  }
  if (layers > layersOf(entry_)) entry_ = id;
}

FoundWord GraphIndex::find(const Descriptor& descriptor, int delta) const {
  if (size() == 0) return {};
  const Near nearest = search(descriptor, 1, options_.search_breadth)[0].front();
  return nearest.distance < delta ? FoundWord{nearest.word, nearest.distance} : FoundWord{};
}

std::vector<std::int32_t> GraphIndex::links() const {
  std::vector<std::int32_t> all;
  for (std::size_t word = 0; word < size(); ++word) {
    for (int layer = 0; layer < layersOf(word); ++layer) {
      const std::int32_t* first = linksOf(static_cast<std::int32_t>(word), layer);
      const std::int32_t* last = std::find(first, first + maxLinks(layer), -1);
      all.push_back(static_cast<std::int32_t>(last - first));
      all.insert(all.end(), first, last);
    }
  }
  return all;
}

void GraphIndex::restore(const std::vector<Descriptor>& words, const std::vector<std::int32_t>& links) {
  GraphIndex restored(options_);
  const auto fail = [] { throw std::runtime_error("the links of its words are inconsistent"); };
  const auto last = static_cast<std::int32_t>(words.size()) - 1;
  std::size_t at = 0;
  for (std::int32_t id = 0; id <= last; ++id) {
    restored.append(words[id]);
    const int layers = layersOf(id);
    bool linked = id == 0;
    for (int layer = 0; layer < layers; ++layer) {
      if (at == links.size() || links[at] < 0 || links[at] > maxLinks(layer)) fail();
      const auto count = static_cast<std::size_t>(links[at++]);
      if (count > links.size() - at) fail();
      for (std::size_t i = at; i < at + count; ++i) {
        if (links[i] < 0 || links[i] > last || links[i] == id) fail();
        if (layer > 0 && layersOf(links[i]) <= layer) fail();
      }
      std::copy_n(links.begin() + at, count, restored.linksOf(id, layer));
      at += count;
      linked = linked || count > 0;
    }
    if (linked && (id == 0 || layers > layersOf(restored.entry_))) restored.entry_ = id;
  }
  if (at != links.size()) fail();
  *this = std::move(restored);
}

}  // namespace ibuild_loop_closure
