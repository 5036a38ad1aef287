// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <mapping_common/archive.h>

#include <opencv2/core.hpp>
#include <vector>

#include "intensity_place_recognition/place_index.h"

namespace intensity_place_recognition {

/// Words that are vectors of length 1 (4.5.2): those nearer than delta to each other are one, their mean. It
/// is built online, and found by PlaceIndex. For LocalDescription.
class VectorVocabulary {
 public:
  using Word = std::vector<float>;
  explicit VectorVocabulary(double delta) : delta_(static_cast<float>(delta)) {}

  std::vector<Word> merge(std::vector<Word> words) const;
  std::size_t nearest(const Word& word, const std::vector<Word>& words) const;
  int find(const Word& word) const;
  void update(std::size_t index, const Word& word, std::size_t seen);
  void add(const Word& word) { index_.add(word); }
  std::size_t size() const { return index_.size(); }
  void write(mapping_common::ArchiveWriter& out) const;
  void read(mapping_common::ArchiveReader& in);

 private:
  float delta_;
  PlaceIndex index_;
};

/// A row as a word. Empty where it isn't finite, or zero.
VectorVocabulary::Word toWord(const float* values, std::size_t count);

}  // namespace intensity_place_recognition
