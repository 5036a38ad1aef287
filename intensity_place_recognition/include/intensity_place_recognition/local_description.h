// SPDX-License-Identifier: BSD-3-Clause
//
// Bags of words over local descriptors (4.5.2): descriptors of a view or cloud that are alike are merged
// (clustering), each is assigned to a word of the vocabulary or becomes a new one, an inverted index has the
// views that each word was seen in, and two views are as similar as the idf of their common words sums up to
// (Eq. 4.2, 4.3). The directions that common words were seen in vote for the turn of the sensor.
#pragma once

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <stdexcept>
#include <utility>

#include "intensity_place_recognition/scene_description.h"

namespace intensity_place_recognition {

/// A descriptor, and the azimuth (rad) that it was seen at.
template <class Word>
struct LocalFeature {
  Word descriptor;
  float azimuth = 0.0f;
};

struct Sighting {
  std::int32_t word;  ///< its number
  float azimuth;      ///< rad
};

/// The visual words of each view.
template <class Word>
struct LocalSignature : Signature {
  struct OfView {
    std::vector<Word> words;
    std::vector<Sighting> sightings;  ///< of them
  };
  std::vector<OfView> views;
};

/// Which words views have, and what they say of their similarity.
class InvertedIndex {
 public:
  /// The next one's, by their words.
  void add(std::vector<Sighting> sightings);
  std::size_t views() const { return views_.size(); }
  /// In how many views a word was seen.
  std::size_t occurrences(std::size_t word) const {
    return word < inverted_.size() ? inverted_[word].size() : 0;
  }
  /// Eq. 4.3 with each of the first `before` views. @param sightings of a view that isn't added, by their
  /// words
  std::vector<float> similarities(const std::vector<Sighting>& sightings, std::size_t before) const;
  float similarity(std::size_t a, std::size_t b) const;
  /// Adds the votes of words that both have for each step of the turn, see bestTurns.
  void vote(const std::vector<Sighting>& sightings, std::size_t view, std::vector<float>& by_step) const;

  void write(mapping_common::ArchiveWriter& out) const;
  /// @throws std::runtime_error where one isn't among so many words
  void read(mapping_common::ArchiveReader& in, std::size_t words);

 private:
  std::vector<std::vector<Sighting>> views_;         // by their words
  std::vector<std::vector<std::int32_t>> inverted_;  // word -> views, ascending
};

/// @tparam Vocabulary has a type Word and
///   - merge(std::vector<Word>): those nearer than delta to each other become one;
///   - nearest(word, words): the index of the nearest of a view's;
///   - find(word): the index of the word of the vocabulary that is nearer than delta, -1: there is none;
///   - update(index, word, seen): of a word that was seen in so many views; add(word);
///   - size(), write(out), read(in).
template <class Vocabulary>
class LocalDescription : public SceneDescription {
 public:
  using Word = typename Vocabulary::Word;
  using Features = std::vector<LocalFeature<Word>>;
  using OfScene = LocalSignature<Word>;

  std::shared_ptr<const Signature> describe(const Scene& scene) const override {
    auto result = std::make_shared<OfScene>();
    std::size_t count = 0;
    for (const Features& features : extract(scene)) {
      typename OfScene::OfView view;
      for (const auto& feature : features) view.words.push_back(feature.descriptor);
      view.words = vocabulary_.merge(std::move(view.words));
      for (const auto& f : features)
        view.sightings.push_back(
            {static_cast<std::int32_t>(vocabulary_.nearest(f.descriptor, view.words)), f.azimuth});
      count += features.size();
      result->views.push_back(std::move(view));
    }
    if (count == 0) throw std::invalid_argument("the scene has no key point");
    return result;
  }

  void add(const std::shared_ptr<const Signature>& signature) override {
    const auto& added = dynamic_cast<const OfScene&>(*signature);
    views_per_place_ = added.views.size();
    for (const auto& view : added.views) {
      std::vector<std::int32_t> words;
      for (const Word& word : view.words) words.push_back(vocabulary_.find(word));
      for (std::size_t i = 0; i < words.size(); ++i) {
        if (words[i] < 0) {
          words[i] = static_cast<std::int32_t>(vocabulary_.size());
          vocabulary_.add(view.words[i]);
        } else {
          vocabulary_.update(words[i], view.words[i], index_.occurrences(words[i]));
        }
      }
      index_.add(sightingsOf(view, words));
    }
  }

