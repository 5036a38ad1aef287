// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <mapping_common/recent.h>

#include <array>
#include <limits>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "intensity_hector_slam/motion_filter.h"
#include "intensity_hector_slam/place_finder.h"
#include "intensity_hector_slam/scan_matcher.h"

namespace intensity_hector_slam {

/// What became of a scan.
enum class Status {
  kStarted,  ///< the first in an empty map: it went in at the start pose
  kGiven,    ///< its pose was given
  kMatched,
  kUnobservable,  ///< matched, but in some direction the pose is just the first guess's; see
                  ///< Match::observable
  kRejected,      ///< it doesn't fit to the map: the pose is the first guess's, the map stays as it was
  kEmpty          ///< too few points: the pose is the first guess's, the map stays as it was
};
std::string toString(Status status);

struct SlamResult {
  Status status = Status::kEmpty;
  Pose pose = Pose::Zero();                              ///< of the body at the scan's stamp, map frame
  Eigen::Matrix3d covariance = Eigen::Matrix3d::Zero();  ///< of x, y, theta, map frame: m^2, m rad, rad^2
  Pose guess = Pose::Zero();                             ///< where the match began
  bool guess_is_odometry = false;  ///< the guess is the last pose, moved as odometry says
  Match match;                     ///< of no meaning where the status is kStarted or kEmpty
  bool map_updated = false;
  bool odometry_jumped = false;   ///< the map denies it, and it isn't the guess
  bool time_jumped_back = false;  ///< by more than SlamOptions::max_gap: no velocity holds
  std::optional<Place> place;     ///< a search for it, see SlamOptions::relocalize
  double gap = 0.0;               ///< s, a pause before this scan longer than SlamOptions::max_gap, else 0
};

/// A scan that went into the map, and where.
struct InsertedScan {
  std::shared_ptr<const Scan> scan;  ///< as if all of it had been measured at once
  Pose pose = Pose::Zero();          ///< of the body then
};
using InsertedScans = std::vector<mapping_common::Recent<InsertedScan>::Entry>;

/// How poses in a map become those in one that was made anew along a corrected trajectory.
struct MapCorrection {
  double stamp = 0.0;              ///< s, of the last scan that is in the new map
  Pose correction = Pose::Zero();  ///< times a pose in the old map
  /// s, from here on poses that were given (Slam::insert) are in the new map already
  double corrected_from = std::numeric_limits<double>::infinity();

  Pose of(const Pose& pose, double at) const {
    return at < corrected_from ? compose(correction, pose) : pose;
  }
};

/// Puts scans into the new map.
void insertAll(const InsertedScans& scans, const MapCorrection& correction, MultiMap& map);

/// The front end: tells the pose of each scan and builds the map.
///
///     Slam slam(options);
///     for (const Scan& scan : scans) trajectory.push_back(slam.process(scan).pose);
class Slam {
 public:
  /// @throws std::invalid_argument that names the option, its value and what is allowed
  explicit Slam(const SlamOptions& options = {});

  /// @param odometry pose of the body at the scan's stamp in any fixed frame, where there is odometry
  /// @throws std::invalid_argument where the scan or the odometry is none; nothing has changed
  SlamResult process(const Scan& scan, const std::optional<Pose>& odometry = {});

  /// Puts a scan into the map, where it is due, at a pose that is known. @throws as process
  SlamResult insert(const Scan& scan, const Pose& pose);

  const SlamOptions& options() const { return options_; }
  /// What isn't the map's: those must be as they were.
  /// @throws std::invalid_argument
  void setOptions(const SlamOptions& options);
  const MultiMap& map() const { return map_; }
  const Pose& pose() const { return pose_; }

  // What takes a pose throws std::invalid_argument where it isn't finite; nothing has changed then.

  /// Puts the body elsewhere in the map.
  void setPose(const Pose& pose);
  /// Moves the body elsewhere in the map, without a pause: the velocity goes on.
  void move(const Pose& correction);
  /// Nobody knows where the body is: until a scan's place is sure, scans are rejected.
  void setLost();
  /// A scan that was processed last as if all of it had been measured at its stamp.
  Scan undistorted(const Scan& scan) const;
  /// Where a scan was taken in the map; nothing changes.
  Place findPlace(const Scan& scan, const SearchRegion& region = {});
  /// Forgets all of the map and starts again at a pose.
  void reset(const Pose& pose = Pose::Zero());
  /// Goes on in another map, from a pose. Its options replace those of the map.
  void setMap(MultiMap map, const Pose& pose);

