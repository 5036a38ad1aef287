// SPDX-License-Identifier: BSD-3-Clause
#include "ibuild_loop_closure/vocabulary.h"

#include <algorithm>
#include <cmath>
#include <stdexcept>

#include "ibuild_loop_closure/graph_index.h"

namespace ibuild_loop_closure {

std::vector<Descriptor> mergeDescriptors(std::vector<Descriptor> descriptors, int delta) {
  std::vector<Descriptor> words;
  std::vector<std::uint16_t> distances(descriptors.size());
  std::vector<char> removed(descriptors.size(), 0);
  for (std::size_t i = 0; i < descriptors.size(); ++i) {
    if (removed[i]) continue;
    Descriptor word = descriptors[i];
    const auto measure = [&](std::size_t first) {
      hammingDistances(word, descriptors.data() + first, descriptors.size() - first,
                       distances.data() + first);
    };
    if (i + 1 < descriptors.size()) measure(i + 1);
    for (std::size_t j = i + 1; j < descriptors.size(); ++j) {
      if (removed[j] || distances[j] >= delta) continue;
      word = centroid(word, descriptors[j]);
      removed[j] = 1;
      if (j + 1 < descriptors.size()) measure(j + 1);  // from the centroid now
    }
    words.push_back(word);
  }
  return words;
}

Vocabulary::Vocabulary(int delta, const IndexOptions& index)
    : delta_(delta), index_options_(index), index_(makeIndex(index)) {
  setDelta(delta);
}

void Vocabulary::setDelta(int delta) {
  mapping_common::Option("delta", delta, "bits", "").within(1, Descriptor::kMaxBits).check();
  delta_ = delta;
}

Assignment Vocabulary::assign(const std::vector<Descriptor>& words) const {
  Assignment assignment;
  for (const Descriptor& word : words) {
    const FoundWord found = index_->find(word, delta_);
    if (found.word >= 0) {
      assignment.old_words.push_back(found.word);
    } else {
      assignment.new_words.push_back(word);
    }
  }
  std::vector<int>& old = assignment.old_words;
  std::sort(old.begin(), old.end());
  old.erase(std::unique(old.begin(), old.end()), old.end());
  return assignment;
}

std::vector<int> Vocabulary::commonWords(const Assignment& assignment) const {
  std::vector<int> common(images(), 0);
  for (int word : assignment.old_words) {
    for (int image : inverted_[word]) ++common[image];
  }
  return common;
}

std::vector<double> Vocabulary::similarities(const Assignment& assignment) const {
  std::vector<double> similarity(images(), 0.0);
  std::vector<int> common(images(), 0);
  for (int word : assignment.old_words) {
    const double inverse = 1.0 / occurrences(word);
    for (int image : inverted_[word]) {
      similarity[image] += inverse;
      ++common[image];
    }
  }
  for (std::size_t i = 0; i < images(); ++i) {
    if (common[i] == 0) continue;
    // U: the common words; T: words of image i that the current one doesn't have.
    const double u = similarity[i] * common[i];
    const double only_in_i = std::max(0.0, inverse_occurrences_[i] - similarity[i]);
    const double t = only_in_i * static_cast<double>(image_words_[i].size() - common[i]);
    similarity[i] = u / (u + t + static_cast<double>(assignment.new_words.size()));
  }
  return similarity;
}

std::vector<double> Vocabulary::idfSimilarities(const Assignment& assignment) const {
  constexpr double kFewWords = 30.0;  // an image of so few says little
  std::vector<double> similarity(images(), 0.0);
  for (int word : assignment.old_words) {
    const double idf = std::log(static_cast<double>(images() + 1) / occurrences(word));
    for (int image : inverted_[word]) similarity[image] += idf;
  }
  for (std::size_t i = 0; i < images(); ++i) {
    similarity[i] /= std::sqrt(std::max(kFewWords, static_cast<double>(image_words_[i].size())));
  }
  return similarity;
}

int Vocabulary::update(const Assignment& assignment) {
  const int id = static_cast<int>(images());
  std::vector<int> words = assignment.old_words;
  double inverse = 0.0;
  for (int word : assignment.old_words) {
    const double f = occurrences(word);
    for (int image : inverted_[word]) inverse_occurrences_[image] += 1.0 / (f + 1.0) - 1.0 / f;
    inverted_[word].push_back(id);
    inverse += 1.0 / (f + 1.0);
  }
  for (const Descriptor& word : assignment.new_words) {
    words.push_back(static_cast<int>(size()));
    index_->add(word);
    inverted_.push_back({id});
    inverse += 1.0;
  }
  image_words_.push_back(std::move(words));
  inverse_occurrences_.push_back(inverse);
  return id;
}

Vocabulary::Content Vocabulary::content() const {
  Content content;
  content.delta = delta_;
  content.index = index_options_;
  content.image_words = image_words_;
  content.words.reserve(size());
  for (std::size_t i = 0; i < size(); ++i) content.words.push_back(word(i));
  if (const auto* graph = dynamic_cast<const GraphIndex*>(index_.get())) content.links = graph->links();
  return content;
}

Vocabulary Vocabulary::restore(Content content) {
  Vocabulary vocabulary(content.delta, content.index);
  if (auto* graph = dynamic_cast<GraphIndex*>(vocabulary.index_.get())) {
    graph->restore(content.words, content.links);
  } else {
    for (const Descriptor& word : content.words) vocabulary.index_->add(word);
  }
  vocabulary.inverted_.resize(content.words.size());
  for (std::size_t image = 0; image < content.image_words.size(); ++image) {
    int last = -1;
    for (int word : content.image_words[image]) {
      if (word <= last || word >= static_cast<int>(content.words.size()))
        throw std::runtime_error("it has an image of unordered or unknown words");
      last = word;
      vocabulary.inverted_[word].push_back(static_cast<int>(image));
    }
  }
  for (const std::vector<int>& images : vocabulary.inverted_) {
    if (images.empty()) throw std::runtime_error("it has a word that no image has");
  }
  for (const std::vector<int>& words : content.image_words) {
    double inverse = 0.0;
    for (int word : words) inverse += 1.0 / vocabulary.occurrences(word);
    vocabulary.inverse_occurrences_.push_back(inverse);
  }
  vocabulary.image_words_ = std::move(content.image_words);
  return vocabulary;
}

}  // namespace ibuild_loop_closure
