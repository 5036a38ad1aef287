// SPDX-License-Identifier: BSD-3-Clause
//
// Bag of the binary words of ibuild_loop_closure (4.4.2) over the panorama or views.
#include <ibuild_loop_closure/features.h>
#include <ibuild_loop_closure/vocabulary.h>
#include <ibuild_loop_closure/word_index.h>

#include "intensity_place_recognition/local_description.h"

namespace intensity_place_recognition {
namespace {

constexpr int kMargin = 32;  // pixels around a view, which descriptors need

class BinaryVocabulary {
 public:
  using Word = ibuild_loop_closure::Descriptor;
  explicit BinaryVocabulary(int delta) : delta_(delta) {}

  std::vector<Word> merge(std::vector<Word> words) const {
    return ibuild_loop_closure::mergeDescriptors(std::move(words), delta_);
  }
  std::size_t nearest(const Word& word, const std::vector<Word>& words) const {
    return ibuild_loop_closure::nearestOf(word, words.data(), words.size()).index;
  }
  int find(const Word& word) const { return index_->find(word, delta_).word; }
  void update(std::size_t, const Word&, std::size_t) {}  // words stay as they were seen first
  void add(const Word& word) { index_->add(word); }
  std::size_t size() const { return index_->size(); }
  void write(mapping_common::ArchiveWriter& out) const {
    std::vector<Word> words;
    for (std::size_t i = 0; i < size(); ++i) words.push_back(index_->word(i));
    out(words);
  }
  void read(mapping_common::ArchiveReader& in) {
    std::vector<Word> words;
    in(words);
    for (const Word& word : words) add(word);
  }

 private:
  int delta_;
  std::unique_ptr<ibuild_loop_closure::WordIndex> index_ = ibuild_loop_closure::makeIndex({});
};

class BinaryWords : public LocalDescription<BinaryVocabulary> {
 public:
  explicit BinaryWords(const DescriptionOptions& options)
      : LocalDescription(BinaryVocabulary(options.binary_delta)), extractor_(extractorOptions(options)) {}

 private:
  static ibuild_loop_closure::FeatureOptions extractorOptions(const DescriptionOptions& options) {
    ibuild_loop_closure::FeatureOptions features;
    features.max_features = options.features;
    features.min_width = features.max_width = 0;
    return features;
  }
  std::vector<Features> extract(const Scene& scene) const override {
    std::vector<Features> all;
    for (const View& view : scene.views()) {
      cv::Mat1b grey;
      view.padded(kMargin, kMargin).convertTo(grey, CV_8U, 255.0);
      const ibuild_loop_closure::Features found = extractor_.extract(grey);
      all.emplace_back();
      for (std::size_t i = 0; i < found.size(); ++i) {
        const float x = found.points[i].x - kMargin;
        if (x < -0.5f || x >= static_cast<float>(view.image.cols) - 0.5f) continue;  // twice in a panorama
        all.back().push_back({found.descriptors[i], static_cast<float>(view.azimuthAt(x))});
      }
    }
    return all;
  }
  ibuild_loop_closure::FeatureExtractor extractor_;
};

}  // namespace

std::unique_ptr<SceneDescription> makeBinary(const DescriptionOptions& options) {
  return std::make_unique<BinaryWords>(options);
}

}  // namespace intensity_place_recognition
