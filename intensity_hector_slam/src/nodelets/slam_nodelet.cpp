// SPDX-License-Identifier: BSD-3-Clause
//
// SLAM with the topics, parameters, frames and services of hector_mapping. Everything happens in the
// nodelet's single-threaded callback queue, so that nothing here needs a lock.
#include <geometry_msgs/PoseWithCovarianceStamped.h>
#include <intensity_hector_slam/ResetMapping.h>
#include <intensity_hector_slam/SlamConfig.h>
#include <mapping_common/nodelet.h>
#include <mapping_common/transform_queue.h>
#include <mapping_msgs/LoadMap.h>
#include <mapping_msgs/SaveMap.h>
#include <nav_msgs/GetMap.h>
#include <std_msgs/String.h>
#include <std_srvs/SetBool.h>
#include <std_srvs/Trigger.h>
#include <tf2_eigen/tf2_eigen.h>
#include <tf2_ros/transform_listener.h>

#include <algorithm>
#include <memory>
#include <optional>
#include <pluginlib/class_list_macros.hpp>
#include <sstream>
#include <stdexcept>
#include <string>
#include <vector>

#include "intensity_hector_slam/ros/map_conversion.h"
#include "intensity_hector_slam/ros/parameters.h"
#include "intensity_hector_slam/ros/scan_conversion.h"
#include "intensity_hector_slam/ros/slam_publisher.h"

namespace intensity_hector_slam {
namespace {

// Why a scan gave no pose: the order of the names given to drops_.
enum Reason { kNoTransform, kMalformed, kEmptyScan, kRejectedScan, kTimeJump, kPaused };

// Stamps may be out of order by this much before time is said to have jumped back.
const ros::Duration kOutOfOrder(1.0);

// What happened since the last diagnostics.
struct Activity {
  std::size_t received = 0, processed = 0, unobservable = 0;
  double time = 0.0, longest = 0.0;  // s
};

}  // namespace

class SlamNodelet : public mapping_common::Nodelet {
 public:
  ~SlamNodelet() override;

 private:
  using ScanPointer = boost::shared_ptr<const sensor_msgs::LaserScan>;

  void start(mapping_common::Parameters& reader) override;
  SlamConfig startConfig(mapping_common::Parameters& reader) const;
  void offerServices();
  void listen();

  void arrived(const ScanPointer& message);
  void process(const sensor_msgs::LaserScan& message);
  void timeJumpedBack(const ros::Time& to);
  void drop(Reason reason, const std::string& why, std::size_t count = 1);

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
  bool paused_ = false;
  SlamResult last_;
  ros::Time last_stamp_;

  tf2_ros::Buffer tf_buffer_;
  ros::Subscriber scan_subscriber_, pose_subscriber_, command_subscriber_;
  std::unique_ptr<mapping_common::TransformQueue<sensor_msgs::LaserScan>> queue_;
  std::unique_ptr<tf2_ros::TransformListener> tf_listener_;  // gone before the queue that it feeds
  std::vector<ros::ServiceServer> services_;
  ros::WallTimer map_timer_;

  Activity activity_;
  mapping_common::DropCounts drops_{
      {"no transform", "malformed", "empty", "rejected", "time jump", "paused"}};
  std::size_t processed_ = 0;
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

  slam_ = std::make_unique<Slam>(parameters_.slam);
  slam_->setPose(parameters_.start);
  if (!parameters_.map_file.empty()) NODELET_INFO_STREAM(load(parameters_.map_file));
  publisher_ = std::make_unique<SlamPublisher>(node, parameters_);