  // A map that is made anew, along a corrected trajectory, lacks what went into the old one meanwhile.

  /// Keeps the last scans that go into the map. @param memory bytes that they take at most; 0: none
  void keepScans(std::size_t memory) { inserted_.setMemory(memory); }
  /// Those later than a stamp (s).
  InsertedScans scansAfter(double stamp) const { return inserted_.after(stamp); }
  /// Whether that is all of them.
  bool keepsScansAfter(double stamp) const { return inserted_.isComplete(stamp); }
  /// Goes on in a corrected map: from where the pose is there, with the same velocity.
  /// @param until stamp of the last scan that is in it already; those kept that are later are put into it
  void correct(MultiMap map, const MapCorrection& correction, double until);

 private:
  static void check(const Scan& scan);
  static void check(const Pose& pose);
  std::optional<SearchRegion> lostIn(double stamp, const std::optional<Pose>& odometry) const;
  void relocalize(const Scan& scan, const std::optional<Pose>& odometry, SlamResult& result);
  void predict(const Scan& scan, const std::optional<Pose>& odometry, SlamResult& result);
  std::optional<Pose> betterThanOdometry(const Scan& scan, const Pose& motion, const Pose& steady,
                                         double elapsed);
  bool isUnsure(double stamp, bool odometry, const SlamResult& result) const;
  void follow(const Scan& scan, bool unsure, SlamResult& result);
  void addUncertainty(const Eigen::Vector3d& change, const Scan& scan, double middle,
                      SlamResult& result) const;
  void startAgain();
  double deskew(const Scan& scan);
  Scan moved(const Scan& scan, double time) const;
  void place(const Scan& scan, double middle, bool unsure, SlamResult& result);
  Match match(const Scan& scan, bool unsure, const SlamResult& result);
  bool accepts(const Match& match, const Pose& guess) const;
  Eigen::Matrix3d unknownCovariance() const;
  bool hasMoved(const std::optional<Pose>& from, const Pose& to) const;
  void filter(double middle, SlamResult& result);
  void updateVelocity(double middle, const SlamResult& result);
  Acceleration limits() const { return {options_.max_acceleration, options_.max_angular_acceleration}; }
  void approach(const Eigen::Vector3d& velocity, double elapsed);
  void updateMap(const Scan& scan, SlamResult& result);
  void keep(const Scan& scan, const Pose& pose);

  SlamOptions options_;
  MultiMap map_;
  ScanMatcher matcher_;
  PlaceFinder finder_;
  bool lost_ = false;  // until a place is sure
  std::optional<double> doubted_since_, last_place_search_;
  double doubted_way_ = 0.0, doubted_turn_ = 0.0;  // m, rad: of the first guesses since
  Scan deskewed_;
  std::vector<Pose> other_guesses_;  // without odometry, where a match from there is rejected
  mapping_common::Recent<InsertedScan> inserted_;

  Pose pose_ = Pose::Zero();                            // at the last stamp
  Eigen::Vector3d velocity_ = Eigen::Vector3d::Zero();  // in the frame of the body: m/s, m/s, rad/s
  bool velocity_known_ = false;
  // Without odometry: of a body on wheels, and of one that is carried. The one that tells the poses better is
  // believed.
  std::array<MotionFilter, 2> filters_ = {MotionFilter(true), MotionFilter(false)};
  bool soon_ = false;      // the scan comes within MatcherOptions::search_gap of the last
  bool steady_ = false;    // the first guess is that of a body with a steady velocity
  bool filtered_ = false;  // the last pose and velocity are the filters'
  std::optional<double> last_stamp_;
  std::optional<Scan> first_;  // until the next, which tells the velocity
  std::optional<Pose> last_odometry_, last_update_, last_search_;
  double last_update_stamp_ = 0.0;
  // The last scan that was matched: the middle of its sweep and the pose then.
  std::optional<double> last_match_;
  Pose matched_pose_ = Pose::Zero();
  double last_observed_ = 0.0;  // the same, of the last in all directions
};

}  // namespace intensity_hector_slam
