// SPDX-License-Identifier: BSD-3-Clause
//
// Descriptions of a whole scene (4.5.2), and their comparison at all azimuths at once.
//
// A description is a matrix with a column for each direction of azimuth. Where the sensor is turned, its
// columns move in a circle; so the cosine similarity at all turns is a circular correlation, which the
// Fourier transform of the rows makes a product, and the magnitudes of that transform don't change at all.
#pragma once

#include <mapping_common/options.h>

#include <complex>
#include <memory>
#include <string>
#include <vector>

#include "intensity_place_recognition/panorama.h"

namespace intensity_place_recognition {

/// What a scan is described from.
struct Scene {
  const Cloud& cloud;        ///< sensor frame, z up
  const Panorama& panorama;  ///< of it, its holes filled
};

/// A way to describe scenes. A new one is a class in a file of its own and a row of `sceneDescriptions()`.
class SceneDescription {
 public:
  virtual ~SceneDescription() = default;
  /// Features x directions, of the same size for all scenes; column i is about the azimuth
  /// pi - (i + 0.5) * 2 pi / columns, as in a panorama.
  virtual cv::Mat1f describe(const Scene& scene) const = 0;
};

enum class Image { kIntensity, kRange };
constexpr auto choicesOf(Image) {
  return mapping_common::choices<Image>(
      {{"intensity", Image::kIntensity, "light or dark"}, {"range", Image::kRange, "near or far"}});
}

struct DescriptionOptions {
  std::string type = "polar";
  Image image = Image::kIntensity;
  int cell = 8;
  double sigma = 1.0;
  int blocks = 4, scales = 3, orientations = 6;
  int rings = 20, directions = 120;
  double radius = 60.0;

  void describe(mapping_common::OptionList& o);
};

/// Name -> class. @throws std::invalid_argument for a name that isn't there
using MakeDescription = std::unique_ptr<SceneDescription> (*)(const DescriptionOptions&);
const mapping_common::Table<MakeDescription>& sceneDescriptions();
std::unique_ptr<SceneDescription> makeDescription(const DescriptionOptions& options);

// The rows of the table.
std::unique_ptr<SceneDescription> makeHog(const DescriptionOptions& options);
std::unique_ptr<SceneDescription> makeGist(const DescriptionOptions& options);
std::unique_ptr<SceneDescription> makePolar(const DescriptionOptions& options);

/// The image of a panorama that is described, 0 to 1, whatever the scanner's own scale is: intensities by the
/// ranks of what was seen; ranges by 1 - exp(-range / 20 m), where the thesis divides by the greatest.
cv::Mat1f normalizedImage(const Panorama& panorama, Image image);

/// A description, ready to be compared.
class Signature {
 public:
  Signature() = default;
  /// Rows' means are left out: they say nothing about directions. @throws std::invalid_argument if all
  /// columns are alike
  explicit Signature(const cv::Mat1f& description);

  /// The cosine similarity to `other` turned by each step, -1 to 1. At s, what is in column i of this is in
  /// column i + s of `other`.
  std::vector<float> similarities(const Signature& other) const;
  struct Turn {
    float similarity = -1.0f;
    double yaw = 0.0;  ///< rad, (-pi, pi]: of this one's sensor seen from the other's
  };
  /// The largest similarities over all turns that are each the largest in 15 degrees around, the best first.
  std::vector<Turn> bestTurns(const Signature& other, std::size_t count) const;

  /// Of length 1, the same however the sensor is turned: the magnitudes of the lowest frequencies of
  /// neighbouring rows.
  const std::vector<float>& key() const { return key_; }
  /// What was read from a file may not be.
  bool isSound() const;

  template <class Archive>
  void transfer(Archive& archive) {
    archive(rows_);
    archive(columns_);
    archive(spectrum_);
    archive(key_);
  }

 private:
  int rows_ = 0, columns_ = 0;
  std::vector<std::complex<float>> spectrum_;  // rows x (columns / 2 + 1), of a description of length 1
  std::vector<float> key_;
};

}  // namespace intensity_place_recognition
