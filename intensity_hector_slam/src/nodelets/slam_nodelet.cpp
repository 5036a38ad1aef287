// SPDX-License-Identifier: BSD-3-Clause
//
// SLAM with the topics, parameters, frames and services of hector_mapping. Everything happens in the
// nodelet's single-threaded callback queue, so that nothing here needs a lock.
#include <diagnostic_updater/diagnostic_updater.h>
#include <dynamic_reconfigure/server.h>
#include <geometry_msgs/PoseStamped.h>
#include <geometry_msgs/PoseWithCovarianceStamped.h>
#include <intensity_hector_slam/ResetMapping.h>
#include <intensity_hector_slam/SlamConfig.h>
#include <mapping_msgs/LoadMap.h>
#include <mapping_msgs/SaveMap.h>
#include <nav_msgs/GetMap.h>
#include <nav_msgs/Odometry.h>
#include <nav_msgs/Path.h>
#include <nodelet/nodelet.h>
#include <std_msgs/String.h>
#include <std_srvs/SetBool.h>
#include <std_srvs/Trigger.h>
#include <tf2_eigen/tf2_eigen.h>
#include <tf2_ros/buffer.h>
#include <tf2_ros/message_filter.h>
#include <tf2_ros/transform_broadcaster.h>
#include <tf2_ros/transform_listener.h>

#include <algorithm>
#include <array>
#include <memory>
#include <optional>
#include <pluginlib/class_list_macros.hpp>
#include <sstream>
#include <stdexcept>
#include <string>
#include <vector>

#include "intensity_hector_slam/key_poses.h"
#include "intensity_hector_slam/ros/map_conversion.h"
#include "intensity_hector_slam/ros/parameters.h"
#include "intensity_hector_slam/ros/scan_conversion.h"

namespace intensity_hector_slam {
namespace {

// Why a scan gave no pose.
enum Reason { kNoTransform, kMalformed, kEmptyScan, kRejectedScan, kTimeJump, kPaused, kNumReasons };
constexpr std::array<const char*, kNumReasons> kReasons = {"no transform", "malformed", "empty",
                                                           "rejected",     "time jump", "paused"};

// Stamps may be out of order by this much before time is said to have jumped back.
const ros::Duration kOutOfOrder(1.0);

// What happened since the last diagnostics.
struct Activity {
  std::size_t received = 0, processed = 0, drops = 0, unobservable = 0;
  double time = 0.0, longest = 0.0;  // s
};

void requireAbsolute(const std::string& path) {
  if (path.empty() || path[0] != '/') {
    throw std::invalid_argument("path is '" + path + "', allowed is an absolute path");
  }
}

}  // namespace

class SlamNodelet : public nodelet::Nodelet {
 public:
  ~SlamNodelet() override;

 private:
  using ScanPointer = boost::shared_ptr<const sensor_msgs::LaserScan>;

  void onInit() override;
  void start();
  void advertise();
  void listen();

  void arrived(const ScanPointer& message);
  void process(const sensor_msgs::LaserScan& message);
  void timeJumpedBack(const ros::Time& to);
  void drop(Reason reason, const std::string& why, std::size_t count = 1);

  void publishPose(const ros::Time& stamp, const SlamResult& result);
  void publishTransforms(const ros::Time& stamp, const Pose& pose, const std::optional<Pose>& odometry);
  void publishKeyPose(const ros::Time& stamp, const SlamResult& result);
  void publishMaps();
  nav_msgs::OccupancyGrid stamped(nav_msgs::OccupancyGrid grid) const;

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
  void forgetPoses();

  void reconfigure(SlamConfig& config);
  void diagnose();
  void diagnoseScans(diagnostic_updater::DiagnosticStatusWrapper& status);
  void diagnoseMap(diagnostic_updater::DiagnosticStatusWrapper& status);

  SlamParameters parameters_;
  std::unique_ptr<Slam> slam_;
  std::unique_ptr<KeyPoses> key_poses_;
  nav_msgs::Path path_;  // of the key poses
  bool paused_ = false;
  SlamResult last_;
  ros::Time last_stamp_;
  std::optional<std::size_t> published_updates_;  // of the map, when it was last published

