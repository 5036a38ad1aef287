// SPDX-License-Identifier: BSD-3-Clause
//
// IBuILD (4.4): detects loop closures in a sequence of images with a binary vocabulary that is built while it
// runs. The thesis's method, and what goes beyond it as options.
#pragma once

#include <functional>
#include <opencv2/core.hpp>
#include <optional>
#include <string>
#include <vector>

#include "ibuild_loop_closure/features.h"
#include "ibuild_loop_closure/geometry.h"
#include "ibuild_loop_closure/stereo.h"
#include "ibuild_loop_closure/straight_run.h"
#include "ibuild_loop_closure/temporal.h"
#include "ibuild_loop_closure/vocabulary.h"

namespace ibuild_loop_closure {

struct LoopDetectorOptions {
  int delta = 70, tracking_delta = 90;
  int beta = 10;
  double min_similarity = 0.0;

  // Beyond the thesis.
  bool grouping = true;
  bool geometric_check = true;
  double step = 0.005;
  bool leave_first = true;
  double max_remaining = 0.5;
  int candidates = 5, verified_candidates = 4;

  FeatureOptions features;
  IndexOptions index;
  GeometryOptions geometry;
  StereoOptions stereo;
  TrackOptions tracks;

  /// The method of section 4.4 to the letter, with its exact linear search.
  static LoopDetectorOptions thesis();

  void describe(mapping_common::OptionList& o) {
    o("delta", delta, "bits",
      "visual words nearer than that are the same: lower for images that hardly change, higher for "
      "those that "
      "change a lot. loop_closure_images --delta auto estimates it")
        .within(1, Descriptor::kMaxBits);
    o("tracking_delta", tracking_delta, "bits", "features of consecutive images nearer than that are matched")
        .within(1, Descriptor::kMaxBits);
    o("beta", beta, "",
      "key frames: the last so many are no loops, and loops go on within so many of the last one")
        .within(1, 1000000);
    o("min_similarity", min_similarity, "", "of a loop, where there is no geometric check").within(0.0, 1.0);
    o("grouping", grouping, "",
      "true: the similarity of neighbouring key frames counts for a candidate, too");
    o("geometric_check", geometric_check, "", "true: the positions of features must agree");
    o("step", step, "",
      "of the image's width: key frames whose features moved by less since the last count for part of one in "
      "beta, so "
      "that slow and fast cameras are treated alike. 0: each counts for one")
        .within(0.0, 1.0);
    o("leave_first", leave_first, "",
      "with the geometric check: what has been in view ever since is no loop");
    o("max_remaining", max_remaining, "",
      "with leave_first: a loop's two images are more significantly alike than each is to some image between "
      "them; "
      "share of it that may remain there: less is safer")
        .within(0.0, 1.0);
    o("candidates", candidates, "",
      "key frames that are checked, and as many again where loops go on: more find more")
        .within(1, 10000);
    o("verified_candidates", verified_candidates, "",
      "of these, the most significant, whose epipolar geometry or pose is sought: takes time")
        .within(1, 10000);
    o.group("features", "", features);
    o.group("index", "", index);
    o.group("geometry", "", geometry);
    o.group("stereo", "with use_stereo: how features are found in the right image", stereo);
    o.group("tracks", "loops that follow each other", tracks);
  }
};

/// That of a rectified stereo camera; the other one is the left image.
struct RightImage {
  cv::Mat image;          ///< as the left one, of its size
  double baseline = 0.0;  ///< m, > 0
  double cx = 0.0;        ///< of its principal point, pixels
};

struct Frame {
  cv::Mat image;  ///< see FeatureExtractor::prepare
  cv::Mat depth;  ///< empty, or of the image's size: 32 bits, m, or 16 bits, mm; 0 or NaN: unknown
  std::optional<Camera> camera;          ///< intrinsics of both, if known
  std::optional<RightImage> right = {};  ///< in place of depth; of use with a camera only
};

struct Loop {
  int query = -1, match = -1;
  double similarity = 0.0;  ///< 0 to 1: the modified Jaccard index, or e / (e + open_significance) of the
                            ///< evidence e with the geometric check
  GeometryResult geometry;  ///< with the geometric check
};

struct Detection {
  int image = -1;            ///< its id, counted from 0
  std::optional<Loop> best;  ///< the most likely loop, accepted or not
  bool accepted = false;
  std::vector<Loop> earlier;  ///< those of images before, accepted now that a track confirms them; by query
  std::vector<double> similarities;  ///< with each earlier image, before any check
  int features = 0, tracked = 0, old_words = 0, new_words = 0;
};

/// In the order in which they happen; the rows of Table 4.3 and those beyond.
enum class Stage {
  kDetection,
  kDescription,
  kTracking,
  kMerging,
  kAssignment,
  kHypotheses,
  kGeometry,
  kUpdate
};
constexpr int kStages = 8;
const char* stageName(Stage stage);
using StageDone = std::function<void(Stage)>;

class LoopDetector {
 public:
  /// @throws std::invalid_argument where the options won't do
  explicit LoopDetector(const LoopDetectorOptions& options = {});

