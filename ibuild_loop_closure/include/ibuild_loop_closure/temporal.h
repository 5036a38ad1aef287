// SPDX-License-Identifier: BSD-3-Clause
//
// What earlier loops say about the next one. Images are numbered; a loop is (query, match), match < query.
#pragma once

#include <mapping_common/options.h>

#include <vector>

namespace ibuild_loop_closure {

/// 4.4.3: after a loop (t - 1, t - k), loops in [t, t + beta] must lie in [t - k, t - k + beta]; after loops
/// to several earlier visits, in the interval of any of them.
class TemporalConsistency {
 public:
  explicit TemporalConsistency(int beta) : beta_(beta) {}
  bool allows(int query, int match) const;
  void accept(int query, int match);

 private:
  struct Loop {
    int query, match;
  };
  int beta_;
  mutable std::vector<Loop> recent_;  // of the last beta images
};

struct TrackOptions {
  double min_significance = 4.0, open_significance = 60.0;
  int min_verified = 2;
  double memory = 0.75;
  int backward = 2, ahead = 4;

  void describe(mapping_common::OptionList& o) {
    o("min_significance", min_significance, "", "-log10 of the false alarms of a pair's layout, at least")
        .within(0.0, 1e6);
    o("open_significance", open_significance, "",
      "of all verified pairs of a track until its loops are published: higher is safer, later")
        .within(0.0, 1e6);
    o("min_verified", min_verified, "", "verified pairs until then").within(0, 1000);
    o("memory", memory, "", "share of a track's significance that is left after a key frame without a loop")
        .within(0.0, 1.0);
    o("backward", backward, "", "key frames that the match may step back by").within(0, 1000);
    o("ahead", ahead, "", "key frames after the last match that are checked, whatever their words")
        .within(0, 1000);
  }
};

/// Loops that follow each other as in TemporalConsistency are a track. One image may deceive, several in a
/// row that agree seldom do: a track's loops are accepted once its verified ones are significant enough, from
/// then on those that are less significant by themselves, too.
class LoopTracks {
 public:
  LoopTracks(const TrackOptions& options, int beta) : options_(options), beta_(beta) {}

  struct Hypothesis {
    int match = -1;
    double significance = 0.0;
    bool verified = false;
    double closeness = 1.0;  ///< 0 to 1, of the viewpoints; the closest of similar images is the match
  };
  struct Decision {
    int hypothesis = -1;  ///< index of the best, -1: none is significant enough
    bool accepted = false;
    double evidence = 0.0;  ///< significance of the track with it
  };
  /// All hypotheses of an image.
  Decision decide(int query, const std::vector<Hypothesis>& hypotheses);
  /// Images with which open tracks may go on, the most likely first.
  std::vector<int> expected(int query) const;

 private:
  struct Track {
    int query, match, verified_count;
    double evidence;
    bool open;
  };
  double left(const Track& track, int query) const;
  const Track* trackOf(int query, int match) const;

  TrackOptions options_;
  int beta_;
  std::vector<Track> tracks_;
};

}  // namespace ibuild_loop_closure
