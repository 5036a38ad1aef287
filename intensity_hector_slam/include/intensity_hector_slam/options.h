// SPDX-License-Identifier: BSD-3-Clause
//
// What SLAM is started with. config/slam.yaml says how each changes the result.
#pragma once

#include <string>

namespace intensity_hector_slam {

struct MapOptions {
  double resolution = 0.025;  ///< m, edge of a cell of the finest level
  int levels = 3;             ///< each has cells twice as large as the one before
  double size_x = 25.6;       ///< m, at the start
  double size_y = 25.6;       ///< m
  double start_x = 0.5;       ///< where the origin of the map frame is, as a share of size_x
  double start_y = 0.5;       ///< the same of size_y
  bool grow = true;           ///< true: the map grows with what is seen; false: what is outside is ignored
  double max_size = 400.0;    ///< m, longest side that a map may grow to
  double update_factor_free = 0.48;     ///< P(g | z) of a cell that a beam crosses, 0 to 0.5
  double update_factor_occupied = 0.7;  ///< P(g | z) of a cell that a beam ends in, 0.5 to 1
  /// m, the last part of each beam, which clears unknown cells alone: a wall seen at a grazing angle lies
  /// along it, and would wear away between the few beams that hit it.
  double clear_margin = 0.2;
  /// Occupancy below which a cell of the coarsest level is surely free. What appears there, with no occupied
  /// cell around, counts as 1 - update_factor_free instead of update_factor_occupied: it may move on. 0:
  /// never.
  double sure_free = 0.3;
  double min_probability = 0.02;  ///< occupancy never falls below: an obstacle that comes is seen soon
  double max_probability = 0.98;  ///< occupancy never rises above: an obstacle that goes is cleared soon
  int max_count =
      1000;  ///< observations that the mean reflectivity goes over; then the latest count 1/max_count

  /// @throws std::invalid_argument that names the option, its value and what is allowed
  void validate() const;
};

/// What a pose minimises the squares of, for beam i with the end point S_i.
enum class Cost {
  kOccupancy,     ///< 1 - M(S_i): Hector SLAM's own
  kReflectivity,  ///< rho_i - R(S_i), Eq. 3.6
  kCombined,      ///< both, weighted
  kAuto           ///< occupancy or combined for each scan, by density and observability
};

/// Weight of a residual e against moving objects, with the scale s.
enum class RobustKernel {
  kNone,    ///< 1
  kHuber,   ///< s / |e| beyond s
  kCauchy,  ///< 1 / (1 + (e / s)^2)
  kTukey    ///< (1 - (e / s)^2)^2, 0 beyond s
};

/// When a window around the first guess is searched for the best start of the iterations.
enum class Search {
  kNever,
  kWhenUnsure,  ///< without odometry and with scans far apart, after a long way or turn, at the start, after
                ///< a pause, where a match is rejected or, once per update of the map, contradicts the map
  kAlways
};

struct MatcherOptions {
  Cost cost = Cost::kCombined;
  double occupancy_weight = 1.0;     ///< combined: of the squared residuals of the occupancy
  double reflectivity_weight = 1.0;  ///< combined: of the squared residuals of the reflectivity
  RobustKernel robust_kernel = RobustKernel::kCauchy;
  double robust_scale = 0.5;  ///< s, in units of the residual
  int max_iterations = 12;    ///< on each level
  int max_halvings =
      3;  ///< of a step that doesn't lower the cost; with 0 each step is taken, as in Hector SLAM
  double max_step_distance = 0.1;   ///< m, of one iteration
  double max_step_angle = 0.1;      ///< rad, of one iteration
  double min_step_distance = 2e-4;  ///< m, an iteration that moves less is the last
  double min_step_angle = 1e-4;     ///< rad, and turns less
  double min_cost_change = 3e-4;    ///< of the cost, an iteration that lowers it by less is the last
  double coarse_step = 0.05;        ///< cells: less is the last iteration on all but the finest level
  /// Cells of the finest level: on all others, neighbouring points within this count as one. What is near
  /// has the most beams, and people walk near. 0: each counts.
  double coarse_spacing = 0.75;
  int coarse_points = 250;  ///< level k > 0 uses 1 / 2^k of those points, but no fewer than this
  /// What a scan tells about the pose is judged from lines through neighbouring points: H holds the noise of
  /// the grid, too.
  double surface_length = 0.6;  ///< m, of such lines
  /// Where the normals of the lines tell less in some direction than this share of what they tell in the best
  /// (angles times the scan's mean range), occupancy doesn't observe the pose there.
  double min_observability = 0.002;
  /// Reflectivity does where it changes along the lines: the square of its slope, over what noise alone would
  /// give, is at least this on the average. Otherwise the pose stays where the first guess is.
  double min_texture = 10.0;
  /// Where the normals tell less than this share, and reflectivity has texture, it is left to reflectivity.
  double min_geometry = 0.02;

