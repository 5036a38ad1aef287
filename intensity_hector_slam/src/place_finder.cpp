// SPDX-License-Identifier: BSD-3-Clause
#include "intensity_hector_slam/place_finder.h"

#include <algorithm>
#include <cmath>
#include <sstream>
#include <vector>

#include "cost.h"

namespace intensity_hector_slam {
namespace {

constexpr int kCandidates = 4;
constexpr double kLeastShare = 0.8;  // of the best score: on the grid it may differ by as much
constexpr double kReachDistance = 0.3, kReachAngle = 0.15;  // m, rad: of a match, from the grid

// Reflectivities of calibrated scans are within a few percent of those that the map has around.
constexpr double kMaxDifference = 0.03;

// Of a beam on the fine level, in cells: how far what it ends on may be, and how far what it passes.
constexpr int kNear = 1, kBeside = 2, kPassed = 10;

bool isNear(const Pose& a, const Pose& b, double distance, double angle) {
  return (a - b).head<2>().norm() <= distance && std::abs(wrapAngle(a.z() - b.z())) <= angle;
}

// The coarsest level that is fine enough.
const GridMap& levelFor(const MultiMap& map, double cell) {
  int level = 0;
  while (level + 1 < map.levels() && map.level(level + 1).resolution() <= 1.01 * cell) ++level;
  return map.level(level);
}

// What the map says of a beam that ends at a point: 1 where something is near; 0 where that isn't known, or
// something is beside; -1 where it is free. Passing through something, long before its end, takes 1 from it.
int agreement(const GridMap& map, const Eigen::Vector2d& from, const Eigen::Vector2d& to) {
  const double cell = map.resolution(), length = (to - from).norm();
  int occupied = 0;  // cells that it passes: a single one may be at a wall's corner
  for (double done = kBeside * cell; done < length - kPassed * cell && occupied < 2; done += cell) {
    const GridMap::Cell* here = map.find(from + (to - from) * (done / length));
    occupied += here != nullptr && GridMap::isOccupied(*here);
  }
  int nearest = kBeside + 1;
  bool free = false;
  for (int y = -kBeside; y <= kBeside; ++y) {
    for (int x = -kBeside; x <= kBeside; ++x) {
      const GridMap::Cell* there = map.find(to + cell * Eigen::Vector2d(x, y));
      if (there == nullptr) continue;
      free = free || GridMap::isFree(*there);
      if (GridMap::isOccupied(*there)) nearest = std::min(nearest, std::max(std::abs(x), std::abs(y)));
    }
  }
  return (nearest <= kNear ? 1 : nearest > kBeside && free ? -1 : 0) - (occupied >= 2 ? 1 : 0);
}

// Of all beams, on the average.
double agreement(const GridMap& map, const Scan& scan, const Pose& pose) {
  const Eigen::Isometry2d to_map = isometry(pose);
  const Eigen::Vector2d from = to_map * scan.origin.cast<double>();
  double sum = 0.0;
  for (const Eigen::Vector2f& point : scan.points) sum += agreement(map, from, to_map * point.cast<double>());
  return scan.points.empty() ? 0.0 : sum / scan.points.size();
}

struct Candidate {
  Pose pose;
  Match match;
  double score, difference;
};

}  // namespace

PlaceFinder::PlaceFinder(const SearchOptions& options, const MatcherOptions& matcher)
    : options_(mapping_common::validate(options)),
      matcher_(matcher),
      reflectivity_(makeCost(matcher.cost, matcher)->uses(Channel::kReflectivity)) {}

// Of the map only as much as the scan reaches from the region, if that isn't all of it.
void PlaceFinder::prepare(const MultiMap& map, const Scan& scan, const SearchRegion& region) {
  double reach = scan.origin.norm();
  for (const Eigen::Vector2f& point : scan.points) reach = std::max(reach, 1.0 * point.norm());
  const Eigen::Vector2d margin = Eigen::Vector2d::Constant(reach + 1.0);
  const Eigen::AlignedBox2d box(region.box.min() - margin, region.box.max() + margin);
  if (search_ && updates_ == map.updates() && box_.contains(box)) return;
  const GridMap& level = levelFor(map, options_.cell);
  const Eigen::Vector2d size = level.resolution() * Eigen::Vector2d(level.width(), level.height());
  const Eigen::AlignedBox2d all(level.origin(), level.origin() + size);
  box_ = box.contains(all) ? SearchRegion().box : box;
  search_.emplace(level, options_, reflectivity_, box_);
  updates_ = map.updates();
}

bool PlaceFinder::fits(const MultiMap& map, const Scan& scan, const Pose& pose) {
  prepare(map, scan, SearchRegion::around(pose, 0.0, 0.0));
  return search_->score(scan, pose) >= options_.min_score &&
         search_->difference(scan, pose) <= kMaxDifference;
}

Place PlaceFinder::find(const MultiMap& map, const Scan& scan, const SearchRegion& region) {
  prepare(map, scan, region);
  Place place;
  const GridMap& fine = levelFor(map, 0.5 * options_.cell);
  std::vector<Candidate> candidates;
  for (const ScanSearch::Optimum& optimum : search_->optima(scan, region, kLeastShare, kCandidates)) {
    Candidate candidate{optimum.pose, matcher_.match(map, scan, optimum.pose), 0.0, 0.0};
    if (isNear(candidate.match.pose, optimum.pose, kReachDistance, kReachAngle))
      candidate.pose = candidate.match.pose;
    candidate.difference = search_->difference(scan, candidate.pose);
    candidate.score =
        agreement(fine, scan, candidate.pose) -
        options_.reflectivity_share * std::min(1.0, candidate.difference / options_.reflectivity_scale);
    candidates.push_back(candidate);
  }
  if (candidates.empty()) {
    place.why = "nothing in the map is like it";
    return place;
  }
  const auto best = std::max_element(candidates.begin(), candidates.end(),
                                     [](const auto& a, const auto& b) { return a.score < b.score; });
  place.pose = best->pose;
  place.covariance = best->match.covariance;
  place.score = best->score;
  for (const Candidate& other : candidates) {
    if (isNear(other.pose, best->pose, options_.apart_distance, options_.apart_angle)) continue;
    place.rival = std::max(place.rival, other.score);
  }
  std::ostringstream why;
  const int apart = pointsApart(scan, options_.cell).size();
  if (apart < options_.min_points) {
    why << "the scan shows too little, " << apart << " points";
  } else if (best->score < (region.isEverywhere() ? options_.min_agreement : options_.min_agreement_around)) {
    why << "the best place fits by " << best->score << " only";
  } else if (best->difference > kMaxDifference) {
    why << "reflectivities differ from the map's by " << best->difference << " on the average";
  } else if (best->score - place.rival < options_.min_lead) {
    why << "two places fit about as well, by " << best->score << " and " << place.rival;
  } else if (best->match.observable < 3 || best->pose != best->match.pose) {
    why << "the scan doesn't tell the whole pose";
  } else {
    // Once more without what the map doesn't know, which walls that end there draw to themselves.
    const Match known = matcher_.match(map, scan, best->pose, false, FirstGuess::kSure);
    if (known.observable < 3 || !isNear(known.pose, best->pose, kReachDistance, kReachAngle))
      why << "what the map knows of the scan doesn't tell the whole pose";
    place.pose = known.pose;
    place.covariance = known.covariance;
  }
  place.why = why.str();
  place.sure = place.why.empty();
  return place;
}

}  // namespace intensity_hector_slam
