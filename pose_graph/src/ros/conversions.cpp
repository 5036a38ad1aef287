// SPDX-License-Identifier: BSD-3-Clause
#include "pose_graph/ros/conversions.h"

#include <mapping_common/stamps.h>

#include <algorithm>
#include <cmath>
#include <map>
#include <numeric>
#include <sstream>
#include <stdexcept>
#include <string>
#include <vector>

#include "pose_graph/graph_keeper.h"

namespace pose_graph {
namespace {

using mapping_msgs::EdgeConstraint;

EdgeType typeOf(std::uint8_t type) {
  switch (type) {
    case EdgeConstraint::CONSECUTIVE:
      return EdgeType::kConsecutive;
    case EdgeConstraint::LOOP_CLOSURE:
      return EdgeType::kLoopClosure;
    case EdgeConstraint::PLACE:
      return EdgeType::kPlace;
    default:
      throw std::invalid_argument("its type is " + std::to_string(type) + ", allowed is 0 to 2");
  }
}

void check(const ros::Time& stamp) {
  if (stamp.isZero()) throw std::invalid_argument("a stamp of it is zero");
  mapping_common::Stamps::require(stamp, "a stamp of it");
  if (stamp.nsec >= 1'000'000'000)
    throw std::invalid_argument("a stamp of it has " + std::to_string(stamp.nsec) +
                                " ns, more than a second");
}

struct Colour {
  float r, g, b, a;
};
const std::map<std::string, Colour> kColours = {
    {"consecutive", {0.3F, 0.5F, 1.0F, 1.0F}}, {"loop_closure", {0.1F, 0.8F, 0.2F, 1.0F}},
    {"place", {0.0F, 0.8F, 0.8F, 1.0F}},       {"by_hand", {0.9F, 0.3F, 0.9F, 1.0F}},
    {"pending", {1.0F, 0.8F, 0.1F, 0.6F}},     {"revoked", {1.0F, 0.1F, 0.1F, 0.6F}}};

std::string classOf(const Edge& edge, const EdgeRecord& record) {
  if (record.state != EdgeState::kAccepted) return mapping_common::nameOf(record.state);
  if (edge.type != EdgeType::kConsecutive && record.trusted) return "by_hand";
  return mapping_common::nameOf(edge.type);
}

}  // namespace

std::int64_t toNanoseconds(const ros::Time& stamp) {
  return static_cast<std::int64_t>(stamp.toNSec());
}
ros::Time toTime(std::int64_t nanoseconds) {
  ros::Time time;
  return time.fromNSec(static_cast<std::uint64_t>(std::max<std::int64_t>(nanoseconds, 0)));
}

Pose toPose(const geometry_msgs::Pose& pose) {
  const auto& p = pose.position;
  const auto& q = pose.orientation;
  Pose converted{{p.x, p.y, p.z}, {q.w, q.x, q.y, q.z}};
  checkTransform(converted, "a pose");
  converted.rotation.normalize();
  return converted;
}
Pose toPose(const Eigen::Isometry3d& transform) {
  return {transform.translation(), Eigen::Quaterniond(transform.rotation()).normalized()};
}
geometry_msgs::Pose toMessage(const Pose& pose) {
  geometry_msgs::Pose message;
  message.position.x = pose.translation.x();
  message.position.y = pose.translation.y();
  message.position.z = pose.translation.z();
  message.orientation.x = pose.rotation.x();
  message.orientation.y = pose.rotation.y();
  message.orientation.z = pose.rotation.z();
  message.orientation.w = pose.rotation.w();
  return message;
}

Measurement toMeasurement(const EdgeConstraint& edge, const std::string& source) {
  check(edge.from_stamp);
  check(edge.to_stamp);
  Measurement m;
  m.from_stamp = toNanoseconds(edge.from_stamp);
  m.to_stamp = toNanoseconds(edge.to_stamp);
  if (m.from_stamp == m.to_stamp) throw std::invalid_argument("both of its stamps are the same");
  m.type = typeOf(edge.type);
  m.source = source;
  if (!edge.has_transform) {
    if (m.type == EdgeType::kConsecutive)
      throw std::invalid_argument("it is consecutive, without a transform");
    return m;
  }
  m.transform = toPose(edge.transform);
  for (int i = 0; i < 36; ++i) m.information(i / 6, i % 6) = edge.information[i];
  checkInformation(m.information, "it");
  return m;
}

Event toMessage(const GraphEvent& event, const std::string& frame) {
  using Kind = GraphEvent::Kind;
  const bool is_loop =
      event.kind == Kind::kAccepted || event.kind == Kind::kRefused || event.kind == Kind::kRevoked;
  Event message;
  message.header.stamp = toTime(std::max(event.from_stamp, event.to_stamp));
  message.header.frame_id = frame;
  message.event = mapping_common::nameOf(event.kind);
  message.from_stamp = toTime(event.from_stamp);
  message.to_stamp = toTime(event.to_stamp);
  message.source = event.source;
  message.chi2 = event.chi2;
  std::ostringstream text;
  text << (is_loop ? "Loop " : "Edge ") << message.event << ": " << message.from_stamp << " to "
       << message.to_stamp << " of " << event.source;
  if (is_loop) text << ", chi2 " << event.chi2;
  message.text = text.str();
  return message;
}

nav_msgs::Path toPath(const Graph& graph, const std_msgs::Header& header) {
  std::vector<std::size_t> order(graph.nodes().size());
  std::iota(order.begin(), order.end(), 0);
  std::stable_sort(order.begin(), order.end(), [&](std::size_t a, std::size_t b) {
    return graph.nodes()[a].stamp < graph.nodes()[b].stamp;
  });
  nav_msgs::Path path;
  path.header = header;
  path.poses.reserve(order.size());
  for (const std::size_t i : order) {
    geometry_msgs::PoseStamped pose;
    pose.header.frame_id = header.frame_id;
    pose.header.stamp = toTime(graph.nodes()[i].stamp);
    pose.pose = toMessage(graph.nodes()[i].pose);
    path.poses.push_back(pose);
  }
  return path;
}

visualization_msgs::MarkerArray toMarkers(const OnlineGraph& graph, const std_msgs::Header& header) {
  std::map<std::string, visualization_msgs::Marker> markers;
  for (const auto& [name, colour] : kColours) {
    visualization_msgs::Marker& marker = markers[name];
    marker.header = header;
    marker.ns = name;
    marker.type = visualization_msgs::Marker::LINE_LIST;
    marker.action = visualization_msgs::Marker::ADD;
    marker.pose.orientation.w = 1.0;
    marker.scale.x = 0.03;
    marker.color.r = colour.r, marker.color.g = colour.g, marker.color.b = colour.b;
    marker.color.a = colour.a;
  }
  const auto& nodes = graph.graph().nodes();
  for (std::size_t e = 0; e < graph.records().size(); ++e) {
    const Edge& edge = graph.graph().edges()[e];
    const EdgeRecord& record = graph.records()[e];
    if (record.state == EdgeState::kDeleted) continue;
    auto& points = markers.at(classOf(edge, record)).points;
    points.push_back(toMessage(nodes[edge.from].pose).position);
    points.push_back(toMessage(nodes[edge.to].pose).position);
  }
  visualization_msgs::MarkerArray array;
  for (auto& [name, marker] : markers) {
    if (marker.points.empty()) marker.action = visualization_msgs::Marker::DELETE;
    array.markers.push_back(std::move(marker));
  }
  return array;
}

void addTo(diagnostic_updater::DiagnosticStatusWrapper& status, const OnlineGraph& graph) {
  status.summaryf(diagnostic_msgs::DiagnosticStatus::OK, "%zu key poses", graph.graph().nodes().size());
  status.add("Key poses", graph.graph().nodes().size());
  status.add("Edges", graph.records().size());
  status.add("Parts", graph.parts());
  const auto loops = graph.countsOfLoops();
  for (const auto& choice : choicesOf(EdgeState()))
    status.add(std::string("Loops: ") + choice.name, loops[static_cast<std::size_t>(choice.value)]);
}

void addTo(diagnostic_updater::DiagnosticStatusWrapper& status, const SessionWriter::Status& session) {
  using diagnostic_msgs::DiagnosticStatus;
  if (!session.error.empty())
    status.summary(DiagnosticStatus::ERROR, session.error);
  else if (session.lost > 0)
    status.summaryf(DiagnosticStatus::WARN, "%zu scans or clouds were lost", session.lost);
  else
    status.summary(DiagnosticStatus::OK, "Kept");
  status.add("Unwritten for (s)", session.unwritten_since);
  status.add("Waiting (bytes)", session.waiting_bytes);
  status.add("Lost scans and clouds", session.lost);
  status.add("Longest commit (s)", session.longest_commit);
}

}  // namespace pose_graph
