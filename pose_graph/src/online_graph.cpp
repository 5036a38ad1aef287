// SPDX-License-Identifier: BSD-3-Clause
#include "pose_graph/online_graph.h"

#include <algorithm>
#include <cmath>
#include <numeric>
#include <stdexcept>
#include <utility>

#include "chain.h"
#include "consistency.h"

namespace pose_graph {
namespace {

constexpr std::int64_t kRetry = 100'000'000;  // ns, between two looks at what waits

std::int64_t nanoseconds(double seconds) {
  return std::llround(1e9 * seconds);
}

// As the graph takes it: in the plane, where it is planar, and without directions of no information at all,
// which would leave poses undetermined. @throws std::invalid_argument
Measurement prepared(Measurement m, bool planar, double odometry_scale) {
  if (m.from_stamp <= 0 || m.to_stamp <= 0) throw std::invalid_argument("an edge without stamps");
  if (m.from_stamp == m.to_stamp) throw std::invalid_argument("an edge from a stamp to itself");
  checkTransform(m.transform, "an edge");
  checkInformation(m.information, "an edge");
  const auto& diagonal = m.information.diagonal();
  const double most = planar ? std::max({diagonal[0], diagonal[1], diagonal[5]}) : diagonal.maxCoeff();
  if (!(most > 0.0)) throw std::invalid_argument("the information of an edge is zero");
  m.transform.rotation.normalize();
  if (planar)
    m.transform = planarPose(m.transform.translation.x(), m.transform.translation.y(), m.transform.yaw());
  const bool leaves_plane = !m.information.block<6, 3>(0, 2).isZero(0.0);
  const Matrix6 covariance = inverseOf(m.information, planar && !leaves_plane);
  m.information = inverseOf(covariance, planar);
  if (m.type == EdgeType::kConsecutive) m.information /= odometry_scale * odometry_scale;
  return m;
}

}  // namespace

void OnlineOptions::describe(mapping_common::OptionList& o) {
  o("planar", planar, "", "true: poses are x, y and yaw, and of edges in space that part counts");
  o("stamp_tolerance", stamp_tolerance, "s", "stamps that differ by less are of one pose").within(0.0, 0.1);
  o("wait", wait, "s", "that an edge waits for poses of its stamps, by later stamps").within(0.0, 1000.0);
  o("most_waiting", most_waiting, "", "edges that wait; the oldest is dropped").within(1, 1000000);
  o("confidence", confidence, "", "share of right loops that is accepted, if their information is right")
      .above(0.5)
      .below(1.0);
  o("odometry_scale", odometry_scale, "",
    "what the standard deviations of consecutive edges are multiplied by; above 1 where the front end is too "
    "sure of itself")
      .within(0.01, 1000.0);
  o("max_doubts", max_doubts, "",
    "after new loops that contradict others, so many groups of accepted ones are tried without")
      .within(0, 1000);
  optimisation.describe(o);
}

Measurement ofBody(const Measurement& of_sensor, const Pose& sensor) {
  Measurement m = of_sensor;
  const Pose back = sensor.inverse();
  m.transform = sensor * of_sensor.transform * back;
  const Matrix6 a = adjoint(back);
  m.information = a.transpose() * of_sensor.information * a;
  return m;
}

OnlineGraph::OnlineGraph(const OnlineOptions& options)
    : options_(mapping_common::validate(options)), graph_(options.planar) {}
OnlineGraph::~OnlineGraph() = default;
OnlineGraph::OnlineGraph(OnlineGraph&&) noexcept = default;
OnlineGraph& OnlineGraph::operator=(OnlineGraph&&) noexcept = default;

void OnlineGraph::restore(const Graph& graph, const std::vector<EdgeRecord>& records) {
  if (!graph_.nodes().empty()) throw std::invalid_argument("the graph isn't empty");
  if (graph.planar() != options_.planar)
    throw std::invalid_argument(std::string("the graph is in ") + (graph.planar() ? "the plane" : "space"));
  for (const Node& node : graph.nodes()) {
    next_id_ = node.id;
    graph_.setFixed(addNode(node.stamp, node.pose), node.fixed);
  }
  next_id_ = 0;
  for (const Node& node : graph.nodes()) next_id_ = std::max(next_id_, node.id + 1);
  for (std::size_t e = 0; e < records.size(); ++e) {
    const EdgeRecord& r = records[e];
    const Edge& edge = graph.edges()[e];
    if (chain_source_.empty() && edge.type == EdgeType::kConsecutive) chain_source_ = r.source;
    addEdge(edge,
            {r.from_stamp, r.to_stamp, edge.type, edge.transform, edge.information, r.source, r.trusted});
    records_.back().state = r.state;
    seen_.emplace(r.from_stamp, std::pair(r.to_stamp, r.source));
  }
  rebuildChains();
  resetParts(records_.size());
}

// ------------------------------------------------------------------------------------------------ what comes

OnlineGraph::Added OnlineGraph::add(const Measurement& measurement) {
  const Measurement m = prepared(measurement, options_.planar, options_.odometry_scale);
  if (isDoubled(m)) return Added::kDoubled;
  seen_.emplace(m.from_stamp, std::pair(m.to_stamp, m.source));
  if (m.type == EdgeType::kConsecutive && (chain_source_.empty() || chain_source_ == m.source)) {
    chain_source_ = m.source;
    addConsecutive(m);
    return Added::kNow;
  }
  if (const auto added = tryToAttach(m)) return *added;
  if (waiting_.size() >= static_cast<std::size_t>(options_.most_waiting)) {
    const Measurement& oldest = waiting_.front().measurement;
    events_.push_back(
        {GraphEvent::Kind::kCrowded, oldest.from_stamp, oldest.to_stamp, oldest.source, 0.0, oldest});
    waiting_.pop_front();
  }
  waiting_.push_back({m, now_});
  return Added::kWaits;
}

bool OnlineGraph::isDoubled(const Measurement& m) const {
  const std::int64_t tolerance = nanoseconds(options_.stamp_tolerance);
  const auto end = seen_.upper_bound(m.from_stamp + tolerance);
  for (auto i = seen_.lower_bound(m.from_stamp - tolerance); i != end; ++i)
    if (std::abs(i->second.first - m.to_stamp) <= tolerance && i->second.second == m.source) return true;
  return false;
}

void OnlineGraph::addKeyPose(std::int64_t stamp) {
  if (stamp <= 0) throw std::invalid_argument("a key pose without a stamp");
  if (!find(stamp)) addNode(stamp, {});
  now_ = std::max(now_, stamp);
  retryWaiting();
}

void OnlineGraph::addFrontEndPose(std::int64_t stamp, const Pose& pose) {
  checkTransform(pose, "a pose of the front end");
  if (!trajectory_.add(stamp, pose)) return;
  placeStart();
  timePassed(stamp);
}

std::size_t OnlineGraph::beginNewRun() {
  const std::size_t waited = waiting_.size();
  waiting_.clear();
  nodes_.clear();
  seen_.clear();
  trajectory_.clear();
  start_.reset();
  now_ = last_retry_ = 0;
  return waited;
}

void OnlineGraph::timePassed(std::int64_t stamp) {
  now_ = std::max(now_, stamp);
  if (now_ - last_retry_ >= kRetry) retryWaiting();
}

void OnlineGraph::retryWaiting() {
  last_retry_ = now_;
  for (std::size_t left = waiting_.size(); left > 0; --left) {
    Waiting waiting = std::move(waiting_.front());
    waiting_.pop_front();
    if (tryToAttach(waiting.measurement)) continue;
    const Measurement& m = waiting.measurement;
    if (waiting.since == 0) waiting.since = now_;
    if (now_ - waiting.since > nanoseconds(options_.wait))
      events_.push_back({GraphEvent::Kind::kExpired, m.from_stamp, m.to_stamp, m.source, 0.0, m});
    else
      waiting_.push_back(std::move(waiting));
  }
}

void OnlineGraph::addConsecutive(const Measurement& m) {
  std::optional<std::size_t> from = find(m.from_stamp), to = find(m.to_stamp);
  const bool had_both = from && to;
  if (!from && !to) {
    const auto front_end = trajectory_.at(m.from_stamp);
    Pose start = correction_;
    if (front_end)
      start = correction_ * *front_end;
    else if (!graph_.nodes().empty())
      start = graph_.nodes().back().pose;
    if (!graph_.nodes().empty())
      events_.push_back({GraphEvent::Kind::kNewPart, m.from_stamp, m.to_stamp, m.source, 0.0, {}});
    const Pose correction = correction_;
    from = addNode(m.from_stamp, start);
    start_.reset();
    if (!front_end) start_ = Start{*from, correction};
  }
  if (!from) from = addNode(m.from_stamp, graph_.nodes()[*to].pose * m.transform.inverse());
  if (!to) to = addNode(m.to_stamp, graph_.nodes()[*from].pose * m.transform);
  const std::size_t e = addEdge({*from, *to, m.type, m.transform, m.information, true}, m);
  link(e);
  const bool joins = partOf(*from) != partOf(*to);
  place(e);
  if (had_both && joins) say(GraphEvent::Kind::kJoined, e);
  if (had_both && !joins) changed_.push_back(e);
  updateCorrection();
  now_ = std::max({now_, m.from_stamp, m.to_stamp});
  retryWaiting();
}

std::size_t OnlineGraph::addNode(std::int64_t stamp, const Pose& pose) {
  const std::size_t node = graph_.addNode({next_id_++, stamp, pose, false});
  nodes_[stamp] = node;
  chain_poses_.emplace_back();
  chain_poses_.back().chain = chains_.size();
  chains_.push_back({node});
  part_.push_back(node);
  part_sizes_.push_back(1);
  return node;
}

std::size_t OnlineGraph::addEdge(const Edge& edge, const Measurement& m) {
  const std::size_t e = graph_.addEdge(edge);
  const bool trusted = m.type == EdgeType::kConsecutive || m.trusted;
  records_.push_back(
      {m.from_stamp, m.to_stamp, m.source, trusted, trusted ? EdgeState::kAccepted : EdgeState::kPending});
  shifts_.push_back(trusted ? nullptr
                            : std::make_shared<Shift>(edge, chain_poses_[edge.from], chain_poses_[edge.to],
                                                      options_.planar));
  return e;
}

// ---------------------------------------------------------------------------------------------- key poses

std::optional<std::size_t> OnlineGraph::find(std::int64_t stamp) const {
  const std::int64_t tolerance = nanoseconds(options_.stamp_tolerance);
  std::optional<std::size_t> nearest;
  std::int64_t least = tolerance;
  for (auto i = nodes_.lower_bound(stamp - tolerance); i != nodes_.end() && i->first <= stamp + tolerance;
       ++i) {
    if (std::abs(i->first - stamp) > least) continue;
    least = std::abs(i->first - stamp);
    nearest = i->second;
  }
  return nearest;
}

// Of two that are neighbours on a chain, or of one alone.
std::optional<OnlineGraph::Attachment> OnlineGraph::attach(std::int64_t stamp) const {
  if (const auto node = find(stamp)) return Attachment{*node, {}, Matrix6::Zero()};
  if (nodes_.empty()) return std::nullopt;
  const auto after = nodes_.lower_bound(stamp);
  const auto before = after == nodes_.begin() ? nodes_.end() : std::prev(after);
  const auto here = trajectory_.at(stamp);
  const auto seenFrom = [&](const auto& node) -> std::optional<Pose> {
    if (!here || node == nodes_.end()) return std::nullopt;
    const auto there = trajectory_.at(node->first);
    return there ? std::make_optional(there->inverse() * *here) : std::nullopt;
  };
  const auto from_before = seenFrom(before), from_after = seenFrom(after);
  // Seen from the body at the stamp: what lies between two neighbours of the chain.
  const auto attachment = [&](std::size_t node, const Pose& offset, const ChainPose& a, const ChainPose& b) {
    const Matrix6 to_body = adjoint((chain_poses_[node].pose * offset).inverse());
    return Attachment{node, offset, to_body * (b.covariance - a.covariance) * to_body.transpose()};
  };
  const auto moved = [](const Pose& pose) {
    return pose.translation.norm() + 2.0 * pose.rotation.vec().norm();
  };
  if (before != nodes_.end() && after != nodes_.end()) {
    const ChainPose &a = chain_poses_[before->second], &b = chain_poses_[after->second];
    if (a.chain != b.chain || a.position + 1 != b.position) return std::nullopt;
    const Pose step = a.pose.inverse() * b.pose;
    if (from_before && from_after) {
      const Pose front_end = *from_before * from_after->inverse();
      // It may have jumped between.
      if (moved(step.inverse() * front_end) < 0.1 * (1.0 + moved(step))) {
        const bool first = stamp - before->first <= after->first - stamp;
        return attachment(first ? before->second : after->second, first ? *from_before : *from_after, a, b);
      }
    }
    const bool may_come = !trajectory_.empty() && trajectory_.last() < stamp;
    if (may_come) return std::nullopt;
    const double share =
        static_cast<double>(stamp - before->first) / static_cast<double>(after->first - before->first);
    Attachment between = attachment(before->second, interpolate({}, step, share), a, b);
    // Uniform over all of the step.
    const double distance = step.translation.norm(), angle = 2.0 * step.rotation.vec().norm();
    between.covariance.diagonal().head<3>().array() += distance * distance / 12.0;
    between.covariance.diagonal().tail<3>().array() += angle * angle / 12.0;
    return between;
  }
  if (before != nodes_.end() && from_before) {
    const std::size_t node = before->second;
    const ChainPose& last = chain_poses_[node];
    if (last.position == 0) return attachment(node, *from_before, last, last);
    const ChainPose& one_before = chain_poses_[chains_[last.chain][last.position - 1]];
    // Farther, the next key pose is on its way.
    if (moved(*from_before) > 0.1 + 2.0 * moved(one_before.pose.inverse() * last.pose)) return std::nullopt;
    return attachment(node, *from_before, one_before, last);
  }
  if (after != nodes_.end() && from_after) {
    const ChainPose& first = chain_poses_[after->second];
    return attachment(after->second, *from_after, first, first);
  }
  return std::nullopt;
}

std::optional<Matrix6> OnlineGraph::drift(std::size_t from, std::size_t to) const {
  const ChainPose &a = chain_poses_[from], &b = chain_poses_[to];
  if (a.chain != b.chain || a.position > b.position) return std::nullopt;
  const Matrix6 to_body = adjoint(b.pose.inverse());
  return to_body * (b.covariance - a.covariance) * to_body.transpose();
}

std::optional<Pose> OnlineGraph::poseAt(std::int64_t stamp) const {
  const auto at = attach(stamp);
  return at ? std::make_optional(graph_.nodes()[at->node].pose * at->offset) : std::nullopt;
}

std::optional<OnlineGraph::Added> OnlineGraph::tryToAttach(const Measurement& m) {
  const auto from = attach(m.from_stamp), to = attach(m.to_stamp);
  if (!from || !to) return std::nullopt;
  if (from->node == to->node) return Added::kOnePose;
  Edge edge{from->node, to->node, m.type, m.transform, m.information, false};
  if (!from->covariance.isZero(0.0) || !to->covariance.isZero(0.0)) {
    // Z' = a Z b^-1 with errors of all three on the right, which are moved to the right of the whole.
    const Pose& b = to->offset;
    edge.transform = from->offset * m.transform * b.inverse();
    const Matrix6 of_from = adjoint(b * m.transform.inverse()), of_to = adjoint(b);
    edge.information = inverseOf(
        of_from * from->covariance * of_from.transpose() +
            of_to * (inverseOf(m.information, options_.planar) + to->covariance) * of_to.transpose(),
        options_.planar);
  } else if (!(from->offset.translation.isZero(0.0) && to->offset.translation.isZero(0.0))) {
    edge.transform = from->offset * m.transform * to->offset.inverse();
  }
  if (options_.planar) {
    const Pose& t = edge.transform;
    edge.transform = planarPose(t.translation.x(), t.translation.y(), t.yaw());
  }
  const bool trusted = m.type == EdgeType::kConsecutive || m.trusted;
  edge.active = trusted;
  const std::size_t e = addEdge(edge, m);
  if (!trusted) {
    new_loops_.push_back(e);
  } else if (partOf(edge.from) != partOf(edge.to)) {
    place(e);
    say(GraphEvent::Kind::kJoined, e);
  } else {
    changed_.push_back(e);
  }
  return Added::kNow;
}

std::size_t OnlineGraph::erase(std::int64_t from_stamp, std::int64_t to_stamp) {
  const std::int64_t tolerance = nanoseconds(options_.stamp_tolerance);
  const auto from = find(from_stamp), to = find(to_stamp);
  std::size_t count = 0;
  bool of_chain = false;
  for (std::size_t e = 0; e < records_.size(); ++e) {
    EdgeRecord& record = records_[e];
    const Edge& edge = graph_.edges()[e];
    const bool by_stamps = std::abs(record.from_stamp - from_stamp) <= tolerance &&
                           std::abs(record.to_stamp - to_stamp) <= tolerance;
    const bool by_nodes = from && to && edge.from == *from && edge.to == *to;
    if (record.state == EdgeState::kDeleted || !(by_stamps || by_nodes)) continue;
    ++count;
    if (edge.active) changed_.push_back(e);
    of_chain |= edge.type == EdgeType::kConsecutive;
    record.state = EdgeState::kDeleted;
    graph_.setActive(e, false);
    shifts_[e] = nullptr;
    new_loops_.erase(std::remove(new_loops_.begin(), new_loops_.end(), e), new_loops_.end());
    const auto end = seen_.upper_bound(record.from_stamp);
    for (auto i = seen_.lower_bound(record.from_stamp); i != end;)
      i = i->second == std::pair(record.to_stamp, record.source) && edge.type != EdgeType::kConsecutive
              ? seen_.erase(i)
              : std::next(i);
  }
  if (of_chain) rebuildChains();
  if (count > 0) resetParts(graph_.edges().size());
  return count;
}

// ------------------------------------------------------------------------------------------ chains and parts

// Makes one chain of two where an edge leads from the last of one to the first of another.
void OnlineGraph::link(std::size_t edge) {
  const Edge& e = graph_.edges()[edge];
  const ChainPose last = chain_poses_[e.from], first = chain_poses_[e.to];
  if (last.chain == first.chain || first.position != 0 || last.position + 1 != chains_[last.chain].size())
    return;
  std::vector<std::size_t> added = std::move(chains_[first.chain]);
  chains_[first.chain].clear();
  const ChainPose next = last.then(e, options_.planar);
  const Matrix6 a = adjoint(next.pose);
  for (const std::size_t node : added) {
    ChainPose& pose = chain_poses_[node];
    pose = {next.chain, next.position + pose.position, next.pose * pose.pose,
            next.covariance + a * pose.covariance * a.transpose()};
    chains_[next.chain].push_back(node);
  }
  while (chains_.back().empty()) chains_.pop_back();
  if (added.size() > 1) updateShifts();
}

void OnlineGraph::rebuildChains() {
  chains_.clear();
  for (std::size_t node = 0; node < chain_poses_.size(); ++node) {
    chain_poses_[node] = ChainPose();
    chain_poses_[node].chain = node;
    chains_.push_back({node});
  }
  for (std::size_t e = 0; e < records_.size(); ++e)
    if (graph_.edges()[e].active && records_[e].source == chain_source_ &&
        graph_.edges()[e].type == EdgeType::kConsecutive)
      link(e);
  updateShifts();
}

void OnlineGraph::updateShifts() {
  for (std::size_t e = 0; e < shifts_.size(); ++e) {
    if (!shifts_[e]) continue;
    const Edge& edge = graph_.edges()[e];
    shifts_[e] =
        std::make_shared<Shift>(edge, chain_poses_[edge.from], chain_poses_[edge.to], options_.planar);
  }
}

std::size_t OnlineGraph::partOf(std::size_t node) const {
  while (part_[node] != node) node = part_[node] = part_[part_[node]];
  return node;
}

// If an edge joins two parts, the later one moves to where the edge has it.
void OnlineGraph::place(std::size_t edge) {
  const Edge& e = graph_.edges()[edge];
  const std::size_t a = partOf(e.from), b = partOf(e.to);
  if (a == b) return;
  const bool forward = a < b;
  const std::size_t stays = std::min(a, b), moves = std::max(a, b), end = forward ? e.to : e.from;
  const Pose there =
      forward ? graph_.nodes()[e.from].pose * e.transform : graph_.nodes()[e.to].pose * e.transform.inverse();
  if (part_sizes_[moves] == 1) {
    graph_.setPose(end, there);
  } else {
    movePart(moves, there * graph_.nodes()[end].pose.inverse());
  }
  part_[moves] = stays;
  part_sizes_[stays] += part_sizes_[moves];
}

void OnlineGraph::movePart(std::size_t part, const Pose& motion) {
  for (std::size_t i = 0; i < part_.size(); ++i)
    if (partOf(i) == part) graph_.setPose(i, motion * graph_.nodes()[i].pose);
}

// The front end's pose may come after the edge that begins a part.
void OnlineGraph::placeStart() {
  if (!start_ || optimising_) return;
  const Node& node = graph_.nodes()[start_->node];
  if (const auto front_end = trajectory_.at(node.stamp)) {
    if (partOf(start_->node) == start_->node)
      movePart(start_->node, start_->correction * *front_end * node.pose.inverse());
    start_.reset();
    updateCorrection();
  }
}

// As the first edges connect them, without moving any.
void OnlineGraph::resetParts(std::size_t edges) {
  std::iota(part_.begin(), part_.end(), 0);
  for (std::size_t e = 0; e < edges; ++e) {
    const Edge& edge = graph_.edges()[e];
    if (!edge.active) continue;
    const std::size_t a = partOf(edge.from), b = partOf(edge.to);
    part_[std::max(a, b)] = std::min(a, b);
  }
  std::fill(part_sizes_.begin(), part_sizes_.end(), 0);
  for (std::size_t i = 0; i < part_.size(); ++i) ++part_sizes_[partOf(i)];
}

std::size_t OnlineGraph::parts() const {
  std::size_t count = 0;
  for (std::size_t i = 0; i < part_.size(); ++i) count += part_[i] == i ? 1 : 0;
  return count;
}

void OnlineGraph::updateCorrection() {
  if (nodes_.empty()) return;
  const auto& [stamp, node] = *nodes_.rbegin();
  if (const auto front_end = trajectory_.at(stamp))
    correction_ = graph_.nodes()[node].pose * front_end->inverse();
}

// -------------------------------------------------------------------------------------------- optimisations

std::optional<GraphOptimisation> OnlineGraph::begin(bool all) {
  if (optimising_ || (!all && !hasWork())) return std::nullopt;
  GraphOptimisation task;
  task.options_ = options_;
  task.threshold_ = quantileOfChi2(graph_.dimension(), options_.confidence);
  task.graph_ = graph_;
  task.shifts_ = shifts_;
  task.new_loops_ = std::exchange(new_loops_, {});
  task.changed_ = std::exchange(changed_, {});
  task.all_ = all;
  optimising_ = graph_.edges().size();
  return task;
}

void OnlineGraph::abandon(GraphOptimisation&& failed) {
  optimising_.reset();
  new_loops_.insert(new_loops_.begin(), failed.new_loops_.begin(), failed.new_loops_.end());
  changed_.insert(changed_.begin(), failed.changed_.begin(), failed.changed_.end());
}

void OnlineGraph::finish(GraphOptimisation&& done) {
  const std::size_t edges = *optimising_;
  optimising_.reset();
  using Kind = GraphEvent::Kind;
  for (std::size_t i = 0; i < done.graph_.nodes().size(); ++i) graph_.setPose(i, done.graph_.nodes()[i].pose);
  for (std::size_t e = 0; e < edges; ++e) {
    EdgeState& state = records_[e].state;
    if (records_[e].trusted || state == EdgeState::kDeleted) continue;
    const bool active = done.graph_.edges()[e].active;
    graph_.setActive(e, active);
    const bool is_new = std::find(done.new_loops_.begin(), done.new_loops_.end(), e) != done.new_loops_.end();
    if (active && state != EdgeState::kAccepted) {
      state = EdgeState::kAccepted;
      say(Kind::kAccepted, e);
    } else if (!active && state == EdgeState::kAccepted) {
      state = EdgeState::kRevoked;
      say(Kind::kRevoked, e);
    } else if (!active && is_new) {
      say(Kind::kRefused, e);
    }
  }
  resetParts(edges);
  for (std::size_t e = edges; e < records_.size(); ++e)
    if (graph_.edges()[e].active) place(e);
  updateCorrection();
}

void OnlineGraph::say(GraphEvent::Kind kind, std::size_t edge) {
  const EdgeRecord& r = records_[edge];
  events_.push_back({kind, r.from_stamp, r.to_stamp, r.source, graph_.chi2(edge), {}});
}

std::vector<GraphEvent> OnlineGraph::takeEvents() {
  return std::exchange(events_, {});
}

std::array<std::size_t, kEdgeStates> OnlineGraph::countsOfLoops() const {
  std::array<std::size_t, kEdgeStates> counts{};
  for (std::size_t e = 0; e < records_.size(); ++e)
    if (graph_.edges()[e].type != EdgeType::kConsecutive)
      ++counts[static_cast<std::size_t>(records_[e].state)];
  return counts;
}

}  // namespace pose_graph
