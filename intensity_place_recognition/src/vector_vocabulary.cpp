// SPDX-License-Identifier: BSD-3-Clause
#include "intensity_place_recognition/vector_vocabulary.h"

#include <Eigen/Core>
#include <cmath>
#include <stdexcept>

namespace intensity_place_recognition {
namespace {

using Word = VectorVocabulary::Word;

Eigen::Map<const Eigen::VectorXf> of(const Word& word) {
  return {word.data(), static_cast<Eigen::Index>(word.size())};
}

// To the mean of so many with that.
void average(Word& word, std::size_t count, const Word& other) {
  Eigen::Map<Eigen::VectorXf> values(word.data(), static_cast<Eigen::Index>(word.size()));
  values += (of(other) - values) / static_cast<float>(count + 1);
}

}  // namespace

Word toWord(const float* values, std::size_t count) {
  const Eigen::Map<const Eigen::VectorXf> row(values, static_cast<Eigen::Index>(count));
  const float length = row.norm();
  if (!(length > 0.0f && std::isfinite(length))) return {};
  Word word(count);
  Eigen::Map<Eigen::VectorXf>(word.data(), row.size()) = row / length;
  return word;
}

std::vector<Word> VectorVocabulary::merge(std::vector<Word> words) const {
  std::vector<std::size_t> counts(words.size(), 1);
  for (bool merged = true; merged;) {
    merged = false;
    for (std::size_t i = 0; i < words.size(); ++i) {
      for (std::size_t j = i + 1; j < words.size();) {
        if ((of(words[i]) - of(words[j])).squaredNorm() >= delta_ * delta_) {
          ++j;
          continue;
        }
        const auto all = static_cast<float>(counts[i] + counts[j]);
        for (std::size_t k = 0; k < words[i].size(); ++k)
          words[i][k] += (words[j][k] - words[i][k]) * static_cast<float>(counts[j]) / all;
        counts[i] += counts[j];
        words.erase(words.begin() + static_cast<std::ptrdiff_t>(j));
        counts.erase(counts.begin() + static_cast<std::ptrdiff_t>(j));
        merged = true;
      }
    }
  }
  return words;
}

std::size_t VectorVocabulary::nearest(const Word& word, const std::vector<Word>& words) const {
  std::size_t best = 0;
  float least = INFINITY;
  for (std::size_t i = 0; i < words.size(); ++i) {
    const float distance = (of(words[i]) - of(word)).squaredNorm();
    if (distance >= least) continue;
    least = distance;
    best = i;
  }
  return best;
}

int VectorVocabulary::find(const Word& word) const {
  const std::vector<std::size_t> found = index_.nearest(word, 1);
  if (found.empty() || (of(index_.key(found[0])) - of(word)).squaredNorm() >= delta_ * delta_) return -1;
  return static_cast<int>(found[0]);
}

void VectorVocabulary::update(std::size_t index, const Word& word, std::size_t seen) {
  Word moved = index_.key(index);
  average(moved, seen, word);
  index_.move(index, moved);
}

void VectorVocabulary::write(mapping_common::ArchiveWriter& out) const {
  out(static_cast<std::uint64_t>(size()));
  for (std::size_t i = 0; i < size(); ++i) out(index_.key(i));
}

void VectorVocabulary::read(mapping_common::ArchiveReader& in) {
  for (std::size_t left = in.count(sizeof(std::uint64_t)); left > 0; --left) {
    Word word;
    in(word);
    if (word.empty() || (size() > 0 && word.size() != index_.key(0).size()) || !of(word).allFinite())
      throw std::runtime_error("a word in it is inconsistent");
    add(word);
  }
}

}  // namespace intensity_place_recognition
