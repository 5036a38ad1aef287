// SPDX-License-Identifier: BSD-3-Clause
#include "intensity_place_recognition/scene_description.h"

#include <algorithm>
#include <cmath>
#include <opencv2/imgproc.hpp>

namespace intensity_place_recognition {
namespace {

constexpr double kNearTurn = 0.2618;  // rad
constexpr float kRangeScale = 20.0f;  // m

}  // namespace

void DescriptionOptions::describe(mapping_common::OptionList& o) {
  o("type", type, "", "how a scene is described").oneOf(sceneDescriptions());
  o("image", image, "", "of the panorama, for hog, gist, words and binary");
  o("views", views, "", "of the panorama, for hog, gist, words and binary");
  o("field_of_view", field_of_view, "deg", "of views, from left to right").inDegrees().within(10.0, 170.0);
  o("cell", cell, "pixels", "L, width and height of a cell of hog").within(2, 512);
  o("sigma", sigma, "pixels", "of the Gaussian filter before hog; 0: none").within(0.0, 50.0);
  o("blocks", blocks, "", "phi, rows of gist's grid").within(1, 64);
  o("scales", scales, "", "Omega, of gist's filters").within(1, 6);
  o("orientations", orientations, "", "chi, for each scale of gist").within(1, 32);
  o("rings", rings, "", "of polar, from the sensor outwards").within(2, 200);
  o("directions", directions, "", "of polar and gist, of a whole turn").within(12, 720);
  o("radius", radius, "m", "of polar, shot and shot_colour").within(1.0, 1000.0);
  o("delta", delta, "",
    "distance of descriptors of length 1 that are one word, for words, shot and shot_colour")
      .within(0.01, 2.0);
  o("binary_delta", binary_delta, "bits", "the same for binary").within(1, 512);
  o("features", features, "", "key points of a view or a cloud at most").within(10, 100000);
  o("psi", psi, "m", "grid that the cloud is thinned by before shot and shot_colour, whose radius is 5 psi")
      .within(0.01, 10.0);
  const bool whole = type == "polar" || type == "shot" || type == "shot_colour";
  o.require(!whole || views == Views::kPanorama, "views", "panorama with " + type);
}

const mapping_common::Table<MakeDescription>& sceneDescriptions() {
  static const mapping_common::Table<MakeDescription> kTable = {
      {"polar", makePolar, "height and intensity over a polar grid of the ground"},
      {"hog", makeHog, "global histograms of oriented gradients of the panorama"},
      {"gist", makeGist, "global responses of Gabor filters to the panorama"},
      {"words", makeWords, "bag of words over SIFT of the panorama"},
      {"binary", makeBinary, "bag of the binary words of ibuild_loop_closure over the panorama"},
      {"shot", makeShot, "bag of words over SHOT of the cloud"},
      {"shot_colour", makeShotColour, "the same with intensities as colours"},
  };
  return kTable;
}

std::unique_ptr<SceneDescription> makeDescription(const DescriptionOptions& options) {
  return valueOf(sceneDescriptions(), options.type)(mapping_common::validate(options));
}

cv::Mat1f normalizedImage(const Panorama& panorama, Image image) {
  cv::Mat1f result(panorama.mask.size(), 0.0f);
  std::vector<float> seen;
  const auto first = panorama.intensity.begin();
  for (int i = 0; i < static_cast<int>(panorama.mask.total()); ++i)
    if (panorama.mask.begin()[i] == 255) seen.push_back(first[i]);
  std::sort(seen.begin(), seen.end());
  for (int i = 0; i < static_cast<int>(panorama.mask.total()); ++i) {
    if (panorama.mask.begin()[i] == 0) continue;
    if (image == Image::kRange) {
      result.begin()[i] = 1.0f - std::exp(-panorama.range.begin()[i] / kRangeScale);
    } else {
      const auto [low, high] = std::equal_range(seen.begin(), seen.end(), first[i]);
      result.begin()[i] = 0.5f * static_cast<float>((low - seen.begin()) + (high - seen.begin())) /
                          static_cast<float>(seen.size());
    }
  }
  return result;
}

double View::azimuthAt(double x) const {
  const double across = 1.0 - 2.0 * (x + 0.5) / image.cols;  // 1 to -1, from left to right
  return std::remainder(
      yaw + (isPanorama() ? M_PI * across : std::atan(std::tan(0.5 * field_of_view) * across)), 2.0 * M_PI);
}

cv::Mat1f View::padded(int columns, int rows) const {
  cv::Mat1f result;
  cv::copyMakeBorder(image, result, 0, 0, columns, columns,
                     isPanorama() ? cv::BORDER_WRAP : cv::BORDER_REPLICATE);
  cv::copyMakeBorder(result, result, rows, rows, 0, 0, cv::BORDER_REPLICATE);
  return result;
}

std::vector<View> viewsOf(const Panorama& panorama, const DescriptionOptions& options) {
  if (options.views == Views::kPanorama) return {{normalizedImage(panorama, options.image), 0.0, 0.0}};
  const PanoramaOptions& p = panorama.options;
  RectilinearView view;
  view.horizontal_fov = options.field_of_view;
  view.vertical_fov =
      std::min(options.field_of_view, 2.0 * std::max(std::abs(p.min_elevation), std::abs(p.max_elevation)));
  // As fine in its middle as the panorama, with square pixels.
  const double pixels = p.width / (2.0 * M_PI) * 2.0;
  view.width = std::max(8, static_cast<int>(pixels * std::tan(0.5 * view.horizontal_fov)));
  view.height = std::max(8, static_cast<int>(pixels * std::tan(0.5 * view.vertical_fov)));
  std::vector<View> all;
  for (const double yaw : {0.0, M_PI}) {
    view.rotation = Eigen::AngleAxisd(yaw, Eigen::Vector3d::UnitZ()).toRotationMatrix();
    all.push_back({normalizedImage(rectilinear(panorama, view), options.image), yaw, options.field_of_view});
    if (options.views == Views::kFront) break;
  }
  return all;
}

View viewOf(const cv::Mat1b& grey, double yaw, double field_of_view) {
  Panorama all{{}, {}, {}, cv::Mat1b(grey.size(), std::uint8_t(255))};
  grey.convertTo(all.intensity, CV_32F);
  return {normalizedImage(all, Image::kIntensity), yaw, field_of_view};
}

std::vector<Turn> bestTurns(const std::vector<float>& by_step, std::size_t count) {
  const int steps = static_cast<int>(by_step.size());
  const double step = 2.0 * M_PI / steps;
  const int reach = std::min(std::max(1, static_cast<int>(kNearTurn / step)), (steps - 1) / 2);
  std::vector<Turn> turns;
  for (int s = 0; s < steps; ++s) {
    const auto at = [&](int i) { return by_step[i < 0 ? i + steps : i >= steps ? i - steps : i]; };
    bool largest = true;
    for (int d = 1; d <= reach && largest; ++d) largest = largest && at(s - d) < at(s) && at(s + d) <= at(s);
    if (!largest) continue;
    // The parabola through the largest and its neighbours.
    const double bend = at(s - 1) - 2.0 * at(s) + at(s + 1);
    const double fraction = bend < 0.0 ? 0.5 * (at(s - 1) - at(s + 1)) / bend : 0.0;
    turns.push_back({at(s), std::remainder(-(s + fraction) * step, 2.0 * M_PI)});
  }
  std::sort(turns.begin(), turns.end(),
            [](const Turn& a, const Turn& b) { return a.similarity > b.similarity; });
  if (turns.size() > count) turns.resize(count);
  return turns;
}

}  // namespace intensity_place_recognition
