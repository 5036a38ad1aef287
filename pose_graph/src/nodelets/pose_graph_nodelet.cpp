// SPDX-License-Identifier: BSD-3-Clause
//
// Keeps the graph of key poses and loops in a session, corrects it after loops, and makes maps anew along it.
// The graph belongs to the nodelet's single-threaded callback queue. Two threads optimise and make maps of
// copies; what they found is taken over in the callback queue again. A session is saved in a thread of its
// own.
#include <geometry_msgs/PoseStamped.h>
#include <intensity_hector_slam/ros/parameters.h>
#include <mapping_common/arrivals.h>
#include <mapping_common/laser_faults.h>
#include <mapping_common/nodelet.h>
#include <mapping_common/worker.h>
#include <mapping_msgs/LoadMap.h>
#include <mapping_msgs/SaveMap.h>
#include <pose_graph/AddEdge.h>
#include <pose_graph/DeleteEdge.h>
#include <ros/callback_queue.h>
#include <ros/spinner.h>
#include <rtree_occupancy_map/ros/parameters.h>
#include <std_srvs/Trigger.h>
#include <tf2_eigen/tf2_eigen.h>
#include <tf2_ros/transform_broadcaster.h>

#include <algorithm>
#include <atomic>
#include <filesystem>
#include <list>
#include <memory>
#include <optional>
#include <pluginlib/class_list_macros.hpp>
#include <set>
#include <sstream>
#include <string>
#include <thread>
#include <tuple>
#include <utility>
#include <vector>

#include "pose_graph/g2o_file.h"
#include "pose_graph/graph_keeper.h"
#include "pose_graph/key_sensors.h"
#include "pose_graph/maps.h"
#include "pose_graph/ros/conversions.h"
#include "pose_graph/ros/corrected_maps.h"
#include "pose_graph/ros/parameters.h"
#include "pose_graph/session_merge.h"
#include "pose_graph/trajectory_file.h"
#include "pose_graph/undistortion.h"

namespace pose_graph {
namespace {

using mapping_common::Arrivals;
using mapping_common::withoutSlash;
using mapping_common::Worker;
using mapping_msgs::EdgeConstraint;
using std_srvs::Trigger;

namespace slam = intensity_hector_slam;
namespace rtree = rtree_occupancy_map;

// Why an edge isn't in the graph, beside what Arrivals has.
constexpr const char *kDoubled = "doubled", *kExpired = "unknown stamps", *kCrowded = "crowded out",
                     *kOnePose = "within one key pose", *kNotMatched = "scans don't match";

constexpr double kTick = 0.05;                   // s
constexpr int kMostTicks = 200;                  // that saving waits for
constexpr std::size_t kMostWithoutFrame = 1000;  // edges

}  // namespace

class PoseGraphNodelet : public mapping_common::Nodelet {
 public:
  ~PoseGraphNodelet() override;

 private:
  struct Waiting {  // for tf of its sensor, or for scans of its key poses
    EdgeConstraint edge;
    std::string topic;
    ros::WallTime until;
  };

  void start(mapping_common::Parameters& reader) override;
  void listen();
  void offerServices();
  std::string open(const std::string& path);
  std::string save(const std::string& path) const;

  void arrived(const EdgeConstraint& edge, const std::string& topic);
  bool tryToAdd(const Waiting& waiting, std::string& why);
  void add(const Measurement& measurement);
  void keepScan(const sensor_msgs::LaserScan& message, const Arrivals::Transforms& transforms);
  void keepCloud(const sensor_msgs::PointCloud2& message, const Arrivals::Transforms& transforms);
  void frontEndPose(const ros::Time& stamp, const Pose& pose);
  void jumpedBack();

  void keep();
  void tick();
  void optimise();
  bool tryToMatch(const Waiting& waiting, std::string& why);
  void sayEvents();
  void publish();
  void publishTransform();
  void publishScanner();
  void send(const Pose& pose, const std::string& frame, const ros::Time& stamp);

  void report() override;
  void diagnoseInput(StatusWrapper& status);
  void diagnoseGraph(StatusWrapper& status);
  void diagnoseSession(StatusWrapper& status);

  PoseGraphParameters parameters_;
  OnlineGraph graph_;
  std::shared_ptr<GraphKeeper> keeper_;  // shared with what is at work; is changed atomically
  std::atomic<unsigned> ticks_{0};
  std::string temporary_;  // file of the session, if nobody has named one
  KeySensors sensors_;
  std::size_t generation_ = 0;  // of graph_: what is at work for an earlier one is of no use

