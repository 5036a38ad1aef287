// SPDX-License-Identifier: BSD-3-Clause
//
// Bag of words over SIFT of the panorama or of views (4.5.2).
#include <opencv2/features2d.hpp>

#include "intensity_place_recognition/local_description.h"
#include "intensity_place_recognition/vector_vocabulary.h"

namespace intensity_place_recognition {

#if CV_VERSION_MAJOR * 100 + CV_VERSION_MINOR >= 404
namespace {

constexpr int kMargin = 32;  // pixels around a view

class SiftWords : public LocalDescription<VectorVocabulary> {
 public:
  explicit SiftWords(const DescriptionOptions& options)
      : LocalDescription(VectorVocabulary(options.delta)), features_(options.features) {}

 private:
  std::vector<Features> extract(const Scene& scene) const override {
    std::vector<Features> all;
    const cv::Ptr<cv::SIFT> sift = cv::SIFT::create(features_);
    for (const View& view : scene.views()) {
      cv::Mat1b grey;
      view.padded(kMargin).convertTo(grey, CV_8U, 255.0);
      std::vector<cv::KeyPoint> points;
      cv::Mat1f descriptors;
      sift->detectAndCompute(grey, cv::noArray(), points, descriptors);
      all.emplace_back();
      for (std::size_t i = 0; i < points.size(); ++i) {
        const float x = points[i].pt.x - kMargin;
        if (x < -0.5f || x >= static_cast<float>(view.image.cols) - 0.5f) continue;  // twice in a panorama
        const VectorVocabulary::Word word = toWord(descriptors[static_cast<int>(i)], descriptors.cols);
        if (!word.empty()) all.back().push_back({word, static_cast<float>(view.azimuthAt(x))});
      }
    }
    return all;
  }
  int features_;
};

}  // namespace

std::unique_ptr<SceneDescription> makeWords(const DescriptionOptions& options) {
  return std::make_unique<SiftWords>(options);
}
#else
std::unique_ptr<SceneDescription> makeWords(const DescriptionOptions&) {
  throw std::invalid_argument("description words needs SIFT, which OpenCV has from 4.4 on");
}
#endif

}  // namespace intensity_place_recognition