  double auto_max_spacing =
      0.1;  ///< m, auto: with the median distance of neighbouring points beyond, reflectivity
            ///< has no good normals, and is used only where occupancy leaves a direction open
  double auto_min_known = 0.3;  ///< auto: share of points with known reflectivity for it to be used

  double sigma = 0.0;             ///< of K = sigma^2 H^-1; 0: estimated from the residuals of each scan
  double covariance_scale = 2.0;  ///< factor on K: residuals of neighbouring beams aren't independent
  /// Cells of the finest level: standard deviation of what all beams have in common, of points at the scan's
  /// mean range for the angle. It is added to K.
  double covariance_floor = 0.03;
  double unobservable_distance = 1.0;  ///< m, standard deviation in a direction that isn't observable
  double unobservable_angle = 0.5;     ///< rad, and of the angle

  Search search = Search::kWhenUnsure;
  double search_gap = 0.09;  ///< s, scans at least as far apart are, without odometry, reason to search
  double search_motion_distance = 0.3;  ///< m, of the first guess since the last scan: more is reason, too
  double search_motion_angle = 0.2;     ///< rad
  double search_contradiction = 0.2;    ///< share of the points in free space: more is reason, too
  double search_min_gain = 0.25;  ///< of Match::score(), for such a search's result to replace the match
  double search_distance = 0.3;   ///< m, half the width of the window
  double search_angle = 0.35;     ///< rad, half its range of angles
  int search_points = 200;        ///< of the scan, evenly spread

  /// @throws std::invalid_argument that names the option, its value and what is allowed
  void validate() const;
};

/// Where the iterations start.
enum class Guess {
  kLastPose,
  kConstantVelocity,  ///< of the last two poses
  kOdometry           ///< the last pose moved on by the odometry; without any, constant velocity
};

struct SlamOptions {
  MapOptions map;
  MatcherOptions matcher;
  Guess guess = Guess::kOdometry;
  bool localization = false;     ///< true: the map stays as it is
  bool deskew = true;            ///< true: points are moved to where they are seen from at the scan's stamp
  double update_distance = 0.4;  ///< m, travelled before another scan goes into the map
  double update_angle = 0.9;     ///< rad, or turned
  double update_period = 0.5;    ///< s, or that went by: what moves on isn't left in the map of who stands
  int min_points = 20;           ///< a scan with fewer is empty
  double max_contradiction =
      0.6;  ///< share of the points in space known as free beyond which a match is rejected
  double max_correction_distance = 0.5;    ///< m, by which a match may differ from the first guess
  double max_correction_angle = 0.7;       ///< rad
  double max_speed = 5.0;                  ///< m/s, faster odometry may have jumped
  double max_turn_rate = 10.0;             ///< rad/s
  double max_acceleration = 5.0;           ///< m/s^2, by which the velocity of the first guess changes
  double max_angular_acceleration = 15.0;  ///< rad/s^2
  double max_gap = 1.0;  ///< s, between scans; longer is a pause, over which no velocity holds

  /// @throws std::invalid_argument that names the option, its value and what is allowed
  void validate() const;
};

/// From the names that parameters and command lines use.
/// @throws std::invalid_argument that names the option, the value and what is allowed
Cost parseCost(const std::string& name);                  ///< occupancy | reflectivity | combined | auto
RobustKernel parseRobustKernel(const std::string& name);  ///< none | huber | cauchy | tukey
Search parseSearch(const std::string& name);              ///< never | when_unsure | always
Guess parseGuess(const std::string& name);                ///< last_pose | constant_velocity | odometry
std::string toString(Cost cost);

}  // namespace intensity_hector_slam
