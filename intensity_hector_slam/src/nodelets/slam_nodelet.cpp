// SPDX-License-Identifier: BSD-3-Clause
//
// SLAM with the topics, parameters, frames and services of hector_mapping. Everything happens in the
// nodelet's single-threaded callback queue, so that nothing here needs a lock.
#include <geometry_msgs/PoseWithCovarianceStamped.h>
#include <intensity_hector_slam/ResetMapping.h>
#include <mapping_common/nodelet.h>
#include <mapping_msgs/LoadMap.h>
#include <mapping_msgs/SaveMap.h>
#include <nav_msgs/GetMap.h>
#include <std_msgs/String.h>
#include <std_srvs/SetBool.h>
#include <std_srvs/Trigger.h>
#include <tf2_eigen/tf2_eigen.h>

#include <algorithm>
#include <cstdint>
#include <limits>
#include <memory>
#include <optional>
#include <pluginlib/class_list_macros.hpp>
#include <sstream>
#include <stdexcept>
#include <string>
#include <vector>

#include "intensity_hector_slam/ros/map_conversion.h"
#include "intensity_hector_slam/ros/parameters.h"
#include "intensity_hector_slam/ros/reconfiguration.h"
#include "intensity_hector_slam/ros/scan_conversion.h"
#include "intensity_hector_slam/ros/scan_counts.h"
#include "intensity_hector_slam/ros/scan_queue.h"
#include "intensity_hector_slam/ros/slam_publisher.h"

namespace intensity_hector_slam {
namespace {

// Stamps may be out of order by this much before time is said to have jumped back.
const ros::Duration kOutOfOrder(1.0);

// s, that ros::Duration reaches: beyond, differences of stamps throw.
constexpr std::uint32_t kLastSecond = std::numeric_limits<std::int32_t>::max() - 1;

constexpr int kReportsWithoutScan = 5;

}  // namespace

class SlamNodelet : public mapping_common::Nodelet {
 public:
  ~SlamNodelet() override;

 private:
  void start(mapping_common::Parameters& reader) override;
  void offerServices();
  void listen();

  void arrived(const ScanQueue::ScanPointer& message);
  void process(const sensor_msgs::LaserScan& message, const ScanQueue::Transforms& transforms);
  void report(const sensor_msgs::LaserScan& message, double time);
  void report(const ScanQueue::Transforms& transforms);
  void timeJumpedBack(const ros::Time& to);
  void drop(ScanCounts::Reason reason, const std::string& why, std::size_t count = 1);

  void initialPose(const geometry_msgs::PoseWithCovarianceStamped& message);
  void systemCommand(const std_msgs::String& message);
  bool dynamicMap(nav_msgs::GetMap::Request&, nav_msgs::GetMap::Response& response);
  bool resetMap(std_srvs::Trigger::Request&, std_srvs::Trigger::Response& response);
  bool restart(ResetMapping::Request& request, ResetMapping::Response&);
  bool pause(std_srvs::SetBool::Request& request, std_srvs::SetBool::Response& response);
  bool saveMap(mapping_msgs::SaveMap::Request& request, mapping_msgs::SaveMap::Response& response);
  bool loadMap(mapping_msgs::LoadMap::Request& request, mapping_msgs::LoadMap::Response& response);
  std::string load(const std::string& path);
  void reset(const Pose& pose);

  void reconfigure(const SlamConfig& config);
  void report() override;
  void diagnoseScans(StatusWrapper& status);
  void diagnoseMap(StatusWrapper& status);

  SlamParameters parameters_;
  std::unique_ptr<Slam> slam_;
  std::unique_ptr<SlamPublisher> publisher_;
  bool paused_ = false, asks_for_body_ = false, has_odometry_ = true;
  SlamResult last_;
  ros::Time last_stamp_;

  ros::Subscriber scan_subscriber_, pose_subscriber_, command_subscriber_;
  std::unique_ptr<ScanQueue> queue_;
  std::vector<ros::ServiceServer> services_;
  ros::WallTimer map_timer_;

