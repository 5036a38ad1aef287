// SPDX-License-Identifier: BSD-3-Clause
//
// The vocabulary (4.4.2): visual words, how often each occurs, and an inverted index of the images they occur
// in. It grows with every image and needs no training.
#pragma once

#include <memory>
#include <opencv2/core.hpp>
#include <string>
#include <vector>

#include "ibuild_loop_closure/descriptor.h"
#include "ibuild_loop_closure/word_index.h"

namespace ibuild_loop_closure {

/// Fig. 4.8: descriptors nearer than delta to each other become one, their centroid, greedily.
std::vector<Descriptor> mergeDescriptors(std::vector<Descriptor> descriptors, int delta);

/// Fig. 4.9: which words of the vocabulary an image has.
struct Assignment {
  std::vector<int> old_words;         ///< S, without repetition, ascending
  std::vector<Descriptor> new_words;  ///< N_new of them
};

class Vocabulary {
 public:
  /// @param delta words nearer than that, bits, are the same
  /// @throws std::invalid_argument if delta isn't 1 to 512; as IndexOptions::validate
  explicit Vocabulary(int delta = 70, const IndexOptions& index = {});

  int delta() const { return delta_; }
  void setDelta(int delta);
  std::size_t size() const { return index_->size(); }
  std::size_t images() const { return image_words_.size(); }
  const Descriptor& word(std::size_t index) const { return index_->word(index); }
  /// f: the number of images that a word was seen in.
  int occurrences(std::size_t word) const { return static_cast<int>(inverted_[word].size()); }
  /// The images that a word was seen in, ascending.
  const std::vector<int>& imagesOf(std::size_t word) const { return inverted_[word]; }
  const std::vector<int>& wordsOf(std::size_t image) const { return image_words_[image]; }
  const WordIndex& index() const { return *index_; }

  Assignment assign(const std::vector<Descriptor>& words) const;

  /// For each image the number of words it shares with the assignment, |U|.
  std::vector<int> commonWords(const Assignment& assignment) const;
  /// 4.4.3: the modified Jaccard index with each image, 0 to 1; 0 for those without a common word.
  std::vector<double> similarities(const Assignment& assignment) const;
  /// With each image the sum of the idf of common words (Eq. 4.3) over the root of the image's number of
  /// words, 0 and up.
  std::vector<double> idfSimilarities(const Assignment& assignment) const;

  /// The last step of an image: its new words are appended, the occurrences of old ones grow. @return its id
  int update(const Assignment& assignment);

  /// Binds a file's content to a vocabulary; see vocabulary_file.h.
  struct Content {
    int delta = 70;
    IndexOptions index;
    std::vector<Descriptor> words;
    std::vector<std::vector<int>> image_words;  ///< ascending
    std::vector<std::int32_t> links;            ///< GraphIndex::links, empty with another index

    void describe(mapping_common::OptionList& o) {
      o("delta", delta, "bits", "words nearer than that are the same").within(1, Descriptor::kMaxBits);
      o.group("index", "", index);
    }
  };
  Content content() const;
  /// @throws std::runtime_error that says what is inconsistent; std::invalid_argument as the constructor
  static Vocabulary restore(Content content);

 private:
  int delta_;
  IndexOptions index_options_;
  std::unique_ptr<WordIndex> index_;
  std::vector<std::vector<int>> inverted_;     // word -> images
  std::vector<std::vector<int>> image_words_;  // image -> words
  std::vector<double> inverse_occurrences_;    // image -> sum of 1 / f over its words
};

}  // namespace ibuild_loop_closure
