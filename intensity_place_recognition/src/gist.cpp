// SPDX-License-Identifier: BSD-3-Clause
//
// Global GIST (4.5.2): mean responses of Gabor filters of several scales and orientations over a grid.
#include <cmath>
#include <opencv2/imgproc.hpp>

#include "intensity_place_recognition/global_description.h"

namespace intensity_place_recognition {
namespace {

constexpr double kShortestWave = 4.0;  // pixels, of the finest scale; each next is twice as long

class Gist : public GlobalDescription {
 public:
  explicit Gist(const DescriptionOptions& options) : options_(options) {}

 private:
  std::vector<cv::Mat1f> matrices(const Scene& scene) const override {
    return ofEachView(scene, [this](const View& view) { return responses(view); });
  }
  cv::Mat1f responses(const View& view) const {
    const cv::Mat1f& image = view.image;
    const cv::Size grid(view.isPanorama() ? options_.directions : options_.blocks, options_.blocks);
    std::vector<cv::Mat1f> all;
    for (int scale = 0; scale < options_.scales; ++scale) {
      const double wave = kShortestWave * std::pow(2.0, scale), sigma = 0.5 * wave;
      const int radius = static_cast<int>(std::ceil(2.5 * sigma));
      const cv::Mat1f padded = view.padded(radius);
      for (int i = 0; i < options_.orientations; ++i) {
        const double angle = M_PI * i / options_.orientations;
        cv::Mat1f energy(padded.size(), 0.0f), filtered;
        for (const double phase : {0.0, M_PI / 2.0}) {
          cv::Mat1f kernel =
              cv::getGaborKernel({2 * radius + 1, 2 * radius + 1}, sigma, angle, wave, 1.0, phase, CV_32F);
          kernel -= cv::mean(kernel)[0];
          cv::filter2D(padded, filtered, CV_32F, kernel / cv::norm(kernel, cv::NORM_L1), {-1, -1}, 0.0,
                       cv::BORDER_REFLECT_101);
          energy += filtered.mul(filtered);
        }
        cv::sqrt(energy, energy);
        cv::Mat1f cells;
        cv::resize(energy(cv::Rect(radius, 0, image.cols, image.rows)), cells, grid, 0.0, 0.0,
                   cv::INTER_AREA);
        all.push_back(cells);
      }
    }
    cv::Mat1f result;
    cv::vconcat(all, result);
    return result;
  }
  DescriptionOptions options_;
};

}  // namespace

std::unique_ptr<SceneDescription> makeGist(const DescriptionOptions& options) {
  return std::make_unique<Gist>(options);
}

}  // namespace intensity_place_recognition