  std::unique_ptr<Arrivals> arrivals_;
  std::vector<ros::Subscriber> inputs_;
  mapping_common::LaserScans laser_scans_;
  std::unique_ptr<mapping_common::LaserFaults> laser_faults_;
  std::optional<slam::SlamParameters> front_end_;  // of SLAM, for scans
  std::optional<bool> undistort_clouds_;           // as the R-tree map does
  std::list<Waiting> waiting_;
  std::set<std::tuple<std::string, ros::Time, ros::Time>> appearances_;  // that are known
  ros::Time last_tf_;

  ros::Publisher path_, markers_, events_;
  tf2_ros::TransformBroadcaster broadcaster_;
  ros::Time last_transform_;
  ros::WallTimer timer_;
  ros::WallTime published_;
  bool changed_ = true, optimise_all_ = false;

  std::string last_loop_ = "none";
  double last_optimisation_ = 0.0, longest_optimisation_ = 0.0;  // s
  std::size_t edges_received_ = 0, optimisations_ = 0, matched_ = 0;

  ros::CallbackQueue saving_;
  ros::AsyncSpinner saver_{1, &saving_};

  // The last, so that they end first.
  std::unique_ptr<CorrectedMaps> maps_;
  std::unique_ptr<Worker> optimiser_;
};

PoseGraphNodelet::~PoseGraphNodelet() {
  endCallbacks();
  saver_.stop();
  timer_.stop();
  optimiser_.reset();
  maps_.reset();
  try {
    if (keeper_) {
      keep();
      keeper_->writer().flush();
    }
  } catch (const std::exception& e) {
    NODELET_ERROR_STREAM("The end of the session is lost: " << e.what());
  }
  keeper_.reset();
  std::error_code ignored;
  if (!temporary_.empty()) std::filesystem::remove(temporary_, ignored);
}

void PoseGraphNodelet::start(mapping_common::Parameters& reader) {
  reader.read(parameters_);
  for (std::string* frame : {&parameters_.map_frame, &parameters_.odom_frame, &parameters_.base_frame})
    *frame = withoutSlash(*frame);
  if (parameters_.session_file.empty()) temporary_ = temporaryPath();
  NODELET_INFO_STREAM(open(temporary_.empty() ? parameters_.session_file : temporary_));

  ros::NodeHandle& node = getNodeHandle();
  path_ = node.advertise<nav_msgs::Path>("graph_path", 1, true);
  markers_ = node.advertise<visualization_msgs::MarkerArray>("graph", 1, true);
  events_ = node.advertise<Event>("graph_events", 100, true);
  optimiser_ = std::make_unique<Worker>();
  maps_ = std::make_unique<CorrectedMaps>(node, parameters_);
  listen();
  offerServices();
  allowReconfiguration<PoseGraphParameters>(parameters_, [this](const PoseGraphParameters& changed) {
    mapping_common::copyDynamic(changed, parameters_);
  });
  timer_ = every(kTick, [this] { tick(); });
  startDiagnostics("none", {{"Edges", [this](StatusWrapper& status) { diagnoseInput(status); }},
                            {"Graph", [this](StatusWrapper& status) { diagnoseGraph(status); }},
                            {"Session", [this](StatusWrapper& status) { diagnoseSession(status); }}});
}

std::string PoseGraphNodelet::open(const std::string& path) {
  OnlineGraph graph(parameters_.graph);
  auto keeper = std::make_shared<GraphKeeper>(path, graph, parameters_.session);
  graph_ = std::move(graph);
  std::atomic_store(&keeper_, std::move(keeper));
  ++generation_;
  sensors_ = KeySensors();
  sensors_.skip(graph_.graph().nodes().size());
  if (maps_) maps_->restart();
  changed_ = true;
  std::ostringstream text;
  text << "The session " << path << " goes on: " << graph_.graph().nodes().size() << " key poses, "
       << graph_.records().size() << " edges";
  return graph_.graph().nodes().empty() ? "A new session, " + path : text.str();
}

// --------------------------------------------------------------------------------------------------- input

void PoseGraphNodelet::listen() {
  ros::NodeHandle& node = getNodeHandle();
  Arrivals::Options options;
  options.drops.name = getName();
  options.drops.warning = "Not taken";
  options.drops.key = "Not taken";
  options.drops.reasons = {kDoubled, kExpired, kCrowded, kOnePose, kNotMatched};
  options.transforms.target_frame = parameters_.base_frame;
  options.transforms.timeout = parameters_.transform_timeout;
  arrivals_ = std::make_unique<Arrivals>(node, guard(), options, [this](const ros::Time&) { jumpedBack(); });
  laser_faults_ = std::make_unique<mapping_common::LaserFaults>(getName());
  for (const std::string& topic : mapping_common::listOf(parameters_.edge_topics)) {
    inputs_.push_back(node.subscribe<EdgeConstraint>(
        topic, parameters_.queue_size,
        [this, topic](const mapping_msgs::EdgeConstraintConstPtr& edge) { arrived(*edge, topic); }));
  }
  if (parameters_.front_end_pose == FrontEndPose::kTopic) {
    inputs_.push_back(node.subscribe<geometry_msgs::PoseStamped>(
        "pose", 1000, [this](const geometry_msgs::PoseStampedConstPtr& message) {
          if (!arrivals_->accept("pose", "Poses", message->header)) return;
          try {
            frontEndPose(message->header.stamp, toPose(message->pose));
          } catch (const std::invalid_argument& e) {
            arrivals_->drops().add(Arrivals::kMalformed, e.what());
          }
        }));
  }
  if (parameters_.keep_scans) {
    inputs_.push_back(arrivals_->subscribe<sensor_msgs::LaserScan>(
        "scan", 1000, "Scans",
        [this](const sensor_msgs::LaserScan& scan, const Arrivals::Transforms& t) { keepScan(scan, t); },
        false));
  }
  if (parameters_.keep_clouds) {
    const bool each_counts = parameters_.key_poses == KeyPoses::kClouds;
    inputs_.push_back(arrivals_->subscribe<sensor_msgs::PointCloud2>(
        "cloud", each_counts ? parameters_.queue_size : 5, "Clouds",
        [this](const sensor_msgs::PointCloud2& cloud, const Arrivals::Transforms& t) { keepCloud(cloud, t); },
        false));
  }
}

void PoseGraphNodelet::arrived(const EdgeConstraint& edge, const std::string& topic) {
  ++edges_received_;
  try {
    const Measurement m = toMeasurement(edge, topic);
    const double wait = edge.has_transform ? parameters_.transform_timeout : parameters_.graph.wait;
    if (!edge.has_transform && !appearances_.insert({topic, edge.from_stamp, edge.to_stamp}).second)
      return arrivals_->drops().add(kDoubled, "");
    const Waiting waiting{edge, topic, ros::WallTime::now() + ros::WallDuration(wait)};
    std::string why;
    if (tryToAdd(waiting, why)) return;
    if (waiting_.size() >= kMostWithoutFrame) {
      arrivals_->drops().add(kCrowded, why);
      waiting_.pop_front();
    }
    waiting_.push_back(waiting);
  } catch (const std::invalid_argument& e) {
    arrivals_->drops().add(Arrivals::kMalformed, "an edge of " + topic + ": " + e.what());
  }
}

// @return false if it has to wait, and why. @throws std::invalid_argument
bool PoseGraphNodelet::tryToAdd(const Waiting& waiting, std::string& why) {
  const EdgeConstraint& edge = waiting.edge;
  if (!edge.has_transform) return tryToMatch(waiting, why);
  const std::string frame = withoutSlash(edge.frame_id);
  Measurement m = toMeasurement(edge, waiting.topic);
  if (!frame.empty() && frame != parameters_.base_frame) {
    try {
      m = ofBody(m, toPose(tf2::transformToEigen(arrivals_->queue().buffer().lookupTransform(
                        parameters_.base_frame, frame, ros::Time(0)))));
    } catch (const tf2::TransformException& e) {
      why = e.what();
      return false;
    }
  }
  add(m);
  return true;
}

void PoseGraphNodelet::add(const Measurement& m) {
  std::ostringstream text;
  text << "an edge of " << m.source << " from " << toTime(m.from_stamp) << " to " << toTime(m.to_stamp);
  switch (graph_.add(m)) {
    case OnlineGraph::Added::kDoubled:
      return arrivals_->drops().add(kDoubled, text.str());
    case OnlineGraph::Added::kOnePose:
      return arrivals_->drops().add(kOnePose, text.str());
    case OnlineGraph::Added::kNow:
    case OnlineGraph::Added::kWaits:
      changed_ = true;
  }
}

void PoseGraphNodelet::keepScan(const sensor_msgs::LaserScan& message,
                                const Arrivals::Transforms& transforms) {
  mapping_common::LaserReading reading = laser_scans_.read(message);
  if (!front_end_) front_end_ = parametersOf<slam::SlamParameters>(getNodeHandle(), parameters_.slam);
  const auto scan =
      std::make_shared<slam::Scan>(slam::toScan(message, reading, transforms.message, front_end_->scan));
  laser_faults_->add(reading);
  const std::int64_t stamp = toNanoseconds(message.header.stamp);
  sensors_.add(
      DataKind::kScan, stamp, stamp + ros::Duration(rtree::sweepTimesOf(message).last).toNSec(),
      [scan, stamp, options = front_end_->slam, frame = parameters_.base_frame](const Trajectory& path) {
        KeyData data = toKeyData(undistorted(*scan, stamp, path, options));
        data.frame = frame;
        return data;
      });
}

void PoseGraphNodelet::keepCloud(const sensor_msgs::PointCloud2& message,
                                 const Arrivals::Transforms& transforms) {
  if (parameters_.key_poses == KeyPoses::kClouds) {
    graph_.addKeyPose(toNanoseconds(message.header.stamp));
    changed_ = true;
  }
  const std::size_t nodes = graph_.graph().nodes().size();
  if (nodes == 0 || sensors_.has(DataKind::kCloud, nodes - 1)) return;
  if (!undistort_clouds_)
    undistort_clouds_ =
        parametersOf<rtree::MappingParameters>(getNodeHandle(), parameters_.mapping).undistort;
  const auto scan = std::make_shared<rtree::Scan>(rtree::toScan(message, transforms.message, {}).scan);
  scan->time = message.header.stamp.toSec();
  const std::int64_t stamp = toNanoseconds(message.header.stamp);
  mapping_common::SweepTimes times;
  std::shared_ptr<const sensor_msgs::PointCloud2> sweep;
  if (*undistort_clouds_) {
    times = rtree::sweepTimesOf(message);
    sweep = std::make_shared<const sensor_msgs::PointCloud2>(message);
  }
  const auto undistort = [=, sensor = toPose(transforms.message)](const Trajectory& front_end) {
    const auto path = sensorPath(front_end, stamp, sensor, times.first, times.last);
    if (!path) return;
    *scan = rtree::toScan(*sweep, *path, *path, {}).scan;
    scan->time = 1e-9 * static_cast<double>(stamp);
  };
  sensors_.add(DataKind::kCloud, stamp, stamp + ros::Duration(std::max(0.0, times.last)).toNSec(),
               [=, frame = parameters_.base_frame](const Trajectory& front_end) {
                 if (times.first < times.last) undistort(front_end);
                 KeyData data = toKeyData(*scan);
                 data.frame = frame;
                 return data;
               });
}

void PoseGraphNodelet::frontEndPose(const ros::Time& stamp, const Pose& pose) {
  if (stamp.isZero()) throw std::invalid_argument("a pose without a stamp");
  graph_.addFrontEndPose(toNanoseconds(stamp), pose);
}

void PoseGraphNodelet::jumpedBack() {
  const std::size_t waited = graph_.beginNewRun() + waiting_.size();
  if (waited > 0) arrivals_->drops().add(Arrivals::kTimeJump, "edges that waited", waited);
  waiting_.clear();
  appearances_.clear();
  sensors_.clear();
  keeper_->beginNewRun();
  last_tf_ = last_transform_ = ros::Time();
}

// ----------------------------------------------------------------------------------------- in the background

// What is new goes to the session.
void PoseGraphNodelet::keep() {
  keeper_->update(graph_);
  for (KeyData& data : sensors_.take(graph_)) keeper_->writer().put(std::move(data));
}

void PoseGraphNodelet::tick() {
  optimiser_->finish();
  if (parameters_.front_end_pose == FrontEndPose::kTf) {
    try {
      const auto t = arrivals_->queue().buffer().lookupTransform(parameters_.map_frame,
                                                                 parameters_.base_frame, ros::Time(0));
      if (t.header.stamp > last_tf_)
        frontEndPose(last_tf_ = t.header.stamp, toPose(tf2::transformToEigen(t)));
    } catch (const tf2::TransformException&) {
      // It isn't there yet.
    }
  }
  const ros::WallTime now = ros::WallTime::now();
  for (auto i = waiting_.begin(); i != waiting_.end();) {
    std::string why;
    bool done = true;
    try {
      done = tryToAdd(*i, why);
    } catch (const std::invalid_argument& e) {
      arrivals_->drops().add(Arrivals::kMalformed, e.what());
    }
    if (!done && now > i->until) {
      arrivals_->drops().add(i->edge.has_transform ? Arrivals::kNoTransform : kExpired, why);
      done = true;
    }
    i = done ? waiting_.erase(i) : std::next(i);
  }
  keep();
  ++ticks_;
  sayEvents();
  optimise();
  const std::string made = maps_->update(graph_, keeper_);
  if (!made.empty()) NODELET_INFO_STREAM(made);
  if (parameters_.publish_tf) publishTransform();
  if (changed_ && now - published_ > ros::WallDuration(parameters_.publish_period)) publish();
}

void PoseGraphNodelet::optimise() {
  if (!optimiser_->isIdle()) return;
  auto begun = graph_.begin(optimise_all_);
  if (!begun) return;
  optimise_all_ = false;
  auto task = std::make_shared<GraphOptimisation>(std::move(*begun));
  optimiser_->post([this, task, worker = optimiser_.get(), generation = generation_]() -> Worker::Work {
    const ros::WallTime start = ros::WallTime::now();
    std::string error;
    try {
      task->run([worker](int, double) { return !worker->isEnding(); });
    } catch (const std::exception& e) {
      error = e.what();
    }
    const double seconds = (ros::WallTime::now() - start).toSec();
    return [this, task, generation, seconds, error] {
      if (generation != generation_) return;
      last_optimisation_ = seconds;
      longest_optimisation_ = std::max(longest_optimisation_, seconds);
      ++optimisations_;
      changed_ = true;
      if (error.empty()) return graph_.finish(std::move(*task));
      graph_.abandon(std::move(*task));
      NODELET_ERROR_STREAM_THROTTLE(5.0, "The graph isn't optimised: " << error);
    };
  });
}

bool PoseGraphNodelet::tryToMatch(const Waiting& waiting, std::string& why) {
  const Measurement m = toMeasurement(waiting.edge, waiting.topic);
  const auto from = graph_.attach(m.from_stamp), to = graph_.attach(m.to_stamp);
  if (!from || !to) {
    why = "an edge by appearance of stamps that aren't known";
    return false;
  }
  if (from->node == to->node) {
    arrivals_->drops().add(kOnePose, "an edge by appearance");
    return true;
  }
  if (!parameters_.match_appearances) {
    arrivals_->drops().add(kNotMatched, "match_appearances is false");
    return true;
  }
  if (!sensors_.has(DataKind::kScan, to->node) || !sensors_.has(DataKind::kScan, from->node)) {
    why = "there is no scan for an edge by appearance";
    return false;
  }
  const auto node = [&](std::size_t i) { return graph_.graph().nodes()[i]; };
  const SessionEdge appearance = keeper_->putAppearance(node(from->node).id, node(to->node).id, m.type,
                                                        m.source, waiting.edge.similarity);
  const bool forward = from->node < to->node;
  const Node first = node(forward ? from->node : to->node), second = node(forward ? to->node : from->node);
  const auto drift = graph_.drift(std::min(from->node, to->node), std::max(from->node, to->node));
  auto graph = std::make_shared<Graph>(graph_.graph().planar());
  for (const Node& n : graph_.graph().nodes()) graph->addNode(n);
  const auto front_end = parametersOf<slam::SlamParameters>(getNodeHandle(), parameters_.slam);
  optimiser_->post([this, first, second, drift, graph, front_end, m, appearance, keeper = keeper_,
                    generation = generation_]() -> Worker::Work {
    ScanMatch match;
    try {
      keeper->writer().flush();
      match = matchScans(Session(keeper->path()), *graph, first.id, second.id, drift, front_end.slam,
                         front_end.loop, parameters_.appearance);
    } catch (const std::exception& e) {
      match.why = e.what();
    }
    return [this, first, second, m, match, appearance, generation] {
      if (generation != generation_) return;
      keeper_->settle(appearance, match.sure ? EdgeState::kAccepted : EdgeState::kRevoked);
      if (!match.sure) return arrivals_->drops().add(kNotMatched, match.why);
      ++matched_;
      Measurement measured = m;
      measured.from_stamp = first.stamp;
      measured.to_stamp = second.stamp;
      measured.transform = match.transform;
      measured.information = match.information;
      add(measured);
    };
  });
  return true;
}

// -------------------------------------------------------------------------------------------------- output

void PoseGraphNodelet::sayEvents() {
  using Kind = GraphEvent::Kind;
  for (const GraphEvent& event : graph_.takeEvents()) {
    changed_ = true;
    const Event message = toMessage(event, parameters_.map_frame);
    events_.publish(message);
    const bool is_loop =
        event.kind == Kind::kAccepted || event.kind == Kind::kRefused || event.kind == Kind::kRevoked;
    if (is_loop) last_loop_ = message.text;
    if (event.kind == Kind::kExpired && event.measurement->type == EdgeType::kPlace)
      keeper_->putForeign(*event.measurement);
    if (event.kind == Kind::kExpired) arrivals_->drops().add(kExpired, message.text);
    if (event.kind == Kind::kCrowded) arrivals_->drops().add(kCrowded, message.text);
    if (event.kind == Kind::kRevoked || event.kind == Kind::kNewPart)
      NODELET_WARN_STREAM(message.text);
    else if (is_loop)
      NODELET_INFO_STREAM(message.text);
  }
}

void PoseGraphNodelet::publish() {
  published_ = ros::WallTime::now();
  changed_ = false;
  std_msgs::Header header;
  header.frame_id = parameters_.map_frame;
  for (const Node& node : graph_.graph().nodes()) header.stamp = std::max(header.stamp, toTime(node.stamp));
  const bool all = parameters_.key_poses == KeyPoses::kEdges;
  path_.publish(toPath(all ? graph_.graph() : largestPart(graph_.graph()), header));
  markers_.publish(toMarkers(graph_, header));
}

void PoseGraphNodelet::publishTransform() {
  if (parameters_.key_poses == KeyPoses::kClouds) return publishScanner();
  if (graph_.frontEnd().empty() || graph_.graph().nodes().empty()) return;
  const std::int64_t stamp = graph_.frontEnd().last();
  const ros::Time time = toTime(stamp);
  const tf2_ros::Buffer& buffer = arrivals_->queue().buffer();
  if (time <= last_transform_ || !buffer.canTransform(parameters_.odom_frame, parameters_.base_frame, time))
    return;
  const Pose odometry = toPose(
      tf2::transformToEigen(buffer.lookupTransform(parameters_.odom_frame, parameters_.base_frame, time)));
  send(graph_.correction() * *graph_.frontEnd().at(stamp) * odometry.inverse(), parameters_.odom_frame, time);
}

// At the last scan of known place.
void PoseGraphNodelet::publishScanner() {
  if (graph_.graph().nodes().empty()) return;
  const Node last = largestPart(graph_.graph()).nodes().back();
  const ros::Time time = toTime(last.stamp);
  if (time > last_transform_) send(last.pose, parameters_.base_frame, time);
}

void PoseGraphNodelet::send(const Pose& pose, const std::string& frame, const ros::Time& stamp) {
  geometry_msgs::TransformStamped message =
      tf2::eigenToTransform(Eigen::Isometry3d(Eigen::Translation3d(pose.translation) * pose.rotation));
  message.header.stamp = last_transform_ = stamp;
  message.header.frame_id = parameters_.map_frame;
  message.child_frame_id = frame;
  broadcaster_.sendTransform(message);
}

// What came before it was called is in it: a whole tick passes first.
std::string PoseGraphNodelet::save(const std::string& path) const {
  const unsigned before = ticks_;
  for (int i = 0; i < kMostTicks && ticks_ - before < 2; ++i)
    std::this_thread::sleep_for(std::chrono::duration<double>(0.5 * kTick));
  const auto keeper = std::atomic_load(&keeper_);
  keeper->writer().flush();
  mergeSessions({keeper->path()}, path);
  return "Wrote the session to " + path;
}

void PoseGraphNodelet::offerServices() {
  ros::NodeHandle& node = getPrivateNodeHandle();
  serve<Trigger>(node, "optimise", [this](auto&, auto& response) {
    optimise_all_ = true;
    response.success = true;
    response.message = "All of " + std::to_string(graph_.graph().nodes().size()) +
                       " poses is optimised in the background; graph_events tells what that changes";
  });
  serve<AddEdge>(node, "add_edge", [this](AddEdge::Request& request, AddEdge::Response& response) {
    try {
      Measurement m = toMeasurement(request.edge, kByHand);
      if (!request.edge.has_transform) throw std::invalid_argument("it has no transform");
      m.trusted = true;
      if (m.type == EdgeType::kConsecutive)
        m.type = EdgeType::kLoopClosure;  // the front end's make the chain
      const auto added = graph_.add(m);
      response.success = added == OnlineGraph::Added::kNow || added == OnlineGraph::Added::kWaits;
      response.message = added == OnlineGraph::Added::kNow       ? "added"
                         : added == OnlineGraph::Added::kWaits   ? "waits for poses of its stamps"
                         : added == OnlineGraph::Added::kDoubled ? "there is one by hand already"
                                                                 : "both stamps are of one key pose";
    } catch (const std::invalid_argument& e) {
      response.message = e.what();
    }
    changed_ = true;
  });
  serve<DeleteEdge>(node, "delete_edge",
                    [this](DeleteEdge::Request& request, DeleteEdge::Response& response) {
                      const std::size_t count =
                          graph_.erase(toNanoseconds(request.from_stamp), toNanoseconds(request.to_stamp));
                      response.success = count > 0;
                      response.message =
                          count > 0 ? "deleted " + std::to_string(count) : "there is no edge of these stamps";
                      changed_ = true;
                    });
  ros::NodeHandle saving(node);
  saving.setCallbackQueue(&saving_);
  serve<mapping_msgs::SaveMap>(saving, "save", [this](auto& request, auto& response) {
    mapping_common::answer(request.path, response, [&] { return save(request.path); });
  });
  saver_.start();
  serveFile<mapping_msgs::LoadMap>("load", [this](const std::string& path) {
    if (!std::filesystem::exists(path)) throw std::runtime_error("there is no " + path);
    keeper_->update(graph_);
    keeper_->writer().flush();
    return open(path);
  });
  serveFile<mapping_msgs::SaveMap>("export", [this](const std::string& path) {
    const std::string ending = std::filesystem::path(path).extension();
    if (ending == ".g2o")
      writeG2o(path, graph_.graph());
    else if (ending == ".tum")
      writeTum(path, graph_.graph());
    else
      throw std::invalid_argument("path is '" + path + "', allowed is one that ends in .g2o or .tum");
    return "Wrote " + std::to_string(graph_.graph().nodes().size()) + " poses to " + path;
  });
}

// --------------------------------------------------------------------------------------------- diagnostics

void PoseGraphNodelet::report() {
  Nodelet::report();
  arrivals_->endReport();
  laser_faults_->endReport();
}

void PoseGraphNodelet::diagnoseInput(StatusWrapper& status) {
  using diagnostic_msgs::DiagnosticStatus;
  const std::size_t dropped = arrivals_->drops().recent();
  if (dropped > 0)
    status.summaryf(DiagnosticStatus::WARN, "%zu edges or messages not taken", dropped);
  else
    status.summary(DiagnosticStatus::OK, edges_received_ > 0 ? "Edges" : "No input");
  status.add("Edges received", edges_received_);
  status.add("Waiting for stamps", graph_.waiting());
  status.add("Waiting for transforms or scans", waiting_.size());
  status.add("Edges by appearance that got a transform", matched_);
  arrivals_->addTo(status, reportedTime());
  laser_faults_->addTo(status);
}

void PoseGraphNodelet::diagnoseGraph(StatusWrapper& status) {
  addTo(status, graph_);
  status.add("Last loop", last_loop_);
  status.add("Optimisations", optimisations_);
  status.add("Last optimisation (s)", last_optimisation_);
  status.add("Longest optimisation (s)", longest_optimisation_);
  status.add("Maps made anew", maps_->last());
}

void PoseGraphNodelet::diagnoseSession(StatusWrapper& status) {
  addTo(status, keeper_->writer().status());
  status.add("File", keeper_->path());
}

}  // namespace pose_graph

PLUGINLIB_EXPORT_CLASS(pose_graph::PoseGraphNodelet, nodelet::Nodelet)
