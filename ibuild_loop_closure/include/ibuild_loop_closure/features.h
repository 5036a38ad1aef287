// SPDX-License-Identifier: BSD-3-Clause
//
// Key points and their BRISK descriptors (4.4.2), and what is matched between two images.
#pragma once

#include <memory>
#include <opencv2/core.hpp>
#include <string>
#include <vector>

#include "ibuild_loop_closure/descriptor.h"

namespace cv {
class BRISK;
class CLAHE;
class FastFeatureDetector;
}  // namespace cv

namespace ibuild_loop_closure {

/// Key points of an image and their descriptors, in the same order.
struct Features {
  std::vector<cv::Point2f> points;  ///< pixels of the image as it came
  std::vector<Descriptor> descriptors;
  std::size_t size() const { return descriptors.size(); }
};

enum class Detector {
  kBrisk,  ///< BRISK's own, the thesis's
  kFast    ///< FAST corners of one scale, about ten times as fast
};

struct FeatureOptions {
  Detector detector = Detector::kFast;
  int threshold = 10;          ///< of the detector, grey values, 1 to 255
  int octaves = 0;             ///< BRISK's, 0 to 8
  float size = 12.0f;          ///< FAST: diameter of the key points, pixels; sets the scale of the descriptor
  double pattern_scale = 1.0;  ///< of BRISK's sampling pattern
  int max_features = 800;      ///< 0: all
  bool spread = true;  ///< true: the strongest of each cell of a grid; false: the strongest of the image
  int columns = 10, rows = 8;  ///< of that grid, 1 to 1000
  bool equalize = false;       ///< contrast limited adaptive histogram equalization before all else
  int min_width = 320;         ///< narrower images are scaled up to it, pixels; 0: never
  int max_width = 800;         ///< wider images are scaled down to it, pixels; 0: never
  /// @throws std::invalid_argument that names the option, its value and the allowed range
  void validate() const;
};

/// Grey, 8 bits; an image of 16 bits is scaled to its range.
/// @param image of 1, 3 (BGR) or 4 (BGRA) channels, 8 or 16 bits
/// @throws std::invalid_argument if it is empty or of another type
cv::Mat toGrey(const cv::Mat& image);

class FeatureExtractor {
 public:
  /// @throws std::invalid_argument as FeatureOptions::validate
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
  /// All three.
  Features extract(const cv::Mat& image) const;

 private:
  FeatureOptions options_;
  cv::Ptr<cv::BRISK> brisk_;
  cv::Ptr<cv::FastFeatureDetector> fast_;
  cv::Ptr<cv::CLAHE> clahe_;
};

struct Match {
  int a = 0, b = 0;  ///< indices into the two sets
  int distance = 0;  ///< bits
  bool operator==(const Match& o) const { return a == o.a && b == o.b && distance == o.distance; }
};

/// Pairs that are each other's nearest, nearer than `delta`. By index of a.
/// @param ratio a's nearest must also be nearer than this times its second nearest; 1: no such test
std::vector<Match> matchDescriptors(const std::vector<Descriptor>& a, const std::vector<Descriptor>& b,
                                    int delta, double ratio = 1.0);

/// Smallest and second smallest distance.
struct Nearest {
  std::size_t index = 0;
  int distance = Descriptor::kBits + 1, second = Descriptor::kBits + 1;
};
Nearest nearestOf(const Descriptor& query, const Descriptor* words, std::size_t count);

}  // namespace ibuild_loop_closure
