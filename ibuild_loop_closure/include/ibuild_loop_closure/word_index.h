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
  kTree     ///< an incremental tree (4.7.1): time grows about with the logarithm of the number of words
};

struct IndexOptions {
  IndexType type = IndexType::kTree;
  bool nearest = true;    ///< linear: the nearest word under delta; false: the first, as in Fig. 4.9
  int branching = 16;     ///< tree: parts that a full leaf splits into, 2 to 64
  int leaf_size = 256;    ///< tree: words of a leaf before it splits, > branching
  int max_checks = 2048;  ///< tree: words compared per look-up at most, whole leaves: more find more
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

/// A tree whose leaves hold words. A word goes down to the leaf of the nearest centres; a full leaf becomes
/// an inner node, its words clustered around centroids (Eq. 4.1) into new leaves. A look-up visits leaves by
/// the distance of their centres, the most promising first, until it has compared max_checks words.
class TreeIndex : public WordIndex {
 public:
  explicit TreeIndex(const IndexOptions& options);

  void add(const Descriptor& word) override;
  FoundWord find(const Descriptor& descriptor, int delta) const override;
  const Descriptor& word(std::size_t index) const override;
  std::size_t size() const override { return places_.size(); }

  /// What a file holds of the tree: for each node its parent (-1: root; before its children) and centre, for
  /// each word its leaf.
  struct Shape {
    std::vector<std::int32_t> parents;
    std::vector<Descriptor> centres;
    std::vector<std::int32_t> leaves;
  };
  Shape shape() const;
  /// @throws std::runtime_error if it isn't a tree whose leaves hold all words
  void restore(const Shape& shape, const std::vector<Descriptor>& words);

 private:
  struct Node {
    std::vector<Descriptor> entries;  // leaf: words; inner node: centres of the children
    std::vector<std::int32_t> ids;    // leaf: numbers of the words; inner node: of the children
    std::int32_t parent = -1;
    bool leaf = true;
  };
  struct Place {
    std::int32_t leaf, slot;
  };
  void split(std::int32_t leaf);

  IndexOptions options_;
  std::vector<Node> nodes_;
  std::vector<Place> places_;
};

}  // namespace ibuild_loop_closure
