// SPDX-License-Identifier: BSD-3-Clause
//
// Global HOG (4.5.2): histograms of the gradients' orientations in cells of L pixels, normalised in blocks of
// 2 x 2 cells.
#include <cmath>
#include <opencv2/imgproc.hpp>

#include "intensity_place_recognition/global_description.h"

namespace intensity_place_recognition {
namespace {

constexpr int kBins = 9;

class Hog : public GlobalDescription {
 public:
  explicit Hog(const DescriptionOptions& options) : options_(options) {}

 private:
  std::vector<cv::Mat1f> matrices(const Scene& scene) const override {
    return ofEachView(scene, [this](const View& view) { return histograms(view); });
  }
  cv::Mat1f histograms(const View& view) const {
    const int border = 16, width = view.image.cols;
    cv::Mat1f image = view.padded(border);
    if (options_.sigma > 0.0) cv::GaussianBlur(image, image, {}, options_.sigma);
    const int rows = image.rows / options_.cell, columns = width / options_.cell;
    std::vector<cv::Mat1f> cells(kBins, cv::Mat1f());
    for (cv::Mat1f& bin : cells) bin = cv::Mat1f(rows, columns, 0.0f);
    for (int y = 1; y < std::min(image.rows - 1, rows * options_.cell); ++y) {
      for (int x = 0; x < columns * options_.cell; ++x) {
        const float ex = image(y, x + border + 1) - image(y, x + border - 1),
                    ey = image(y + 1, x + border) - image(y - 1, x + border);
        const float orientation =
            (std::atan2(ey, ex) / static_cast<float>(M_PI) + 1.0f) * kBins;  // of a half turn
        const int bin = static_cast<int>(orientation) % kBins;
        cells[bin](y / options_.cell, x / options_.cell) += std::hypot(ex, ey);
      }
    }
    return inBlocks(cells, rows, columns, view.isPanorama());
  }

  static cv::Mat1f inBlocks(const std::vector<cv::Mat1f>& cells, int rows, int columns, bool meet) {
    const int block_rows = std::max(1, rows - 1);
    cv::Mat1f result(block_rows * 4 * kBins, columns, 0.0f);
    for (int y = 0; y < block_rows; ++y) {
      for (int x = 0; x < columns; ++x) {
        cv::Mat1f block = result(cv::Rect(x, y * 4 * kBins, 1, 4 * kBins));
        int row = 0;
        for (int dy = 0; dy < 2; ++dy)
          for (int dx = 0; dx < 2; ++dx)
            for (const cv::Mat1f& bin : cells)
              block(row++, 0) =
                  bin(std::min(y + dy, rows - 1), meet ? (x + dx) % columns : std::min(x + dx, columns - 1));
        const double norm = cv::norm(block);
        if (norm > 1e-3) block /= norm;
      }
    }
    return result;
  }
  DescriptionOptions options_;
};

}  // namespace

std::unique_ptr<SceneDescription> makeHog(const DescriptionOptions& options) {
  return std::make_unique<Hog>(options);
}

}  // namespace intensity_place_recognition
