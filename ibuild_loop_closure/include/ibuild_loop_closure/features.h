// SPDX-License-Identifier: BSD-3-Clause
//
// Key points of an image and their descriptors (4.4.2).
#pragma once

#include <mapping_common/options.h>

#include <memory>
#include <opencv2/core.hpp>
#include <string>
#include <vector>

#include "ibuild_loop_closure/descriptor.h"

namespace cv {
class CLAHE;
class Feature2D;
}  // namespace cv

namespace ibuild_loop_closure {

/// Key points of an image and their descriptors, in the same order.
struct Features {
  std::vector<cv::Point2f> points;  ///< pixels of the image as it came
  std::vector<Descriptor> descriptors;
  std::size_t size() const { return descriptors.size(); }
};

enum class Detector { kBrisk, kFast };
constexpr auto choicesOf(Detector) {
  return mapping_common::choices<Detector>(
      {{"brisk", Detector::kBrisk, "BRISK's own, the thesis's"},
       {"fast", Detector::kFast, "FAST corners of one scale, about ten times as fast"}});
}

struct FeatureOptions;
/// Makes what computes binary descriptors of key points (cv::Feature2D::compute), of
/// Descriptor::kMaxBits at most.
using MakeDescriptors = cv::Ptr<cv::Feature2D> (*)(const FeatureOptions& options);
/// All there are, by the names that FeatureOptions::descriptor and vocabulary files have for them.
const mapping_common::Table<MakeDescriptors>& descriptors();

struct FeatureOptions {
  Detector detector = Detector::kFast;
  std::string descriptor = "brisk";  ///< a name of descriptors()
  int threshold = 10;
  int octaves = 0;
  double size = 12.0;
  double pattern_scale = 1.0;
  int max_features = 800;
  bool spread = true;
  int columns = 10, rows = 8;
  bool equalize = false;
  int min_width = 320;
  int max_width = 800;

  void describe(mapping_common::OptionList& o) {
    o("detector", detector, "", "of key points");
    o("descriptor", descriptor, "",
      "of key points; delta, tracking_delta and geometry/delta go by its length")
        .oneOf(descriptors());
    o("threshold", threshold, "grey values", "of the detector: lower for dark or hazy scenes").within(1, 255);
    o("octaves", octaves, "", "of brisk").within(0, 8);
    o("size", size, "pixels", "fast: diameter of the key points; sets the scale of descriptors")
        .within(1.0, 100.0);
    o("pattern_scale", pattern_scale, "", "of BRISK's sampling pattern").within(0.1, 10.0);
    o("max_features", max_features, "", "of an image, 0: all. Time grows with its square").within(0, 100000);
    o("spread", spread, "", "true: the strongest of each part of the image; false: of the whole image");
    o("columns", columns, "", "parts of the image for spread, across").within(1, 1000);
    o("rows", rows, "", "and down").within(1, 1000);
    o("equalize", equalize, "",
      "true: evens out contrast first (contrast limited adaptive histogram equalization)");
    o("min_width", min_width, "pixels",
      "narrower images are scaled up to it, 0: never. Descriptors need room around them")
        .within(0, 10000);
    o("max_width", max_width, "pixels",
      "wider images are scaled down to it, 0: never. FAST corners have one scale, and wider images find less")
        .within(0, 100000);
  }
};

/// Grey, 8 bits; an image of 16 bits is scaled to its range.
/// @param image of 1, 3 (BGR) or 4 (BGRA) channels, 8 or 16 bits
/// @throws std::invalid_argument if it is empty or of another type
cv::Mat toGrey(const cv::Mat& image);

class FeatureExtractor {
 public:
  /// @throws std::invalid_argument where the options won't do
  explicit FeatureExtractor(const FeatureOptions& options = {});
  FeatureExtractor(FeatureExtractor&&) noexcept;
  FeatureExtractor& operator=(FeatureExtractor&&) noexcept;
  ~FeatureExtractor();

  /// 4.4.1: grey (toGrey), scaled and equalized as the options say.
  /// @throws std::invalid_argument as toGrey
  cv::Mat prepare(const cv::Mat& image) const;
  /// Key points of a prepared image.
  std::vector<cv::KeyPoint> detect(const cv::Mat& prepared) const;
  /// Key points too near to the border have no descriptor and are left out.
  /// @param scale pixels of the image per pixel of the prepared one
  Features describe(const cv::Mat& prepared, std::vector<cv::KeyPoint> key_points, float scale = 1.0f) const;
  /// p, the length of descriptors.
  int bits() const;
  /// All three.
  Features extract(const cv::Mat& image) const;

 private:
  FeatureOptions options_;
  cv::Ptr<cv::Feature2D> detector_, descriptor_;
  cv::Ptr<cv::CLAHE> clahe_;
};

}  // namespace ibuild_loop_closure
