// SPDX-License-Identifier: BSD-3-Clause
#include "pose_graph/session_merge.h"

#include <algorithm>
#include <cstdio>
#include <filesystem>
#include <map>
#include <memory>
#include <stdexcept>
#include <system_error>
#include <utility>

namespace pose_graph {
namespace {

// Poses that PLACE edges put farther from each other than this don't agree: sessions that drifted do, within.
constexpr double kAgreeDistance = 1.0, kAgreeAngle = 0.2;   // m, rad
constexpr std::int64_t kSameStamp = 1'000'000;              // ns
constexpr std::size_t kFlushBytes = std::size_t{64} << 20;  // of data that wait to be written

// A file that gets its name when it is whole.
class Part {
 public:
  explicit Part(std::string path) : path_(std::move(path)) { removeAll(part()); }
  ~Part() { removeAll(part()); }
  Part(const Part&) = delete;
  Part& operator=(const Part&) = delete;
  std::string part() const { return path_ + ".part"; }
  void finish() const {
    // The log of an older file must not be taken for this one's.
    for (const char* ending : {"-wal", "-shm"}) std::remove((path_ + ending).c_str());
    std::error_code error;
    std::filesystem::rename(part(), path_, error);
    if (error) throw std::runtime_error(path_ + " can't be written: " + error.message());
  }

 private:
  static void removeAll(const std::string& path) {
    for (const char* ending : {"", "-wal", "-shm", "-lock"}) std::remove((path + ending).c_str());
  }
  std::string path_;
};

// A session among those that are merged.
struct Source {
  std::unique_ptr<Session> session;
  std::map<std::int64_t, std::int64_t> ids;  // of its key poses, in the merged session
  bool connected = false;
};

struct Ids {
  std::map<std::int64_t, std::int64_t> runs;
  std::int64_t key_pose = 0, edge = 0;
};

class Merger {
 public:
  Merger(const std::vector<std::string>& paths, const std::function<bool(double)>& progress)
      : progress_(progress) {
    for (const std::string& path : paths) {
      sources_.push_back({std::make_unique<Session>(path), {}, false});
      if (sources_.back().session->planar() != planar())
        throw std::invalid_argument(path + " and " + paths.front() +
                                    " can't be merged: one is in the plane, the other in space");
      for (const auto& [kind, amount] : sources_.back().session->amounts()) all_ += amount.count;
    }
  }
  bool planar() const { return sources_.front().session->planar(); }

  // @return false where it was ended
  bool copyAll(SessionWriter& writer) {
    for (Source& source : sources_)
      if (!copy(source, writer)) return false;
    for (Source& source : sources_) addForeignEdges(source, writer);
    writer.flush();
    return true;
  }

  SessionMerge align(const std::string& path, SessionWriter& writer) {
    SessionGraph read = readGraph(Session(path));
    Graph& graph = read.graph;
    std::vector<std::size_t> source_of(graph.nodes().size());
    for (std::size_t s = 0; s < sources_.size(); ++s)
      for (const auto& [from, to] : sources_[s].ids) source_of[*graph.find(to)] = s;

    SessionMerge merge;
    merge.key_poses = graph.nodes().size();
    std::vector<std::size_t> between;
    for (std::size_t e = 0; e < graph.edges().size(); ++e)
      if (source_of[graph.edges()[e].from] != source_of[graph.edges()[e].to]) between.push_back(e);
    merge.place_edges = between.size();

    sources_.front().connected = true;
    for (;;) {
      // The one that most edges connect with those that are in place.
      std::map<std::size_t, std::vector<std::size_t>> edges_of;
      for (const std::size_t e : between) {
        const std::size_t a = source_of[graph.edges()[e].from], b = source_of[graph.edges()[e].to];
        if (sources_[a].connected != sources_[b].connected)
          edges_of[sources_[a].connected ? b : a].push_back(e);
      }
      if (edges_of.empty()) break;
      const auto next = std::max_element(edges_of.begin(), edges_of.end(), [](const auto& a, const auto& b) {
        return a.second.size() < b.second.size();
      });
      const Pose motion =
          motionOf(graph, next->second, [&](std::size_t node) { return source_of[node] == next->first; });
      std::map<std::int64_t, Pose> poses;
      for (std::size_t i = 0; i < graph.nodes().size(); ++i) {
        if (source_of[i] != next->first) continue;
        graph.setPose(i, motion * graph.nodes()[i].pose);
        poses[graph.nodes()[i].id] = graph.nodes()[i].pose;
      }
      writer.setPoses(poses);
      sources_[next->first].connected = true;
    }
    for (const std::size_t e : between) {
      const Edge& edge = graph.edges()[e];
      if (agree(graph, edge, graph.nodes()[edge.from].pose, graph.nodes()[edge.to].pose)) continue;
      read.edges[e].state = EdgeState::kRevoked;
      writer.put(read.edges[e]);
      ++merge.revoked;
    }
    for (const Source& source : sources_)
      if (!source.connected) merge.unconnected.push_back(source.session->path());
    return merge;
  }

