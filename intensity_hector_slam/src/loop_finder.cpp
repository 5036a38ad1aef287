// SPDX-License-Identifier: BSD-3-Clause
#include "intensity_hector_slam/loop_finder.h"

#include <Eigen/LU>
#include <algorithm>
#include <cmath>
#include <functional>
#include <limits>
#include <queue>
#include <stdexcept>
#include <utility>

#include "pose_covariance.h"

namespace intensity_hector_slam {
namespace {

constexpr double kSigmas = 3.0;          // of a region that is searched
constexpr double kTurnLength = 0.5;      // m for each rad
constexpr double kTieLength = 0.5;       // m, of a loop
constexpr double kSpacing = 0.04;        // m, between points that are kept
constexpr double kJump = 2.0;            // times LoopOptions::sigma_distance: an edge less sure is one
constexpr std::size_t kSubmaps = 8;      // that are kept
constexpr std::size_t kSearches = 4;     // for each key pose, at most
constexpr double kSpare = 0.3;           // m, of a region beyond its uncertainty
constexpr double kSpareAngle = 0.1;      // rad
constexpr double kReach = 3.0;           // m, from an earlier key pose whose surroundings a scan sees well
constexpr double kSame = 0.3;            // m, by which places may differ that confirm each other
constexpr double kSameAngle = 0.08;      // rad
constexpr std::size_t kChainSteps = 60;  // between key poses that confirm each other

// Neighbouring points nearer than that count once.
Scan thinned(const Scan& scan) {
  Scan result;
  result.stamp = scan.stamp;
  result.origin = scan.origin;
  for (std::size_t i = 0; i < scan.points.size(); ++i) {
    if (!result.points.empty() && (scan.points[i] - result.points.back()).norm() < kSpacing) continue;
    result.points.push_back(scan.points[i]);
    if (!scan.reflectivities.empty()) result.reflectivities.push_back(scan.reflectivities[i]);
  }
  return result;
}

MapOptions submapOptions(const LoopOptions& options, const MapOptions& map) {
  MapOptions result = map;
  result.resolution = std::max(map.resolution, options.resolution);
  result.levels = 2;
  result.size = static_cast<int>(std::lround(20.0 / result.resolution));
  result.grow = true;
  result.start_x = result.start_y = 0.5;
  result.sure_free = 0.0;  // few scans
  return result;
}

}  // namespace

LoopFinder::LoopFinder(const LoopOptions& options, const SlamOptions& slam)
    : options_(mapping_common::validate(options)),
      slam_(mapping_common::validate(slam)),
      map_options_(submapOptions(options_, slam.map)) {}

void LoopFinder::clear() {
  nodes_.clear();
  anchors_.clear();
  submaps_.clear();
  pending_.reset();
  last_tie_.reset();
  points_ = first_kept_ = 0;
}

double LoopFinder::lengthOf(const Pose& transform) const {
  return transform.head<2>().norm() + kTurnLength * std::abs(transform.z());
}

void LoopFinder::connect(std::size_t from, std::size_t to, const Pose& transform,
                         const Eigen::Matrix3d& covariance, double length) {
  const Pose back = between(transform, Pose::Zero());
  nodes_[from].links.push_back({to, transform, covariance, length});
  nodes_[to].links.push_back(
      {from, back, covarianceBetween(transform, covariance, Pose::Zero(), Eigen::Matrix3d::Zero()), length});
}

std::vector<Edge> LoopFinder::add(const KeyPose& key, const Scan& scan, const std::optional<Edge>& edge,
                                  bool search_it) {
  if (edge && (nodes_.empty() || nodes_.back().key.id != edge->from.id || edge->to.id != key.id)) {
    throw std::invalid_argument("an edge isn't from the last key pose to this one");
  }
  if (!edge) clear();
  const std::size_t node = nodes_.size();
  const double length = edge ? lengthOf(edge->transform) : 0.0;
  nodes_.push_back({key, thinned(scan), node > 0 ? nodes_.back().travelled + length : 0.0, {}, {}});
  points_ += nodes_.back().scan.points.size();
  if (edge) {
    connect(node - 1, node, edge->transform, inverseOf(edge->information), length);
    nodes_[node - 1].next = nodes_[node - 1].links.back();
  }
  if (anchors_.empty() ||
      nodes_[node].travelled - nodes_[anchors_.back()].travelled >= 0.25 * options_.submap_length) {
    anchors_.push_back(node);
  }
  ++counts_.key_poses;
  forgetBeyondMemory();

  std::vector<Edge> loops;
  // Behind a jump of the pose, the way from the last loop tells little.
  if (edge && inverseOf(edge->information).topLeftCorner<2, 2>().trace() >
                  std::pow(kJump * options_.sigma_distance, 2))
    last_tie_.reset();
  if (!search_it || (last_tie_ && nodes_[node].travelled - *last_tie_ < options_.spacing)) return loops;
  const std::vector<Relative> seen = reachFrom(node);
  std::optional<Found> found = search(node, seen);
  if (!found) return loops;
  if (!found->confirmed && pending_ && agree(*pending_, *found)) {
    // Too near to it, a place tells nothing new.
    if (nodes_[node].travelled - nodes_[pending_->to].travelled < options_.confirmation) return loops;
    loops.push_back(accept(*pending_));
    found->confirmed = true;
  }
  if (found->confirmed) {
    loops.push_back(accept(*found));
    pending_.reset();
  } else {
    counts_.unconfirmed += pending_.has_value();
    pending_ = found;
  }
  return loops;
}

// Dijkstra, from one key pose to all others that are connected with it.
std::vector<LoopFinder::Relative> LoopFinder::reachFrom(std::size_t start) const {
  std::vector<Relative> seen(nodes_.size());
  std::vector<bool> done(nodes_.size());
  using Next = std::pair<double, std::size_t>;
  std::priority_queue<Next, std::vector<Next>, std::greater<Next>> queue;
  seen[start].known = true;
  queue.push({0.0, start});
  while (!queue.empty()) {
    const std::size_t i = queue.top().second;
    queue.pop();
    if (done[i]) continue;
    done[i] = true;
    const Relative here = seen[i];
    for (const Link& link : nodes_[i].links) {
      Relative& there = seen[link.to];
      const double length = here.length + link.length;
      if (there.known && there.length <= length) continue;
      there = {true, length, compose(here.pose, link.transform),
               composedCovariance(here.pose, here.covariance, link.transform, link.covariance)};
      queue.push({length, link.to});
    }
  }
  return seen;
}

// The nearest first, none twice in one submap.
std::vector<std::size_t> LoopFinder::anchorsNear(std::size_t node, const std::vector<Relative>& seen) const {
  std::vector<std::pair<double, std::size_t>> near;
  for (const std::size_t anchor : anchors_) {
    const Relative& there = seen[anchor];
    if (anchor < first_kept_ || !there.known) continue;
    if (nodes_[node].travelled - nodes_[anchor].travelled < options_.min_travel ||
        (last_tie_ && there.length < options_.spacing))
      continue;
    const double deviation = std::sqrt(there.covariance.topLeftCorner<2, 2>().trace());
    const double uncertain = std::min(options_.max_distance, kSigmas * deviation);
    const double distance = there.pose.head<2>().norm();
    if (distance <= kReach + uncertain) near.push_back({distance, anchor});
  }
  std::sort(near.begin(), near.end());
  std::vector<std::size_t> result;
  for (const auto& [distance, anchor] : near) {
    const bool apart = std::all_of(result.begin(), result.end(), [&, a = anchor](std::size_t other) {
      return std::abs(nodes_[a].travelled - nodes_[other].travelled) >= 0.5 * options_.submap_length;
    });
    if (apart) result.push_back(anchor);
    if (result.size() == kSearches) break;
  }
  return result;
}

LoopFinder::Submap& LoopFinder::submapAt(std::size_t anchor) {
  const auto kept = std::find_if(submaps_.begin(), submaps_.end(),
                                 [anchor](const Submap& submap) { return submap.anchor == anchor; });
  if (kept != submaps_.end()) {
    submaps_.splice(submaps_.begin(), submaps_, kept);
    return submaps_.front();
  }
  submaps_.push_front(
      {anchor, MultiMap(map_options_), {{anchor, Pose::Zero()}}, PlaceFinder(slam_.place, slam_.matcher)});
  Submap& submap = submaps_.front();
  const auto near = [&](std::size_t i) {
    return std::abs(nodes_[i].travelled - nodes_[anchor].travelled) <= 0.5 * options_.submap_length;
  };
  Pose pose = Pose::Zero();
  for (std::size_t i = anchor; i > first_kept_ && nodes_[i - 1].next && near(i - 1); --i) {
    pose = compose(pose, between(nodes_[i - 1].next->transform, Pose::Zero()));
    submap.members.push_back({i - 1, pose});
  }
  pose = Pose::Zero();
  for (std::size_t i = anchor; nodes_[i].next && near(i + 1); ++i) {
    pose = compose(pose, nodes_[i].next->transform);
    submap.members.push_back({i + 1, pose});
  }
  for (const auto& [member, at] : submap.members) submap.map.update(nodes_[member].scan, at);
  if (submaps_.size() > kSubmaps) submaps_.pop_back();
  return submap;
}

std::optional<LoopFinder::Found> LoopFinder::search(std::size_t node, const std::vector<Relative>& seen) {
  struct Candidate {
    Found found;
    Place place;
    Pose in_node;  // the anchor's pose, seen from the node, as the place has it
    double half;
  };
  std::vector<Candidate> candidates;
  for (const std::size_t anchor : anchorsNear(node, seen)) {
    Submap& submap = submapAt(anchor);
    const Relative& there = seen[anchor];
    const Pose expected = between(there.pose, Pose::Zero());
    const Eigen::Matrix3d covariance =
        covarianceBetween(there.pose, there.covariance, Pose::Zero(), Eigen::Matrix3d::Zero());
    const double uncertain =
        std::min(options_.max_distance, kSigmas * std::sqrt(covariance.diagonal().head<2>().maxCoeff()));
    const double angle = std::min(options_.max_angle, kSigmas * std::sqrt(covariance(2, 2)));
    const SearchRegion region = SearchRegion::around(expected, uncertain + kSpare, angle + kSpareAngle);
    ++counts_.searches;
    const Place place = submap.finder.find(submap.map, nodes_[node].scan, region);
    if (place.score <= 0.0) continue;
    // From the member that is nearest.
    const auto nearest =
        std::min_element(submap.members.begin(), submap.members.end(), [&](const auto& a, const auto& b) {
          return lengthOf(between(a.second, place.pose)) < lengthOf(between(b.second, place.pose));
        });
    Candidate candidate;
    candidate.place = place;
    candidate.in_node = between(place.pose, Pose::Zero());
    candidate.half = uncertain;
    candidate.found = {
        nearest->first,
        node,
        between(nearest->second, place.pose),
        covarianceBetween(nearest->second, Eigen::Matrix3d::Zero(), place.pose, place.covariance),
        place.score,
        uncertain <= options_.sure_distance};
    candidates.push_back(candidate);
  }
  if (candidates.empty()) return {};
  const auto best =
      std::max_element(candidates.begin(), candidates.end(),
                       [](const Candidate& a, const Candidate& b) { return a.place.score < b.place.score; });
  if (!best->place.sure) {
    ++counts_.unsure;
    why_unsure_ = best->place.why;
    return {};
  }
  return best->found;
}

std::optional<Pose> LoopFinder::alongChain(std::size_t from, std::size_t to) const {
  Pose pose = Pose::Zero();
  const std::size_t first = std::min(from, to), last = std::max(from, to);
  if (last - first > kChainSteps) return {};
  for (std::size_t i = first; i < last; ++i) {
    if (!nodes_[i].next) return {};
    pose = compose(pose, nodes_[i].next->transform);
  }
  return from <= to ? pose : between(pose, Pose::Zero());
}

bool LoopFinder::agree(const Found& earlier, const Found& later) const {
  const auto between_from = alongChain(earlier.from, later.from),
             between_to = alongChain(earlier.to, later.to);
  if (!between_from || !between_to) return false;
  const Pose expected = compose(earlier.transform, *between_to);
  const Pose error = between(expected, compose(*between_from, later.transform));
  return error.head<2>().norm() <= kSame && std::abs(error.z()) <= kSameAngle;
}

Eigen::Matrix3d loopCovariance(const Eigen::Matrix3d& match, const LoopOptions& options) {
  const double distance = options.sigma_distance, angle = options.sigma_angle;
  Eigen::Matrix3d covariance = match;
  covariance.diagonal() += Eigen::Vector3d(distance * distance, distance * distance, angle * angle);
  return covariance;
}

Edge LoopFinder::accept(const Found& found) {
  const Eigen::Matrix3d covariance = loopCovariance(found.covariance, options_);
  connect(found.from, found.to, found.transform, covariance, kTieLength);
  last_tie_ = nodes_[found.to].travelled;
  ++counts_.loops;
  Edge edge{nodes_[found.from].key, nodes_[found.to].key, found.transform, inverseOf(covariance)};
  edge.type = EdgeType::kLoopClosure;
  edge.similarity = found.score;
  return edge;
}

void LoopFinder::forgetBeyondMemory() {
  constexpr double kBytes = sizeof(Eigen::Vector2f) + sizeof(float);
  while (points_ * kBytes > options_.memory * 1e6 && first_kept_ + 1 < nodes_.size()) {
    points_ -= nodes_[first_kept_].scan.points.size();
    nodes_[first_kept_].scan = {};
    submaps_.remove_if([this](const Submap& submap) { return submap.anchor == first_kept_; });
    ++first_kept_;
    ++counts_.forgotten;
  }
}

}  // namespace intensity_hector_slam
