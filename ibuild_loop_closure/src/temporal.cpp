// SPDX-License-Identifier: BSD-3-Clause
#include "ibuild_loop_closure/temporal.h"

#include <algorithm>
#include <cmath>
#include <cstdlib>

namespace ibuild_loop_closure {

bool TemporalConsistency::allows(int query, int match) const {
  recent_.erase(std::remove_if(recent_.begin(), recent_.end(),
                               [&](const Loop& l) { return query > l.query + 1 + beta_; }),
                recent_.end());
  return recent_.empty() || std::any_of(recent_.begin(), recent_.end(), [&](const Loop& l) {
           return match >= l.match && match <= l.match + beta_;
         });
}

void TemporalConsistency::accept(int query, int match) {
  recent_.push_back({query, match});
}

double LoopTracks::left(const Track& track, int query) const {
  return track.evidence * std::pow(options_.memory, query - track.query);
}

const LoopTracks::Track* LoopTracks::trackOf(int query, int match) const {
  const Track* best = nullptr;
  for (const Track& track : tracks_) {
    if (query - track.query > beta_) continue;
    if (match < track.match - options_.backward || match > track.match + beta_) continue;
    if (!best || left(track, query) > left(*best, query)) best = &track;
  }
  return best;
}

LoopTracks::Decision LoopTracks::decide(int query, const std::vector<Hypothesis>& hypotheses) {
  Decision decision;
  std::vector<Track> extended;
  int chosen = -1;
  double most = 0.0;
  for (std::size_t i = 0; i < hypotheses.size(); ++i) {
    const Hypothesis& h = hypotheses[i];
    if (h.significance < options_.min_significance) continue;
    const Track* before = trackOf(query, h.match);
    Track track{query, h.match, h.verified ? 1 : 0, h.verified ? h.significance : 0.0, false};
    double weight = h.closeness * h.significance;
    if (before) {
      // Both walks are most likely as fast.
      const int deviation = std::abs((h.match - before->match) - (query - before->query));
      weight *= static_cast<double>(beta_) / (beta_ + deviation);
      track.verified_count += before->verified_count;
      track.evidence += left(*before, query);
      track.open = before->open;
      weight += left(*before, query);
    }
    track.open = track.verified_count >= options_.min_verified &&
                 track.evidence >= (track.open ? options_.min_significance : options_.open_significance);
    extended.push_back(track);
    if (weight > most) {
      most = weight;
      chosen = static_cast<int>(extended.size()) - 1;
      decision.hypothesis = static_cast<int>(i);
    }
  }
  if (chosen >= 0) {
    decision.accepted = extended[chosen].open;
    decision.evidence = extended[chosen].evidence;
  }
  tracks_.erase(std::remove_if(tracks_.begin(), tracks_.end(),
                               [&](const Track& t) { return query - t.query >= beta_; }),
                tracks_.end());
  tracks_.insert(tracks_.end(), extended.begin(), extended.end());
  return decision;
}

std::vector<int> LoopTracks::expected(int query) const {
  std::vector<Track> open;
  for (const Track& track : tracks_) {
    if (track.open && query - track.query <= beta_) open.push_back(track);
  }
  std::sort(open.begin(), open.end(),
            [&](const Track& a, const Track& b) { return left(a, query) > left(b, query); });
  std::vector<int> images;
  for (const Track& track : open) {
    for (int image = track.match; image <= track.match + options_.ahead; ++image) {
      if (std::find(images.begin(), images.end(), image) == images.end()) images.push_back(image);
    }
  }
  return images;
}

}  // namespace ibuild_loop_closure