  const LoopDetectorOptions& options() const { return options_; }
  const Vocabulary& vocabulary() const { return vocabulary_; }
  int images() const { return static_cast<int>(vocabulary_.images()); }
  /// Its features; empty without the geometric check.
  const View& view(int image) const { return views_[image]; }

  /// Compares an image with all earlier ones and adds it to the vocabulary.
  /// @param done called at the end of each stage
  /// @throws std::invalid_argument if the image, its depth or its right image won't do; nothing has changed
  /// then
  Detection process(const Frame& frame, const StageDone& done = {});

  /// Says that the next image doesn't follow the last one: time jumped, the camera was moved.
  void breakSequence();

  /// See vocabulary_file.h: all but what follows from the last few images.
  void save(const std::string& path) const;
  /// Replaces the vocabulary and all images. delta and the index are the file's from then on; the descriptors
  /// have to be of the same kind.
  /// @throws std::runtime_error with the reason; the detector is then as it was
  void load(const std::string& path);

 private:
  struct Checked {
    int image;  // a candidate
    GeometryResult result;
  };
  struct Past {
    int end;        // of its candidates
    bool accepted;  // it has a loop
  };
  double progressOf(const View& view, const std::vector<Match>& tracked) const;
  std::vector<int> candidatesOf(const std::vector<double>& similarities, int end) const;
  int endOfCandidates(const View& view, int end);
  bool hasLeft(int image, int until, double significance) const;
  bool isLikely(int candidate, int image, const GeometryResult& result) const;
  bool standsOut(int candidate, int image, const View& view, const Placement& like,
                 double significance) const;
  static LoopTracks::Hypothesis hypothesisOf(const Checked& checked);
  void decideBySimilarity(int end, Detection& detection);
  void decideByGeometry(const View& view, const std::optional<Camera>& camera, int end, Detection& detection);
  std::vector<Checked> checkLike(const LoopTracks::Link& link, int image, const View& view, int end) const;
  std::vector<Loop> lookBack(LoopTracks::Link link, const std::optional<Camera>& camera) const;

  LoopDetectorOptions options_;
  FeatureExtractor extractor_;
  Vocabulary vocabulary_;
  TemporalConsistency consistency_;
  LoopTracks tracks_;
  std::vector<View> views_;
  std::vector<double> clock_;  // of each image: images until then, see LoopDetectorOptions::step
  std::vector<Past> past_;     // of each image, with the geometric check
  int first_ = 0;              // image of the sequence
  StraightRun straight_run_;
  Features last_;    // of the image before
  int in_view_ = 0;  // images from this one on show what the last one shows
};

/// 4.7.1: the largest delta at which matches of consecutive images are not false. Matches are false that
/// don't fit the pair's epipolar geometry; a share of 5 % is allowed, which pixel noise causes.
/// @param pairs consecutive images that represent the sequence
/// @return delta, 0 if too few features match
int estimateDelta(const std::vector<std::pair<Features, Features>>& pairs, int start = 160);

}  // namespace ibuild_loop_closure
