// SPDX-License-Identifier: BSD-3-Clause
//
// What earlier loops say about the next one. Images are numbered; a loop is (query, match), match < query.
#pragma once

#include <mapping_common/options.h>

#include <optional>
#include <vector>

#include "ibuild_loop_closure/geometry.h"

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
  double trust_significance = 120.0;
  int look_back = 10;

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
    o("trust_significance", trust_significance, "",
      "the same until a track is trusted: then less will do where images are like its last ones, and images "
      "before it are looked at again. What looks alike seldom has as much")
        .within(0.0, 1e6);
    o("look_back", look_back, "",
      "key frames before the one that opened a track that are checked once more when it is trusted: their "
      "loops are published then. 0: none, all loops are the last image's")
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
    Placement placement = {};
  };
  /// A loop of a track, from which those before it and after it can be told.
  struct Link {
    int query, match;
    double evidence;  ///< of the track
    Placement placement;
  };
  struct Decision {
    int hypothesis = -1;  ///< index of the best, -1: none is significant enough
    bool accepted = false;
    double evidence = 0.0;          ///< significance of the track with it
    std::optional<Link> look_back;  ///< if the track is trusted from now on: the loop that opened it
  };
  /// All hypotheses of an image.
  Decision decide(int query, const std::vector<Hypothesis>& hypotheses);
  /// Images with which open tracks may go on, the most likely first.
  std::vector<int> expected(int query) const;
  /// The last verified loop of the trusted track with most evidence left.
  std::optional<Link> lastVerified(int query) const;
  /// Whether a loop would be one of an open track.
  bool goesOn(int query, int match) const;
  /// What is left of a link's evidence at another image, before it or after it.
  double left(const Link& link, int query) const;
  /// How well a hypothesis at another image continues it, of several at this image the most is best.
  double weightOf(const Hypothesis& hypothesis, int query, const Link& link) const;

 private:
  struct Track : Link {
    int verified_count;
    bool open;
    bool trusted = false;
    Link first = {};  // that opened it
  };
  const Track* trackOf(int query, int match) const;

  TrackOptions options_;
  int beta_;
  std::vector<Track> tracks_;
};

}  // namespace ibuild_loop_closure
