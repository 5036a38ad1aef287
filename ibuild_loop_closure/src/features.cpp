// SPDX-License-Identifier: BSD-3-Clause
#include "ibuild_loop_closure/features.h"

#include <algorithm>
#include <cstring>
#include <limits>
#include <opencv2/features2d.hpp>
#include <opencv2/imgproc.hpp>
#include <stdexcept>

namespace ibuild_loop_closure {
namespace {

constexpr double kMaxRows = 10000.0;  // of an image that is scaled up: some are very narrow

// The strongest key points of each cell of a grid in turn, until there are enough.
std::vector<cv::KeyPoint> spread(const std::vector<cv::KeyPoint>& sorted, std::size_t count, cv::Size size,
                                 cv::Size grid) {
  std::vector<std::vector<cv::KeyPoint>> cells(grid.area());
  for (const cv::KeyPoint& k : sorted) {
    const int column = std::min(grid.width - 1, static_cast<int>(k.pt.x) * grid.width / size.width);
    const int row = std::min(grid.height - 1, static_cast<int>(k.pt.y) * grid.height / size.height);
    cells[row * grid.width + column].push_back(k);
  }
  std::vector<cv::KeyPoint> chosen;
  chosen.reserve(count);
  for (std::size_t rank = 0; chosen.size() < count; ++rank) {
    for (const auto& cell : cells) {
      if (rank < cell.size() && chosen.size() < count) chosen.push_back(cell[rank]);
    }
  }
  return chosen;
}

cv::Ptr<cv::Feature2D> makeBrisk(const FeatureOptions& options) {
  return cv::BRISK::create(options.threshold, options.octaves, static_cast<float>(options.pattern_scale));
}

// BRISK's pattern as cv::BRISK::create makes it, without the pairs of far points that give the direction.
cv::Ptr<cv::Feature2D> makeUprightBrisk(const FeatureOptions& options) {
  const auto scale = static_cast<float>(options.pattern_scale);
  std::vector<float> radii{0.0f, 2.9f, 4.9f, 7.4f, 10.8f};
  for (float& radius : radii) radius *= 0.85f * scale;
  return cv::BRISK::create(options.threshold, options.octaves, radii, {1, 10, 14, 15, 20}, 5.85f * scale,
                           std::numeric_limits<float>::max());
}

cv::Ptr<cv::Feature2D> makeOrb(const FeatureOptions&) {
  return cv::ORB::create();
}

}  // namespace

const mapping_common::Table<MakeDescriptors>& descriptors() {
  static const mapping_common::Table<MakeDescriptors> table{
      {"brisk", makeBrisk, "512 bits, the thesis's, turned with what they show"},
      {"upright_brisk", makeUprightBrisk,
       "the same not turned, for a level camera: more match, by chance, too, so that "
       "tracks/open_significance 120, tracks/min_significance 8 and geometry/delta 115 suit them"},
      {"orb", makeOrb, "256 bits of ORB (Rublee et al. 2011)"}};
  return table;
}

FeatureExtractor::FeatureExtractor(const FeatureOptions& options)
    : options_(mapping_common::validate(options)) {
  if (options.detector == Detector::kBrisk) {
    detector_ = makeBrisk(options);
  } else {
    detector_ = cv::FastFeatureDetector::create(options.threshold);
  }
  descriptor_ = mapping_common::valueOf(descriptors(), options.descriptor)(options);
  if (descriptor_->descriptorType() != CV_8U || bits() > Descriptor::kMaxBits)
    throw std::invalid_argument("descriptors '" + options.descriptor +
                                "' aren't binary, of 512 bits at most");
  clahe_ = cv::createCLAHE(3.0);
}

FeatureExtractor::FeatureExtractor(FeatureExtractor&&) noexcept = default;
FeatureExtractor& FeatureExtractor::operator=(FeatureExtractor&&) noexcept = default;
FeatureExtractor::~FeatureExtractor() = default;

cv::Mat toGrey(const cv::Mat& image) {
  if (image.empty()) throw std::invalid_argument("the image is empty");
  if (image.depth() != CV_8U && image.depth() != CV_16U) {
    throw std::invalid_argument("the image has neither 8 nor 16 bits per channel");
  }
  cv::Mat grey = image;
  if (grey.depth() == CV_16U) cv::normalize(image, grey, 0, 255, cv::NORM_MINMAX, CV_8U);
  switch (grey.channels()) {
    case 1:
      break;
    case 3:
      cv::cvtColor(grey, grey, cv::COLOR_BGR2GRAY);
      break;
    case 4:
      cv::cvtColor(grey, grey, cv::COLOR_BGRA2GRAY);
      break;
    default:
      throw std::invalid_argument("the image has " + std::to_string(grey.channels()) +
                                  " channels, allowed is 1, 3 or 4");
  }
  return grey;
}

cv::Mat FeatureExtractor::prepare(const cv::Mat& image) const {
  cv::Mat grey = toGrey(image);
  const int min_width =
      options_.max_width > 0 ? std::min(options_.min_width, options_.max_width) : options_.min_width;
  const double up = static_cast<double>(min_width) / grey.cols;
  const double down = static_cast<double>(options_.max_width) / grey.cols;
  if (up > 1.0 && up * grey.rows <= kMaxRows) {
    cv::resize(grey, grey, {}, up, up, cv::INTER_CUBIC);
  } else if (down > 0.0 && down < 1.0 && down * grey.rows >= 1.0) {
    cv::resize(grey, grey, {}, down, down, cv::INTER_AREA);
  }
  if (options_.equalize) {
    cv::Mat equalized;
    clahe_->apply(grey, equalized);
    return equalized;
  }
  return grey;
}

std::vector<cv::KeyPoint> FeatureExtractor::detect(const cv::Mat& prepared) const {
  std::vector<cv::KeyPoint> found;
  detector_->detect(prepared, found);
  if (options_.detector == Detector::kFast) {
    for (cv::KeyPoint& k : found) k.size = static_cast<float>(options_.size);
  }
  const std::size_t count = static_cast<std::size_t>(options_.max_features);
  if (count == 0 || found.size() <= count) return found;
  // Equal responses are ordered by place, so that the same image always gives the same.
  std::sort(found.begin(), found.end(), [](const cv::KeyPoint& a, const cv::KeyPoint& b) {
    if (a.response != b.response) return a.response > b.response;
    return a.pt.y != b.pt.y ? a.pt.y < b.pt.y : a.pt.x < b.pt.x;
  });
  if (options_.spread) return spread(found, count, prepared.size(), {options_.columns, options_.rows});
  found.resize(count);
  return found;
}

Features FeatureExtractor::describe(const cv::Mat& prepared, std::vector<cv::KeyPoint> key_points,
                                    float scale) const {
  cv::Mat rows;
  descriptor_->compute(prepared, key_points, rows);
  const cv::Point2f middle(0.5f, 0.5f);
  Features features;
  features.descriptors.resize(key_points.size());
  features.points.reserve(key_points.size());
  for (std::size_t i = 0; i < key_points.size(); ++i) {
    std::memcpy(features.descriptors[i].bits.data(), rows.ptr(static_cast<int>(i)), rows.cols);
    // Pixels have their coordinates at their middle.
    features.points.push_back((key_points[i].pt + middle) * scale - middle);
  }
  return features;
}

int FeatureExtractor::bits() const {
  return 8 * descriptor_->descriptorSize();
}

Features FeatureExtractor::extract(const cv::Mat& image) const {
  const cv::Mat prepared = prepare(image);
  return describe(prepared, detect(prepared), static_cast<float>(image.cols) / prepared.cols);
}

}  // namespace ibuild_loop_closure
