// SPDX-License-Identifier: BSD-3-Clause
#include "intensity_place_recognition/place_recognizer.h"

#include <mapping_common/archive.h>

#include <algorithm>
#include <cmath>
#include <iomanip>
#include <set>
#include <sstream>
#include <stdexcept>
#include <utility>

#include "intensity_place_recognition/alignment.h"
#include "intensity_place_recognition/scan_check.h"

namespace intensity_place_recognition {
namespace {

const mapping_common::ArchiveFormat kFormat{"PLACEDB2", "a database of places", 1, 2};
constexpr std::size_t kLeastPlace = 32;  // bytes of a place in a file, at least
constexpr int kYaws = 120;               // of a query's plans
constexpr double kParallax = 0.14;       // rad, that descriptions may err as the sensor is some metres beside
constexpr std::size_t kPeaks = 3;        // shifts at each turn
constexpr double kSamePose = 2.5, kSameYaw = 0.17;  // m, rad
constexpr double kOnePose = 0.5, kOneYaw = 0.05;    // m, rad
constexpr double kLikeShape = 0.8;                  // of the best one's fit
constexpr double kLessEvidence = 0.8;               // that two places are one, where the query says so, too
constexpr double kNoRival = 100.0;                  // standard deviations

Eigen::Isometry3d flatPose(double x, double y, double yaw) {
  Eigen::Isometry3d pose(Eigen::AngleAxisd(yaw, Eigen::Vector3d::UnitZ()));
  pose.translation() << x, y, 0.0;
  return pose;
}

bool samePose(const Eigen::Isometry3d& a, const Eigen::Isometry3d& b, double within = kSamePose,
              double yaw_within = kSameYaw) {
  const Eigen::Isometry3d difference = a.inverse() * b;
  return difference.translation().norm() < within &&
         Eigen::AngleAxisd(difference.linear()).angle() < yaw_within;
}

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
  o("turns", turns, "", "the most similar turns of each, at which plans of shape and light are compared")
      .within(1, 24);
  o("plans", plans, "", "of them, the best by plans to 2 m, that are compared to 1 m").within(1, 10000);
  o("candidates", candidates, "", "of them, the best by these plans, that are aligned roughly")
      .within(1, 10000);
  o("alignments", alignments, "", "of them, the best by shape and intensities, that are aligned better")
      .within(1, 1000);
  o("registrations", registrations, "",
    "of them, the best by shape and intensities, that are registered until as many as matches are accepted")
      .within(1, 1000);
  o("matches", matches, "",
    "places that a scan is registered to at most; more than 1 where a graph is made of them alone")
      .within(1, 1000);
  o("min_margin", min_margin, "",
    "standard deviations by which intensities correlate better than at any other place of like shape; 0 for "
    "scanners without intensities")
      .within(0.0, 100.0)
      .dynamic();
  o("beta", beta, "", "the last scans, which aren't places to be found again").within(0, 1000000);
  o.group("registration", "verification and pose", registration);
}

double confidence(const Recognition& recognition, const PlaceRecognizerOptions& options) {
  const Registration& r = recognition.registration;
  const RegistrationOptions& o = options.registration;
  const auto part = [](double value, double least) { return least > 0.0 ? value / least : 1e3; };
  return std::min({part(r.score, o.min_score), part(r.evidence, o.min_evidence),
                   part(recognition.margin, options.min_margin), part(r.intensity.pieces, o.min_pieces)});
}

std::string refusal(const Recognition& recognition, const PlaceRecognizerOptions& options) {
  const Registration& r = recognition.registration;
  const RegistrationOptions& o = options.registration;
  if (r.accepted) return "";
  if (recognition.match < 0) return "no place before it";
  std::ostringstream text;
  text << std::setprecision(3);
  const auto below = [&](double value, const char* what, double least, const char* option) {
    if (value < least)
      text << (text.tellp() > 0 ? "; " : "") << value << what << ", less than " << option << ' ' << least;
  };
  below(r.score, " of the surfaces agree", o.min_score, "min_score");
  below(r.intensity.pieces, " cubes of 2 m with surfaces that both see", o.min_pieces, "min_pieces");
  below(r.evidence, " standard deviations of evidence", o.min_evidence, "min_evidence");
  below(recognition.margin, " standard deviations above a rival", options.min_margin, "min_margin");
  if (r.pose.translation().norm() > o.max_distance)
    text << (text.tellp() > 0 ? "; " : "") << r.pose.translation().norm()
         << " m away, more than max_distance " << o.max_distance;
  return text.str();
}

const char* stageName(Stage stage) {
  static constexpr std::array<const char*, kStages> kNames = {"Panorama", "Description", "Shape", "Search",
                                                              "Verification"};
  return kNames[static_cast<std::size_t>(stage)];
}

PlaceRecognizer::Kept::Kept(PackedShape packed, const Shape& unpacked)
    : shape(std::move(packed)), walls(unpacked), plan(GroundPlan(unpacked, 0.0)) {}

PlaceRecognizer::PlaceRecognizer(const PlaceRecognizerOptions& options)
    : options_(mapping_common::validate(options)), description_(makeDescription(options.description)) {}

Place PlaceRecognizer::describe(const Cloud& all, const std::function<void(Stage)>& done) const {
  checkScan(all, options_.panorama);
  const bool whole = std::all_of(all.begin(), all.end(), isMeasured);
  const Cloud measured = whole ? Cloud() : measuredIn(all);
  const Cloud& cloud = whole ? all : measured;
  const Panorama panorama = toPanorama(cloud, options_.panorama, options_.largest_hole);
  done(Stage::kPanorama);
  Place place;
  place.signature = description_->describe(
      {cloud, options_.panorama.min_range, [&] { return viewsOf(panorama, options_.description); }});
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
  description_->add(place.signature);
  PackedShape packed(place.shape);
  const Shape unpacked = packed.unpacked();
  places_.emplace_back(std::move(packed), unpacked);
}

std::vector<PlaceRecognizer::Hypothesis> PlaceRecognizer::hypotheses(const Place& place, int before) const {
  const auto reach = static_cast<float>(options_.registration.max_distance);
  struct Likely {
    int place = -1;
    float similarity = 0.0f;   // of the descriptions
    float correlation = 0.0f;  // of the plans
    int turn = 0;              // of the plan
    GroundPlan::Shift shift;
  };
  const auto keepBest = [](std::vector<Likely>& all, int count) {
    const auto kept = all.begin() + std::min<std::ptrdiff_t>(static_cast<std::ptrdiff_t>(all.size()), count);
    std::partial_sort(all.begin(), kept, all.end(), [](const Likely& a, const Likely& b) {
      return std::make_pair(-a.correlation, a.place) < std::make_pair(-b.correlation, b.place);
    });
    all.erase(kept, all.end());
  };
  const WallDirections walls(place.shape);
  std::vector<GroundPlan> turned(kYaws);
  const auto planAt = [&](int turn) -> const GroundPlan& {
    if (turned[turn].empty()) {
      const GroundPlan& opposite = turned[(turn + kYaws / 2) % kYaws];
      turned[turn] =
          opposite.empty() ? GroundPlan(place.shape, 2.0 * M_PI / kYaws * turn) : opposite.halfTurned();
    }
    return turned[turn];
  };
  std::vector<Likely> rough, fine;
  for (const Candidate& candidate :
       description_->candidates(*place.signature, before, options_.neighbours, options_.turns)) {
    const Kept& there = places_[candidate.place];
    for (const double likely : candidate.yaws) {
      const double yaw = walls.bestYaw(there.walls, likely, kParallax);
      Likely h;
      h.place = candidate.place;
      h.similarity = candidate.similarity;
      h.turn = (static_cast<int>(std::lround(yaw / (2.0 * M_PI) * kYaws)) + 2 * kYaws) % kYaws;
      h.correlation = planAt(h.turn).roughShift(there.plan, reach).correlation;
      rough.push_back(h);
    }
  }
  keepBest(rough, options_.plans);
  for (Likely& h : rough) {
    for (const GroundPlan::Shift& shift : planAt(h.turn).bestShifts(places_[h.place].plan, reach, kPeaks)) {
      h.correlation = shift.correlation;
      h.shift = shift;
      fine.push_back(h);
    }
  }
  keepBest(fine, options_.candidates);
  std::vector<Hypothesis> result;
  for (const Likely& h : fine) {
    Alignment alignment;
    alignment.pose = flatPose(h.shift.x, h.shift.y, 2.0 * M_PI / kYaws * h.turn);
    result.push_back({h.place, h.similarity, alignment});
  }
  return result;
}

void PlaceRecognizer::align(const Aligner& aligner, std::vector<Hypothesis>& all) const {
  const auto byQuality = [&] {
    std::stable_sort(all.begin(), all.end(),
                     [](const Hypothesis& a, const Hypothesis& b) { return a.quality() > b.quality(); });
  };
  // Place by place, as each is read from memory then.
  std::stable_sort(all.begin(), all.end(),
                   [](const Hypothesis& a, const Hypothesis& b) { return a.place < b.place; });
  for (Hypothesis& h : all) h.alignment = aligner(places_[h.place].shape, h.alignment.pose, Aligner::kLittle);
  byQuality();
  std::vector<Hypothesis> kept;
  for (const Hypothesis& h : all) {
    if (static_cast<int>(kept.size()) == options_.alignments) break;
    const bool known = std::any_of(kept.begin(), kept.end(), [&](const Hypothesis& other) {
      return other.place == h.place && samePose(other.alignment.pose, h.alignment.pose, kOnePose, kOneYaw);
    });
    if (!known) kept.push_back(h);
  }
  all = std::move(kept);
  for (Hypothesis& h : all) h.alignment = aligner(places_[h.place].shape, h.alignment.pose);
  byQuality();
}

double PlaceRecognizer::margin(const Hypothesis& best, const Registration& found,
                               const std::vector<Hypothesis>& all) const {
  const Correlation own{std::max(found.intensity.value, best.alignment.intensity.value),
                        found.intensity.pieces};
  std::vector<std::pair<double, const Hypothesis*>> rivals;
  for (const Hypothesis& h : all) {
    const bool same = h.place == best.place && samePose(h.alignment.pose, found.pose);
    if (&h != &best && !same && h.alignment.fit >= kLikeShape * best.alignment.fit)
      rivals.emplace_back(evidence(own, h.alignment.intensity), &h);
  }
  std::sort(rivals.begin(), rivals.end());
  Shape match;
  std::unique_ptr<Aligner> at_match;
  for (const auto& [by, h] : rivals) {
    if (by >= options_.min_margin || h->place == best.place) return by;
    // Where the query's poses say that both show one place, do they?
    if (!at_match) {
      match = places_[best.place].shape.unpacked();
      at_match = std::make_unique<Aligner>(match);
    }
    const Eigen::Isometry3d between = h->alignment.pose * found.pose.inverse();
    const Alignment same = (*at_match)(places_[h->place].shape, between);
    if (!samePose(between, same.pose) || evidence(same.intensity, options_.registration.min_intensity) <
                                             kLessEvidence * options_.registration.min_evidence)
      return by;
  }
  return kNoRival;
}

Recognition PlaceRecognizer::recognize(const Place& place, int query,
                                       const std::function<void(Stage)>& done) const {
  Recognition result;
  result.query = query;
  std::vector<Hypothesis> all = hypotheses(place, std::min(query, places()) - options_.beta);
  done(Stage::kSearch);
  align(Aligner(place.shape), all);
  const Registrar registrar(place.shape, options_.registration);
  std::set<int> registered;  // places
  const auto found = [&](const Hypothesis& h, const Registration& registration) {
    Recognition r;
    r.query = query;
    r.match = h.place;
    r.similarity = h.similarity;
    r.registration = registration;
    if (registration.accepted) {
      registered.insert(h.place);
      r.margin = margin(h, registration, all);
      r.registration.accepted = r.margin >= options_.min_margin;
    }
    return r;
  };
  const Hypothesis* best = nullptr;
  int left = options_.registrations;
  for (const Hypothesis& h : all) {
    if (registered.count(h.place) > 0) continue;
    if (left-- == 0) break;
    const Registration registration = registrar(places_[h.place].shape.unpacked(), h.alignment.pose);
    if (!registered.empty()) {
      Recognition other = found(h, registration);
      if (other.registration.accepted) result.others.push_back(std::move(other));
    } else if (!best || registration.accepted || registration.evidence > result.registration.evidence) {
      best = &h;
      result = found(h, registration);
    }
    if (registered.size() == static_cast<std::size_t>(options_.matches)) break;
  }
  if (best && registered.empty()) result.margin = margin(*best, result.registration, all);
  done(Stage::kVerification);
  return result;
}

void PlaceRecognizer::setThresholds(const PlaceRecognizerOptions& options) {
  options_.min_margin = options.min_margin;
  options_.registration.min_score = options.registration.min_score;
  options_.registration.min_intensity = options.registration.min_intensity;
  options_.registration.min_evidence = options.registration.min_evidence;
  options_.registration.min_pieces = options.registration.min_pieces;
}

void PlaceRecognizer::save(const std::string& path) const {
  mapping_common::writeArchive(path, kFormat, [&](mapping_common::ArchiveWriter& out) {
    PlaceRecognizerOptions options = options_;
    out(mapping_common::optionsOf(options));
    out(static_cast<std::uint64_t>(places_.size()));
    for (const Kept& place : places_) {
      PackedShape shape = place.shape;
      shape.transfer(out);
    }
    description_->write(out);
  });
}

void PlaceRecognizer::load(const std::string& path) {
  std::unique_ptr<PlaceRecognizer> loaded;
  mapping_common::readArchive(path, kFormat, [&](mapping_common::ArchiveReader& in) {
    PlaceRecognizerOptions file, merged = options_;
    in(mapping_common::optionsOf(file));
    mapping_common::validate(file);
    merged.panorama = file.panorama;
    merged.largest_hole = file.largest_hole;
    merged.description = file.description;
    loaded = std::make_unique<PlaceRecognizer>(merged);
    for (std::size_t left = in.count(kLeastPlace); left > 0; --left) {
      PackedShape packed;
      if (in.version() == 1) {
        Shape shape;
        shape.transfer(in);
        packed = PackedShape(shape);
      } else {
        packed.transfer(in);
      }
      const Shape unpacked = packed.unpacked();
      if (!unpacked.isSound()) throw std::runtime_error("a place in it is inconsistent");
      loaded->places_.emplace_back(std::move(packed), unpacked);
    }
    loaded->description_->read(in);
    if (loaded->description_->places() != loaded->places())
      throw std::runtime_error("some places in it aren't described");
  });
  *this = std::move(*loaded);
}

}  // namespace intensity_place_recognition
