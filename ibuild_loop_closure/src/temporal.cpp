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

double LoopTracks::left(const Link& link, int query) const {
  return link.evidence * std::pow(options_.memory, std::abs(query - link.query));
}

double LoopTracks::weightOf(const Hypothesis& hypothesis, int query, const Link& link) const {
  // Both walks are most likely as fast.
  const int deviation = std::abs((hypothesis.match - link.match) - (query - link.query));
  return hypothesis.closeness * hypothesis.significance * beta_ / (beta_ + deviation) + left(link, query);
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
    Track track{{query, h.match, h.verified ? h.significance : 0.0, h.placement}, h.verified ? 1 : 0, false};
    const double weight = before ? weightOf(h, query, *before) : h.closeness * h.significance;
    const bool was_open = before && before->open;
    if (before) {
      track.verified_count += before->verified_count;
      track.evidence += left(*before, query);
      track.trusted = before->trusted;
      track.first = before->first;
    }
    track.open = track.verified_count >= options_.min_verified &&
                 track.evidence >= (was_open ? options_.min_significance : options_.open_significance);
    if (!was_open) track.first = track;
    const bool was_trusted = track.trusted;
    track.trusted = track.open && (was_trusted || track.evidence >= options_.trust_significance);
    extended.push_back(track);
    if (weight > most) {
      most = weight;
      decision.look_back.reset();
      if (track.trusted && !was_trusted) {
        decision.look_back = track.first;
        decision.look_back->evidence = track.evidence;
      }
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

bool LoopTracks::goesOn(int query, int match) const {
  const Track* track = trackOf(query, match);
  return track && track->open;
}

std::optional<LoopTracks::Link> LoopTracks::lastVerified(int query) const {
  constexpr double more = 1.0 + 1e-9;  // than what others have left of the same
  std::optional<Link> last;
  for (const Track& track : tracks_) {
    if (track.trusted && query - track.query <= beta_ &&
        (!last || left(track, query) > more * left(*last, query)))
      last = track;
  }
  return last;
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