  tf2_ros::Buffer tf_buffer_;
  std::unique_ptr<tf2_ros::TransformBroadcaster> broadcaster_;
  ros::Subscriber scan_subscriber_, pose_subscriber_, command_subscriber_;
  std::unique_ptr<tf2_ros::MessageFilter<sensor_msgs::LaserScan>> filter_;
  std::unique_ptr<tf2_ros::TransformListener> tf_listener_;  // gone before the filter that it feeds
  std::size_t waiting_ = 0;

  ros::Publisher map_publisher_, metadata_publisher_, reflectivity_publisher_, pose_publisher_,
      update_publisher_, odometry_publisher_, path_publisher_, edge_publisher_;
  std::vector<ros::ServiceServer> services_;
  ros::WallTimer map_timer_, diagnostics_timer_;
  boost::recursive_mutex reconfigure_mutex_;
  std::unique_ptr<dynamic_reconfigure::Server<SlamConfig>> reconfigure_server_;
  SlamConfig config_;

  std::unique_ptr<diagnostic_updater::Updater> diagnostics_;
  ros::WallTime last_diagnostics_;
  Activity activity_;
  std::array<std::size_t, kNumReasons> dropped_{};
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

void SlamNodelet::onInit() {
  try {
    start();
  } catch (const std::exception& e) {
    NODELET_FATAL_STREAM("Not started: " << e.what());
    throw;  // the manager then reports that the nodelet could not be loaded
  }
}

void SlamNodelet::start() {
  ros::NodeHandle& node = getNodeHandle();
  ros::NodeHandle& private_node = getPrivateNodeHandle();
  XmlRpc::XmlRpcValue values;
  private_node.getParam(private_node.getNamespace(), values);
  mapping_common::Parameters reader(values);
  parameters_ = readSlamParameters(reader);
  reader.rejectUnknown({"reconfigure/"});

  slam_ = std::make_unique<Slam>(parameters_.slam);
  slam_->setPose(parameters_.start);
  key_poses_ = std::make_unique<KeyPoses>(parameters_.key_pose_distance, parameters_.key_pose_angle);
  path_.header.frame_id = parameters_.map_frame;
  if (!parameters_.map_file.empty()) NODELET_INFO_STREAM(load(parameters_.map_file));

  config_.cost = reader.get<std::string>("cost", "combined");
  config_.occupancy_weight = parameters_.slam.matcher.occupancy_weight;
  config_.reflectivity_weight = parameters_.slam.matcher.reflectivity_weight;
  config_.robust_kernel = reader.get<std::string>("robust_kernel", "cauchy");
  config_.robust_scale = parameters_.slam.matcher.robust_scale;
  config_.search = reader.get<std::string>("search", "when_unsure");
  config_.localization = parameters_.slam.localization;
  config_.map_update_distance_thresh = parameters_.slam.update_distance;
  config_.map_update_angle_thresh = parameters_.slam.update_angle;
  config_.max_contradiction = parameters_.slam.max_contradiction;
  config_.map_pub_period = parameters_.map_pub_period;

  advertise();
  // Wall time: what a bag brought is shown and reported while it is paused, too.
  map_timer_ = node.createWallTimer(ros::WallDuration(parameters_.map_pub_period),
                                    [this](const ros::WallTimerEvent&) { publishMaps(); });
  reconfigure_server_ = std::make_unique<dynamic_reconfigure::Server<SlamConfig>>(
      reconfigure_mutex_, ros::NodeHandle(private_node, "reconfigure"));
  reconfigure_server_->updateConfig(config_);
  reconfigure_server_->setCallback([this](SlamConfig& config, std::uint32_t) { reconfigure(config); });
  listen();

  diagnostics_ = std::make_unique<diagnostic_updater::Updater>(node, private_node, getName());
  diagnostics_->setHardwareID("none");
  diagnostics_->add("Scans", this, &SlamNodelet::diagnoseScans);
  diagnostics_->add("Map", this, &SlamNodelet::diagnoseMap);
  last_diagnostics_ = ros::WallTime::now();
  diagnostics_timer_ =
      node.createWallTimer(ros::WallDuration(1.0), [this](const ros::WallTimerEvent&) { diagnose(); });
}

void SlamNodelet::advertise() {
  ros::NodeHandle& node = getNodeHandle();
  ros::NodeHandle& private_node = getPrivateNodeHandle();
  map_publisher_ = node.advertise<nav_msgs::OccupancyGrid>("map", 1, true);
  metadata_publisher_ = node.advertise<nav_msgs::MapMetaData>("map_metadata", 1, true);
  reflectivity_publisher_ = node.advertise<nav_msgs::OccupancyGrid>("reflectivity_map", 1, true);
  pose_publisher_ = node.advertise<geometry_msgs::PoseStamped>("slam_out_pose", 10);
  update_publisher_ =
      node.advertise<geometry_msgs::PoseWithCovarianceStamped>(parameters_.pose_update_topic, 10);
  if (parameters_.pub_odometry)
    odometry_publisher_ = node.advertise<nav_msgs::Odometry>("scanmatch_odom", 50);
  path_publisher_ = node.advertise<nav_msgs::Path>("path", 1, true);
  edge_publisher_ = node.advertise<mapping_msgs::EdgeConstraint>("edges", 100);
  broadcaster_ = std::make_unique<tf2_ros::TransformBroadcaster>();
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
  // In the queue of the scans: tf2_ros::MessageFilter forgets a message whose transform comes from another
  // thread in the very moment in which it is added.
  tf_listener_ = std::make_unique<tf2_ros::TransformListener>(tf_buffer_, node, false);
  if (!frames.empty()) {
    filter_ = std::make_unique<tf2_ros::MessageFilter<sensor_msgs::LaserScan>>(
        tf_buffer_, "", parameters_.scan_subscriber_queue_size, node);
    filter_->setTargetFrames(frames);
    filter_->setTolerance(ros::Duration(parameters_.transform_tolerance));
    filter_->registerCallback([this](const ScanPointer& message) {
      --waiting_;
      process(*message);
    });
    filter_->registerFailureCallback([this](const ScanPointer& message, tf2_ros::FilterFailureReason) {
      --waiting_;
      if (message->header.frame_id.empty()) {
        drop(kMalformed, "it has no frame_id");
      } else {
        drop(kNoTransform, "from " + message->header.frame_id + " to " + parameters_.base_frame +
                               (parameters_.usesOdometry() ? " and " + parameters_.odom_frame : ""));
      }
    });
  }
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
    ++dropped_[kPaused];
  } else if (filter_) {
    ++waiting_;
    filter_->add(message);
  } else {
    process(*message);
  }
}

// Transforms and waiting scans are of another time now; the map stays. Odometry tells where the body is in
// it, without it is taken to be where it was at that time.
void SlamNodelet::timeJumpedBack(const ros::Time& to) {
  NODELET_WARN_STREAM("Time jumped back by " << last_stamp_ - to
                                             << " s: transforms are forgotten, the map goes on");
  // With simulated time the listener has done so already, and may have heard of new ones since.
  if (!ros::Time::isSimTime()) tf_buffer_.clear();
  if (filter_) filter_->clear();
  if (waiting_ > 0) drop(kTimeJump, "it waited for a transform", waiting_);
  waiting_ = 0;
  if (!parameters_.usesOdometry() && !path_.poses.empty()) {
    const auto then =
        std::lower_bound(path_.poses.begin(), path_.poses.end(), to,
                         [](const auto& pose, const ros::Time& time) { return pose.header.stamp < time; });
    slam_->setPose(toPose((then != path_.poses.end() ? *then : path_.poses.back()).pose));
  }
  forgetPoses();
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
      publishPose(header.stamp, last_);
      publishKeyPose(header.stamp, last_);
    }
    publishTransforms(header.stamp, last_.pose, odometry);
  } catch (const tf2::TransformException& e) {
    drop(kNoTransform, e.what());
  } catch (const std::invalid_argument& e) {
    drop(kMalformed, e.what());
  }
}