 private:
  bool copy(Source& source, SessionWriter& writer) {
    const Session& session = *source.session;
    for (const auto& [name, value] : session.settings()) writer.setSetting(name, value);
    std::map<std::int64_t, std::int64_t> runs;
    for (const Run& run : session.runs()) runs[run.id] = writer.beginRun(run.stamp, run.name);
    std::int64_t id = writer.nextKeyPose();
    for (KeyPose key_pose : session.keyPoses()) {
      stamps_.emplace(key_pose.stamp, id);
      source.ids[key_pose.id] = id;
      key_pose.id = id++;
      key_pose.run = runs.at(key_pose.run);
      writer.put(key_pose);
    }
    id = writer.nextEdge();
    for (SessionEdge edge : session.edges()) {
      edge.id = id++;
      edge.from = source.ids.at(edge.from), edge.to = source.ids.at(edge.to);
      writer.put(edge);
    }
    bool goes_on = true;
    for (const auto& [kind, amount] : session.amounts()) {
      session.visitData(kind, [&](KeyData&& data) {
        data.key_pose = source.ids.at(data.key_pose);
        writer.put(std::move(data));
        if (writer.status().waiting_bytes > kFlushBytes) writer.flush();
        ++done_;
        return goes_on = !progress_ || progress_(static_cast<double>(done_) / static_cast<double>(all_));
      });
      if (!goes_on) return false;
    }
    return true;
  }

  // Those whose both ends are here now become edges, the others stay.
  void addForeignEdges(const Source& source, SessionWriter& writer) const {
    for (const ForeignEdge& foreign : source.session->foreignEdges()) {
      const auto from = find(foreign.from_stamp), to = find(foreign.to_stamp);
      if (!from || !to || *from == *to) {
        writer.put(foreign);
        continue;
      }
      SessionEdge edge;
      edge.id = writer.nextEdge();
      edge.from = *from, edge.to = *to;
      edge.type = EdgeType::kPlace;
      edge.source = foreign.source;
      edge.transform = foreign.transform;
      edge.information = foreign.information;
      edge.similarity = foreign.similarity;
      writer.put(edge);
    }
  }

  std::optional<std::int64_t> find(std::int64_t stamp) const {
    const auto there = stamps_.lower_bound(stamp - kSameStamp);
    if (there == stamps_.end() || there->first > stamp + kSameStamp) return {};
    return there->second;
  }

  static bool agree(const Graph& graph, const Edge& edge, const Pose& from, const Pose& to) {
    const Vector6 error = errorOf(edge, from, to, graph.planar());
    return error.head<3>().norm() < kAgreeDistance && error.tail<3>().norm() < kAgreeAngle;
  }

  // Of those that each edge asks for, the one that most edges agree with.
  template <class IsMoved>
  static Pose motionOf(const Graph& graph, const std::vector<std::size_t>& edges, const IsMoved& is_moved) {
    const auto motionBy = [&](std::size_t e) {
      const Edge& edge = graph.edges()[e];
      const Pose &from = graph.nodes()[edge.from].pose, &to = graph.nodes()[edge.to].pose;
      return is_moved(edge.to) ? from * edge.transform * to.inverse()
                               : to * edge.transform.inverse() * from.inverse();
    };
    Pose best;
    std::size_t most = 0;
    for (const std::size_t e : edges) {
      const Pose motion = motionBy(e);
      const auto agrees = [&](std::size_t other) {
        const Edge& edge = graph.edges()[other];
        Pose from = graph.nodes()[edge.from].pose, to = graph.nodes()[edge.to].pose;
        (is_moved(edge.to) ? to : from) = motion * (is_moved(edge.to) ? to : from);
        return agree(graph, edge, from, to);
      };
      const auto agreeing = static_cast<std::size_t>(std::count_if(edges.begin(), edges.end(), agrees));
      if (agreeing > most) best = motion, most = agreeing;
    }
    return best;
  }

  std::function<bool(double)> progress_;
  std::vector<Source> sources_;
  std::map<std::int64_t, std::int64_t> stamps_;  // of all key poses, to their ids
  std::size_t all_ = 0, done_ = 0;               // data
};

}  // namespace

std::optional<SessionMerge> mergeSessions(const std::vector<std::string>& paths, const std::string& out,
                                          const std::function<bool(double)>& progress) {
  if (paths.empty()) throw std::invalid_argument("there is no session to merge");
  for (const std::string& path : paths) {
    std::error_code error;
    if (std::filesystem::equivalent(path, out, error))
      throw std::invalid_argument(out +
                                  " is one of the sessions that are merged: choose another for the result");
  }
  Merger merger(paths, progress);
  const Part part(out);
  SessionMerge merge;
  {
    SessionWriter writer(part.part(), merger.planar());
    if (!merger.copyAll(writer)) return {};
    merge = merger.align(part.part(), writer);
    writer.flush();
  }
  part.finish();
  return merge;
}

}  // namespace pose_graph
