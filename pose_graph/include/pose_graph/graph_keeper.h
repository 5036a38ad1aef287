// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "pose_graph/online_graph.h"
#include "pose_graph/session.h"

namespace pose_graph {

constexpr const char* kByHand = "by hand";  ///< source of edges that are trusted although they are loops

/// Writes what becomes of a graph that grows into a session.
class GraphKeeper {
 public:
  /// @param path a new session, or one that goes on
  /// @param graph an empty one, gets what the session holds
  /// @throws std::runtime_error as SessionWriter; std::invalid_argument
  GraphKeeper(const std::string& path, OnlineGraph& graph, const SessionWriterOptions& options = {});

  /// Another run begins with the next key pose.
  void beginNewRun() { run_.reset(); }
  /// Writes what has changed.
  void update(const OnlineGraph& graph);
  /// An edge that is known by appearance alone, pending until `settle`. @param from, to ids of nodes
  SessionEdge putAppearance(std::int64_t from, std::int64_t to, EdgeType type, const std::string& source,
                            double similarity);
  /// What became of an edge by appearance: accepted where scans gave it a transform, which is an edge of its
  /// own, or revoked.
  void settle(SessionEdge appearance, EdgeState state);

  /// A PLACE edge to a pose of another session.
  void putForeign(const Measurement& measurement);

  SessionWriter& writer() { return *writer_; }
  const std::string& path() const { return path_; }

 private:
  std::string path_;
  std::unique_ptr<SessionWriter> writer_;
  std::optional<std::int64_t> run_;
  std::vector<Pose> poses_;             // as they are in the session, by node
  std::vector<std::int64_t> edge_ids_;  // by edge
  std::vector<EdgeState> states_;
};

}  // namespace pose_graph
