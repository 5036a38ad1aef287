// SPDX-License-Identifier: BSD-3-Clause
//
// How far an estimated trajectory is from the truth: relations between poses (Kuemmerle et al., "On Measuring
// the Accuracy of SLAM Algorithms", Autonomous Robots 27(4), 2009), the delta pose error of consecutive poses
// (Burgard et al., "A Comparison of SLAM Algorithms Based on a Graph of Relations", IROS 2009; Fig. 3.7), and
// the absolute trajectory error (Sturm et al., IROS 2012).
#pragma once

#include <mapping_simulation/trajectory.h>

#include <Eigen/Geometry>
#include <cstddef>
#include <functional>
#include <iosfwd>
#include <limits>
#include <map>
#include <optional>
#include <string>
#include <vector>

namespace rosbag_tests {

/// Mean and standard deviation (of the population), median and maximum of a list; NaN of an empty one.
struct Moments {
  double mean, deviation, median, max;
};
Moments momentsOf(std::vector<double> values);

/// Pose of a trajectory at a time: that of its pose within 10 microseconds, else interpolated between two
/// poses that are at most `max_gap` (s) apart; nothing elsewhere.
std::optional<Eigen::Isometry3d> poseAt(const mapping_simulation::Trajectory& trajectory, double time,
                                        double max_gap);

/// Error of one pose or of the difference of two.
struct PoseError {
  double time;         ///< s, of the (later) pose
  double translation;  ///< m
  double rotation;     ///< rad, angle of the rotation
};

struct PoseErrors {
  std::vector<PoseError> errors;
  std::size_t unmatched = 0;  ///< left out, as there was no pose for their time

  Moments translation() const;         ///< m
  Moments rotation() const;            ///< rad
  Moments squaredTranslation() const;  ///< m^2
  Moments squaredRotation() const;     ///< rad^2
};

/// Pose of the body at `to`, seen from its pose at `from` (s).
struct Relation {
  double from, to;
  Eigen::Isometry3d pose;
};

/// Reads lines `from to x y z roll pitch yaw` (s, m, rad); # starts a comment. Throws std::runtime_error that
/// names file and line.
std::vector<Relation> readRelations(const std::string& file);

/// Stamps that were changed on the way from a log to the trajectory: lines `stamp original`, as carmen_to_bag
/// writes them. Gives the stamp of an original to the microsecond, and others as they are.
class StampMap {
 public:
  StampMap() = default;
  explicit StampMap(const std::string& file);
  double operator()(double original) const;

 private:
  std::map<long long, double> stamps_;  // original in microseconds -> stamp
};

/// Error of each relation: T of delta*^-1 delta, delta = x_from^-1 x_to of the trajectory, delta* the
/// relation; its translation's norm, and its rotation's angle. What Kuemmerle et al. tabulate are
/// translation() and rotation() (absolute errors), squaredTranslation() and squaredRotation(), with equal
/// weights (their Eq. 4).
PoseErrors relationErrors(const mapping_simulation::Trajectory& trajectory,
                          const std::vector<Relation>& relations, double max_gap,
                          const StampMap& stamps = StampMap());

/// Delta pose error (section 3.5.2): of each pose of the estimate, what it differs from the one before it
/// against what the reference differs between the same times. epsilon(delta) are the means of the squares.
PoseErrors deltaErrors(const mapping_simulation::Trajectory& reference,
                       const mapping_simulation::Trajectory& estimate, double max_gap);

/// How an estimate is laid over the reference.
enum class Alignment {
  kNone,   ///< not at all
  kFirst,  ///< at its first pose that has a reference
  kRigid,  ///< by the rotation about z and the translation that minimise the squared distances (Umeyama 1991)
};

/// Absolute trajectory error: of each pose of the estimate, against the reference at its time.
PoseErrors absoluteErrors(const mapping_simulation::Trajectory& reference,
                          const mapping_simulation::Trajectory& estimate, double max_gap,
                          Alignment alignment);

/// A table: mean, standard deviation, median and maximum of translation (m) and rotation (degrees), the means
/// of their squares, and how many were used and left out.
void printErrors(std::ostream& out, const std::string& name, const PoseErrors& errors);

/// The same as one JSON object with the key `name`, and the single errors; for plot_evaluation.py.
std::string errorsToJson(const PoseErrors& errors);

}  // namespace rosbag_tests
