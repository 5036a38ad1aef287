// SPDX-License-Identifier: BSD-3-Clause
#include "intensity_hector_slam/slam.h"

#include <algorithm>
#include <cmath>
#include <stdexcept>
#include <utility>

namespace intensity_hector_slam {
namespace {

constexpr double kPlaceSearchPeriod = 0.5;  // s
constexpr double kOdometryShare = 2.0;  // of the way, by which it is off at most: some counts a way back as
                                        // one forward
constexpr double kTurnShare = 0.2;      // the same of the turn, and m for each rad
constexpr double kUnknownSpeed = 1.0, kUnknownTurnRate = 2.0;  // m/s, rad/s: standard deviations at the start
constexpr double kVelocityError = 0.5;                         // of its change by a scan, that it is off by
constexpr double kOdometryTrust = 10.0;  // times SlamOptions::max_gap, that it leads while nothing fits

}  // namespace

std::string toString(Status status) {
  switch (status) {
    case Status::kStarted:
      return "started";
    case Status::kGiven:
      return "given";
    case Status::kMatched:
      return "matched";
    case Status::kUnobservable:
      return "unobservable";
    case Status::kRejected:
      return "rejected";
    case Status::kEmpty:
      return "empty";
  }
  return "";
}

Slam::Slam(const SlamOptions& options)
    : options_(mapping_common::validate(options)),
      map_(options.map),
      matcher_(options.matcher),
      finder_(options.place, options.matcher) {}

void Slam::setOptions(const SlamOptions& options) {
  mapping_common::validate(options);
  matcher_ = ScanMatcher(options.matcher);
  finder_ = PlaceFinder(options.place, options.matcher);
  const MapOptions map = options_.map;
  options_ = options;
  options_.map = map;
}

void Slam::setPose(const Pose& pose) {
  check(pose);
  pose_ = {pose.x(), pose.y(), wrapAngle(pose.z())};
  velocity_.setZero();
  velocity_known_ = false;
  last_stamp_.reset();
  last_match_.reset();
  last_search_.reset();
  last_odometry_.reset();
  last_update_.reset();
  first_.reset();
  lost_ = false;
  doubted_since_.reset();
  last_place_search_.reset();
}

void Slam::move(const Pose& correction) {
  check(correction);
  for (Pose* pose : {&pose_, &matched_pose_}) *pose = compose(correction, *pose);
  for (auto* pose : {&last_update_, &last_search_})
    if (*pose) *pose = compose(correction, **pose);
}

void Slam::setLost() {
  setPose(pose_);
  lost_ = true;
}

Place Slam::findPlace(const Scan& scan, const SearchRegion& region) {
  check(scan);
  return finder_.find(map_, scan, region);
}

void Slam::reset(const Pose& pose) {
  check(pose);
  map_ = MultiMap(options_.map);
  inserted_.clear();
  finder_.forget();
  setPose(pose);
}

void Slam::setMap(MultiMap map, const Pose& pose) {
  check(pose);
  map_ = std::move(map);
  inserted_.clear();
  options_.map = map_.options();
  finder_.forget();
  setPose(pose);
}

void Slam::check(const Pose& pose) {
  if (!pose.allFinite()) throw std::invalid_argument("a pose that is not finite");
}

void Slam::check(const Scan& scan) {
  if (!std::isfinite(scan.stamp)) throw std::invalid_argument("a scan has a stamp that is not finite");
  const auto areFinite = [](const std::vector<Eigen::Vector2f>& points) {
    return std::all_of(points.begin(), points.end(), [](const auto& point) { return point.allFinite(); });
  };
  if (!areFinite(scan.points) || !areFinite(scan.free)) {
    throw std::invalid_argument("a scan has a point that is not finite");
  }
  if (!scan.reflectivities.empty() && scan.reflectivities.size() != scan.points.size()) {
    throw std::invalid_argument("a scan has another number of reflectivities than of points");
  }
  if ((!scan.times.empty() && scan.times.size() != scan.points.size()) ||
      (scan.free_times.size() != (scan.times.empty() ? 0 : scan.free.size()))) {
    throw std::invalid_argument("a scan has another number of times than of points");
  }
}

SlamResult Slam::process(const Scan& scan, const std::optional<Pose>& odometry) {
  check(scan);
  if (odometry) check(*odometry);
  SlamResult result;
  const bool empty = static_cast<int>(scan.points.size()) < options_.min_points;
  if (!empty) relocalize(scan, odometry, result);
  predict(scan, odometry, result);
  if (empty || lost_) {
    result.status = empty ? Status::kEmpty : Status::kRejected;
    result.pose = result.guess;
    result.covariance = unknownCovariance();
  } else {
    const bool unsure = isUnsure(scan.stamp, odometry && last_odometry_ && !result.odometry_jumped, result);
    const Pose guess = result.guess;
    follow(scan, unsure, result);
    if (result.status == Status::kStarted && options_.deskew && !scan.times.empty()) {
      first_ = scan;
    } else if (first_ && result.status != Status::kRejected) {
      startAgain();
      result.guess = guess;
      follow(scan, unsure, result);
    }
  }
  // A pose that is wrong may fit halfway. While mapping, what is new does, too.
  const bool doubted =
      result.status == Status::kRejected ||
      (options_.localization && options_.relocalize && !empty && !finder_.fits(map_, scan, result.pose));
  if (!doubted && !empty) doubted_since_.reset();
  if (doubted && !doubted_since_) {
    doubted_since_ = scan.stamp;
    doubted_way_ = doubted_turn_ = 0.0;
  }
  if (doubted) {
    const Pose motion = between(pose_, result.guess);
    doubted_way_ += motion.head<2>().norm();
    doubted_turn_ += std::abs(motion.z());
  }
  if (result.status != Status::kStarted) first_.reset();
  pose_ = result.pose;
  last_stamp_ = scan.stamp;
  last_odometry_ = odometry;
  return result;
}

SlamResult Slam::insert(const Scan& scan, const Pose& pose) {
  check(scan);
  check(pose);
  SlamResult result;
  const double elapsed = last_stamp_ ? scan.stamp - *last_stamp_ : 0.0;
  velocity_.setZero();
  if (elapsed > 0.0 && elapsed <= options_.max_gap) velocity_ = between(pose_, pose) / elapsed;
  pose_ = pose;
  last_stamp_ = scan.stamp;
  if (static_cast<int>(scan.points.size()) >= options_.min_points) {
    result.status = Status::kGiven;
    const double middle = deskew(scan);
    result.pose = compose(pose, velocity_ * middle);
    updateMap(deskewed_, result);
  }
  result.pose = result.guess = pose;
  return result;
}

// Where the body may be, if the first guess doesn't tell.
std::optional<SearchRegion> Slam::lostIn(double stamp, const std::optional<Pose>& odometry) const {
  if (lost_) return SearchRegion();
  if (!options_.relocalize || map_.updates() == 0) return {};
  const double doubted = doubted_since_ ? stamp - *doubted_since_ : 0.0;
  if (doubted_since_ && odometry && last_odometry_ && doubted <= kOdometryTrust * options_.max_gap) {
    const Pose motion = between(*last_odometry_, *odometry);
    const double way = doubted_way_ + motion.head<2>().norm(), turn = doubted_turn_ + std::abs(motion.z());
    return SearchRegion::around(compose(pose_, motion),
                                options_.max_correction_distance + kOdometryShare * way + kTurnShare * turn,
                                options_.max_correction_angle + kTurnShare * turn);
  }
  if (doubted > options_.max_gap) return SearchRegion();
  if (odometry || !last_match_ || stamp - *last_match_ <= options_.max_gap) return {};
  const double gap = stamp - *last_match_;
  return SearchRegion::around(matched_pose_, options_.max_speed * gap, options_.max_turn_rate * gap);
}

void Slam::relocalize(const Scan& scan, const std::optional<Pose>& odometry, SlamResult& result) {
  const std::optional<SearchRegion> region = lostIn(scan.stamp, odometry);
  if (!region) return;
  // Not for each scan: it takes much longer than a match.
  if (last_place_search_ && std::abs(scan.stamp - *last_place_search_) < kPlaceSearchPeriod) return;
  result.place = finder_.find(map_, scan, *region);
  if (result.place->sure) {
    const std::optional<double> before = last_stamp_;
    setPose(result.place->pose);
    last_stamp_ = before;
  }
  last_place_search_ = scan.stamp;
}

// The first guess.
void Slam::predict(const Scan& scan, const std::optional<Pose>& odometry, SlamResult& result) {
  const double stamp = scan.stamp;
  const double elapsed = last_stamp_ ? stamp - *last_stamp_ : 0.0;
  result.time_jumped_back = elapsed < -options_.max_gap;  // less is out of order
  if (elapsed > options_.max_gap) result.gap = elapsed;
  const bool follows = last_match_ && stamp > *last_match_ && stamp - *last_match_ <= options_.max_gap;
  if (!follows) {
    velocity_.setZero();
    velocity_known_ = false;
  }

  soon_ = follows && elapsed < options_.matcher.search_gap;
  steady_ = options_.guess != Guess::kLastPose &&
            !(options_.guess == Guess::kOdometry && odometry && last_odometry_);
  const Pose steady = follows && elapsed > 0.0 ? Pose(velocity_ * elapsed) : Pose::Zero();
  Pose motion = Pose::Zero();
  other_guesses_.clear();
  if (options_.guess == Guess::kOdometry && odometry && last_odometry_) {
    other_guesses_ = {compose(pose_, steady), pose_};
    motion = between(*last_odometry_, *odometry);
    if (const auto other = betterThanOdometry(scan, motion, steady, elapsed)) {
      result.odometry_jumped = true;
      motion = *other;
    } else {
      result.guess_is_odometry = true;
      if (follows && elapsed > 0.0) velocity_ = motion / elapsed;
    }
  } else if (options_.guess != Guess::kLastPose) {
    motion = steady;
  }
  result.guess = compose(pose_, motion);
}

// Odometry that is faster than the body can be has jumped, or its stamps are wrong; some counts a way back as
// one forward. Where the pose may be farther from it than the search reaches, the map knows.
std::optional<Pose> Slam::betterThanOdometry(const Scan& scan, const Pose& motion, const Pose& steady,
                                             double elapsed) {
  const MatcherOptions& o = options_.matcher;
  const auto isBeyond = [](const Pose& by, double distance, double angle) {
    return by.head<2>().norm() > distance || std::abs(by.z()) > angle;
  };
  const bool implausible =
      isBeyond(motion, options_.max_speed * std::abs(elapsed), options_.max_turn_rate * std::abs(elapsed));
  const double distance = 0.5 * o.search_distance, angle = 0.5 * o.search_angle;
  const bool far = isBeyond(motion, distance, angle) || isBeyond(between(steady, motion), distance, angle);
  if (!(implausible || far) || map_.updates() == 0 ||
      static_cast<int>(scan.points.size()) < options_.min_points)
    return {};
  const auto score = [&](const Pose& by) {
    return matcher_.match(map_, scan, compose(pose_, by), true).score();
  };
  double best = score(motion) + o.search_min_gain;
  std::optional<Pose> better;
  for (const Pose& other : {steady, Pose(Pose::Zero())}) {
    if (!implausible && !isBeyond(between(other, motion), distance, angle)) continue;
    const double here = score(other);
    if (here <= best) continue;
    best = here;
    better = other;
  }
  return better;
}

// Whether the first guess may be farther from the pose than the iterations reach.
bool Slam::isUnsure(double stamp, bool odometry, const SlamResult& result) const {
  const MatcherOptions& o = options_.matcher;
  if (!last_match_ || result.gap > 0.0 || result.time_jumped_back) return true;
  if (!odometry && stamp - *last_stamp_ >= o.search_gap) return true;
  const Pose motion = between(pose_, result.guess);
  return motion.head<2>().norm() > o.search_motion_distance || std::abs(motion.z()) > o.search_motion_angle;
}

// The pose is sought at the middle of the sweep: there it doesn't depend on the velocity that is assumed for
// the sweep. Sought at its start, an error of the velocity would give one of the pose, and that the next
// velocity's.
void Slam::follow(const Scan& scan, bool unsure, SlamResult& result) {
  const double middle = deskew(scan);
  result.guess = compose(result.guess, velocity_ * middle);
  const Eigen::Vector3d assumed = velocity_;
  place(deskewed_, scan.stamp + middle, unsure, result);
  updateVelocity(scan.stamp + middle, result);
  addUncertainty(velocity_ - assumed, scan, middle, result);
  for (Pose* pose : {&result.pose, &result.guess}) *pose = compose(*pose, -velocity_ * middle);
}

// The velocity is off by about a part of what the scan changes it by, and with it the way from the middle of
// the sweep to the stamp, and the places to which points were moved: by the mean of those, so is the pose.
void Slam::addUncertainty(const Eigen::Vector3d& change, const Scan& scan, double middle,
                          SlamResult& result) const {
  constexpr std::size_t kStride = 4;  // of the points that the mean is of
  if (!options_.deskew || scan.points.empty() || scan.times.empty()) return;
  Eigen::Vector3d moved = Eigen::Vector3d::Zero();
  double squares = 0.0;
  double n = 0.0;
  for (std::size_t i = 0; i < scan.points.size(); i += kStride) {
    const Eigen::Vector2d point = scan.points[i].cast<double>(), across(-point.y(), point.x());
    const Eigen::Vector2d by = (scan.times[i] - middle) * (change.head<2>() + change.z() * across);
    moved += Eigen::Vector3d(by.x(), by.y(), across.dot(by));
    squares += point.squaredNorm();
    n += 1.0;
  }
  moved = moved.cwiseQuotient(Eigen::Vector3d(n, n, std::max(squares, 1e-9)));
  for (const Eigen::Vector3d& difference : {Eigen::Vector3d(change * middle), moved}) {
    const Eigen::Vector3d in_map = kVelocityError * turnBy(result.pose.z()) * difference;
    result.covariance += in_map * in_map.transpose();
  }
}

// Now that the velocity is known, the first scan goes into the map as it should have.
void Slam::startAgain() {
  map_.clear();
  const double middle = deskew(*first_);
  matched_pose_ = compose(pose_, velocity_ * middle);
  last_match_ = first_->stamp + middle;
  map_.update(deskewed_, matched_pose_);
  inserted_.clear();
  keep(deskewed_, matched_pose_);
  last_update_ = matched_pose_;
  last_update_stamp_ = first_->stamp;
}

// To the middle of the sweep. @return the time from the stamp to there, s
double Slam::deskew(const Scan& scan) {
  const bool deskews = options_.deskew && !scan.times.empty();
  const double middle = deskews ? 0.5 * (scan.times.front() + scan.times.back()) : 0.0;
  deskewed_ = moved(scan, middle);
  return middle;
}

Scan Slam::undistorted(const Scan& scan) const {
  return moved(scan, 0.0);
}

Scan Slam::moved(const Scan& scan, double time) const {
  return options_.deskew ? seenAt(time, scan, velocity_) : scan;
}

void Slam::place(const Scan& scan, double middle, bool unsure, SlamResult& result) {
  result.pose = result.guess;
  if (map_.updates() == 0) {
    result.status = options_.localization ? Status::kRejected : Status::kStarted;
    if (options_.localization) {
      result.covariance = unknownCovariance();
      return;
    }
  } else {
    result.match = match(scan, unsure, result);
    bool accepted = accepts(result.match, result.guess);
    for (const Pose& other : other_guesses_) {
      if (accepted) break;
      const Match there = matcher_.match(map_, scan, other, true);
      accepted = accepts(there, other) && there.contradiction <= options_.matcher.search_contradiction;
      if (accepted) result.match = there;
    }
    if (!accepted) {
      result.status = Status::kRejected;
      result.covariance = unknownCovariance();
      return;
    }
    result.status = result.match.observable == 3 ? Status::kMatched : Status::kUnobservable;
    result.pose = result.match.pose;
    result.covariance = result.match.covariance;
    filter(middle, result);
  }
  updateMap(scan, result);
}

Match Slam::match(const Scan& scan, bool unsure, const SlamResult& result) {
  const Search search = options_.matcher.search;
  const Pose& guess = result.guess;
  const bool at_once = search == Search::kAlways || (search == Search::kWhenUnsure && unsure);
  FirstGuess is = FirstGuess::kFar;
  if (steady_ && filtered_ && velocity_known_) is = FirstGuess::kSure;
  if (result.guess_is_odometry && soon_) is = FirstGuess::kNear;
  const Match match = matcher_.match(map_, scan, guess, at_once, is);
  if (at_once || search == Search::kNever) return match;
  const bool accepted = accepts(match, guess);
  const bool contradicts = match.contradiction > options_.matcher.search_contradiction;
  if (accepted && !(contradicts && hasMoved(last_search_, match.pose))) return match;

  last_search_ = match.pose;
  const Match other = matcher_.match(map_, scan, guess, true);
  if (!accepted) return other;
  const bool better = other.score() > match.score() + options_.matcher.search_min_gain;
  return better && accepts(other, guess) ? other : match;
}

// Far enough for another scan to tell the map something.
bool Slam::hasMoved(const std::optional<Pose>& from, const Pose& to) const {
  if (!from) return true;
  const Pose moved = between(*from, to);
  return moved.head<2>().norm() >= options_.update_distance || std::abs(moved.z()) >= options_.update_angle;
}

void Slam::updateMap(const Scan& scan, SlamResult& result) {
  const double since = scan.stamp - last_update_stamp_;
  const bool due = since >= options_.update_period || since < -options_.max_gap;  // time jumped back
  if (options_.localization || !(due || hasMoved(last_update_, result.pose))) return;
  map_.update(scan, result.pose);
  keep(scan, result.pose);
  last_update_stamp_ = scan.stamp;
  last_update_ = result.pose;
  result.map_updated = true;
}

void Slam::keep(const Scan& scan, const Pose& pose) {
  // What doesn't fit counts as forgotten, so that isComplete() tells.
  const auto size = [](const auto& values) { return values.size() * sizeof(values.front()); };
  const std::size_t bytes = sizeof(Scan) + size(scan.points) + size(scan.reflectivities) + size(scan.free);
  auto kept = std::make_shared<Scan>();
  if (inserted_.keeps()) {
    *kept = scan;
    kept->times = {};
    kept->free_times = {};
  }
  inserted_.add(scan.stamp, bytes, {std::move(kept), pose});
}

void insertAll(const InsertedScans& scans, const MapCorrection& correction, MultiMap& map) {
  for (const auto& entry : scans) map.update(*entry.value.scan, correction.of(entry.value.pose, entry.stamp));
}

void Slam::correct(MultiMap map, const MapCorrection& correction, double until) {
  check(correction.correction);
  insertAll(scansAfter(until), correction, map);
  for (auto& entry : inserted_.entries()) entry.value.pose = correction.of(entry.value.pose, entry.stamp);
  map_ = std::move(map);
  options_.map = map_.options();
  finder_.forget();
  const double stamp = last_stamp_.value_or(0.0);
  if (stamp < correction.corrected_from) move(correction.correction);
  first_.reset();
}

bool Slam::accepts(const Match& match, const Pose& guess) const {
  const Pose correction = between(guess, match.pose);
  return match.pose.allFinite() && match.observable > 0 &&
         match.contradiction <= options_.max_contradiction &&
         correction.head<2>().norm() <= options_.max_correction_distance &&
         std::abs(correction.z()) <= options_.max_correction_angle;
}

Eigen::Matrix3d Slam::unknownCovariance() const {
  const double d = options_.matcher.unobservable_distance, a = options_.matcher.unobservable_angle;
  return Eigen::Vector3d(d * d, d * d, a * a).asDiagonal();
}

// Without odometry, what a scan tells of the pose is weighed against how the body moved so far.
void Slam::filter(double middle, SlamResult& result) {
  const double elapsed = last_match_ ? middle - *last_match_ : 0.0;
  const bool follows = steady_ && elapsed > 0.0 && elapsed <= options_.max_gap;
  if (follows && !(filtered_ && velocity_known_)) {
    for (MotionFilter& filter : filters_) filter.start(velocity_, kUnknownSpeed, kUnknownTurnRate);
  }
  filtered_ = follows;
  if (!follows) return;
  const MotionFilter::Noise noise{{options_.acceleration_noise, options_.angular_acceleration_noise},
                                  limits()};
  if (result.match.observable == 3) last_observed_ = middle;
  double best = -std::numeric_limits<double>::infinity();
  for (MotionFilter& filter : filters_) {
    const Pose pose =
        filter.update(noise, matched_pose_, result.match.pose, result.match.uncertainty, elapsed);
    // A velocity that can't be observed goes on over a blind stretch, but would never end.
    if (middle - last_observed_ > options_.max_gap) {
      const Eigen::Matrix3d to_map = turnBy(pose.z());
      filter.stop(to_map.transpose() * result.match.unobservable_part * to_map);
    }
    if (filter.score() <= best) continue;
    best = filter.score();
    result.pose = pose;
    velocity_ = filter.velocity();
  }
  velocity_known_ = true;
}

void Slam::updateVelocity(double middle, const SlamResult& result) {
  if (result.status == Status::kRejected) return;
  const double elapsed = last_match_ ? middle - *last_match_ : 0.0;
  if (result.status != Status::kUnobservable || !(middle >= last_observed_)) last_observed_ = middle;
  if (!filtered_ && elapsed > 0.0 && elapsed <= options_.max_gap) {
    // A velocity that can't be observed goes on over a blind stretch, but would never end.
    Pose motion(result.pose - matched_pose_);
    motion.z() = wrapAngle(motion.z());
    if (middle - last_observed_ > options_.max_gap) motion -= result.match.unobservable_part * motion;
    approach(between(Pose(0.0, 0.0, matched_pose_.z()), motion + Pose(0.0, 0.0, matched_pose_.z())) / elapsed,
             elapsed);
  }
  last_match_ = middle;
  matched_pose_ = result.pose;
}

void Slam::approach(const Eigen::Vector3d& velocity, double elapsed) {
  const Eigen::Vector3d change = velocity - velocity_;
  velocity_ += velocity_known_ ? limited(change, limits(), elapsed) : change;
  velocity_known_ = true;
}

}  // namespace intensity_hector_slam
