// SPDX-License-Identifier: BSD-3-Clause
//
// Recognises places in 3D scans: scans go in one by one, and for each the place that it shows comes out.
#pragma once

#include <algorithm>
#include <array>
#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "intensity_place_recognition/alignment.h"
#include "intensity_place_recognition/ground_plan.h"
#include "intensity_place_recognition/registration.h"
#include "intensity_place_recognition/scene_description.h"

namespace intensity_place_recognition {

struct PlaceRecognizerOptions {
  PanoramaOptions panorama;
  int largest_hole = 4;
  DescriptionOptions description;
  ShapeOptions shape;
  int neighbours = 1000, turns = 3, plans = 400, candidates = 250, alignments = 20, registrations = 2;
  int matches = 1;
  double min_margin = 1.25;
  int beta = 0;
  RegistrationOptions registration;

  void describe(mapping_common::OptionList& o);
};

/// What a scan is recognised by.
struct Place {
  std::shared_ptr<const Signature> signature;
  Shape shape;
};

struct Recognition {
  int query = -1;           ///< number of the scan; from 0
  int match = -1;           ///< of the most likely place, -1: there is none before it
  float similarity = 0.0f;  ///< of the descriptions
  Registration registration;
  /// By how many standard deviations its intensities correlate better than those of any rival: another place,
  /// or another pose at it, where the shape fits about as well. 100: there is none
  double margin = 0.0;
  std::vector<Recognition> others;  ///< accepted at further places, where PlaceRecognizerOptions::matches > 1
};

/// At least 1 where a place is accepted: how far the criterion that is met the least is above its threshold.
double confidence(const Recognition& recognition, const PlaceRecognizerOptions& options);
/// Why the most likely place isn't accepted; empty where it is.
std::string refusal(const Recognition& recognition, const PlaceRecognizerOptions& options);

enum class Stage { kPanorama, kDescription, kShape, kSearch, kVerification };
constexpr int kStages = 5;
const char* stageName(Stage stage);

class PlaceRecognizer {
 public:
  explicit PlaceRecognizer(const PlaceRecognizerOptions& options = {});

  /// @param done called after each stage, to take the time
  /// @throws std::invalid_argument that says why a cloud can't be described; nothing is added then
  Recognition process(
      const Cloud& cloud, const std::function<void(Stage)>& done = [](Stage) {});
  /// The same without adding it.
  Recognition recognize(
      const Place& place, int query, const std::function<void(Stage)>& done = [](Stage) {}) const;
  Place describe(
      const Cloud& cloud, const std::function<void(Stage)>& done = [](Stage) {}) const;
  void add(Place place);

  int places() const { return static_cast<int>(places_.size()); }
  /// How all are described, with the places.
  const SceneDescription& description() const { return *description_; }
  const PlaceRecognizerOptions& options() const { return options_; }
  /// Takes over those that decide what is accepted.
  void setThresholds(const PlaceRecognizerOptions& options);

  /// @throws std::runtime_error that names the file and what is wrong; load changes nothing then. It brings
  /// the
  ///   options that scans were described with.
  void save(const std::string& path) const;
  void load(const std::string& path);

 private:
  /// A place and a pose there that a scan may have been taken from.
  struct Hypothesis {
    int place = -1;
    float similarity = 0.0f;  ///< of the descriptions
    Alignment alignment;
    double quality() const { return alignment.fit * std::max(0.0, alignment.intensity.value); }
  };
  /// The best by what stands where and how light it is, seen from above.
  std::vector<Hypothesis> hypotheses(const Place& place, int before) const;
  /// Roughly, and the best of them better; these are left, the best first.
  void align(const Aligner& aligner, std::vector<Hypothesis>& all) const;
  double margin(const Hypothesis& best, const Registration& found, const std::vector<Hypothesis>& all) const;

  PlaceRecognizerOptions options_;
  std::unique_ptr<SceneDescription> description_;
  /// What is kept of a place beside its description. All is of the packed shape, which files have.
  struct Kept {
    Kept(PackedShape packed, const Shape& unpacked);
    PackedShape shape;
    WallDirections walls;
    PackedPlan plan;
  };
  std::vector<Kept> places_;
};

}  // namespace intensity_place_recognition