  int places() const override { return static_cast<int>(index_.views() / views_per_place_); }

  std::vector<Candidate> candidates(const Signature& signature, int before, int count,
                                    int turns) const override {
    std::vector<Candidate> all;
    if (before <= 0) return all;
    const auto& query = dynamic_cast<const OfScene&>(signature);
    std::vector<std::vector<Sighting>> views;
    for (const auto& view : query.views) {
      std::vector<std::int32_t> words;
      for (const Word& word : view.words) words.push_back(vocabulary_.find(word));
      views.push_back(sightingsOf(view, words));
    }
    std::vector<float> best(std::min(before, places()), 0.0f);
    for (const auto& view : views) {
      const std::vector<float> similarities = index_.similarities(view, best.size() * views_per_place_);
      for (std::size_t i = 0; i < similarities.size(); ++i)
        best[i / views_per_place_] = std::max(best[i / views_per_place_], similarities[i]);
    }
    for (std::size_t i = 0; i < best.size(); ++i)
      if (best[i] > 0.0f) all.push_back({static_cast<int>(i), best[i], {}});
    const auto kept = all.begin() + std::min<std::ptrdiff_t>(static_cast<std::ptrdiff_t>(all.size()), count);
    std::partial_sort(all.begin(), kept, all.end(), [](const Candidate& a, const Candidate& b) {
      return std::make_pair(-a.similarity, a.place) < std::make_pair(-b.similarity, b.place);
    });
    all.erase(kept, all.end());
    for (Candidate& candidate : all) {
      std::vector<float> votes(kTurns, 0.0f);
      for (const auto& view : views)
        for (std::size_t v = 0; v < views_per_place_; ++v)
          index_.vote(view, candidate.place * views_per_place_ + v, votes);
      for (const Turn& turn : bestTurns(votes, turns)) candidate.yaws.push_back(turn.yaw);
    }
    return all;
  }

  float similarity(int a, int b) const override {
    float best = 0.0f;
    for (std::size_t v = 0; v < views_per_place_; ++v)
      for (std::size_t w = 0; w < views_per_place_; ++w)
        best = std::max(best, index_.similarity(a * views_per_place_ + v, b * views_per_place_ + w));
    return best;
  }

  void write(mapping_common::ArchiveWriter& out) const override {
    vocabulary_.write(out);
    out(static_cast<std::uint64_t>(views_per_place_));
    index_.write(out);
  }
  void read(mapping_common::ArchiveReader& in) override {
    vocabulary_.read(in);
    views_per_place_ = in.next<std::uint64_t>();
    index_.read(in, vocabulary_.size());
    if (views_per_place_ < 1 || index_.views() % views_per_place_ != 0)
      throw std::runtime_error("views of places in it are missing");
  }

 protected:
  explicit LocalDescription(Vocabulary vocabulary) : vocabulary_(std::move(vocabulary)) {}

 private:
  static constexpr int kTurns = 120;

  /// Those of each view.
  virtual std::vector<Features> extract(const Scene& scene) const = 0;

  // Of words that the vocabulary has.
  static std::vector<Sighting> sightingsOf(const typename OfScene::OfView& view,
                                           const std::vector<std::int32_t>& words) {
    std::vector<Sighting> result;
    for (const auto& s : view.sightings)
      if (words[s.word] >= 0) result.push_back({words[s.word], s.azimuth});
    std::sort(result.begin(), result.end(), [](const auto& a, const auto& b) {
      return std::make_pair(a.word, a.azimuth) < std::make_pair(b.word, b.azimuth);
    });
    return result;
  }

  Vocabulary vocabulary_;
  InvertedIndex index_;
  std::size_t views_per_place_ = 1;
};

}  // namespace intensity_place_recognition
