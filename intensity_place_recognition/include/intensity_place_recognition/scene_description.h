// SPDX-License-Identifier: BSD-3-Clause
//
// Descriptions of a whole scene (4.5.2), and the places that are found again by them.
//
// What a description is made of, how two of them are compared and how they are looked up differ: global ones
// (global_description.h) are vectors for each direction, local ones (local_description.h) the words of a
// vocabulary. All say which places look like a scene, and how the sensor is turned there.
#pragma once

#include <mapping_common/archive.h>
#include <mapping_common/options.h>

#include <functional>
#include <memory>
#include <string>
#include <vector>

#include "intensity_place_recognition/panorama.h"

namespace intensity_place_recognition {

enum class Image { kIntensity, kRange };
constexpr auto choicesOf(Image) {
  return mapping_common::choices<Image>(
      {{"intensity", Image::kIntensity, "light or dark"}, {"range", Image::kRange, "near or far"}});
}

enum class Views { kPanorama, kFront, kFrontAndBack };
constexpr auto choicesOf(Views) {
  return mapping_common::choices<Views>(
      {{"panorama", Views::kPanorama, "all around"},
       {"front", Views::kFront, "what a camera that looks ahead would see"},
       {"front_and_back", Views::kFrontAndBack, "two of them; a place is recognised in either"}});
}

struct DescriptionOptions {
  std::string type = "polar";
  Image image = Image::kIntensity;
  Views views = Views::kPanorama;
  double field_of_view = M_PI / 2.0;
  int cell = 8;
  double sigma = 1.0;
  int blocks = 4, scales = 3, orientations = 6;
  int rings = 20, directions = 120;
  double radius = 60.0;
  double delta = 0.4;
  int binary_delta = 80;
  int features = 500;
  double psi = 0.1;

  void describe(mapping_common::OptionList& o);
};

/// An image that a scene is described from.
struct View {
  cv::Mat1f image;             ///< 0 to 1, of what is 0 nothing was seen
  double yaw = 0.0;            ///< rad, azimuth of its middle
  double field_of_view = 0.0;  ///< rad, from left to right; 0: a panorama, whose edges meet

  bool isPanorama() const { return field_of_view == 0.0; }
  /// @param x pixels, 0 is the middle of the first. @return rad
  double azimuthAt(double x) const;
  /// With so many more pixels on each side: what is there in a panorama, otherwise the edges' repeated.
  cv::Mat1f padded(int columns, int rows = 0) const;
};
/// What of a panorama is described.
std::vector<View> viewsOf(const Panorama& panorama, const DescriptionOptions& options);
/// What a camera saw, which is treated as intensities are. @param grey of 8 bits
View viewOf(const cv::Mat1b& grey, double yaw, double field_of_view);

/// The image of a panorama that is described, 0 to 1, whatever the scanner's own scale is: intensities by the
/// ranks of what was seen; ranges by 1 - exp(-range / 20 m), where the thesis divides by the greatest.
cv::Mat1f normalizedImage(const Panorama& panorama, Image image);

/// What a scan is described from.
struct Scene {
  const Cloud& cloud;                        ///< sensor frame, z up
  double min_range;                          ///< m, what is nearer is the robot itself
  std::function<std::vector<View>()> views;  ///< the same number for all scenes
};

/// What a description says of a scene; it alone knows what that is.
class Signature {
 public:
  virtual ~Signature() = default;
};

/// How the sensor is turned at a place.
struct Turn {
  float similarity = 0.0f;
  double yaw = 0.0;  ///< rad, (-pi, pi]: of the query's sensor seen from the place's
};
/// The largest values that are each the largest in 15 degrees around, the best first.
/// @param by_step of equal steps of a whole turn, to the right: the yaw at i is -i * 2 pi / size
std::vector<Turn> bestTurns(const std::vector<float>& by_step, std::size_t count);

/// A place that looks like a scene, from somewhere near.
struct Candidate {
  int place = -1;
  float similarity = 0.0f;   ///< larger: more alike; of what scale, its description knows
  std::vector<double> yaws;  ///< rad, the most likely first; as Turn::yaw
};

/// A way to describe scenes, with the places that were described. A new one is a class in a file of its own
/// and a row of `sceneDescriptions()`.
class SceneDescription {
 public:
  virtual ~SceneDescription() = default;
  /// @throws std::invalid_argument that says why it can't be described
  virtual std::shared_ptr<const Signature> describe(const Scene& scene) const = 0;

  /// The next place, of what `describe` made.
  virtual void add(const std::shared_ptr<const Signature>& signature) = 0;
  virtual int places() const = 0;
  /// The `count` places among the first `before` that look the most like it, each with its best `turns`.
  virtual std::vector<Candidate> candidates(const Signature& signature, int before, int count,
                                            int turns) const = 0;
  /// Of two places, as Candidate::similarity.
  virtual float similarity(int a, int b) const = 0;

  /// All places; `read` throws std::runtime_error where they are inconsistent.
  virtual void write(mapping_common::ArchiveWriter& out) const = 0;
  virtual void read(mapping_common::ArchiveReader& in) = 0;
};

/// Name -> class. @throws std::invalid_argument for a name that isn't there
using MakeDescription = std::unique_ptr<SceneDescription> (*)(const DescriptionOptions&);
const mapping_common::Table<MakeDescription>& sceneDescriptions();
std::unique_ptr<SceneDescription> makeDescription(const DescriptionOptions& options);

// The rows of the table.
std::unique_ptr<SceneDescription> makeHog(const DescriptionOptions& options);
std::unique_ptr<SceneDescription> makeGist(const DescriptionOptions& options);
std::unique_ptr<SceneDescription> makePolar(const DescriptionOptions& options);
std::unique_ptr<SceneDescription> makeWords(const DescriptionOptions& options);
std::unique_ptr<SceneDescription> makeBinary(const DescriptionOptions& options);
std::unique_ptr<SceneDescription> makeShot(const DescriptionOptions& options);
std::unique_ptr<SceneDescription> makeShotColour(const DescriptionOptions& options);

}  // namespace intensity_place_recognition