void SlamNodelet::drop(Reason reason, const std::string& why, std::size_t count) {
  dropped_[reason] += count;
  activity_.drops += count;
  std::ostringstream counts;
  for (int r = 0; r < kNumReasons; ++r) counts << (r > 0 ? ", " : "") << dropped_[r] << ' ' << kReasons[r];
  NODELET_WARN_STREAM_THROTTLE(
      5.0, "No pose from a scan (" << kReasons[reason] << "): " << why << ". So far: " << counts.str());
}

// --------------------------------------------------------------------------------------------------------
// output

void SlamNodelet::publishPose(const ros::Time& stamp, const SlamResult& result) {
  geometry_msgs::PoseWithCovarianceStamped update;
  update.header.stamp = stamp;
  update.header.frame_id = parameters_.map_frame;
  update.pose.pose = toMessage(result.pose);
  constexpr std::array<int, 3> kRows = {0, 1, 5};  // x, y, yaw
  for (int row = 0; row < 3; ++row) {
    for (int column = 0; column < 3; ++column) {
      update.pose.covariance[6 * kRows[row] + kRows[column]] = result.covariance(row, column);
    }
  }
  update_publisher_.publish(update);
  geometry_msgs::PoseStamped pose;
  pose.header = update.header;
  pose.pose = update.pose.pose;
  pose_publisher_.publish(pose);
  if (!parameters_.pub_odometry) return;
  nav_msgs::Odometry odometry;
  odometry.header = update.header;
  odometry.child_frame_id = parameters_.base_frame;
  odometry.pose = update.pose;
  odometry_publisher_.publish(odometry);
}

