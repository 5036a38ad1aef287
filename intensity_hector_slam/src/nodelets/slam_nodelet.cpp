// SPDX-License-Identifier: BSD-3-Clause
//
// SLAM with the topics, parameters, frames and services of hector_mapping. Everything happens in the
// nodelet's single-threaded callback queue, so that nothing here needs a lock; what takes longer than a scan
// has threads that hand over what they found.
#include <geometry_msgs/PoseWithCovarianceStamped.h>
#include <intensity_hector_slam/ResetMapping.h>
#include <mapping_common/arrivals.h>
#include <mapping_common/corrected_maps.h>
#include <mapping_common/laser_faults.h>
#include <mapping_common/nodelet.h>
#include <mapping_msgs/LoadMap.h>
#include <mapping_msgs/SaveMap.h>
#include <nav_msgs/GetMap.h>
#include <std_msgs/String.h>
#include <std_srvs/SetBool.h>
#include <std_srvs/Trigger.h>
#include <tf2_eigen/tf2_eigen.h>

#include <algorithm>
#include <memory>
#include <optional>
#include <pluginlib/class_list_macros.hpp>
#include <sstream>
#include <stdexcept>
#include <string>
#include <vector>

#include "intensity_hector_slam/ros/loop_thread.h"
#include "intensity_hector_slam/ros/map_conversion.h"
#include "intensity_hector_slam/ros/parameters.h"
#include "intensity_hector_slam/ros/scan_conversion.h"
#include "intensity_hector_slam/ros/scan_counts.h"
#include "intensity_hector_slam/ros/slam_publisher.h"

namespace intensity_hector_slam {
namespace {

using mapping_common::Arrivals;
using mapping_common::CorrectedMaps;
using mapping_common::withoutSlash;

// Why a scan gives no pose, beside what Arrivals does.
constexpr const char *kEmpty = "empty", *kRejected = "rejected", *kPaused = "paused";

constexpr int kReportsWithoutScan = 5;

}  // namespace

class SlamNodelet : public mapping_common::Nodelet {
 public:
  ~SlamNodelet() override;

 private:
  void start(mapping_common::Parameters& reader) override;
  void offerServices();
  void listen();

  void process(const sensor_msgs::LaserScan& message, const Arrivals::Transforms& transforms);
  void report(const sensor_msgs::LaserScan& message, double time);
  void reportOdometry(bool there);
  void timeJumpedBack(const ros::Time& to);
  void publishPose(const sensor_msgs::LaserScan& message, const Scan& scan);
  void publishLoops();
  void follow(const Edge& loop);
  void restart();

  CorrectedMaps::Prepare beginToCorrect(const CorrectedMaps::Map& corrected);
  std::string correct(MultiMap&& map, const MapCorrection& correction, double until);

  void initialPose(const geometry_msgs::PoseWithCovarianceStamped& message);
  void systemCommand(const std_msgs::String& message);
  static std::string describe(const Place& place);
  std::string load(const std::string& path);
  void reset(const Pose& pose);

  void reconfigure(const SlamParameters& changed);
  void report() override;
  void diagnoseScans(StatusWrapper& status);
  void diagnoseMap(StatusWrapper& status);
  void diagnoseLoops(StatusWrapper& status);

  SlamParameters parameters_;
  std::unique_ptr<Slam> slam_;
  std::unique_ptr<SlamPublisher> publisher_;
  std::unique_ptr<LoopThread> loops_;  // null where they aren't sought
  bool paused_ = false, asks_for_body_ = false, has_odometry_ = true;
  SlamResult last_;
  std::optional<Scan> last_scan_;  // that isn't empty
  ros::Time last_stamp_;

  std::unique_ptr<Arrivals> arrivals_;
  ros::Subscriber scan_subscriber_, pose_subscriber_, command_subscriber_;
  ros::WallTimer map_timer_;

  mapping_common::LaserScans laser_scans_;
  std::unique_ptr<mapping_common::LaserFaults> laser_faults_;
  ScanCounts counts_;
  int reports_without_scan_ = 0;

