// SPDX-License-Identifier: BSD-3-Clause
//
// Finds the word of a vocabulary that a descriptor is assigned to.
#pragma once

#include <cstdint>
#include <memory>
#include <string>
#include <vector>

#include "ibuild_loop_closure/descriptor.h"

namespace ibuild_loop_closure {

enum class IndexType {
  kLinear,  ///< compares with every word, Fig. 4.9; exact
  kGraph    ///< see graph_index.h (4.7.1): time grows about with the logarithm of the number of words
};

struct IndexOptions {
  IndexType type = IndexType::kGraph;
  bool nearest = true;      ///< linear: the nearest word under delta; false: the first, as in Fig. 4.9
  int links = 24;           ///< graph: of a new word to others, 2 to 64; any word has at most twice as many
  int insert_breadth = 24;  ///< graph: words among which a new word's links are chosen, 1 to 10000
  int search_breadth = 24;  ///< graph: words that a look-up keeps in view, 1 to 10000: more find more
  /// @throws std::invalid_argument that names the option, its value and the allowed range
  void validate() const;
};

struct FoundWord {
  int word = -1;  ///< -1: none under delta
  int distance = Descriptor::kBits + 1;
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

/// @throws std::invalid_argument as IndexOptions::validate
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