void SlamNodelet::publishTransforms(const ros::Time& stamp, const Pose& pose,
                                    const std::optional<Pose>& odometry) {
  const auto send = [&](const Pose& transform, const std::string& child) {
    geometry_msgs::TransformStamped message = tf2::eigenToTransform(toIsometry(transform));
    message.header.stamp = stamp;
    message.header.frame_id = parameters_.map_frame;
    message.child_frame_id = child;
    broadcaster_->sendTransform(message);
  };
  if (parameters_.pub_map_odom_transform && odometry) {
    send(compose(pose, between(*odometry, Pose::Zero())), parameters_.odom_frame);
  }
  if (parameters_.pub_map_scanmatch_transform) send(pose, parameters_.tf_map_scanmatch_transform_frame_name);
}

void SlamNodelet::publishKeyPose(const ros::Time& stamp, const SlamResult& result) {
  const auto edge = key_poses_->add(stamp.toSec(), result);
  if (!edge && !path_.poses.empty()) return;
  geometry_msgs::PoseStamped pose;
  pose.header.stamp = stamp;
  pose.header.frame_id = parameters_.map_frame;
  pose.pose = toMessage(result.pose);
  path_.header.stamp = stamp;
  path_.poses.push_back(pose);
  if (path_publisher_.getNumSubscribers() > 0) path_publisher_.publish(path_);
  if (edge) edge_publisher_.publish(toMessage(*edge, parameters_.map_frame, parameters_.base_frame));
}

nav_msgs::OccupancyGrid SlamNodelet::stamped(nav_msgs::OccupancyGrid grid) const {
  grid.header.stamp = last_stamp_;
  grid.header.frame_id = parameters_.map_frame;
  grid.info.map_load_time = last_stamp_;
  return grid;
}

// At the end of each period in which the map changed.
void SlamNodelet::publishMaps() {
  if (published_updates_ == slam_->map().updates()) return;
  published_updates_ = slam_->map().updates();
  const nav_msgs::OccupancyGrid map = stamped(toOccupancyGrid(slam_->map().level(0)));
  map_publisher_.publish(map);
  metadata_publisher_.publish(map.info);
  reflectivity_publisher_.publish(stamped(toReflectivityGrid(slam_->map().level(0))));
}

// -----------------------------------------------------------------------------------------------------
// commands

void SlamNodelet::forgetPoses() {
  key_poses_->breakChain();
  path_.poses.clear();
}

void SlamNodelet::reset(const Pose& pose) {
  slam_->reset(pose);
  forgetPoses();
  published_updates_.reset();
}

void SlamNodelet::initialPose(const geometry_msgs::PoseWithCovarianceStamped& message) {
  try {
    const std::string& frame = message.header.frame_id;
    Eigen::Isometry3d to_map = Eigen::Isometry3d::Identity();
    if (!frame.empty() && frame != parameters_.map_frame) {
      to_map = tf2::transformToEigen(tf_buffer_.lookupTransform(parameters_.map_frame, frame, ros::Time(0)));
    }
    slam_->setPose(toPose(Eigen::Isometry3d(to_map * toIsometry(toPose(message.pose.pose)))));
    forgetPoses();
    NODELET_INFO_STREAM("The pose is set to " << slam_->pose().transpose());
  } catch (const std::exception& e) {
    NODELET_ERROR_STREAM("initialpose is ignored: " << e.what());
  }
}