  std::unique_ptr<CorrectedMaps> corrected_maps_;
  std::size_t map_number_ = 0;  // of maps that were loaded, or begun anew
};

SlamNodelet::~SlamNodelet() {
  endCallbacks();
  if (parameters_.save_on_shutdown.empty() || !slam_ || slam_->map().updates() == 0) return;
  try {
    slam_->map().save(parameters_.save_on_shutdown);
    NODELET_INFO_STREAM("Wrote the map to " << parameters_.save_on_shutdown);
  } catch (const std::exception& e) {
    NODELET_ERROR_STREAM("The map is lost: " << e.what());
  }
}

void SlamNodelet::start(mapping_common::Parameters& reader) {
  ros::NodeHandle& node = getNodeHandle();
  reader.read(parameters_);
  parameters_.resolve();
  mapping_common::requireOwnEnding(parameters_.save_on_shutdown);
  for (const std::string& warning : parameters_.warnings()) NODELET_WARN_STREAM(warning);

  slam_ = std::make_unique<Slam>(parameters_.slam);
  slam_->setPose(parameters_.start);
  if (!parameters_.map_file.empty()) NODELET_INFO_STREAM(load(parameters_.map_file));
  if (parameters_.relocalize_at_start) slam_->setLost();
  publisher_ = std::make_unique<SlamPublisher>(node, parameters_);
  if (parameters_.loops && !parameters_.map_with_known_poses)
    loops_ = std::make_unique<LoopThread>(parameters_.loop, parameters_.slam);

  map_timer_ = every(parameters_.map_pub_period,
                     [this] { publisher_->maps().publish(last_stamp_, slam_->map().level(0)); });
  allowReconfiguration<SlamParameters>(parameters_,
                                       [this](const SlamParameters& changed) { reconfigure(changed); });
  offerServices();
  listen();
  startDiagnostics("none", {{"Scans", [this](StatusWrapper& status) { diagnoseScans(status); }},
                            {"Map", [this](StatusWrapper& status) { diagnoseMap(status); }},
                            {"Loops", [this](StatusWrapper& status) { diagnoseLoops(status); }}});
}

void SlamNodelet::offerServices() {
  ros::NodeHandle& node = getNodeHandle();
  serve<std_srvs::Trigger>(node, "reset_map", [this](auto&, auto& response) {
    reset(parameters_.start);
    response.success = true;
  });
  serve<ResetMapping>(node, "restart_mapping_with_new_pose", [this](auto& request, auto&) {
    reset(toPose(request.initial_pose));
    paused_ = false;
  });
  serve<std_srvs::SetBool>(node, "pause_mapping", [this](auto& request, auto& response) {
    paused_ = request.data;
    response.success = true;
    response.message = paused_ ? "paused" : "going on";
  });
  serve<std_srvs::Trigger>(getPrivateNodeHandle(), "relocalize", [this](auto&, auto& response) {
    const Place place = last_scan_ ? slam_->findPlace(*last_scan_) : Place();
    response.success = place.sure;
    response.message = last_scan_ ? describe(place) : "no scan came yet";
    if (!place.sure) return;
    slam_->setPose(place.pose);
    restart();
  });
  serveFile<mapping_msgs::SaveMap>("save_map", [this](const std::string& path) {
    mapping_common::requireOwnEnding(path);
    slam_->map().save(path);
    return "Wrote the map to " + path;
  });
  serveFile<mapping_msgs::LoadMap>("load_map", [this](const std::string& path) {
    const std::string text = load(path);
    restart();
    return text;
  });
  if (parameters_.advertise_map_service) {
    serve<nav_msgs::GetMap>(node, "dynamic_map", [this](auto&, auto& response) {
      response.map = toOccupancyGrid(slam_->map().level(0));
      response.map.header.frame_id = parameters_.map_frame;
      response.map.header.stamp = response.map.info.map_load_time = last_stamp_;
    });
  }
}

// --------------------------------------------------------------------------------------------------------
// input

void SlamNodelet::listen() {
  ros::NodeHandle& node = getNodeHandle();
  const SlamParameters& p = parameters_;
  Arrivals::Options options;
  options.drops.name = getName();
  options.drops.warning = "No pose from a scan";
  options.drops.key = "Without a pose";
  options.drops.reasons = {kEmpty, kRejected, kPaused};
  mapping_common::TransformQueue::Options& wanted = options.transforms;
  if (p.use_tf_scan_transformation) wanted.target_frame = p.base_frame;
  wanted.timeout = p.transform_timeout;
  wanted.needs_other = p.map_with_known_poses;
  wanted.other_source = p.base_frame;
  if (p.map_with_known_poses) {
    wanted.other_target = p.map_frame;
  } else if (p.usesOdometry() || (p.pub_map_odom_transform && p.odom_frame != p.base_frame)) {
    wanted.other_target = p.odom_frame;
  }
  laser_faults_ = std::make_unique<mapping_common::LaserFaults>(getName());
  asks_for_body_ = !wanted.other_target.empty();
  arrivals_ =
      std::make_unique<Arrivals>(node, guard(), options, [this](const ros::Time& to) { timeJumpedBack(to); });
  scan_subscriber_ = arrivals_->subscribe<sensor_msgs::LaserScan>(
      p.scan_topic, p.scan_subscriber_queue_size, "Scans",
      [this](const sensor_msgs::LaserScan& message, const Arrivals::Transforms& transforms) {
        process(message, transforms);
      });
  corrected_maps_ = std::make_unique<CorrectedMaps>(
      node, "corrected_map", guard(), getName(), p.map_frame,
      [this](const CorrectedMaps::Map& corrected) { return beginToCorrect(corrected); });
  pose_subscriber_ = node.subscribe("initialpose", 2, &SlamNodelet::initialPose, this);
  command_subscriber_ = node.subscribe(p.sys_msg_topic, 2, &SlamNodelet::systemCommand, this);
  NODELET_INFO_STREAM("Scans of " << scan_subscriber_.getTopic() << " tell where " << p.base_frame
                                  << " is in " << p.map_frame);
}

// The map stays. Odometry tells where the body is in it, without it is taken to be where it was at that time.
void SlamNodelet::timeJumpedBack(const ros::Time& to) {
  if (!parameters_.usesOdometry() || !arrivals_->queue().otherExists()) {
    if (const auto then = publisher_->keyPoseAt(to)) slam_->setPose(*then);
  }
  restart();
}

void SlamNodelet::process(const sensor_msgs::LaserScan& message, const Arrivals::Transforms& transforms) {
  if (paused_) return arrivals_->drops().add(kPaused, "");
  const ros::Time& stamp = last_stamp_ = message.header.stamp;
  publishLoops();
  const ros::WallTime start = ros::WallTime::now();
  mapping_common::LaserReading reading = laser_scans_.read(message);
  const Scan scan = toScan(message, reading, transforms.message, parameters_.scan);
  laser_faults_->add(reading);
  if (static_cast<int>(scan.points.size()) >= parameters_.slam.min_points) last_scan_ = scan;
  slam_->keepScans(corrected_maps_->isPublished()
                       ? static_cast<std::size_t>(parameters_.corrected_map_memory * (1 << 20))
                       : 0);
  std::optional<Pose> body;
  if (transforms.other) body = toPose(*transforms.other);
  if (parameters_.map_with_known_poses) {
    last_ = slam_->insert(scan, *body);
  } else {
    last_ = slam_->process(scan, parameters_.usesOdometry() ? body : std::nullopt);
  }
  if (last_.map_updated) publisher_->maps().changed(slam_->map().level(0).updated());
  const double time = (ros::WallTime::now() - start).toSec();
  publisher_->publishCloud(message, reading);
  if (!parameters_.map_with_known_poses) {
    if (last_.status != Status::kEmpty && last_.status != Status::kRejected) publishPose(message, scan);
    const bool is_body = parameters_.odom_frame == parameters_.base_frame;
    publisher_->publishTransforms(stamp, last_.pose, is_body ? Pose::Zero() : body,
                                  is_body || arrivals_->queue().otherExists());
    if (asks_for_body_) reportOdometry(body.has_value());
  }
  report(message, time);
}

void SlamNodelet::publishPose(const sensor_msgs::LaserScan& message, const Scan& scan) {
  const auto key = publisher_->publishPose(message.header.stamp, last_);
  if (key) publisher_->publishKeyScan(message);
  if (key && loops_) loops_->add(key->key, slam_->undistorted(scan), key->edge);
}

void SlamNodelet::report(const sensor_msgs::LaserScan& message, double time) {
  counts_.processed(last_, time);
  if (parameters_.output_timing) {
    NODELET_INFO_STREAM("Scan of " << message.header.stamp << ": " << toString(last_.status) << ", "
                                   << 1e3 * time << " ms");
  }
  if (last_.place && last_.place->sure) {
    restart();
    NODELET_WARN_STREAM("Lost, and found again: " << describe(*last_.place));
  } else if (last_.place) {
    NODELET_WARN_STREAM_THROTTLE(5.0, "Lost: " << describe(*last_.place));
  }
  if (last_.gap > 0.0) NODELET_WARN_STREAM("A pause of " << last_.gap << " s before this scan");
  if (last_.status == Status::kEmpty) {
    arrivals_->drops().add(kEmpty, "fewer than " + std::to_string(parameters_.slam.min_points) + " of its " +
                                       std::to_string(message.ranges.size()) +
                                       " points are within the limits");
  } else if (last_.status == Status::kRejected) {
    arrivals_->drops().add(kRejected,
                           std::to_string(static_cast<int>(100.0 * last_.match.contradiction)) +
                               " % of its points are in free space, or it is too far from the first guess");
  }
}

void SlamNodelet::reportOdometry(bool there) {
  const bool exists = arrivals_->queue().otherExists();
  const std::string& why = arrivals_->queue().whyNoOther();
  counts_.odometry(there, exists);
  if (!there && exists) {
    NODELET_WARN_STREAM_THROTTLE(5.0, "No odometry for a scan: " << why);
  } else if (there != has_odometry_) {
    if (there) {
      NODELET_INFO_STREAM("Odometry comes from " << parameters_.odom_frame);
    } else {
      NODELET_WARN_STREAM("Mapping goes on without odometry, which is used once tf has it: "
                          << why << ". If there is none, set odom_frame to " << parameters_.base_frame);
    }
  }
  has_odometry_ = there;
  if (last_.odometry_jumped) {
    NODELET_WARN_STREAM_THROTTLE(5.0,
                                 "The map denies odometry, which jumped, slipped or counted a way back as "
                                 "one forward: it is not used for this scan");
  }
}

// -----------------------------------------------------------------------------------------------------
// corrected maps

CorrectedMaps::Prepare SlamNodelet::beginToCorrect(const CorrectedMaps::Map& corrected) {
  MapCorrection correction;
  correction.stamp = corrected.stamp;
  correction.correction = toPose(corrected.correction);
  if (parameters_.map_with_known_poses) correction.corrected_from = corrected.corrected_from;
  return [this, corrected, correction, number = map_number_, options = slam_->options().map,
          scans = slam_->scansAfter(corrected.stamp)]() -> CorrectedMaps::Take {
    MultiMap map = MultiMap::fromBytes(corrected.begin, corrected.end, "its data", options);
    map.requireLike(options);
    insertAll(scans, correction, map);
    const double until = scans.empty() ? corrected.stamp : scans.back().stamp;
    const auto shared = std::make_shared<MultiMap>(std::move(map));  // as std::function copies
    return [this, shared, correction, until, number] {
      if (number != map_number_) throw std::runtime_error("the map was reset or loaded meanwhile");
      return correct(std::move(*shared), correction, until);
    };
  };
}

std::string SlamNodelet::correct(MultiMap&& map, const MapCorrection& correction, double until) {
  const std::size_t scans = slam_->scansAfter(correction.stamp).size();
  if (!slam_->keepsScansAfter(correction.stamp)) {
    NODELET_WARN_STREAM("A corrected map lacks scans that came after "
                        << correction.stamp
                        << " s: those are kept only while somebody publishes it, in ~corrected_map_memory");
  }
  slam_->correct(std::move(map), correction, until);
  publisher_->correct(ros::Time(correction.stamp), correction.correction);
  std::ostringstream text;
  text << scans << " scans were added. The pose moved by " << correction.correction.transpose();
  return text.str();
}

// -----------------------------------------------------------------------------------------------------
// commands

void SlamNodelet::reset(const Pose& pose) {
  slam_->reset(pose);
  ++map_number_;
  restart();
}

void SlamNodelet::initialPose(const geometry_msgs::PoseWithCovarianceStamped& message) {
  try {
    const std::string frame = withoutSlash(message.header.frame_id);
    Eigen::Isometry3d to_map = Eigen::Isometry3d::Identity();
    if (!frame.empty() && frame != parameters_.map_frame) {
      to_map = tf2::transformToEigen(
          arrivals_->queue().buffer().lookupTransform(parameters_.map_frame, frame, ros::Time(0)));
    }
    slam_->setPose(toPose(Eigen::Isometry3d(to_map * toIsometry(toPose(message.pose.pose)))));
    restart();
    NODELET_INFO_STREAM("The pose is set to " << slam_->pose().transpose());
  } catch (const std::exception& e) {
    NODELET_ERROR_STREAM("initialpose is ignored: " << e.what());
  }
}

void SlamNodelet::systemCommand(const std_msgs::String& message) {
  if (message.data == "reset") reset(parameters_.start);
}

std::string SlamNodelet::describe(const Place& place) {
  std::ostringstream text;
  text << (place.sure ? "the pose is " : "no place is sure, ");
  if (place.sure) {
    text << place.pose.transpose() << ", which fits by " << place.score << ", any other by " << place.rival;
  } else {
    text << place.why;
  }
  return text.str();
}

std::string SlamNodelet::load(const std::string& path) {
  slam_->setMap(MultiMap::load(path, slam_->options().map), parameters_.start);
  ++map_number_;
  const GridMap& map = slam_->map().level(0);
  std::ostringstream text;
  text << "Read a map of " << map.width() << " x " << map.height() << " cells of " << map.resolution()
       << " m from " << path << ". The pose is " << slam_->pose().transpose() << ", initialpose sets another";
  return text.str();
}

// ------------------------------------------------------------------------------------------------------
// loops

void SlamNodelet::publishLoops() {
  if (!loops_) return;
  for (const Edge& loop : loops_->take()) {
    publisher_->publishEdge(loop);
    if (parameters_.follow_loops && !corrected_maps_->isPublished()) follow(loop);
  }
}

// Edges between key poses aren't of this motion: the last moves, too.
void SlamNodelet::follow(const Edge& loop) {
  const Pose correction = correctionOf(loop);
  if (!isJump(loop)) return;
  slam_->move(correction);
  publisher_->correct(last_stamp_, correction);
  NODELET_INFO_STREAM("A loop to the key pose of " << loop.from.stamp << " s moves the pose by "
                                                   << correction.transpose());
}

// The chain of key poses begins anew.
void SlamNodelet::restart() {
  publisher_->restart();
  if (loops_) loops_->restart();
}

void SlamNodelet::diagnoseLoops(StatusWrapper& status) {
  if (loops_) return loops_->addTo(status);
  status.summary(diagnostic_msgs::DiagnosticStatus::OK, "Not sought");
}

// --------------------------------------------------------------------------------------------- while it runs

void SlamNodelet::reconfigure(const SlamParameters& changed) {
  SlamOptions options = slam_->options();  // with the map's that was loaded
  mapping_common::copyDynamic(changed.slam, options);
  slam_->setOptions(options);
  map_timer_.setPeriod(ros::WallDuration(changed.map_pub_period));
}

void SlamNodelet::report() {
  publishLoops();
  Nodelet::report();
  if (arrivals_->received() == 0 && ++reports_without_scan_ == kReportsWithoutScan) {
    NODELET_WARN_STREAM(whyNoScan(scan_subscriber_.getTopic()));
  }
  arrivals_->endReport();
  laser_faults_->endReport();
  counts_.endReport();
}

void SlamNodelet::diagnoseScans(StatusWrapper& status) {
  counts_.addTo(status, reportedTime(), arrivals_->drops().recent(), arrivals_->queue().waiting(),
                slam_->options().localization ? "Localizing" : "Mapping");
  arrivals_->addTo(status, reportedTime());
  laser_faults_->addTo(status);
  if (paused_) status.summary(diagnostic_msgs::DiagnosticStatus::OK, "Paused");
}

void SlamNodelet::diagnoseMap(StatusWrapper& status) {
  const GridMap& map = slam_->map().level(0);
  status.summaryf(diagnostic_msgs::DiagnosticStatus::OK, "%d x %d cells", map.width(), map.height());
  status.add("Resolution (m)", map.resolution());
  status.add("Levels", slam_->map().levels());
  status.add("Memory (MB)", slam_->map().bytes() / 1e6);
  status.add("Updates", slam_->map().updates());
  corrected_maps_->addTo(status);
}

}  // namespace intensity_hector_slam

PLUGINLIB_EXPORT_CLASS(intensity_hector_slam::SlamNodelet, nodelet::Nodelet)
