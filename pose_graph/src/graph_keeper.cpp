// SPDX-License-Identifier: BSD-3-Clause
#include "pose_graph/graph_keeper.h"

#include <map>
#include <memory>

namespace pose_graph {

GraphKeeper::GraphKeeper(const std::string& path, OnlineGraph& graph, const SessionWriterOptions& options)
    : path_(path) {
  writer_ = std::make_unique<SessionWriter>(path, graph.graph().planar(), options);
  writer_->flush();
  const Session session(path);
  const SessionGraph read = readGraph(session);
  std::vector<EdgeRecord> records;
  for (std::size_t e = 0; e < read.edges.size(); ++e) {
    const SessionEdge& edge = read.edges[e];
    const auto stamp = [&](std::size_t node) { return read.graph.nodes()[node].stamp; };
    const Edge& of_graph = read.graph.edges()[e];
    records.push_back({stamp(of_graph.from), stamp(of_graph.to), edge.source,
                       edge.type == EdgeType::kConsecutive || edge.source == kByHand, edge.state});
    edge_ids_.push_back(edge.id);
    states_.push_back(edge.state);
  }
  graph.restore(read.graph, records);
  for (const Node& node : read.graph.nodes()) poses_.push_back(node.pose);
}

void GraphKeeper::update(const OnlineGraph& graph) {
  const auto& nodes = graph.graph().nodes();
  const auto same = [](const Pose& a, const Pose& b) {
    return a.translation == b.translation && a.rotation.coeffs() == b.rotation.coeffs();
  };
  std::map<std::int64_t, Pose> moved;
  for (std::size_t i = 0; i < poses_.size(); ++i) {
    if (same(poses_[i], nodes[i].pose)) continue;
    moved[nodes[i].id] = poses_[i] = nodes[i].pose;
  }
  if (!moved.empty()) writer_->setPoses(moved);
  for (std::size_t i = poses_.size(); i < nodes.size(); ++i) {
    if (!run_) run_ = writer_->beginRun(nodes[i].stamp, "");
    writer_->put(KeyPose{nodes[i].id, *run_, nodes[i].stamp, nodes[i].pose, nodes[i].pose, nodes[i].fixed});
    poses_.push_back(nodes[i].pose);
  }
  for (std::size_t e = 0; e < graph.records().size(); ++e) {
    const EdgeRecord& record = graph.records()[e];
    if (e < states_.size() && states_[e] == record.state) continue;
    if (e == states_.size()) {
      states_.push_back(record.state);
      edge_ids_.push_back(writer_->nextEdge());
    }
    states_[e] = record.state;
    const Edge& edge = graph.graph().edges()[e];
    SessionEdge kept;
    kept.id = edge_ids_[e];
    kept.from = nodes[edge.from].id;
    kept.to = nodes[edge.to].id;
    kept.type = edge.type;
    kept.state = record.state;
    kept.source = record.source;
    kept.transform = edge.transform;
    kept.information = edge.information;
    kept.similarity = 1.0;
    writer_->put(kept);
  }
}

SessionEdge GraphKeeper::putAppearance(std::int64_t from, std::int64_t to, EdgeType type,
                                       const std::string& source, double similarity) {
  SessionEdge edge;
  edge.id = writer_->nextEdge();
  edge.from = from;
  edge.to = to;
  edge.type = type;
  edge.state = EdgeState::kPending;
  edge.source = source;
  edge.similarity = similarity;
  writer_->put(edge);
  return edge;
}

void GraphKeeper::settle(SessionEdge appearance, EdgeState state) {
  appearance.state = state;
  writer_->put(appearance);
}

void GraphKeeper::putForeign(const Measurement& m) {
  writer_->put(ForeignEdge{m.from_stamp, m.to_stamp, m.source, m.transform, m.information, 1.0});
}

}  // namespace pose_graph