  // Wall time: what a bag brought is shown while it is paused, too.
  map_timer_ = node.createWallTimer(
      ros::WallDuration(parameters_.map_pub_period),
      [this](const ros::WallTimerEvent&) { publisher_->publishMaps(last_stamp_, slam_->map()); });
  allowReconfiguration<SlamConfig>(startConfig(reader),
                                   [this](const SlamConfig& config, std::uint32_t) { reconfigure(config); });
  offerServices();
  listen();
  startDiagnostics("none", {{"Scans", [this](StatusWrapper& status) { diagnoseScans(status); }},
                            {"Map", [this](StatusWrapper& status) { diagnoseMap(status); }}});
}

SlamConfig SlamNodelet::startConfig(mapping_common::Parameters& reader) const {
  SlamConfig config;
  config.cost = reader.get<std::string>("cost", "combined");
  config.occupancy_weight = parameters_.slam.matcher.occupancy_weight;
  config.reflectivity_weight = parameters_.slam.matcher.reflectivity_weight;
  config.robust_kernel = reader.get<std::string>("robust_kernel", "cauchy");
  config.robust_scale = parameters_.slam.matcher.robust_scale;
  config.search = reader.get<std::string>("search", "when_unsure");
  config.localization = parameters_.slam.localization;
  config.map_update_distance_thresh = parameters_.slam.update_distance;
  config.map_update_angle_thresh = parameters_.slam.update_angle;
  config.max_contradiction = parameters_.slam.max_contradiction;
  config.map_pub_period = parameters_.map_pub_period;
  return config;
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
  const bool needs_odometry = parameters_.odom_frame != parameters_.base_frame &&
                              (parameters_.usesOdometry() || parameters_.pub_map_odom_transform);
  std::vector<std::string> frames;
  if (parameters_.use_tf_scan_transformation) frames.push_back(parameters_.base_frame);
  if (needs_odometry) frames.push_back(parameters_.odom_frame);
  tf_listener_ = std::make_unique<tf2_ros::TransformListener>(tf_buffer_, node, false);
  queue_ = std::make_unique<mapping_common::TransformQueue<sensor_msgs::LaserScan>>(
      tf_buffer_, frames, parameters_.scan_subscriber_queue_size, parameters_.transform_tolerance, node,
      [this](const sensor_msgs::LaserScan& message) { process(message); },
      [this](const sensor_msgs::LaserScan& message, const std::string& why) {
        drop(message.header.frame_id.empty() ? kMalformed : kNoTransform, why);
      });
  scan_subscriber_ =
      node.subscribe<sensor_msgs::LaserScan>(parameters_.scan_topic, parameters_.scan_subscriber_queue_size,
                                             [this](const ScanPointer& message) { arrived(message); });
  pose_subscriber_ = node.subscribe("initialpose", 2, &SlamNodelet::initialPose, this);
  command_subscriber_ = node.subscribe(parameters_.sys_msg_topic, 2, &SlamNodelet::systemCommand, this);
}

void SlamNodelet::arrived(const ScanPointer& message) {
  ++activity_.received;
  const ros::Time& stamp = message->header.stamp;
  if (stamp + kOutOfOrder < last_stamp_) timeJumpedBack(stamp);
  last_stamp_ = stamp;
  if (paused_) {
    drops_.add(kPaused);
  } else {
    queue_->add(message);
  }
}

// Transforms and waiting scans are of another time now; the map stays. Odometry tells where the body is in
// it, without it is taken to be where it was at that time.
void SlamNodelet::timeJumpedBack(const ros::Time& to) {
  NODELET_WARN_STREAM("Time jumped back by " << last_stamp_ - to
                                             << " s: transforms are forgotten, the map goes on");
  // With simulated time the listener has done so already, and may have heard of new ones since.
  if (!ros::Time::isSimTime()) tf_buffer_.clear();
  if (const std::size_t waiting = queue_->clear()) drop(kTimeJump, "it waited for a transform", waiting);
  if (!parameters_.usesOdometry()) {
    if (const auto then = publisher_->keyPoseAt(to)) slam_->setPose(*then);
  }
  publisher_->restart();
}

void SlamNodelet::process(const sensor_msgs::LaserScan& message) {
  const std_msgs::Header& header = message.header;
  try {
    const auto lookup = [&](const std::string& target, const std::string& source) {
      return tf2::transformToEigen(tf_buffer_.lookupTransform(target, source, header.stamp));
    };
    const std::string& base = parameters_.base_frame;
    const Eigen::Isometry3d sensor = parameters_.use_tf_scan_transformation ? lookup(base, header.frame_id)
                                                                            : Eigen::Isometry3d::Identity();
    std::optional<Pose> odometry;
    if (parameters_.odom_frame == base) {
      odometry = Pose::Zero();
    } else if (parameters_.usesOdometry() || parameters_.pub_map_odom_transform) {
      odometry = toPose(lookup(parameters_.odom_frame, base));
    }
    const Scan scan = toScan(message, sensor, parameters_.scan);
    const ros::WallTime start = ros::WallTime::now();
    last_ = slam_->process(scan, parameters_.usesOdometry() ? odometry : std::optional<Pose>());
    const double time = (ros::WallTime::now() - start).toSec();

    ++processed_;
    ++activity_.processed;
    activity_.time += time;
    activity_.longest = std::max(activity_.longest, time);
    activity_.unobservable += last_.status == Status::kUnobservable;
    if (last_.gap > 0.0) NODELET_WARN_STREAM("A pause of " << last_.gap << " s before this scan");
    if (last_.status == Status::kEmpty) {
      drop(kEmptyScan, std::to_string(scan.points.size()) + " points within the limits");
    } else if (last_.status == Status::kRejected) {
      drop(kRejectedScan, std::to_string(static_cast<int>(100.0 * last_.match.contradiction)) +
                              " % of its points are in free space, or it is too far from the first guess");
    } else {
      publisher_->publishPose(header.stamp, last_);
    }
    publisher_->publishTransforms(header.stamp, last_.pose, odometry);
  } catch (const tf2::TransformException& e) {
    drop(kNoTransform, e.what());
  } catch (const std::invalid_argument& e) {
    drop(kMalformed, e.what());
  }
}

void SlamNodelet::drop(Reason reason, const std::string& why, std::size_t count) {
  drops_.add(reason, count);
  NODELET_WARN_STREAM_THROTTLE(
      5.0, "No pose from a scan (" << drops_.name(reason) << "): " << why << ". So far: " << drops_.text());
}

// -----------------------------------------------------------------------------------------------------
// commands

void SlamNodelet::reset(const Pose& pose) {
  slam_->reset(pose);
  publisher_->restart();
}

void SlamNodelet::initialPose(const geometry_msgs::PoseWithCovarianceStamped& message) {
  try {
    const std::string& frame = message.header.frame_id;
    Eigen::Isometry3d to_map = Eigen::Isometry3d::Identity();
    if (!frame.empty() && frame != parameters_.map_frame) {
      to_map = tf2::transformToEigen(tf_buffer_.lookupTransform(parameters_.map_frame, frame, ros::Time(0)));
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
  SlamOptions options = slam_->options();
  options.matcher.cost = parseCost(config.cost);
  options.matcher.occupancy_weight = config.occupancy_weight;
  options.matcher.reflectivity_weight = config.reflectivity_weight;
  options.matcher.robust_kernel = parseRobustKernel(config.robust_kernel);
  options.matcher.robust_scale = config.robust_scale;
  options.matcher.search = parseSearch(config.search);
  options.localization = config.localization;
  options.update_distance = config.map_update_distance_thresh;
  options.update_angle = config.map_update_angle_thresh;
  options.max_contradiction = config.max_contradiction;
  slam_->setOptions(options);
  map_timer_.setPeriod(ros::WallDuration(config.map_pub_period));
}

void SlamNodelet::report() {
  Nodelet::report();
  drops_.endReport();
  activity_ = {};
}

void SlamNodelet::diagnoseScans(StatusWrapper& status) {
  using diagnostic_msgs::DiagnosticStatus;
  const double seconds = reportedTime();
  if (paused_) {
    status.summary(DiagnosticStatus::OK, "Paused");
  } else if (drops_.recent() > 0) {
    status.summaryf(DiagnosticStatus::WARN, "%zu scans without a pose", drops_.recent());
  } else if (activity_.processed == 0 && queue_->waiting() > 0) {
    status.summaryf(DiagnosticStatus::WARN, "%zu scans wait for transforms", queue_->waiting());
  } else if (activity_.unobservable > 0) {
    status.summaryf(DiagnosticStatus::WARN, "%zu scans don't tell the whole pose", activity_.unobservable);
  } else {
    status.summary(DiagnosticStatus::OK, activity_.processed == 0        ? "No input"
                                         : slam_->options().localization ? "Localizing"
                                                                         : "Mapping");
  }
  status.addf("Scans (Hz)", "%.1f", static_cast<double>(activity_.received) / seconds);
  status.add("Processed", processed_);
  status.add("Waiting for transforms", queue_->waiting());
  drops_.addTo(status, "Without a pose");
  status.addf("Time, mean (ms)", "%.3f",
              activity_.processed > 0 ? 1e3 * activity_.time / activity_.processed : 0.0);
  status.addf("Time, longest (ms)", "%.3f", 1e3 * activity_.longest);
  status.add("Last scan", processed_ > 0 ? toString(last_.status) : "");
  status.add("Last cost", last_.match.iterations > 0 ? toString(last_.match.cost) : "");
  status.addf("Last contradiction", "%.3f", last_.match.contradiction);
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
