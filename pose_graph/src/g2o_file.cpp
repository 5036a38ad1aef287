// SPDX-License-Identifier: BSD-3-Clause
#include "pose_graph/g2o_file.h"

#include <mapping_common/files.h>
#include <mapping_common/text.h>

#include <algorithm>
#include <cctype>
#include <cerrno>
#include <cmath>
#include <cstdlib>
#include <iomanip>
#include <limits>
#include <optional>
#include <stdexcept>
#include <vector>

namespace pose_graph {
namespace {

struct Line {
  std::string tag, where;
  std::vector<std::int64_t> ids;
  std::vector<double> numbers;
};

struct Tag {
  const char* name;
  bool planar, edge;
};
const Tag kTags[] = {{"VERTEX_SE2", true, false},       {"EDGE_SE2", true, true},
                     {"VERTEX2", true, false},          {"EDGE2", true, true},
                     {"VERTEX_SE3:QUAT", false, false}, {"EDGE_SE3:QUAT", false, true}};

[[noreturn]] void fail(const std::string& where, const std::string& what) {
  throw std::runtime_error(where + ": " + what);
}

// `ids` integers, the rest numbers.
Line parseLine(const std::string& text, const std::string& tag, std::size_t start, std::size_t ids,
               const std::string& where) {
  Line line{tag, where, {}, {}};
  const char* p = text.c_str() + start;
  while (true) {
    while (std::isspace(static_cast<unsigned char>(*p))) ++p;
    if (*p == 0) return line;
    char* end = nullptr;
    errno = 0;
    if (line.ids.size() < ids)
      line.ids.push_back(std::strtoll(p, &end, 10));
    else
      line.numbers.push_back(std::strtod(p, &end));
    const bool overflow = errno == ERANGE && line.ids.size() < ids;
    if (end == p || overflow || (*end != 0 && !std::isspace(static_cast<unsigned char>(*end)))) {
      const char* word_end = p;
      while (*word_end != 0 && !std::isspace(static_cast<unsigned char>(*word_end))) ++word_end;
      fail(where, '\'' + std::string(p, word_end) + "' is no " + (line.numbers.empty() ? "id" : "number"));
    }
    p = end;
  }
}

Pose poseOf(const std::vector<double>& n, bool planar, const std::string& where) {
  if (planar) return planarPose(n[0], n[1], n[2]);
  Pose pose{{n[0], n[1], n[2]}, {n[6], n[3], n[4], n[5]}};
  // g2o normalises what it reads; files have few digits.
  const double norm = pose.rotation.norm();
  if (!(std::abs(norm - 1.0) < 0.1)) fail(where, "a quaternion of length " + std::to_string(norm));
  pose.rotation.normalize();
  return pose;
}

// From what stands behind the pose: the upper triangle, row by row.
Matrix6 informationOf(const std::vector<double>& n, bool planar, bool toro) {
  Matrix6 information = Matrix6::Zero();
  if (planar) {
    static const int kRow[] = {0, 0, 0, 1, 1, 5}, kColumn[] = {0, 1, 5, 1, 5, 5};
    static const int kToroRow[] = {0, 0, 1, 5, 0, 1}, kToroColumn[] = {0, 1, 1, 5, 5, 5};
    for (int i = 0; i < 6; ++i) {
      const int r = toro ? kToroRow[i] : kRow[i], c = toro ? kToroColumn[i] : kColumn[i];
      information(r, c) = information(c, r) = n[3 + i];
    }
    return information;
  }
  for (int r = 0, i = 7; r < 6; ++r)
    for (int c = r; c < 6; ++c, ++i)
      // Of the vector part of the quaternion there, of twice that here.
      information(r, c) = information(c, r) = n[i] * (r < 3 ? 1.0 : 0.5) * (c < 3 ? 1.0 : 0.5);
  return information;
}

}  // namespace

G2oFile parseG2o(const std::string& text, const std::string& path) {
  std::vector<Line> vertices, edges, fixed;
  std::optional<bool> planar;
  mapping_common::forEachLine(text, path, [&](const std::string& line, const std::string& where) {
    const std::size_t start = line.find_first_not_of(" \t\r");
    if (start == std::string::npos) return;
    const std::size_t end = std::min(line.find_first_of(" \t\r", start), line.size());
    const std::string name = line.substr(start, end - start);
    if (name.rfind("PARAMS_", 0) == 0) return;  // sensors' offsets, which the edges here don't use
    if (name == "FIX") {
      fixed.push_back(parseLine(line, name, end, std::numeric_limits<std::size_t>::max(), where));
      return;
    }
    const auto tag =
        std::find_if(std::begin(kTags), std::end(kTags), [&](const Tag& t) { return name == t.name; });
    if (tag == std::end(kTags))
      fail(where, '\'' + name + "' is none of VERTEX_SE2 | EDGE_SE2 | VERTEX_SE3:QUAT | EDGE_SE3:QUAT | FIX");
    if (planar && *planar != tag->planar)
      fail(where, name + " in a graph " + (*planar ? "of the plane" : "in space"));
    planar = tag->planar;
    Line parsed = parseLine(line, name, end, tag->edge ? 2 : 1, where);
    const std::size_t ids = tag->edge ? 2 : 1,
                      numbers = (tag->planar ? 3 : 7) + (tag->edge ? (tag->planar ? 6 : 21) : 0);
    if (parsed.ids.size() != ids || parsed.numbers.size() != numbers)
      fail(where, name + " has " + std::to_string(ids) + (ids == 1 ? " id and " : " ids and ") +
                      std::to_string(numbers) + " numbers, not " +
                      std::to_string(parsed.ids.size() + parsed.numbers.size()) + " in all");
    (tag->edge ? edges : vertices).push_back(std::move(parsed));
  });
  if (!planar) throw std::runtime_error(path + " has no vertices and no edges of poses");

  G2oFile file{Graph(*planar), !vertices.empty()};
  const auto at = [](const Line& line, const auto& add) {
    try {
      add();
    } catch (const std::invalid_argument& e) {
      fail(line.where, e.what());
    }
  };
  for (const Line& line : vertices)
    at(line, [&] { file.graph.addNode({line.ids[0], 0, poseOf(line.numbers, *planar, line.where), false}); });
  if (!file.has_poses) {
    std::vector<std::int64_t> ids;
    for (const Line& line : edges) ids.insert(ids.end(), line.ids.begin(), line.ids.end());
    std::sort(ids.begin(), ids.end());
    ids.erase(std::unique(ids.begin(), ids.end()), ids.end());
    for (const std::int64_t id : ids) file.graph.addNode({id, 0, {}, false});
  }
  const auto node = [&](const Line& line, std::int64_t id) {
    const auto found = file.graph.find(id);
    if (!found)
      fail(line.where, line.tag + " of a vertex " + std::to_string(id) + " that the file doesn't have");
    return *found;
  };
  for (const Line& line : edges) {
    const bool consecutive = line.ids[1] - line.ids[0] == 1 || line.ids[0] - line.ids[1] == 1;
    Edge edge{node(line, line.ids[0]),
              node(line, line.ids[1]),
              consecutive ? EdgeType::kConsecutive : EdgeType::kLoopClosure,
              poseOf(line.numbers, *planar, line.where),
              informationOf(line.numbers, *planar, line.tag == "EDGE2"),
              true};
    at(line, [&] { file.graph.addEdge(edge); });
  }
  for (const Line& line : fixed)
    for (const std::int64_t id : line.ids) file.graph.setFixed(node(line, id), true);
  return file;
}

G2oFile readG2o(const std::string& path) {
  return parseG2o(mapping_common::readFile(path), path);
}

void writeG2o(const std::string& path, const Graph& graph) {
  const bool planar = graph.planar();
  mapping_common::writeFile(path, [&](std::ostream& out) {
    out << std::setprecision(std::numeric_limits<double>::max_digits10);
    const auto write = [&](const Pose& pose) {
      const auto& t = pose.translation;
      const auto& q = pose.rotation;
      if (planar)
        out << ' ' << t.x() << ' ' << t.y() << ' ' << pose.yaw();
      else
        out << ' ' << t.x() << ' ' << t.y() << ' ' << t.z() << ' ' << q.x() << ' ' << q.y() << ' ' << q.z()
            << ' ' << q.w();
    };
    for (const Node& node : graph.nodes()) {
      out << (planar ? "VERTEX_SE2 " : "VERTEX_SE3:QUAT ") << node.id;
      write(node.pose);
      out << '\n';
    }
    for (const Node& node : graph.nodes())
      if (node.fixed) out << "FIX " << node.id << '\n';
    for (const Edge& edge : graph.edges()) {
      if (!edge.active) continue;
      out << (planar ? "EDGE_SE2 " : "EDGE_SE3:QUAT ") << graph.nodes()[edge.from].id << ' '
          << graph.nodes()[edge.to].id;
      write(edge.transform);
      for (int r = 0; r < 6; ++r)
        for (int c = r; c < 6; ++c) {
          if (planar && (r == 2 || r == 3 || r == 4 || c == 2 || c == 3 || c == 4)) continue;
          const double scale = planar ? 1.0 : (r < 3 ? 1.0 : 2.0) * (c < 3 ? 1.0 : 2.0);
          out << ' ' << scale * edge.information(r, c);
        }
      out << '\n';
    }
  });
}

}  // namespace pose_graph
