// SPDX-License-Identifier: BSD-3-Clause
//
// A graph that grows while the robot drives. What is added takes microseconds; loops are tried and optimised
// on a copy, in whatever thread, and what came meanwhile is put on top of the result.
#pragma once

#include <mapping_common/options.h>

#include <array>
#include <cstdint>
#include <deque>
#include <map>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "pose_graph/graph.h"
#include "pose_graph/optimisation.h"
#include "pose_graph/trajectory.h"

namespace pose_graph {

struct ChainPose;
class Shift;

struct OnlineOptions {
  bool planar = true;
  double stamp_tolerance = 0.001;
  double wait = 10.0;
  int most_waiting = 1000;
  double confidence = 0.999;
  double odometry_scale = 1.0;
  int max_doubts = 5;
  OptimisationOptions optimisation{20, 1e-6};

  void describe(mapping_common::OptionList& o);
};

/// A measurement of a pose as seen from another, both known by when they were.
struct Measurement {
  std::int64_t from_stamp = 0, to_stamp = 0;  ///< ns since the epoch
  EdgeType type = EdgeType::kConsecutive;
  Pose transform;  ///< of the body at to_stamp, seen from where it was at from_stamp
  Matrix6 information = Matrix6::Identity();  ///< as Edge's
  std::string source;                         ///< e.g. a topic
  bool trusted = false;  ///< a loop that isn't checked, as one that somebody has added by hand
};

/// The same of the body that carries a sensor. @param sensor its pose, seen from the body
Measurement ofBody(const Measurement& of_sensor, const Pose& sensor);

constexpr std::size_t kEdgeStates = 4;

/// Of an edge of an OnlineGraph, beside what Edge holds.
struct EdgeRecord {
  std::int64_t from_stamp = 0, to_stamp = 0;  ///< ns, as they came
  std::string source;
  bool trusted = false;  ///< isn't checked: consecutive, or added by hand
  EdgeState state = EdgeState::kAccepted;
};

/// What became of loops, and of the graph.
struct GraphEvent {
  enum class Kind {
    kAccepted,
    kRefused,  ///< for now
    kRevoked,
    kExpired,  ///< its stamps stayed unknown for OnlineOptions::wait
    kCrowded,  ///< more than OnlineOptions::most_waiting waited
    kNewPart,  ///< a chain begins that nothing connects with what was before
    kJoined    ///< parts became one
  };
  Kind kind;
  std::int64_t from_stamp = 0, to_stamp = 0;  ///< ns
  std::string source;
  double chi2 = 0.0;                                      ///< of the loop's own error
  std::optional<Measurement> measurement = std::nullopt;  ///< of one that waited in vain
};
constexpr auto choicesOf(GraphEvent::Kind) {
  using Kind = GraphEvent::Kind;
  return mapping_common::choices<Kind>({{"accepted", Kind::kAccepted},
                                        {"refused", Kind::kRefused},
                                        {"revoked", Kind::kRevoked},
                                        {"expired", Kind::kExpired},
                                        {"crowded out", Kind::kCrowded},
                                        {"new part", Kind::kNewPart},
                                        {"joined", Kind::kJoined}});
}

/// What optimises a copy of an OnlineGraph. run() may be called in another thread than that of the graph.
///
/// Of all loops those are accepted for which truncated least squares, the sum of chi2 of trusted edges and
/// accepted loops and of a threshold for each loop that isn't, are least, as far as trying tells: new ones
/// are tried with what was accepted before, and without what contradicts them (Shift). What doesn't fit then
/// is left out, what fits comes back.
class GraphOptimisation {
 public:
  /// @param progress gets the iterations of each solver; false ends all soon
  /// @throws std::runtime_error where Ceres fails
  void run(const Progress& progress = {});

  const Graph& graph() const { return graph_; }
  /// Optimisations that it took.
  int solved() const { return solved_; }

 private:
  friend class OnlineGraph;
  using Edges = std::vector<std::size_t>;
  struct State {
    std::vector<Pose> poses;
    std::vector<bool> active;
    double cost = 0.0;
  };

  bool isLoop(std::size_t e) const { return shifts_[e] != nullptr; }
  double cost() const;
  State state() const;
  void restore(const State& state);
  void join(const Edges& added);
  void settle(Edges changed);
  bool tryWith(const Edges& added, const Edges& removed);
  bool tryGroup(const Edges& group);
  void tryToJoin(const Edges& group);
  void doubt();

  OnlineOptions options_;
  double threshold_ = 0.0;
  Graph graph_;
  std::vector<std::shared_ptr<const Shift>> shifts_;  // by edge; none: trusted, or deleted
  Edges new_loops_, changed_;
  bool all_ = false;
  double cost_ = 0.0;
  Progress progress_;
  int solved_ = 0;
};

class OnlineGraph {
 public:
  explicit OnlineGraph(const OnlineOptions& options = {});
  ~OnlineGraph();
  OnlineGraph(OnlineGraph&&) noexcept;
  OnlineGraph& operator=(OnlineGraph&&) noexcept;

  /// Goes on with a graph that there was: nodes with their ids and stamps, and edges whose records these are.
  /// Its edges wait for stamps of its nodes alone.
  /// @throws std::invalid_argument if it isn't planar as this one is, or something was added before
  void restore(const Graph& graph, const std::vector<EdgeRecord>& records);

