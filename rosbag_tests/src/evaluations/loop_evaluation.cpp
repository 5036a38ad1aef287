// SPDX-License-Identifier: BSD-3-Clause
#include <rosbag_tests/evaluations/loop_evaluation.h>
#include <rosbag_tests/evaluations/trajectory_metrics.h>

#include <algorithm>
#include <cmath>
#include <map>
#include <optional>
#include <set>

namespace rosbag_tests {

namespace slam = intensity_hector_slam;
using mapping_simulation::TimedPose;

namespace {

constexpr double kMaxGap = 3.0;  // s, of the reference

pose_graph::Pose toGraph(const slam::Pose& pose) {
  return pose_graph::planarPose(pose.x(), pose.y(), pose.z());
}
slam::Pose toPlane(const pose_graph::Pose& pose) {
  return {pose.translation.x(), pose.translation.y(), pose.yaw()};
}
Eigen::Isometry3d toSpace(const slam::Pose& pose) {
  return Eigen::Translation3d(pose.x(), pose.y(), 0.0) *
         Eigen::Isometry3d(Eigen::AngleAxisd(pose.z(), Eigen::Vector3d::UnitZ()));
}

pose_graph::Matrix6 toGraph(const Eigen::Matrix3d& information) {
  pose_graph::Matrix6 result = pose_graph::Matrix6::Zero();
  constexpr int kRows[] = {0, 1, 5};
  for (int row = 0; row < 3; ++row)
    for (int column = 0; column < 3; ++column) result(kRows[row], kRows[column]) = information(row, column);
  return result;
}

// Key poses of one chain, numbered from 0 on as the graph wants them.
struct Part {
  pose_graph::Graph graph{true};
  std::vector<std::size_t> loops;  // of the run's
};

}  // namespace

CorrectedRun correct(const slam::BagResult& run, const pose_graph::LoopCheckOptions& options) {
  CorrectedRun result;
  for (const slam::Edge& edge : run.edges)
    if (edge.type == slam::EdgeType::kLoopClosure) result.loops.push_back(edge);
  result.accepted.resize(result.loops.size());

  std::vector<Part> parts;
  std::map<std::uint32_t, std::size_t> part_of;
  std::map<std::uint32_t, std::size_t> index_of;
  const auto add = [&](const slam::KeyPose& key, std::size_t part) {
    if (part_of.count(key.id)) return;
    part_of[key.id] = part;
    index_of[key.id] = parts[part].graph.addNode({static_cast<std::int64_t>(parts[part].graph.nodes().size()),
                                                  std::llround(1e9 * key.stamp), toGraph(key.pose), false});
  };
  const auto addEdge = [&](const slam::Edge& edge, Part& part, pose_graph::EdgeType type) {
    pose_graph::Edge added;
    added.from = index_of.at(edge.from.id);
    added.to = index_of.at(edge.to.id);
    added.type = type;
    added.transform = toGraph(edge.transform);
    added.information = toGraph(informationAtEnd(edge));
    part.graph.addEdge(added);
  };
  std::map<std::uint32_t, slam::KeyPose> keys;
  for (const slam::Edge& edge : run.edges) {
    if (edge.type != slam::EdgeType::kConsecutive) continue;
    if (!part_of.count(edge.from.id)) parts.emplace_back();
    add(edge.from, parts.size() - 1);
    add(edge.to, parts.size() - 1);
    addEdge(edge, parts.back(), pose_graph::EdgeType::kConsecutive);
    for (const slam::KeyPose* key : {&edge.from, &edge.to}) keys[key->id] = *key;
  }
  for (std::size_t i = 0; i < result.loops.size(); ++i) {
    const slam::Edge& loop = result.loops[i];
    const auto from = part_of.find(loop.from.id), to = part_of.find(loop.to.id);
    if (from == part_of.end() || to == part_of.end() || from->second != to->second) continue;
    addEdge(loop, parts[from->second], pose_graph::EdgeType::kLoopClosure);
    parts[from->second].loops.push_back(i);
  }
  result.parts = parts.size();
  for (Part& part : parts) {
    const std::size_t first_loop = part.graph.edges().size() - part.loops.size();
    if (part.loops.empty()) continue;
    pose_graph::optimiseAndCheck(part.graph, options);
    for (std::size_t i = 0; i < part.loops.size(); ++i)
      result.accepted[part.loops[i]] = part.graph.edges()[first_loop + i].active;
  }

  std::map<double, slam::KeyPose> by_stamp;
  for (const auto& [id, key] : keys) by_stamp[key.stamp] = key;
  for (const auto& entry : run.entries) {
    const slam::Status status = entry.result.status;
    if (status == slam::Status::kRejected || status == slam::Status::kEmpty) continue;
    slam::Pose pose = entry.result.pose;
    result.front_end.push_back({entry.stamp, toSpace(pose)});
    auto after = by_stamp.upper_bound(entry.stamp);
    if (after != by_stamp.begin()) --after;
    if (after != by_stamp.end()) {
      const slam::KeyPose& key = after->second;
      const auto& node = parts[part_of.at(key.id)].graph.nodes()[index_of.at(key.id)];
      // SLAM's map may be another one since (SlamParameters::follow_loops).
      const slam::Pose way = key.stamp == entry.stamp ? slam::Pose(0, 0, 0) : slam::between(key.pose, pose);
      pose = slam::compose(toPlane(node.pose), way);
    }
    result.corrected.push_back({entry.stamp, toSpace(pose)});
  }
  return result;
}

std::pair<std::size_t, std::size_t> wrongLoops(const CorrectedRun& run,
                                               const mapping_simulation::Trajectory& reference,
                                               double distance, double angle) {
  std::pair<std::size_t, std::size_t> wrong(0, 0);
  for (std::size_t i = 0; i < run.loops.size(); ++i) {
    const auto from = poseAt(reference, run.loops[i].from.stamp, kMaxGap),
               to = poseAt(reference, run.loops[i].to.stamp, kMaxGap);
    if (!from || !to) continue;
    const Eigen::Isometry3d error = toSpace(run.loops[i].transform).inverse() * (from->inverse() * *to);
    const bool right =
        error.translation().norm() <= distance && Eigen::AngleAxisd(error.rotation()).angle() <= angle;
    wrong.first += !right && run.accepted[i];
    wrong.second += !right;
  }
  return wrong;
}

}  // namespace rosbag_tests
