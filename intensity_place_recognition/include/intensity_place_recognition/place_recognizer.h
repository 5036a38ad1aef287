// SPDX-License-Identifier: BSD-3-Clause
//
// Recognises places in 3D scans: scans go in one by one, and for each the place that it shows comes out.
#pragma once

#include <array>
#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "intensity_place_recognition/place_index.h"
#include "intensity_place_recognition/registration.h"
#include "intensity_place_recognition/scene_description.h"

namespace intensity_place_recognition {

struct PlaceRecognizerOptions {
  PanoramaOptions panorama;
  int largest_hole = 4;
  DescriptionOptions description;
  ShapeOptions shape;
  int neighbours = 50, candidates = 6, turns = 3, registrations = 2;
  int beta = 0;
  RegistrationOptions registration;

  void describe(mapping_common::OptionList& o);
};

/// What is kept of a scan.
struct Place {
  Signature signature;
  Shape shape;
};

struct Candidate {
  int place = -1;
  std::vector<Signature::Turn> turns;  ///< the best first
};

struct Recognition {
  int query = -1;           ///< number of the scan; from 0
  int match = -1;           ///< of the most likely place, -1: there is none before it
  float similarity = 0.0f;  ///< of the descriptions
  Registration registration;
};

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
  /// Those that look like it most, the best first, among the places before `before`.
  std::vector<Candidate> candidates(const Signature& signature, int before) const;

  int places() const { return static_cast<int>(places_.size()); }
  const Place& place(int number) const { return places_.at(number); }
  const PlaceRecognizerOptions& options() const { return options_; }
  void setMinScore(double score) { options_.registration.min_score = score; }

  /// @throws std::runtime_error that names the file and what is wrong; load changes nothing then. It brings
  /// the
  ///   options that scans were described with.
  void save(const std::string& path) const;
  void load(const std::string& path);

 private:
  PlaceRecognizerOptions options_;
  std::unique_ptr<SceneDescription> description_;
  std::vector<Place> places_;
  PlaceIndex index_;
};

}  // namespace intensity_place_recognition