  enum class Added {
    kNow,
    kWaits,    ///< for its stamps
    kDoubled,  ///< it was there already, by its stamps and source
    kOnePose   ///< both stamps belong to the same key pose
  };
  /// The first source of consecutive edges makes the key poses. All other edges are attached to them, if need
  /// be by the front end's trajectory.
  /// @throws std::invalid_argument that says what is malformed
  Added add(const Measurement& measurement);
  /// A key pose that no edge has made, such as that of a scan of an unknown place: a part of its own, until
  /// loops connect it.
  void addKeyPose(std::int64_t stamp);
  /// Where the front end has the body: asked for between key poses, and for where a new chain begins.
  void addFrontEndPose(std::int64_t stamp, const Pose& pose);
  /// Time has jumped back: stamps up to now mean nothing any more. What waits is dropped.
  /// @return how many waited
  std::size_t beginNewRun();

  /// By hand: all edges between two key poses or of these stamps. @return how many
  std::size_t erase(std::int64_t from_stamp, std::int64_t to_stamp);

  /// A copy to be optimised, if there is need: after loops, trusted edges that close a cycle, and deletions.
  /// There is one at a time, until finish() or abandon().
  /// @param all optimises all of the graph to the end, and doubts all loops
  std::optional<GraphOptimisation> begin(bool all = false);
  /// Takes the result, and puts on top what came since begin().
  void finish(GraphOptimisation&& done);
  /// Instead of finish(): what was to be tried will be tried next time.
  void abandon(GraphOptimisation&& failed);
  bool isOptimising() const { return optimising_.has_value(); }
  /// Whether begin() would give something.
  bool hasWork() const { return !new_loops_.empty() || !changed_.empty(); }

  /// Ids of nodes follow one another.
  const Graph& graph() const { return graph_; }
  /// By edge of graph().
  const std::vector<EdgeRecord>& records() const { return records_; }
  /// The key pose at a time, to within stamp_tolerance.
  std::optional<std::size_t> find(std::int64_t stamp) const;
  struct Attachment {
    std::size_t node;
    Pose offset;         ///< of the body at the stamp, seen from the node
    Matrix6 covariance;  ///< of the offset's error
  };
  /// A key pose near a stamp, and by the front end's trajectory where the body was then.
  std::optional<Attachment> attach(std::int64_t stamp) const;
  /// Covariance of odometry from one node to a later one of the same chain, of the error seen from the later.
  std::optional<Matrix6> drift(std::size_t from, std::size_t to) const;
  /// Where the body was, by the graph, and by the front end's trajectory between its key poses.
  std::optional<Pose> poseAt(std::int64_t stamp) const;
  /// Moves the front end's poses to where the graph has them, at the last key pose with a pose of the front
  /// end.
  const Pose& correction() const { return correction_; }
  const Trajectory& frontEnd() const { return trajectory_; }

  std::vector<GraphEvent> takeEvents();
  /// Edges that aren't consecutive, by EdgeState.
  std::array<std::size_t, kEdgeStates> countsOfLoops() const;
  std::size_t waiting() const { return waiting_.size(); }
  std::size_t parts() const;

 private:
  struct Waiting {
    Measurement measurement;
    std::int64_t since;  // ns; 0: from the first stamp on
  };

  bool isDoubled(const Measurement& m) const;
  std::optional<Added> tryToAttach(const Measurement& m);
  void addConsecutive(const Measurement& m);
  std::size_t addNode(std::int64_t stamp, const Pose& pose);
  std::size_t addEdge(const Edge& edge, const Measurement& m);
  void link(std::size_t edge);
  void place(std::size_t edge);
  void resetParts(std::size_t edges);
  std::size_t partOf(std::size_t node) const;
  void rebuildChains();
  void updateShifts();
  void movePart(std::size_t part, const Pose& motion);
  void placeStart();
  void updateCorrection();
  void timePassed(std::int64_t stamp);
  void retryWaiting();
  void say(GraphEvent::Kind kind, std::size_t edge);

  OnlineOptions options_;
  Graph graph_;
  std::vector<EdgeRecord> records_;
  std::vector<std::shared_ptr<const Shift>> shifts_;  // by edge, of loops
  std::vector<ChainPose> chain_poses_;                // by node
  std::vector<std::vector<std::size_t>> chains_;      // their nodes, in order
  mutable std::vector<std::size_t> part_;             // by node, a forest; roots are first nodes of parts
  std::vector<std::size_t> part_sizes_;               // by root
  std::map<std::int64_t, std::size_t> nodes_;         // of this run, by their stamps
  std::string chain_source_;
  std::multimap<std::int64_t, std::pair<std::int64_t, std::string>> seen_;  // edges of this run
  Trajectory trajectory_;
  Pose correction_;
  struct Start {
    std::size_t node;  // first of a part
    Pose correction;
  };
  std::optional<Start> start_;  // whose pose the front end hasn't told yet
  std::deque<Waiting> waiting_;
  std::int64_t next_id_ = 0;
  std::int64_t now_ = 0, last_retry_ = 0;  // the latest stamp; when waiting ones were looked at
  std::vector<std::size_t> new_loops_, changed_;
  std::vector<GraphEvent> events_;
  std::optional<std::size_t> optimising_;  // edges that there were
};

}  // namespace pose_graph
