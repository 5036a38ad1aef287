// SPDX-License-Identifier: BSD-3-Clause
#include "intensity_place_recognition/place_recognizer.h"

#include <mapping_common/archive.h>

#include <algorithm>
#include <cmath>
#include <stdexcept>
#include <utility>

#include "intensity_place_recognition/scan_check.h"

namespace intensity_place_recognition {
namespace {

const mapping_common::ArchiveFormat kFormat{"PLACEDB1", "a database of places"};
constexpr std::size_t kLeastPlace = 64;  // bytes of a place in a file, at least

Cloud measuredIn(const Cloud& all) {
  Cloud measured;
  measured.reserve(all.size());
  for (const pcl::PointXYZI& p : all)
    if (isMeasured(p)) measured.push_back(p);
  return measured;
}

}  // namespace

void PlaceRecognizerOptions::describe(mapping_common::OptionList& o) {
  o.group("panorama", "the scan as an image", panorama);
  o("panorama/largest_hole", largest_hole, "pixels", "between pixels that were seen: filled. 0: none")
      .within(0, 1000);
  o.group("description", "of the whole scene", description);
  o.group("shape", "what is kept to verify places and measure poses", shape);
  o.section("the search");
  o("neighbours", neighbours, "", "places from the index that are compared at all turns").within(1, 100000);
  o("candidates", candidates, "", "of them, the most similar, whose ground plans are compared")
      .within(1, 1000);
  o("turns", turns, "", "the most similar turns, that are tried for each").within(1, 24);
  o("registrations", registrations, "",
    "of them, the best by what stands where, that are registered until one is accepted")
      .within(1, 1000);
  o("beta", beta, "", "the last scans, which aren't places to be found again").within(0, 1000000);
  o.group("registration", "verification and pose", registration);
}

const char* stageName(Stage stage) {
  static constexpr std::array<const char*, kStages> kNames = {"Panorama", "Description", "Shape", "Search",
                                                              "Verification"};
  return kNames[static_cast<std::size_t>(stage)];
}

PlaceRecognizer::PlaceRecognizer(const PlaceRecognizerOptions& options)
    : options_(mapping_common::validate(options)), description_(makeDescription(options.description)) {}

Place PlaceRecognizer::describe(const Cloud& all, const std::function<void(Stage)>& done) const {
  checkScan(all, options_.panorama);
  const Cloud cloud = measuredIn(all);
  const Panorama panorama = toPanorama(cloud, options_.panorama, options_.largest_hole);
  done(Stage::kPanorama);
  Place place;
  place.signature = Signature(description_->describe({cloud, panorama}));
  done(Stage::kDescription);
  place.shape = Shape(cloud, panorama, options_.shape);
  done(Stage::kShape);
  return place;
}

Recognition PlaceRecognizer::process(const Cloud& cloud, const std::function<void(Stage)>& done) {
  Place place = describe(cloud, done);
  const Recognition result = recognize(place, places(), done);
  add(std::move(place));
  return result;
}

void PlaceRecognizer::add(Place place) {
  index_.add(place.signature.key());
  places_.push_back(std::move(place));
}

std::vector<Candidate> PlaceRecognizer::candidates(const Signature& signature, int before) const {
  std::vector<Candidate> result;
  if (before <= 0) return result;
  for (const std::size_t i : index_.nearest(signature.key(), options_.neighbours, before))
    result.push_back({static_cast<int>(i), signature.bestTurns(places_[i].signature, options_.turns)});
  const auto similarity = [](const Candidate& c) {
    return c.turns.empty() ? -1.0f : c.turns.front().similarity;
  };
  std::sort(result.begin(), result.end(), [&](const Candidate& a, const Candidate& b) {
    return std::make_pair(-similarity(a), a.place) < std::make_pair(-similarity(b), b.place);
  });
  if (result.size() > static_cast<std::size_t>(options_.candidates)) result.resize(options_.candidates);
  return result;
}

Recognition PlaceRecognizer::recognize(const Place& place, int query,
                                       const std::function<void(Stage)>& done) const {
  Recognition result;
  result.query = query;
  const std::vector<Candidate> all = candidates(place.signature, std::min(query, places()) - options_.beta);
  done(Stage::kSearch);
  struct Trial {
    const Candidate* candidate;
    std::unique_ptr<Registrar> registrar;
    Guess guess;
  };
  std::vector<Trial> trials;
  for (const Candidate& candidate : all) {
    std::vector<double> yaws;
    for (const Signature::Turn& turn : candidate.turns) yaws.push_back(turn.yaw);
    auto registrar = std::make_unique<Registrar>(places_[candidate.place].shape, options_.registration);
    const Guess guess = registrar->guess(place.shape, yaws);
    trials.push_back({&candidate, std::move(registrar), guess});
  }
  std::stable_sort(trials.begin(), trials.end(),
                   [](const Trial& a, const Trial& b) { return a.guess.correlation > b.guess.correlation; });
  if (trials.size() > static_cast<std::size_t>(options_.registrations)) trials.resize(options_.registrations);
  for (const Trial& trial : trials) {
    const Registration registration = (*trial.registrar)(place.shape, trial.guess);
    if (result.match >= 0 && registration.score <= result.registration.score) continue;
    result.match = trial.candidate->place;
    result.similarity = trial.candidate->turns.empty() ? 0.0f : trial.candidate->turns.front().similarity;
    result.registration = registration;
    if (registration.accepted) break;
  }
  done(Stage::kVerification);
  return result;
}

void PlaceRecognizer::save(const std::string& path) const {
  mapping_common::writeArchive(path, kFormat, [&](mapping_common::ArchiveWriter& out) {
    PlaceRecognizerOptions options = options_;
    out(mapping_common::optionsOf(options));
    out(static_cast<std::uint64_t>(places_.size()));
    for (Place place : places_) {
      place.signature.transfer(out);
      place.shape.transfer(out);
    }
  });
}

void PlaceRecognizer::load(const std::string& path) {
  PlaceRecognizerOptions file;
  std::vector<Place> read;
  mapping_common::readArchive(path, kFormat, [&](mapping_common::ArchiveReader& in) {
    in(mapping_common::optionsOf(file));
    mapping_common::validate(file);
    read.resize(in.count(kLeastPlace));
    for (Place& place : read) {
      place.signature.transfer(in);
      place.shape.transfer(in);
      if (!place.signature.isSound() || !place.shape.isSound() ||
          place.signature.key().size() != read.front().signature.key().size())
        throw std::runtime_error("a place in it is inconsistent");
    }
  });
  PlaceRecognizerOptions merged = options_;
  merged.panorama = file.panorama;
  merged.largest_hole = file.largest_hole;
  merged.description = file.description;
  PlaceRecognizer loaded(merged);
  for (Place& place : read) loaded.add(std::move(place));
  *this = std::move(loaded);
}

}  // namespace intensity_place_recognition
