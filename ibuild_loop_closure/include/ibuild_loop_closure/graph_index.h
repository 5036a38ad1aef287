// SPDX-License-Identifier: BSD-3-Clause
//
// An incremental index of binary words (4.7.1): look-up and insertion grow about with the logarithm of the
// number of words.
#pragma once

#include "ibuild_loop_closure/word_index.h"

namespace ibuild_loop_closure {

/// A hierarchical navigable small world (Malkov and Yashunin 2020) in Hamming space. Words are the nodes of a
/// graph and linked to near ones in different directions; a share of 1 / links of them is in the next coarser
/// layer, too. A search goes from the coarsest layer to the finest, in each from word to nearer word. A
/// word's layers follow from its number: the same words in the same order are the same graph.
///
/// A word that is equal to an earlier one gets no links: the earlier one is found.
class GraphIndex : public WordIndex {
 public:
  /// @throws std::invalid_argument as IndexOptions::validate
  explicit GraphIndex(const IndexOptions& options);

  void add(const Descriptor& word) override;
  FoundWord find(const Descriptor& descriptor, int delta) const override;
  const Descriptor& word(std::size_t index) const override { return *words_[index]; }
  std::size_t size() const override { return words_.size(); }

  /// What a file holds of the graph: for each word and each of its layers, the finest first, the number of
  /// links and the words that they lead to.
  std::vector<std::int32_t> links() const;
  /// Replaces all words. @throws std::runtime_error if these are no links of that many words; all is then as
  /// it was
  void restore(const std::vector<Descriptor>& words, const std::vector<std::int32_t>& links);

 private:
  /// An array of rows that grows without moving any: no look-up waits for a copy of all words.
  template <class T>
  class Rows {
   public:
    explicit Rows(std::size_t width) : width_(width) {}
    std::size_t size() const { return size_; }
    void push_back(const T& value);
    T* operator[](std::size_t row) { return &blocks_[row / kBlock][row % kBlock * width_]; }
    const T* operator[](std::size_t row) const { return &blocks_[row / kBlock][row % kBlock * width_]; }

   private:
    static constexpr std::size_t kBlock = 1024;
    std::size_t width_, size_ = 0;
    std::vector<std::vector<T>> blocks_;
  };
  struct Near {
    std::int32_t word, distance;
    bool expanded;
    bool operator<(const Near& o) const {
      return distance != o.distance ? distance < o.distance : word < o.word;
    }
  };

  int layersOf(std::size_t word) const;
  int maxLinks(int layer) const { return layer == 0 ? 2 * options_.links : options_.links; }
  std::int32_t* linksOf(std::int32_t word, int layer);
  const std::int32_t* linksOf(std::int32_t word, int layer) const;
  void append(const Descriptor& word);
  void link(std::int32_t from, std::int32_t to, int layer);
  std::vector<std::int32_t> spread(const std::vector<Near>& sorted, int most) const;
  std::vector<Near> searchLayer(const Descriptor& query, int layer, std::size_t breadth,
                                std::vector<Near> from) const;
  std::vector<std::vector<Near>> search(const Descriptor& query, int layers, std::size_t breadth) const;

  IndexOptions options_;
  Rows<Descriptor> words_;
  Rows<std::int32_t> finest_;             // links of each word in layer 0, -1 after the last one
  std::vector<std::int32_t> coarser_;     // the same of the coarser layers, one after another
  std::vector<std::int32_t> coarser_at_;  // where in it each word's begin
  std::int32_t entry_ = -1;               // the first word of the coarsest layer
};

}  // namespace ibuild_loop_closure
