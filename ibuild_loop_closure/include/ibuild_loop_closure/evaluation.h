// SPDX-License-Identifier: BSD-3-Clause
//
// Precision and recall of detected loops (4.4.4, 4.6.1), and the ground truth that they are measured with.
#pragma once

#include <Eigen/Geometry>
#include <optional>
#include <string>
#include <vector>

namespace ibuild_loop_closure {

/// For each image the intervals of earlier images that show the same place.
class GroundTruth {
 public:
  struct Interval {
    int first, last;  ///< inclusive
  };
  explicit GroundTruth(int images = 0) : intervals_(images) {}
  void add(int query, Interval interval);
  bool isLoop(int query, int match) const;
  bool hasLoop(int query) const { return !intervals_[query].empty(); }
  int images() const { return static_cast<int>(intervals_.size()); }
  /// How many images have a loop.
  int loops() const;

  /// Rows "query first last"; # starts a comment. A number is that of an image in `ids`.
  /// @param ids the numbers that the file has for images 0, 1, ...
  /// @param tolerance images that intervals are widened by on both sides
  /// @throws std::runtime_error that names the file and the line
  static GroundTruth fromIntervals(const std::string& path, const std::vector<int>& ids, int tolerance = 0);
  /// Each of several walks of the same route has the same images.
  static GroundTruth fromWalks(const std::vector<int>& lengths, int tolerance);
  /// Images at least `gap` apart whose cameras are nearer than `distance` (m) and whose optical axes differ
  /// by less than `angle` (rad).
  static GroundTruth fromPoses(const std::vector<Eigen::Isometry3d>& poses, double distance, double angle,
                               int gap);

 private:
  std::vector<std::vector<Interval>> intervals_;
};

/// A file of camera poses, one a row: 12 numbers (3 x 4, row-major), 13 (the image's number first), 16, or 8
/// (time, position, quaternion x y z w).
/// @param ids as in GroundTruth::fromIntervals, for 13 numbers; otherwise rows are images
/// @throws std::runtime_error that names the file and what is wrong
std::vector<Eigen::Isometry3d> loadPoses(const std::string& path, const std::vector<int>& ids);

/// One image's most likely loop.
struct Proposal {
  int query = -1, match = -1;
  double similarity = 0.0;
  bool accepted = false;
};

struct PrecisionRecall {
  int detected = 0, correct = 0, loops = 0;
  double precision() const { return detected > 0 ? static_cast<double>(correct) / detected : 1.0; }
  double recall() const { return loops > 0 ? static_cast<double>(correct) / loops : 0.0; }
};

/// Of the accepted ones.
PrecisionRecall evaluate(const std::vector<Proposal>& proposals, const GroundTruth& truth);

struct CurvePoint {
  double threshold = 0.0;  ///< proposals of at least that similarity are taken for loops
  PrecisionRecall at;
};
/// Over all thresholds, the highest first.
std::vector<CurvePoint> precisionRecallCurve(std::vector<Proposal> proposals, const GroundTruth& truth);
/// The point of the highest recall at 100 % precision, as in Table 4.2.
std::optional<CurvePoint> bestAtFullPrecision(const std::vector<CurvePoint>& curve);

}  // namespace ibuild_loop_closure
