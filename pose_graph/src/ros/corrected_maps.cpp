// SPDX-License-Identifier: BSD-3-Clause
#include "pose_graph/ros/corrected_maps.h"

#include <intensity_hector_slam/ros/parameters.h>
#include <rtree_occupancy_map/ros/parameters.h>
#include <unistd.h>

#include <algorithm>
#include <cstdlib>
#include <filesystem>
#include <sstream>
#include <stdexcept>
#include <utility>

#include "pose_graph/maps.h"
#include "pose_graph/ros/conversions.h"

namespace pose_graph {
namespace {

using mapping_common::Worker;

constexpr int kNice = 10;      // of the thread that makes maps
constexpr double kWait = 5.0;  // s, for the front end to go over to a corrected map

}  // namespace

std::string temporaryPath() {
  std::string path = (std::filesystem::temp_directory_path() / "pose_graph_XXXXXX").string();
  const int file = mkstemp(path.data());
  if (file < 0) throw std::runtime_error("can't make " + path);
  close(file);
  std::filesystem::remove(path);
  return path;
}

CorrectedMaps::CorrectedMaps(ros::NodeHandle& node, const PoseGraphParameters& parameters)
    : node_(node),
      parameters_(parameters),
      grid_(node.advertise<mapping_msgs::CorrectedMap>("corrected_map", 1)),
      cells_(node.advertise<mapping_msgs::CorrectedMap>("corrected_cloud_map", 1)),
      worker_(std::make_unique<Worker>(kNice)) {}
CorrectedMaps::~CorrectedMaps() = default;

void CorrectedMaps::restart() {
  ++generation_;
  poses_.clear();
  inside_ = 0;
  waiting_.reset();
}

std::string CorrectedMaps::update(const OnlineGraph& graph, const std::shared_ptr<GraphKeeper>& keeper) {
  const auto& nodes = graph.graph().nodes();
  for (std::size_t i = poses_.size(); i < nodes.size(); ++i) poses_.push_back(nodes[i].pose);
  worker_->finish();
  std::string text;
  if (const auto made = std::move(made_)) {
    text = made->error;
    if (text.empty()) {
      publish(graph, *made);
      for (std::size_t i = 0; i < nodes.size(); ++i)
        poses_[i] = i < made->poses.size() ? made->poses[i] : nodes[i].pose;
      std::ostringstream said;
      said << (made->grid ? 1 : 0) + (made->cells ? 1 : 0) << " maps along " << made->poses.size()
           << " key poses in " << made->seconds << " s";
      last_ = said.str();
      text = "Made anew: " + last_;
    }
  }
  publishWaiting(graph);
  if ((parameters_.rebuild_map || parameters_.rebuild_cloud_map) && worker_->isIdle() && !waiting_ &&
      !graph.isOptimising() && !graph.hasWork() &&
      ros::WallTime::now() - begun_ > ros::WallDuration(parameters_.rebuild_period))
    begin(graph, keeper);
  return text;
}

void CorrectedMaps::begin(const OnlineGraph& graph, const std::shared_ptr<GraphKeeper>& keeper) {
  const auto& nodes = graph.graph().nodes();
  double farthest = 0.0;
  for (std::size_t i = 0; i < nodes.size(); ++i)
    farthest = std::max(farthest, (nodes[i].pose.translation - poses_[i].translation).norm());
  const bool of_clouds = parameters_.key_poses == KeyPoses::kClouds;
  auto copy = std::make_shared<Graph>(graph.graph().planar());
  if (of_clouds) *copy = largestPart(graph.graph());
  if (farthest <= parameters_.rebuild_distance && copy->nodes().size() == inside_) return;
  begun_ = ros::WallTime::now();
  auto made = std::make_shared<Made>();
  for (const Node& node : nodes) {
    if (!of_clouds) copy->addNode(node);
    made->poses.push_back(node.pose);
  }
  if (of_clouds) inside_ = copy->nodes().size();
  if (!graph.frontEnd().empty()) made->begun = graph.frontEnd().last();
  const auto grid = parametersOf<intensity_hector_slam::SlamParameters>(node_, parameters_.slam).slam;
  const auto cells = parametersOf<rtree_occupancy_map::MappingParameters>(node_, parameters_.mapping).map;
  worker_->post([this, worker = worker_.get(), copy, made, keeper, grid, cells,
                 with_grid = parameters_.rebuild_map, with_cells = parameters_.rebuild_cloud_map,
                 generation = generation_]() -> Worker::Work {
    const ros::WallTime start = ros::WallTime::now();
    const auto goes_on = [worker](double) { return !worker->isEnding(); };
    const auto keep = [](std::optional<Made::Map>& map, const auto& built) {
      if (built) {
        const std::string bytes = built->map.toBytes();
        map = Made::Map{built->last_stamp, {bytes.begin(), bytes.end()}};
      }
    };
    try {
      keeper->writer().flush();
      const Session session(keeper->path());
      auto amounts = session.amounts();
      if (with_grid && amounts[DataKind::kScan].count > 0)
        keep(made->grid, buildGridMap(session, *copy, grid, goes_on));
      if (with_cells && amounts[DataKind::kCloud].count > 0)
        keep(made->cells, buildOccupancyMap(session, *copy, cells, goes_on));
    } catch (const std::exception& e) {
      made->error = std::string("No map was made anew: ") + e.what();
    }
    made->seconds = (ros::WallTime::now() - start).toSec();
    return [this, made, generation] {
      if (generation == generation_) made_ = std::make_unique<Made>(std::move(*made));
    };
  });
}

// What came after the last scan is moved to where the graph has that.
std::optional<mapping_msgs::CorrectedMap> CorrectedMaps::message(const OnlineGraph& graph, const Made& made,
                                                                 const Made::Map& map) const {
  const auto at = graph.attach(map.stamp);
  if (!at || at->node >= made.poses.size()) return std::nullopt;
  const auto front_end = graph.frontEnd().at(graph.graph().nodes()[at->node].stamp);
  const Pose before = front_end ? *front_end : poses_[at->node];
  mapping_msgs::CorrectedMap message;
  message.header.stamp = toTime(map.stamp);
  message.header.frame_id = parameters_.map_frame;
  message.correction = toMessage(made.poses[at->node] * before.inverse());
  message.data = map.data;
  return message;
}

void CorrectedMaps::publish(const OnlineGraph& graph, const Made& made) {
  const auto grid = made.grid ? message(graph, made, *made.grid) : std::nullopt;
  auto cells = made.cells ? message(graph, made, *made.cells) : std::nullopt;
  if (grid) grid_.publish(*grid);
  if (!cells) return;
  if (parameters_.publish_tf) cells->corrected_from = toTime(made.begun);
  if (parameters_.publish_tf || !grid || grid_.getNumSubscribers() == 0 || graph.frontEnd().empty())
    return cells_.publish(*cells);
  waiting_ = Waiting{*cells, toPose(grid->correction), *graph.frontEnd().at(graph.frontEnd().last()),
                     ros::WallTime::now() + ros::WallDuration(kWait)};
}

// The front end's poses jump by the correction where it goes over to the new map.
void CorrectedMaps::publishWaiting(const OnlineGraph& graph) {
  if (!waiting_) return;
  if (!graph.frontEnd().empty()) {
    const std::int64_t stamp = graph.frontEnd().last();
    const Pose now = *graph.frontEnd().at(stamp);
    const auto distance = [](const Pose& a, const Pose& b) {
      const Pose motion = a.inverse() * b;
      return motion.translation.norm() + 2.0 * motion.rotation.vec().norm();
    };
    const Pose before = std::exchange(waiting_->front_end, now);
    if (distance(waiting_->correction * before, now) < distance(before, now))
      waiting_->cells.corrected_from = toTime(stamp);
  }
  if (waiting_->cells.corrected_from.isZero() && ros::WallTime::now() < waiting_->until) return;
  cells_.publish(waiting_->cells);
  waiting_.reset();
}

}  // namespace pose_graph