  ScanCounts counts_;
  int reports_without_scan_ = 0;
};

SlamNodelet::~SlamNodelet() {
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
  parameters_ = readSlamParameters(reader);
  rejectUnknown(reader);
  for (const std::string& warning : parameters_.warnings) NODELET_WARN_STREAM(warning);

  slam_ = std::make_unique<Slam>(parameters_.slam);
  slam_->setPose(parameters_.start);
  if (!parameters_.map_file.empty()) NODELET_INFO_STREAM(load(parameters_.map_file));
  publisher_ = std::make_unique<SlamPublisher>(node, parameters_);

  // Wall time: what a bag brought is shown while it is paused, too.
  map_timer_ = node.createWallTimer(
      ros::WallDuration(parameters_.map_pub_period),
      [this](const ros::WallTimerEvent&) { publisher_->publishMaps(last_stamp_, slam_->map()); });
  allowReconfiguration<SlamConfig>(startConfig(reader, parameters_),
                                   [this](const SlamConfig& config, std::uint32_t) { reconfigure(config); });
  offerServices();
  listen();
  startDiagnostics("none", {{"Scans", [this](StatusWrapper& status) { diagnoseScans(status); }},
                            {"Map", [this](StatusWrapper& status) { diagnoseMap(status); }}});
}

void SlamNodelet::offerServices() {
  ros::NodeHandle& node = getNodeHandle();
  ros::NodeHandle& private_node = getPrivateNodeHandle();
  services_ = {node.advertiseService("reset_map", &SlamNodelet::resetMap, this),
               node.advertiseService("restart_mapping_with_new_pose", &SlamNodelet::restart, this),
               node.advertiseService("pause_mapping", &SlamNodelet::pause, this),
               private_node.advertiseService("save_map", &SlamNodelet::saveMap, this),
               private_node.advertiseService("load_map", &SlamNodelet::loadMap, this)};
  if (parameters_.advertise_map_service) {
    services_.push_back(node.advertiseService("dynamic_map", &SlamNodelet::dynamicMap, this));
  }
}

// --------------------------------------------------------------------------------------------------------
// input

void SlamNodelet::listen() {
  ros::NodeHandle& node = getNodeHandle();
  const SlamParameters& p = parameters_;
  ScanQueue::Options options;
  options.base_frame = p.base_frame;
  options.use_sensor_frame = p.use_tf_scan_transformation;
  options.timeout = p.transform_timeout;
  options.needs_body = p.map_with_known_poses;
  if (p.map_with_known_poses) {
    options.fixed_frame = p.map_frame;
  } else if (p.usesOdometry() || (p.pub_map_odom_transform && p.odom_frame != p.base_frame)) {
    options.fixed_frame = p.odom_frame;
  }
  asks_for_body_ = !options.fixed_frame.empty();
  queue_ = std::make_unique<ScanQueue>(
      node, options,
      [this](const sensor_msgs::LaserScan& message, const ScanQueue::Transforms& transforms) {
        process(message, transforms);
      },
      [this](const sensor_msgs::LaserScan& message, const std::string& why) {
        drop(message.header.frame_id.empty() ? ScanCounts::kMalformed : ScanCounts::kNoTransform, why);
      });
  scan_subscriber_ = node.subscribe<sensor_msgs::LaserScan>(
      p.scan_topic, p.scan_subscriber_queue_size,
      [this](const ScanQueue::ScanPointer& message) { arrived(message); });
  pose_subscriber_ = node.subscribe("initialpose", 2, &SlamNodelet::initialPose, this);
  command_subscriber_ = node.subscribe(p.sys_msg_topic, 2, &SlamNodelet::systemCommand, this);
  NODELET_INFO_STREAM("Scans of " << scan_subscriber_.getTopic() << " tell where " << p.base_frame
                                  << " is in " << p.map_frame);
}

void SlamNodelet::arrived(const ScanQueue::ScanPointer& message) {
  counts_.received();
  const ros::Time& stamp = message->header.stamp;
  if (stamp.sec > kLastSecond) {
    return drop(ScanCounts::kMalformed, "its stamp is " + std::to_string(stamp.sec) + " s, after 2038");
  }
  if (stamp + kOutOfOrder < last_stamp_) timeJumpedBack(stamp);
  last_stamp_ = stamp;
  queue_->add(message);
}

// Transforms and waiting scans are of another time now; the map stays. Odometry tells where the body is in
// it, without it is taken to be where it was at that time.
void SlamNodelet::timeJumpedBack(const ros::Time& to) {
  NODELET_WARN_STREAM("Time jumped back by " << last_stamp_ - to
                                             << " s: transforms are forgotten, the map goes on");
  if (const std::size_t waiting = queue_->restart())
    drop(ScanCounts::kTimeJump, "it waited for a transform", waiting);
  if (!parameters_.usesOdometry() || !queue_->bodyExists()) {
    if (const auto then = publisher_->keyPoseAt(to)) slam_->setPose(*then);
  }
  publisher_->restart();
}

void SlamNodelet::process(const sensor_msgs::LaserScan& message, const ScanQueue::Transforms& transforms) {
  if (paused_) return counts_.drop(ScanCounts::kPaused);
  const ros::Time& stamp = message.header.stamp;
  try {
    const ros::WallTime start = ros::WallTime::now();
    bool raw = false;
    const Scan scan = toScan(message, transforms.sensor_in_body, parameters_.scan, &raw);
    if (raw) {
      NODELET_WARN_STREAM_ONCE(
          "Raw intensities are left out: with reflectivity_scale they are to be about 0 "
          "(black) to 1 (white paper)");
    }
    if (parameters_.map_with_known_poses) {
      last_ = slam_->insert(scan, *transforms.body);
    } else {
      last_ = slam_->process(scan, parameters_.usesOdometry() ? transforms.body : std::nullopt);
    }
    const double time = (ros::WallTime::now() - start).toSec();
    publisher_->publishCloud(message);
    if (!parameters_.map_with_known_poses) {
      if (last_.status != Status::kEmpty && last_.status != Status::kRejected)
        publisher_->publishPose(stamp, last_);
      const bool is_body = parameters_.odom_frame == parameters_.base_frame;
      publisher_->publishTransforms(stamp, last_.pose, is_body ? Pose::Zero() : transforms.body,
                                    is_body || queue_->bodyExists());
      if (asks_for_body_) report(transforms);
    }
    report(message, time);
  } catch (const std::invalid_argument& e) {
    drop(ScanCounts::kMalformed, e.what());
  }
}

void SlamNodelet::report(const sensor_msgs::LaserScan& message, double time) {
  counts_.processed(last_, time);
  if (parameters_.output_timing) {
    NODELET_INFO_STREAM("Scan of " << message.header.stamp << ": " << toString(last_.status) << ", "
                                   << 1e3 * time << " ms");
  }
  if (last_.gap > 0.0) NODELET_WARN_STREAM("A pause of " << last_.gap << " s before this scan");
  if (last_.status == Status::kEmpty) {
    drop(ScanCounts::kEmpty, "fewer than " + std::to_string(parameters_.slam.min_points) + " of its " +
                                 std::to_string(message.ranges.size()) + " points are within the limits");
  } else if (last_.status == Status::kRejected) {
    drop(ScanCounts::kRejected,
         std::to_string(static_cast<int>(100.0 * last_.match.contradiction)) +
             " % of its points are in free space, or it is too far from the first guess");
  }
}

void SlamNodelet::report(const ScanQueue::Transforms& transforms) {
  const bool there = transforms.body.has_value();
  counts_.odometry(there, queue_->bodyExists());
  if (!there && queue_->bodyExists()) {
    NODELET_WARN_STREAM_THROTTLE(5.0, "No odometry for a scan: " << queue_->whyNoBody());
  } else if (there != has_odometry_) {
    if (there) {
      NODELET_INFO_STREAM("Odometry comes from " << parameters_.odom_frame);
    } else {
      NODELET_WARN_STREAM("Mapping goes on without odometry, which is used once tf has it: "
                          << queue_->whyNoBody() << ". If there is none, set odom_frame to "
                          << parameters_.base_frame);
    }
  }
  has_odometry_ = there;
  if (last_.odometry_jumped) {
    NODELET_WARN_STREAM_THROTTLE(5.0,
                                 "Odometry jumped, faster than max_speed or max_turn_rate: it is not "
                                 "used for this scan");
  }
}

void SlamNodelet::drop(ScanCounts::Reason reason, const std::string& why, std::size_t count) {
  counts_.drop(reason, count);
  NODELET_WARN_STREAM_THROTTLE(
      5.0, "No pose from a scan (" << counts_.name(reason) << "): " << why << ". So far: " << counts_.text());
}

// -----------------------------------------------------------------------------------------------------
// commands

void SlamNodelet::reset(const Pose& pose) {
  slam_->reset(pose);
  publisher_->restart();
}

void SlamNodelet::initialPose(const geometry_msgs::PoseWithCovarianceStamped& message) {
  try {
    const std::string frame = withoutSlash(message.header.frame_id);
    Eigen::Isometry3d to_map = Eigen::Isometry3d::Identity();
    if (!frame.empty() && frame != parameters_.map_frame) {
      to_map =
          tf2::transformToEigen(queue_->buffer().lookupTransform(parameters_.map_frame, frame, ros::Time(0)));
    }
    slam_->setPose(toPose(Eigen::Isometry3d(to_map * toIsometry(toPose(message.pose.pose)))));
    publisher_->restart();
    NODELET_INFO_STREAM("The pose is set to " << slam_->pose().transpose());
  } catch (const std::exception& e) {
    NODELET_ERROR_STREAM("initialpose is ignored: " << e.what());
  }
}

void SlamNodelet::systemCommand(const std_msgs::String& message) {
  if (message.data == "reset") reset(parameters_.start);
}

bool SlamNodelet::dynamicMap(nav_msgs::GetMap::Request&, nav_msgs::GetMap::Response& response) {
  response.map = publisher_->occupancyGrid(last_stamp_, slam_->map());
  return true;
}

bool SlamNodelet::resetMap(std_srvs::Trigger::Request&, std_srvs::Trigger::Response& response) {
  reset(parameters_.start);
  response.success = true;
  return true;
}

bool SlamNodelet::restart(ResetMapping::Request& request, ResetMapping::Response&) {
  try {
    reset(toPose(request.initial_pose));
    paused_ = false;
    return true;
  } catch (const std::invalid_argument& e) {
    NODELET_ERROR_STREAM("Mapping goes on as it was: " << e.what());
    return false;
  }
}

bool SlamNodelet::pause(std_srvs::SetBool::Request& request, std_srvs::SetBool::Response& response) {
  paused_ = request.data;
  response.success = true;
  response.message = paused_ ? "paused" : "going on";
  return true;
}

bool SlamNodelet::saveMap(mapping_msgs::SaveMap::Request& request,
                          mapping_msgs::SaveMap::Response& response) {
  mapping_common::answer(request.path, response, [&] {
    slam_->map().save(request.path);
    return "Wrote the map to " + request.path;
  });
  return true;
}

bool SlamNodelet::loadMap(mapping_msgs::LoadMap::Request& request,
                          mapping_msgs::LoadMap::Response& response) {
  mapping_common::answer(request.path, response, [&] {
    const std::string text = load(request.path);
    publisher_->restart();
    return text;
  });
  return true;
}

std::string SlamNodelet::load(const std::string& path) {
  slam_->setMap(MultiMap::load(path, slam_->options().map), parameters_.start);
  const GridMap& map = slam_->map().level(0);
  std::ostringstream text;
  text << "Read a map of " << map.width() << " x " << map.height() << " cells of " << map.resolution()
       << " m from " << path << ". The pose is " << slam_->pose().transpose() << ", initialpose sets another";
  return text.str();
}

// --------------------------------------------------------------------------------------------- while it runs

void SlamNodelet::reconfigure(const SlamConfig& config) {
  slam_->setOptions(reconfigured(slam_->options(), config));
  map_timer_.setPeriod(ros::WallDuration(config.map_pub_period));
}

void SlamNodelet::report() {
  Nodelet::report();
  if (counts_.allReceived() == 0 && ++reports_without_scan_ == kReportsWithoutScan) {
    NODELET_WARN_STREAM(whyNoScan(scan_subscriber_.getTopic()));
  }
  counts_.endReport();
}

void SlamNodelet::diagnoseScans(StatusWrapper& status) {
  counts_.addTo(status, reportedTime(), queue_->waiting(),
                slam_->options().localization ? "Localizing" : "Mapping");
  if (paused_) status.summary(diagnostic_msgs::DiagnosticStatus::OK, "Paused");
}

void SlamNodelet::diagnoseMap(StatusWrapper& status) {
  const GridMap& map = slam_->map().level(0);
  status.summaryf(diagnostic_msgs::DiagnosticStatus::OK, "%d x %d cells", map.width(), map.height());
  status.add("Resolution (m)", map.resolution());
  status.add("Levels", slam_->map().levels());
  status.add("Updates", slam_->map().updates());
}

}  // namespace intensity_hector_slam

PLUGINLIB_EXPORT_CLASS(intensity_hector_slam::SlamNodelet, nodelet::Nodelet)
