// SPDX-License-Identifier: BSD-3-Clause
//
// Sessions: SQLite files of one or more runs, with key poses, what was measured between them, and the scans,
// clouds and images that maps are made of and loops are found with. Times are in ns since the epoch. Where
// the file is foreign, of another version, corrupted or can't be read or written, functions throw
// std::runtime_error that names it and says what to do.
#pragma once

#include <mapping_common/database.h>
#include <mapping_common/options.h>

#include <cstdint>
#include <functional>
#include <map>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "pose_graph/graph.h"

namespace pose_graph {

/// One time that the robot was out. Poses of different runs are connected by PLACE edges alone.
struct Run {
  std::int64_t id = 0;
  std::int64_t stamp = 0;  ///< when it began
  std::string name;
};

struct KeyPose {
  std::int64_t id = 0;  ///< unique in the file
  std::int64_t run = 0;
  std::int64_t stamp = 0;
  Pose pose;      ///< of the body in the map, as last optimised
  Pose odometry;  ///< the same as the front end had it when it was new
  bool fixed = false;
};

struct SessionEdge {
  std::int64_t id = 0;            ///< unique in the file
  std::int64_t from = 0, to = 0;  ///< key poses
  EdgeType type = EdgeType::kConsecutive;
  EdgeState state = EdgeState::kAccepted;
  std::string source;                         ///< who measured it, e.g. a topic
  std::optional<Pose> transform;              ///< of `to`, seen from `from`; none: known by appearance alone
  Matrix6 information = Matrix6::Identity();  ///< as Edge's
  double similarity = 0.0;                    ///< 0 to 1
};

/// A PLACE edge to a pose of a session in another file, known by its stamp, which merging finds it by.
struct ForeignEdge {
  std::int64_t from_stamp = 0, to_stamp = 0;
  std::string source;
  Pose transform;  ///< of the body at to_stamp, seen from where it was at from_stamp
  Matrix6 information = Matrix6::Identity();  ///< as Edge's
  double similarity = 0.0;                    ///< 0 to 1
};

enum class DataKind { kScan = 1, kCloud, kThumbnail, kWords };
constexpr auto choicesOf(DataKind) {
  return mapping_common::choices<DataKind>({{"scan", DataKind::kScan},
                                            {"cloud", DataKind::kCloud},
                                            {"thumbnail", DataKind::kThumbnail},
                                            {"words", DataKind::kWords}});
}

/// What was measured at a key pose, or near it.
struct KeyData {
  std::int64_t key_pose = 0;
  DataKind kind = DataKind::kScan;
  std::int64_t stamp = 0;
  std::string frame;  ///< that the data are in
  /// Pose of that frame at the stamp, seen from the body at the key pose: where both have the same stamp, how
  /// the sensor is mounted.
  Pose sensor;
  std::uint32_t format = 0;  ///< of the data, see who wrote them
  std::string data;          ///< any bytes; the file has them compressed where that pays
};

/// Whether a file is a session, by what is in it.
bool isSession(const std::string& path);

/// Reads a session as it was when it was opened, also while somebody writes to it. The log of one that is
/// written to can't be cleared meanwhile, so it is not to be kept open for long.
class Session {
 public:
  explicit Session(const std::string& path);
  ~Session();
  Session(Session&&) noexcept;

  const std::string& path() const;
  bool planar() const;
  /// Names and values that whoever writes may keep with it, such as the options of maps.
  std::map<std::string, std::string> settings() const;
  std::vector<Run> runs() const;                  ///< in the order of their ids
  std::vector<KeyPose> keyPoses() const;          ///< in the order of their ids
  std::vector<SessionEdge> edges() const;         ///< in the order of their ids
  std::vector<ForeignEdge> foreignEdges() const;  ///< in the order in which they came
  /// Those of the kind in the order of their stamps, until `visit` returns false.
  void visitData(DataKind kind, const std::function<bool(KeyData&&)>& visit) const;
  /// Those of a key pose and kind in the order of their stamps.
  std::vector<KeyData> dataAt(std::int64_t key_pose, DataKind kind) const;

  struct Amount {
    std::size_t count = 0, bytes = 0, stored_bytes = 0;  ///< before and after compression
  };
  std::map<DataKind, Amount> amounts() const;

 private:
  KeyData readData(const mapping_common::Database::Use& row) const;
  std::unique_ptr<mapping_common::Database> database_;
};

/// The graph of a session. Nodes have the ids of key poses.
struct SessionGraph {
  Graph graph;
  std::vector<SessionEdge> edges;  ///< of which each of the graph's edges is, in their order
  /// Those without a transform, and those deleted, which aren't in the graph.
  std::vector<SessionEdge> others;
};
/// Edges are active that are accepted.
SessionGraph readGraph(const Session& session);

struct SessionWriterOptions {
  double period = 0.5;    ///< s, between commits: what is newer is lost where the process is killed
  double memory = 256.0;  ///< MiB, of data that wait; what doesn't get in is lost, and counted

  void describe(mapping_common::OptionList& o);
};

/// Writes a session, a new one or on where it was, from a thread of its own: functions only take what they
/// are given, and may be called from any thread. Where writing fails, as on a full disk, all is kept and
/// tried again. One writer at a time may have a file.
class SessionWriter {
 public:
  /// @param planar of a new file; one that there is must agree
  /// @throws std::runtime_error; std::invalid_argument for options
  explicit SessionWriter(const std::string& path, bool planar, const SessionWriterOptions& options = {});
  /// Writes what waits, if it can be written.
  ~SessionWriter();

  // The functions that follow throw std::invalid_argument that says why where what they are given can't be
  // taken.

  /// @return its id
  std::int64_t beginRun(std::int64_t stamp, const std::string& name);
  /// Adds it, or replaces that of the same id.
  void put(const KeyPose& key_pose);
  /// Adds it, or replaces that of the same id.
  void put(const SessionEdge& edge);
  /// Adds it.
  void put(const ForeignEdge& edge);
  /// Adds it, where there is memory for it. Whoever writes more at once than that waits by flush().
  void put(KeyData data);
  /// Poses as they were optimised, by the ids of their key poses.
  void setPoses(const std::map<std::int64_t, Pose>& poses);
  void setSetting(const std::string& name, const std::string& value);

  /// Ids that aren't used yet.
  std::int64_t nextKeyPose() const;
  std::int64_t nextEdge() const;

  /// Waits until all is on the disk. @throws std::runtime_error where it can't be written
  void flush();

  struct Status {
    std::string error;              ///< why the file can't be written now; empty: all is well
    double unwritten_since = 0.0;   ///< s that the oldest of what waits has waited for
    std::size_t waiting_bytes = 0;  ///< of data
    std::size_t lost = 0;           ///< data that there was no memory for
    std::size_t commits = 0;
    double longest_commit = 0.0;  ///< s
  };
  Status status() const;

 private:
  class Implementation;
  std::unique_ptr<Implementation> implementation_;
};

}  // namespace pose_graph
