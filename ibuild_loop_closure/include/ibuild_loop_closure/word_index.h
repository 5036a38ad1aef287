// SPDX-License-Identifier: BSD-3-Clause
//
// Finds the word of a vocabulary that a descriptor is assigned to.
#pragma once

#include <mapping_common/options.h>

#include <cstdint>
#include <memory>
#include <string>
#include <vector>

#include "ibuild_loop_closure/descriptor.h"

namespace ibuild_loop_closure {

enum class IndexType { kLinear, kGraph };
constexpr auto choicesOf(IndexType) {
  return mapping_common::choices<IndexType>(
      {{"linear", IndexType::kLinear, "compares with every word, Fig. 4.9; exact"},
       {"graph", IndexType::kGraph, "time grows about with the logarithm of the number of words (4.7.1)"}});
}

struct IndexOptions {
  IndexType type = IndexType::kGraph;
  bool nearest = true;
  int links = 24, insert_breadth = 24, search_breadth = 24;

  void describe(mapping_common::OptionList& o) {
    o("type", type, "", "how the word of a descriptor is found");
    o("nearest", nearest, "", "linear: the nearest word under delta; false: the first, as in Fig. 4.9");
    o("links", links, "",
      "graph: of a new word to others; any word has at most twice as many. More find more and take more "
      "memory")
        .within(2, 64);
    o("insert_breadth", insert_breadth, "", "graph: words among which a new word's links are chosen")
        .within(1, 10000);
    o("search_breadth", search_breadth, "", "graph: words that a look-up keeps in view: more find more")
        .within(1, 10000);
  }
};

struct FoundWord {
  int word = -1;  ///< -1: none under delta
  int distance = Descriptor::kMaxBits + 1;
};

/// Words are numbered in the order in which they are added.
class WordIndex {
 public:
  virtual ~WordIndex() = default;
  virtual void add(const Descriptor& word) = 0;
  /// A word nearer than delta.
  virtual FoundWord find(const Descriptor& descriptor, int delta) const = 0;
  virtual const Descriptor& word(std::size_t index) const = 0;
  virtual std::size_t size() const = 0;
};

/// @throws std::invalid_argument where the options won't do
std::unique_ptr<WordIndex> makeIndex(const IndexOptions& options);

/// Fig. 4.9, or its nearest word.
class LinearIndex : public WordIndex {
 public:
  explicit LinearIndex(bool nearest) : nearest_(nearest) {}
  void add(const Descriptor& word) override { words_.push_back(word); }
  FoundWord find(const Descriptor& descriptor, int delta) const override;
  const Descriptor& word(std::size_t index) const override { return words_[index]; }
  std::size_t size() const override { return words_.size(); }

 private:
  bool nearest_;
  std::vector<Descriptor> words_;
};

}  // namespace ibuild_loop_closure
