// SPDX-License-Identifier: BSD-3-Clause
#include <algorithm>
#include <utility>

#include "blocks.h"
#include "chain.h"
#include "consistency.h"
#include "pose_graph/online_graph.h"

namespace pose_graph {
namespace {

constexpr double kFar = 4.0;             // chi2 over the threshold, of loops that don't nearly fit
constexpr std::size_t kMostAllies = 20;  // loops that are tried with a group again

}  // namespace

// Truncated least squares.
double GraphOptimisation::cost() const {
  double sum = 0.0;
  for (std::size_t e = 0; e < shifts_.size(); ++e) {
    if (graph_.edges()[e].active)
      sum += graph_.chi2(e);
    else if (isLoop(e))
      sum += threshold_;
  }
  return sum;
}

GraphOptimisation::State GraphOptimisation::state() const {
  State state;
  for (const Node& node : graph_.nodes()) state.poses.push_back(node.pose);
  for (const Edge& edge : graph_.edges()) state.active.push_back(edge.active);
  state.cost = cost_;
  return state;
}
void GraphOptimisation::restore(const State& state) {
  for (std::size_t i = 0; i < state.poses.size(); ++i) graph_.setPose(i, state.poses[i]);
  for (std::size_t e = 0; e < state.active.size(); ++e) graph_.setActive(e, state.active[e]);
  cost_ = state.cost;
}

// Optimises after changes, and accepts what fits and nothing else, until no more change.
void GraphOptimisation::settle(Edges changed) {
  for (int round = 0; round < 5 && !changed.empty(); ++round) {
    optimiseAround(graph_, changed, options_.optimisation, progress_);
    ++solved_;
    changed.clear();
    for (std::size_t e = 0; e < shifts_.size(); ++e) {
      if (!isLoop(e)) continue;
      const bool fits = graph_.chi2(e) <= threshold_;
      if (fits == graph_.edges()[e].active) continue;
      graph_.setActive(e, fits);
      changed.push_back(e);
    }
  }
  if (!changed.empty()) {
    optimiseAround(graph_, changed, options_.optimisation, progress_);
    ++solved_;
  }
  cost_ = cost();
}

// Parts begin where the first edge between them has the later one.
void GraphOptimisation::join(const Edges& added) {
  std::vector<std::size_t> part = connectedParts(graph_);
  for (const std::size_t e : added) {
    const Edge& edge = graph_.edges()[e];
    const std::size_t a = part[edge.from], b = part[edge.to];
    if (a == b) continue;
    const Pose &from = graph_.nodes()[edge.from].pose, &to = graph_.nodes()[edge.to].pose;
    const Pose motion =
        a < b ? from * edge.transform * to.inverse() : to * edge.transform.inverse() * from.inverse();
    if (!motion.translation.allFinite() || !motion.rotation.coeffs().allFinite()) continue;
    for (std::size_t i = 0; i < part.size(); ++i) {
      if (part[i] != std::max(a, b)) continue;
      part[i] = std::min(a, b);
      const Pose moved = motion * graph_.nodes()[i].pose;
      if (moved.translation.allFinite()) graph_.setPose(i, moved);
    }
  }
}

// @return false if that isn't better, and nothing has changed
bool GraphOptimisation::tryWith(const Edges& added, const Edges& removed) {
  const State before = state();
  join(added);
  for (const std::size_t e : added) graph_.setActive(e, true);
  for (const std::size_t e : removed) graph_.setActive(e, false);
  Edges changed = added;
  changed.insert(changed.end(), removed.begin(), removed.end());
  settle(changed);
  if (cost_ < before.cost - 0.01 * threshold_) return true;
  restore(before);
  return false;
}

// @return whether what is accepted is in doubt
bool GraphOptimisation::tryGroup(const Edges& group) {
  const auto agree = [&](std::size_t a, std::size_t b) {
    return !shifts_[a]->comparable(*shifts_[b]) || shifts_[a]->disagreement(*shifts_[b]) <= threshold_;
  };
  const auto agreesWithAll = [&](std::size_t e, const Edges& others) {
    return std::all_of(others.begin(), others.end(), [&](std::size_t other) { return agree(e, other); });
  };
  Edges against, allies;
  for (std::size_t e = 0; e < shifts_.size(); ++e) {
    if (!isLoop(e) || std::find(group.begin(), group.end(), e) != group.end()) continue;
    const bool agrees = agreesWithAll(e, group);
    if (graph_.edges()[e].active != agrees) (agrees ? allies : against).push_back(e);
  }
  const bool outvoted = against.size() > 2 * (group.size() + allies.size()) + 2;
  const bool is_far = std::all_of(group.begin(), group.end(),
                                  [&](std::size_t e) { return graph_.chi2(e) > kFar * threshold_; });
  if (outvoted && is_far) return false;
  tryWith(group, {});
  // What was refused, and says the same as the group: together they may be believed.
  const auto distance = [&](std::size_t a, std::size_t b) {
    const auto apart = [](std::size_t i, std::size_t j) { return std::max(i, j) - std::min(i, j); };
    const Edge &first = graph_.edges()[a], &second = graph_.edges()[b];
    return apart(first.from, second.from) + apart(first.to, second.to);
  };
  std::stable_sort(allies.begin(), allies.end(), [&](std::size_t a, std::size_t b) {
    return distance(a, group.front()) < distance(b, group.front());
  });
  allies.resize(std::min(allies.size(), kMostAllies));
  const auto inactive = [&](Edges edges) {
    edges.insert(edges.end(), group.begin(), group.end());
    edges.erase(
        std::remove_if(edges.begin(), edges.end(), [&](std::size_t e) { return graph_.edges()[e].active; }),
        edges.end());
    return edges;
  };
  if (!allies.empty()) tryWith(inactive(allies), {});
  if (against.empty() || outvoted) return false;
  Edges instead;
  for (const std::size_t e : allies)
    if (!agreesWithAll(e, against)) instead.push_back(e);
  tryWith(inactive(instead), against);
  return true;
}

// Of several loops that place a part, a wrong one may pull it away from where the others have it: each is
// tried alone, with all that fits then.
void GraphOptimisation::tryToJoin(const Edges& group) {
  const std::vector<std::size_t> part = connectedParts(graph_);
  const auto joins = [&](std::size_t e) {
    return part[graph_.edges()[e].from] != part[graph_.edges()[e].to];
  };
  if (std::none_of(group.begin(), group.end(), joins)) return;
  const State before = state();
  State best = before;
  for (const std::size_t e : group) {
    if (!joins(e)) continue;
    if (tryWith({e}, {}) && cost_ < best.cost) best = state();
    restore(before);
  }
  restore(best);
}

// Groups of wrong loops that agree with each other may fit, and bend the trusted edges between. Those with
// the largest residuals are left out in turn.
void GraphOptimisation::doubt() {
  Edges accepted;
  for (std::size_t e = 0; e < shifts_.size(); ++e)
    if (isLoop(e) && graph_.edges()[e].active) accepted.push_back(e);
  std::vector<std::pair<double, Edges>> groups;
  for (Edges& group : groupsOf(graph_, accepted)) {
    double chi2 = 0.0;
    for (const std::size_t e : group) chi2 += graph_.chi2(e);
    groups.emplace_back(chi2, std::move(group));
  }
  std::stable_sort(groups.begin(), groups.end(),
                   [](const auto& a, const auto& b) { return a.first > b.first; });
  for (std::size_t i = 0; i < std::min<std::size_t>(groups.size(), options_.max_doubts); ++i) {
    Edges active;
    for (const std::size_t e : groups[i].second)
      if (graph_.edges()[e].active) active.push_back(e);
    if (!active.empty()) tryWith({}, active);
  }
}

void GraphOptimisation::run(const Progress& progress) {
  bool ended = false;
  progress_ = [&](int iteration, double chi2) {
    ended |= progress && !progress(iteration, chi2);
    return !ended;
  };
  if (all_) {
    OptimisationOptions to_the_end;
    to_the_end.max_iterations = std::max(to_the_end.max_iterations, options_.optimisation.max_iterations);
    optimise(graph_, to_the_end, progress_);
    ++solved_;
  }
  settle(changed_);
  bool in_doubt = all_;
  Edges loops = new_loops_;
  if (all_) {
    loops.clear();
    for (std::size_t e = 0; e < shifts_.size(); ++e)
      if (isLoop(e) && !graph_.edges()[e].active) loops.push_back(e);
  }
  const std::vector<Edges> groups = groupsOf(graph_, loops);
  if (groups.size() > 1) tryWith(loops, {});
  for (const Edges& group : groups) {
    Edges left;
    for (const std::size_t e : group)
      if (!graph_.edges()[e].active) left.push_back(e);
    if (!left.empty() && !ended) in_doubt |= tryGroup(left);
    if (left.size() > 1 && !ended) tryToJoin(left);
  }
  if (in_doubt && !ended) doubt();
  progress_ = nullptr;
}

}  // namespace pose_graph