void SlamNodelet::systemCommand(const std_msgs::String& message) {
  if (message.data == "reset") reset(parameters_.start);
}

bool SlamNodelet::dynamicMap(nav_msgs::GetMap::Request&, nav_msgs::GetMap::Response& response) {
  response.map = stamped(toOccupancyGrid(slam_->map().level(0)));
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
  try {
    requireAbsolute(request.path);
    slam_->map().save(request.path);
    response.success = true;
    response.message = "Wrote the map to " + request.path;
  } catch (const std::exception& e) {
    response.message = e.what();
  }
  return true;
}

bool SlamNodelet::loadMap(mapping_msgs::LoadMap::Request& request,
                          mapping_msgs::LoadMap::Response& response) {
  try {
    requireAbsolute(request.path);
    response.message = load(request.path);
    response.success = true;
  } catch (const std::exception& e) {
    response.message = e.what();
  }
  return true;
}

std::string SlamNodelet::load(const std::string& path) {
  slam_->setMap(MultiMap::load(path, slam_->options().map), parameters_.start);
  forgetPoses();
  published_updates_.reset();
  const GridMap& map = slam_->map().level(0);
  std::ostringstream text;
  text << "Read a map of " << map.width() << " x " << map.height() << " cells of " << map.resolution()
       << " m from " << path << ". The pose is " << slam_->pose().transpose() << ", initialpose sets another";
  return text.str();
}

// --------------------------------------------------------------------------------------------- while it runs

void SlamNodelet::reconfigure(SlamConfig& config) {
  try {
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
    config_ = config;
  } catch (const std::invalid_argument& e) {
    NODELET_ERROR_STREAM("Reconfiguration rejected: " << e.what());
    config = config_;
  }
}

void SlamNodelet::diagnose() {
  diagnostics_->force_update();
  last_diagnostics_ = ros::WallTime::now();
  activity_ = {};
}

void SlamNodelet::diagnoseScans(diagnostic_updater::DiagnosticStatusWrapper& status) {
  using diagnostic_msgs::DiagnosticStatus;
  const double seconds = std::max(1e-3, (ros::WallTime::now() - last_diagnostics_).toSec());
  if (paused_) {
    status.summary(DiagnosticStatus::OK, "Paused");
  } else if (activity_.drops > 0) {
    status.summaryf(DiagnosticStatus::WARN, "%zu scans without a pose", activity_.drops);
  } else if (activity_.processed == 0 && waiting_ > 0) {
    status.summaryf(DiagnosticStatus::WARN, "%zu scans wait for transforms", waiting_);
  } else if (activity_.unobservable > 0) {
    status.summaryf(DiagnosticStatus::WARN, "%zu scans don't tell the whole pose", activity_.unobservable);
  } else {
    status.summary(DiagnosticStatus::OK, activity_.processed == 0 ? "No input"
                                         : config_.localization   ? "Localizing"
                                                                  : "Mapping");
  }
  status.addf("Scans (Hz)", "%.1f", static_cast<double>(activity_.received) / seconds);
  status.add("Processed", processed_);
  status.add("Waiting for transforms", waiting_);
  for (int r = 0; r < kNumReasons; ++r)
    status.add(std::string("Without a pose: ") + kReasons[r], dropped_[r]);
  status.addf("Time, mean (ms)", "%.3f",
              activity_.processed > 0 ? 1e3 * activity_.time / activity_.processed : 0.0);
  status.addf("Time, longest (ms)", "%.3f", 1e3 * activity_.longest);
  status.add("Last scan", processed_ > 0 ? toString(last_.status) : "");
  status.add("Last cost", last_.match.iterations > 0 ? toString(last_.match.cost) : "");
  status.addf("Last contradiction", "%.3f", last_.match.contradiction);
}

void SlamNodelet::diagnoseMap(diagnostic_updater::DiagnosticStatusWrapper& status) {
  const GridMap& map = slam_->map().level(0);
  status.summaryf(diagnostic_msgs::DiagnosticStatus::OK, "%d x %d cells", map.width(), map.height());
  status.add("Resolution (m)", map.resolution());
  status.add("Levels", slam_->map().levels());
  status.add("Updates", slam_->map().updates());
}

}  // namespace intensity_hector_slam

PLUGINLIB_EXPORT_CLASS(intensity_hector_slam::SlamNodelet, nodelet::Nodelet)
