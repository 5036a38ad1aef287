// SPDX-License-Identifier: BSD-3-Clause
#include "session_commands.h"

#include <intensity_hector_slam/map_image.h>
#include <mapping_common/map_image.h>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <filesystem>
#include <functional>
#include <iostream>
#include <map>
#include <set>
#include <stdexcept>

#include "pose_graph/g2o_file.h"
#include "pose_graph/initialisation.h"
#include "pose_graph/maps.h"
#include "pose_graph/session_merge.h"
#include "pose_graph/trajectory_file.h"
#include "shown.h"

namespace pose_graph {
namespace {

std::string endingOf(const std::string& path) {
  return std::filesystem::path(path).extension().string();
}

std::string size(double bytes) {
  char text[32];
  std::snprintf(text, sizeof(text), bytes < 1e6 ? "%.0f kB" : "%.1f MB",
                bytes < 1e6 ? bytes / 1e3 : bytes / 1e6);
  return text;
}

// How far a run went (m), by the poses, and how long it took (s).
void printRun(const Run& run, const std::vector<KeyPose>& key_poses) {
  double length = 0.0;
  const KeyPose *first = nullptr, *last = nullptr;
  std::size_t count = 0;
  for (const KeyPose& key_pose : key_poses) {
    if (key_pose.run != run.id) continue;
    ++count;
    if (first == nullptr) first = &key_pose;
    if (last != nullptr) length += (key_pose.pose.translation - last->pose.translation).norm();
    last = &key_pose;
  }
  const double duration = count > 0 ? 1e-9 * static_cast<double>(last->stamp - first->stamp) : 0.0;
  std::printf("run %lld%s%s: %zu poses, %.1f m, %.1f s, from %.3f s\n", static_cast<long long>(run.id),
              run.name.empty() ? "" : " ", run.name.c_str(), count, length, duration,
              1e-9 * static_cast<double>(run.stamp));
}

void printEdges(const std::vector<SessionEdge>& edges) {
  std::map<std::string, std::map<std::string, std::size_t>> counts;
  for (const SessionEdge& edge : edges) {
    const std::string kind =
        mapping_common::nameOf(edge.type) + (edge.transform ? "" : " by appearance alone");
    ++counts[kind][mapping_common::nameOf(edge.state)];
  }
  for (const auto& [kind, states] : counts) {
    std::printf("edges, %s:", kind.c_str());
    const char* separator = " ";
    for (const auto& [state, count] : states) {
      std::printf("%s%zu %s", separator, count, state.c_str());
      separator = ", ";
    }
    std::printf("\n");
  }
}

// Loops and their states, of the graph as it is now.
std::vector<SessionEdge> changedEdges(const SessionGraph& read) {
  std::vector<SessionEdge> changed;
  for (std::size_t e = 0; e < read.edges.size(); ++e) {
    SessionEdge edge = read.edges[e];
    const bool active = read.graph.edges()[e].active;
    if (active == (edge.state == EdgeState::kAccepted)) continue;
    edge.state = active ? EdgeState::kAccepted : EdgeState::kRevoked;
    changed.push_back(edge);
  }
  return changed;
}

void optimiseGraph(SessionGraph& read, const LoopCheckOptions& options) {
  OptimisationResult result;
  if (options.method == LoopCheck::kNone) {
    result = optimise(read.graph, options.optimisation, iterationsShown());
  } else {
    const LoopCheckResult checked = optimiseAndCheck(read.graph, options, iterationsShown());
    result = checked.optimisation;
    const auto print = [&](const char* what, const std::vector<std::size_t>& edges) {
      for (const std::size_t e : edges)
        std::cout << what << ": " << read.edges[e].from << " -> " << read.edges[e].to << '\n';
    };
    print("accepted", checked.accepted);
    print("wrong", checked.revoked);
  }
  std::cout << "chi2 " << result.initial_chi2 << " -> " << result.chi2 << " in " << result.iterations
            << (result.converged ? " iterations\n" : " iterations; not converged, see --max-iterations\n");
}

void store(const std::string& path, const SessionGraph& read) {
  SessionWriter writer(path, read.graph.planar());
  std::map<std::int64_t, Pose> poses;
  for (const Node& node : read.graph.nodes()) poses[node.id] = node.pose;
  writer.setPoses(poses);
  for (const SessionEdge& edge : changedEdges(read)) writer.put(edge);
  writer.flush();
}

void writeGraph(const std::string& path, const Graph& graph) {
  endingOf(path) == ".tum" ? writeTum(path, graph) : writeG2o(path, graph);
}

void say(std::size_t count, const std::string& what, const std::string& path) {
  std::cerr << "\npose_graph: " << count << ' ' << what << " -> " << path << '\n';
}

void requireAny(std::size_t inserted, const std::string& path) {
  if (inserted == 0) throw std::runtime_error(path + " holds no scans or clouds that a map could be made of");
}

void exportGrid(const Session& session, const Graph& graph, const SessionArguments& a) {
  auto options = mapOptions(session).slam;
  if (a.resolution > 0.0) options.map.resolution = a.resolution;
  const auto built = buildGridMap(session, graph, options, shareShown());
  requireAny(built->inserted, a.in);
  mapping_common::writeMapImage(a.out, intensity_hector_slam::imageOf(built->map.level(0)));
  say(built->inserted, "scans", a.out);
}

void exportOccupancy(const Session& session, const Graph& graph, const SessionArguments& a) {
  auto options = mapOptions(session).occupancy;
  if (a.resolution > 0.0) options.resolution = a.resolution;
  const auto built = buildOccupancyMap(session, graph, options, shareShown());
  requireAny(built->inserted, a.in);
  built->map.save(a.out);
  say(built->inserted, "clouds, " + std::to_string(built->map.size()) + " cells", a.out);
}

void exportCloud(const Session& session, const Graph& graph, const SessionArguments& a) {
  const auto points = buildCloud(session, graph, a.voxel, shareShown());
  requireAny(points->size(), a.in);
  writePcd(a.out, *points);
  say(points->size(), "points", a.out);
}

}  // namespace

const char kExports[] =
    ".g2o, .tum, .pgm or .yaml (for map_server), .pcd (the clouds), .map or .db (the R-tree map)";

bool isExport(const std::string& path) {
  const std::string ending = endingOf(path);
  constexpr const char* kEndings[] = {".g2o", ".tum", ".pgm", ".yaml", ".pcd", ".map", ".db"};
  return std::find(std::begin(kEndings), std::end(kEndings), ending) != std::end(kEndings);
}

void printSession(const std::string& path) {
  const Session session(path);
  const std::vector<KeyPose> key_poses = session.keyPoses();
  const SessionGraph read = readGraph(session);
  const auto parts = connectedParts(read.graph);
  std::printf("session of %zu poses in %s, in %zu connected parts\n", key_poses.size(),
              session.planar() ? "the plane" : "space",
              std::set<std::size_t>(parts.begin(), parts.end()).size());
  for (const Run& run : session.runs()) printRun(run, key_poses);
  printEdges(session.edges());
  if (const std::size_t foreign = session.foreignEdges().size(); foreign > 0)
    std::printf("edges to poses of other files: %zu\n", foreign);
  std::printf("chi2 %.10g\n", read.graph.chi2());
  for (const auto& [kind, amount] : session.amounts()) {
    std::printf("%ss: %zu, %s, %s in the file\n", mapping_common::nameOf(kind).c_str(), amount.count,
                size(static_cast<double>(amount.bytes)).c_str(),
                size(static_cast<double>(amount.stored_bytes)).c_str());
  }
  for (const auto& [name, value] : session.settings()) std::printf("%s: %s\n", name.c_str(), value.c_str());
}

void optimiseSession(const SessionArguments& a) {
  SessionGraph read = readGraph(Session(a.in));
  const std::string ending = endingOf(a.out);
  const bool to_graph = ending == ".g2o" || ending == ".tum";
  optimiseGraph(read, a.check);
  if (to_graph) {
    writeGraph(a.out, read.graph);
  } else if (a.out.empty() || a.out == a.in) {
    store(a.in, read);
  } else {
    // Ids become others in a copy, but not their order.
    if (!mergeSessions({a.in}, a.out, shareShown())) return;
    SessionGraph copy = readGraph(Session(a.out));
    for (std::size_t i = 0; i < read.graph.nodes().size(); ++i)
      copy.graph.setPose(i, read.graph.nodes()[i].pose);
    for (std::size_t e = 0; e < read.edges.size(); ++e) copy.graph.setActive(e, read.graph.edges()[e].active);
    store(a.out, copy);
  }
  say(read.graph.nodes().size(), "poses", a.out.empty() ? a.in : a.out);
}

void exportSession(const SessionArguments& a) {
  const Session session(a.in);
  Graph graph = readGraph(session).graph;
  if (a.without_loops) {
    for (std::size_t e = 0; e < graph.edges().size(); ++e)
      if (graph.edges()[e].type != EdgeType::kConsecutive) graph.setActive(e, false);
    startFromOdometry(graph);
  }
  // Without odometry, where a part lies to another isn't known.
  const auto& edges = graph.edges();
  if (!edges.empty() && std::none_of(edges.begin(), edges.end(),
                                     [](const Edge& e) { return e.type == EdgeType::kConsecutive; }))
    graph = largestPart(graph);
  const std::string ending = endingOf(a.out);
  if (ending == ".g2o" || ending == ".tum") {
    writeGraph(a.out, graph);
    say(graph.nodes().size(), "poses", a.out);
  } else if (ending == ".pgm" || ending == ".yaml") {
    exportGrid(session, graph, a);
  } else if (ending == ".pcd") {
    exportCloud(session, graph, a);
  } else {
    exportOccupancy(session, graph, a);
  }
}

void mergeSessionFiles(const std::vector<std::string>& paths, const SessionArguments& a) {
  const auto merge = mergeSessions(paths, a.out, shareShown());
  std::cout << merge->place_edges << " PLACE edges between the sessions, " << merge->revoked
            << " of them revoked, as they don't agree with most\n";
  for (const std::string& path : merge->unconnected) {
    std::cout << path << ": no PLACE edge connects it with " << paths.front()
              << ", so it stays in a frame of its own\n";
  }
  SessionGraph read = readGraph(Session(a.out));
  optimiseGraph(read, a.check);
  store(a.out, read);
  say(merge->key_poses, "poses", a.out);
}

}  // namespace pose_graph
