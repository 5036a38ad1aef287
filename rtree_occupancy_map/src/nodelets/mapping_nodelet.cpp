// SPDX-License-Identifier: BSD-3-Clause
//
// Builds an occupancy map from point clouds and laser scans. Everything happens in the nodelet's
// single-threaded callback queue but publishing, which has a thread of its own: those two share the map and
// the publisher, which know of that, and publications_.
#include <mapping_common/arrivals.h>
#include <mapping_common/corrected_maps.h>
#include <mapping_common/laser_faults.h>
#include <mapping_common/nodelet.h>
#include <mapping_msgs/LoadMap.h>
#include <mapping_msgs/SaveMap.h>
#include <ros/callback_queue.h>
#include <rtree_occupancy_map/BoundingBoxQuery.h>
#include <rtree_occupancy_map/CastRay.h>
#include <rtree_occupancy_map/CellsInBox.h>
#include <std_srvs/Empty.h>
#include <tf2_eigen/tf2_eigen.h>

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <functional>
#include <map>
#include <memory>
#include <mutex>
#include <pluginlib/class_list_macros.hpp>
#include <sstream>
#include <stdexcept>
#include <string>
#include <type_traits>
#include <utility>
#include <vector>

#include "rtree_occupancy_map/robot_body.h"
#include "rtree_occupancy_map/ros/cell_conversion.h"
#include "rtree_occupancy_map/ros/map_correction.h"
#include "rtree_occupancy_map/ros/map_formats.h"
#include "rtree_occupancy_map/ros/map_publisher.h"
#include "rtree_occupancy_map/ros/octomap_message.h"
#include "rtree_occupancy_map/ros/parameters.h"
#include "rtree_occupancy_map/ros/scan_conversion.h"

namespace rtree_occupancy_map {
namespace {

using mapping_common::CorrectedMaps;
using mapping_common::SweepTimes;

// Why a message is dropped, beside what mapping_common::Arrivals does.
constexpr const char* kEmpty = "empty";

// Clouds, which may be large, that wait for transforms where stamps don't go on.
constexpr std::size_t kMostWaiting = 100;

// What happened since the last diagnostics.
struct Activity {
  std::size_t insertions = 0;
  double insertion_time = 0.0, longest_insertion = 0.0;  // s
};
struct Publications {
  std::size_t count = 0;
  double time = 0.0;  // s
};

// A sweep's poses that tf is asked for: 3 ms apart at 10 Hz.
constexpr int kPoses = 33;

constexpr std::size_t kMostScanners = 64;  // whose readings are told apart, by their frames

template <class Message>
constexpr bool is_cloud = std::is_same_v<Message, sensor_msgs::PointCloud2>;

bool isEmpty(const sensor_msgs::PointCloud2& cloud) {
  return cloud.width == 0 || cloud.height == 0;
}
bool isEmpty(const sensor_msgs::LaserScan& scan) {
  return scan.ranges.empty();
}

void requireBox(const geometry_msgs::Point& min, const geometry_msgs::Point& max) {
  if ((toEigen(min).array() <= toEigen(max).array()).all()) return;
  std::ostringstream text;
  text << "min is " << toEigen(min).transpose() << ", max is " << toEigen(max).transpose()
       << ", allowed is min <= max along each axis";
  throw std::invalid_argument(text.str());
}

}  // namespace

class MappingNodelet : public mapping_common::Nodelet {
 public:
  ~MappingNodelet() override;

 private:
  void start(mapping_common::Parameters& reader) override;
  void listen();
  void offerServices();
  template <class Message>
  void insert(const Message& message, const mapping_common::Arrivals::Transforms& transforms);
  ConvertedScan convert(const sensor_msgs::PointCloud2& cloud,
                        const mapping_common::Arrivals::Transforms& transforms) const;
  ConvertedScan convert(const sensor_msgs::LaserScan& scan,
                        const mapping_common::Arrivals::Transforms& transforms);
  template <class Message>
  std::function<SweepTimes(const Message&)> sweepOf() const;
  SensorPath pathOf(const std::string& frame, const ros::Time& stamp, const SweepTimes& times) const;
  Eigen::Isometry3d latestPose(const std::string& frame, const ros::Time& stamp) const;
  void leaveOutBody(const ros::Time& stamp, Scan& scan);
  void filterGround(const ros::Time& stamp, Scan& scan);
  void warnOfFrame(const std::string& cloud_frame);

  void startWindow();
  void replace(OccupancyMap&& map);
  ScanLimits scanLimits() const;
  CorrectedMaps::Prepare beginToCorrect(const CorrectedMaps::Map& corrected);
  std::string correct(OccupancyMap&& map, const CorrectedMaps::Map& corrected, double until);
  std::string load(const std::string& path);
  void reconfigure(const MappingParameters& changed);
  void publish();
  void report() override;
  void diagnoseInput(StatusWrapper& status);
  void diagnoseMap(StatusWrapper& status);

  SharedMap map_;
  ros::CallbackQueue publishing_;
  std::unique_ptr<mapping_common::GuardedQueue> guarded_publishing_;
  std::unique_ptr<MapPublisher> publisher_;
  MappingParameters parameters_;
  std::string save_on_shutdown_;  // empty until the nodelet has started

  std::unique_ptr<mapping_common::Arrivals> arrivals_;
  std::vector<BodyBox> robot_body_;
  std::vector<ros::Subscriber> inputs_;
  std::map<std::string, mapping_common::LaserScans> laser_scans_;  // by their frame
  std::unique_ptr<mapping_common::LaserFaults> laser_faults_;
  std::unique_ptr<CorrectedMaps> corrected_maps_;
  RecentScans recent_scans_;
  std::size_t map_number_ = 0;  // of maps that were loaded, or begun anew
  bool colored_ = false;        // whether the map has colours

  ros::WallTimer publish_timer_, flush_timer_;
  std::mutex publications_mutex_;
  Publications publications_;
  ros::AsyncSpinner publishing_thread_{1, &publishing_};

  mapping_common::Throttle frame_throttle_{60.0}, far_throttle_{60.0}, body_throttle_{60.0},
      ground_throttle_{60.0}, window_throttle_{10.0};
  Activity activity_;
  InsertReport points_;  // sums over all scans
  std::size_t inserted_ = 0, points_outside_z_ = 0, points_of_body_ = 0, points_of_ground_ = 0;
};

MappingNodelet::~MappingNodelet() {
  endCallbacks();
  publishing_thread_.stop();
  try {
    map_([this](OccupancyMap& map) {
      if (!save_on_shutdown_.empty() && map.size() > 0)
        NODELET_INFO_STREAM(writeMap(map, save_on_shutdown_, parameters_.display));
      map.flush();
    });
  } catch (const std::exception& e) {
    NODELET_ERROR_STREAM("The map is lost: " << e.what());
  }
}

void MappingNodelet::start(mapping_common::Parameters& reader) {
  reader.read(parameters_);
  formatOf(parameters_.save_on_shutdown);
  robot_body_ = parseRobotBody(parameters_.robot_body);
  map_([this](OccupancyMap& map) { map = OccupancyMap(parameters_.map); });
  colored_ = parameters_.map.color;
  startWindow();
  if (!parameters_.map_file.empty()) NODELET_INFO_STREAM(load(parameters_.map_file));
  guarded_publishing_ = std::make_unique<mapping_common::GuardedQueue>(publishing_, guard());
  ros::NodeHandle publishing_node(getNodeHandle());
  publishing_node.setCallbackQueue(guarded_publishing_.get());
  publisher_ = std::make_unique<MapPublisher>(publishing_node, parameters_.display, map_);
  publish_timer_ = publishing_node.createWallTimer(
      ros::WallDuration(1.0 / parameters_.publish_rate),
      [this](const ros::WallTimerEvent&) { guard()->run([this] { publish(); }); });
  if (parameters_.window_flush_period > 0.0) {
    flush_timer_ =
        every(parameters_.window_flush_period, [this] { map_([](OccupancyMap& map) { map.flush(); }); });
  }
  allowReconfiguration<MappingParameters>(parameters_,
                                          [this](const MappingParameters& changed) { reconfigure(changed); });
  listen();
  offerServices();
  startDiagnostics("none", {{"Input", [this](StatusWrapper& status) { diagnoseInput(status); }},
                            {"Map", [this](StatusWrapper& status) { diagnoseMap(status); }}});
  save_on_shutdown_ = parameters_.save_on_shutdown;
  publishing_thread_.start();
}

// --------------------------------------------------------------------------------------------------------
// input

void MappingNodelet::listen() {
  const std::string& frame_id = parameters_.display.frame_id;
  using mapping_common::Arrivals;
  Arrivals::Options options;
  options.drops.name = getName();
  options.drops.reasons = {kEmpty};
  options.transforms.target_frame = frame_id;
  if (!parameters_.sensor_frame_id.empty()) {
    options.transforms.other_target = frame_id;
    options.transforms.other_source = parameters_.sensor_frame_id;
    options.transforms.needs_other = true;
  }
  options.transforms.timeout = parameters_.transform_timeout;
  options.transforms.tolerance = parameters_.transform_tolerance;
  options.transforms.most = kMostWaiting;
  arrivals_ = std::make_unique<Arrivals>(getNodeHandle(), guard(), options, [](const ros::Time&) {});
  const std::vector<std::string> topics = mapping_common::listOf(parameters_.cloud_topics);
  if (topics.empty()) throw std::invalid_argument("~cloud_topics names no topic");
  for (const std::string& topic : topics) {
    inputs_.push_back(arrivals_->subscribe<sensor_msgs::PointCloud2>(
        topic, parameters_.queue_size, topics.size() == 1 ? "Clouds" : "Clouds of " + topic,
        [this](const sensor_msgs::PointCloud2& cloud, const Arrivals::Transforms& transforms) {
          if (parameters_.sensor_frame_id.empty()) warnOfFrame(cloud.header.frame_id);
          insert(cloud, transforms);
        },
        true, sweepOf<sensor_msgs::PointCloud2>()));
  }
  laser_faults_ = std::make_unique<mapping_common::LaserFaults>(getName());
  corrected_maps_ = std::make_unique<CorrectedMaps>(
      getNodeHandle(), "corrected_cloud_map", guard(), getName(), frame_id,
      [this](const CorrectedMaps::Map& corrected) { return beginToCorrect(corrected); });
  inputs_.push_back(arrivals_->subscribe<sensor_msgs::LaserScan>(
      "scan", parameters_.queue_size, "Scans",
      [this](const sensor_msgs::LaserScan& scan, const Arrivals::Transforms& transforms) {
        insert(scan, transforms);
      },
      false,  // beams start in the scan's own frame
      sweepOf<sensor_msgs::LaserScan>()));
}

// What a message waits for transforms for.
template <class Message>
std::function<SweepTimes(const Message&)> MappingNodelet::sweepOf() const {
  if (!parameters_.undistort) return nullptr;
  return [](const Message& message) { return isEmpty(message) ? SweepTimes() : sweepTimesOf(message); };
}

// A frame whose transform at the stamp hasn't come yet, as of an arm, is where it was last.
Eigen::Isometry3d MappingNodelet::latestPose(const std::string& frame, const ros::Time& stamp) const {
  const tf2_ros::Buffer& buffer = arrivals_->queue().buffer();
  const std::string source = mapping_common::withoutSlash(frame),
                    map_frame = mapping_common::withoutSlash(parameters_.display.frame_id);
  const bool known = buffer.canTransform(map_frame, source, stamp);
  return tf2::transformToEigen(buffer.lookupTransform(map_frame, source, known ? stamp : ros::Time(0)));
}

void MappingNodelet::leaveOutBody(const ros::Time& stamp, Scan& scan) {
  for (const BodyBox& part : robot_body_) {
    try {
      points_of_body_ += removeHitsIn(part.box, latestPose(part.frame, stamp), scan);
    } catch (const tf2::TransformException& e) {
      if (body_throttle_())
        NODELET_WARN_STREAM("~robot_body: returns of " << part.frame << " aren't left out: " << e.what());
    }
  }
}

void MappingNodelet::filterGround(const ros::Time& stamp, Scan& scan) {
  try {
    points_of_ground_ +=
        clearGround(parameters_.ground_filter, latestPose(parameters_.base_frame_id, stamp), scan);
  } catch (const tf2::TransformException& e) {
    if (ground_throttle_()) NODELET_WARN_STREAM("~filter_ground: the ground isn't left out: " << e.what());
  }
}

// As LOAM and others publish them once they are registered.
void MappingNodelet::warnOfFrame(const std::string& cloud_frame) {
  const std::string& frame_id = parameters_.display.frame_id;
  if (mapping_common::withoutSlash(cloud_frame) != mapping_common::withoutSlash(frame_id)) return;
  if (!frame_throttle_()) return;
  NODELET_WARN_STREAM("Clouds come in the map's own frame, "
                      << frame_id
                      << ": their beams are taken to start at its origin. If the sensor isn't there, set "
                         "~sensor_frame_id to the frame that it is at the origin of");
}

SensorPath MappingNodelet::pathOf(const std::string& frame, const ros::Time& stamp,
                                  const SweepTimes& times) const {
  const std::string map_frame = mapping_common::withoutSlash(parameters_.display.frame_id);
  const ros::Time first = stamp + ros::Duration(times.first), last = stamp + ros::Duration(times.last);
  SensorPath path;
  if (mapping_common::withoutSlash(frame) == map_frame) {
    path.add(0.0, Eigen::Isometry3d::Identity());
    return path;
  }
  for (int i = 0; i < kPoses; ++i) {
    const ros::Time time = first + (last - first) * (i / (kPoses - 1.0));
    path.add((time - stamp).toSec(), tf2::transformToEigen(arrivals_->queue().buffer().lookupTransform(
                                         map_frame, mapping_common::withoutSlash(frame), time)));
    if (first == last) break;
  }
  return path;
}

ConvertedScan MappingNodelet::convert(const sensor_msgs::PointCloud2& cloud,
                                      const mapping_common::Arrivals::Transforms& transforms) const {
  if (!parameters_.undistort) {
    ConvertedScan converted = toScan(cloud, transforms.message, scanLimits());
    if (transforms.other) converted.scan.origin = transforms.other->translation().cast<float>();
    return converted;
  }
  const SweepTimes times = sweepTimesOf(cloud);
  const SensorPath path = pathOf(cloud.header.frame_id, cloud.header.stamp, times);
  const SensorPath origin =
      transforms.other ? pathOf(parameters_.sensor_frame_id, cloud.header.stamp, times) : path;
  return toScan(cloud, path, origin, scanLimits());
}

ScanLimits MappingNodelet::scanLimits() const {
  ScanLimits limits = parameters_.scan;
  limits.color = colored_;
  return limits;
}

ConvertedScan MappingNodelet::convert(const sensor_msgs::LaserScan& scan,
                                      const mapping_common::Arrivals::Transforms& transforms) {
  if (laser_scans_.size() > kMostScanners) laser_scans_.clear();
  const mapping_common::LaserReading reading = laser_scans_[scan.header.frame_id].read(scan);
  laser_faults_->add(reading);
  if (!parameters_.undistort) return toScan(scan, reading, transforms.message, parameters_.scan);
  const SensorPath path = pathOf(scan.header.frame_id, scan.header.stamp, sweepTimesOf(scan));
  return toScan(scan, reading, path, parameters_.scan);
}

template <class Message>
void MappingNodelet::insert(const Message& message, const mapping_common::Arrivals::Transforms& transforms) {
  if (isEmpty(message)) return arrivals_->drops().add(kEmpty, "nothing was measured in it");
  ConvertedScan converted = convert(message, transforms);
  Scan& scan = converted.scan;
  scan.time = message.header.stamp.toSec();
  if (is_cloud<Message> && colored_ && scan.colors.empty() && !scan.hits.empty()) {
    NODELET_WARN_STREAM_ONCE("~color is true, but clouds of " << message.header.frame_id
                                                              << " have no field rgb or rgba: what they "
                                                                 "occupy gets no colour");
  }
  leaveOutBody(message.header.stamp, scan);
  if (is_cloud<Message> && parameters_.filter_ground) filterGround(message.header.stamp, scan);
  double time = 0.0;
  const InsertReport report = map_([&](OccupancyMap& map) {
    const ros::WallTime start = ros::WallTime::now();
    InsertReport result = map.insertScan(scan);
    time = (ros::WallTime::now() - start).toSec();
    return result;
  });
  publisher_->changed(report.changed_blocks, message.header.stamp);
  if (!report.window_error.empty() && window_throttle_())
    NODELET_ERROR_STREAM("~window/file can't be written, and all stays in memory: " << report.window_error);

  ++inserted_;
  ++activity_.insertions;
  activity_.insertion_time += time;
  activity_.longest_insertion = std::max(activity_.longest_insertion, time);
  if (converted.at_infinity > 0) {
    NODELET_WARN_STREAM_ONCE(
        "Clouds have points at infinity: they clear nothing, as they don't tell where their beams went. "
        "Those of "
        "laser scans do (no_return_clears)");
  }
  points_.hits += report.hits;
  points_.non_finite += report.non_finite;
  points_.too_near += report.too_near + converted.below_minimum;
  points_.beyond_range += report.beyond_range;
  points_.outside += report.outside;
  points_outside_z_ += converted.outside_z;

  recent_scans_.setMemory(corrected_maps_->isPublished()
                              ? static_cast<std::size_t>(parameters_.corrected_map_memory * (1 << 20))
                              : 0);
  keep(std::move(scan), recent_scans_);
}

// -----------------------------------------------------------------------------------------------------
// corrected maps

CorrectedMaps::Prepare MappingNodelet::beginToCorrect(const CorrectedMaps::Map& corrected) {
  const Options options = map_([](const OccupancyMap& map) { return map.options(); });
  return [this, corrected, options, number = map_number_,
          scans = recent_scans_.after(corrected.stamp)]() -> CorrectedMaps::Take {
    OccupancyMap map = readCorrected(corrected, options);
    insertAll(scans, corrected, map);
    const double until = scans.empty() ? corrected.stamp : scans.back().stamp;
    const auto shared = std::make_shared<OccupancyMap>(std::move(map));  // as std::function copies
    return [this, shared, corrected, until, number] {
      if (number != map_number_) throw std::runtime_error("the map was reset or loaded meanwhile");
      return correct(std::move(*shared), corrected, until);
    };
  };
}

std::string MappingNodelet::correct(OccupancyMap&& map, const CorrectedMaps::Map& corrected, double until) {
  insertAll(recent_scans_.after(until), corrected, map);
  const std::size_t cells = map.size(), scans = recent_scans_.after(corrected.stamp).size();
  replace(std::move(map));
  publisher_->restart();
  if (!recent_scans_.isComplete(corrected.stamp)) {
    NODELET_WARN_STREAM("A corrected map lacks clouds or scans that came after "
                        << corrected.stamp
                        << " s: those are kept only while somebody publishes it, in ~corrected_map_memory");
  }
  correctAll(corrected, recent_scans_);
  std::ostringstream text;
  text << "It has " << cells << " cells; " << scans << " clouds and scans were added";
  return text.str();
}

// -----------------------------------------------------------------------------------------------------
// services

void MappingNodelet::offerServices() {
  serveFile<mapping_msgs::SaveMap>("save_map", [this](const std::string& path) {
    return map_([&](const OccupancyMap& map) { return writeMap(map, path, parameters_.display); });
  });
  serveFile<mapping_msgs::LoadMap>("load_map", [this](const std::string& path) {
    const std::string text = load(path);
    publisher_->restart();
    return text;
  });
  ros::NodeHandle& node = getPrivateNodeHandle();
  serve<std_srvs::Empty>(node, "reset", [this](auto&, auto&) {
    map_([](OccupancyMap& map) { map.clear(); });
    recent_scans_.clear();
    ++map_number_;
    publisher_->restart();
  });
  serve<BoundingBoxQuery>(node, "clear_bbx", [this](const auto& request, auto&) {
    requireBox(request.min, request.max);
    const std::vector<Block> changed =
        map_([&](OccupancyMap& map) { return map.clearBox(toEigen(request.min), toEigen(request.max)); });
    publisher_->changed(changed, ros::Time::now());
  });
  const auto serveOctomap = [this](const std::string& name, OctomapFormat format) {
    serve<GetOctomap>(getNodeHandle(), name, [this, format](auto&, auto& response) {
      std_msgs::Header header;
      header.stamp = ros::Time::now();
      header.frame_id = parameters_.display.frame_id;
      map_([&](const OccupancyMap& map) {
        response.map = toMessage(toOctomap(map, format), format, map.options().resolution, header);
      });
    });
  };
  serveOctomap("octomap_binary", OctomapFormat::kBinary);
  serveOctomap("octomap_full", OctomapFormat::kFull);
  serve<CellsInBox>(node, "cells_in_box", [this](const auto& request, auto& response) {
    requireBox(request.min, request.max);
    map_([&](const OccupancyMap& map) {
      map.visitBox(toEigen(request.min), toEigen(request.max), [&](const Cell& cell) {
        if (!request.occupied_only || map.isOccupied(cell)) response.cells.push_back(toMessage(map, cell));
        return true;
      });
    });
  });
  serve<CastRay>(node, "cast_ray", [this](const auto& request, auto& response) {
    map_([&](const OccupancyMap& map) { castRay(map, request, response); });
  });
}

// Goes on with the map of the store, if there is one.
void MappingNodelet::startWindow() {
  const WindowOptions& window = parameters_.window;
  if (window.file.empty()) return;
  if (!std::filesystem::exists(window.file))
    return map_([&window](OccupancyMap& map) { map.keepIn(window); });
  if (!parameters_.map_file.empty()) {
    throw std::invalid_argument("~window/file is '" + window.file +
                                "', which holds a map already, and ~map_file is '" + parameters_.map_file +
                                "': one of them has to be empty, or " + window.file + " be removed");
  }
  OccupancyMap map = OccupancyMap::open(window, parameters_.map);
  const double resolution = map.options().resolution;
  if (parameters_.other_resolution != OtherResolution::kAdopt && resolution != parameters_.map.resolution) {
    std::ostringstream text;
    text << "~window/file is '" << window.file << "', whose voxels are of " << resolution
         << " m, ~resolution is " << parameters_.map.resolution
         << " m: set other_resolution to adopt, or remove " << window.file;
    throw std::invalid_argument(text.str());
  }
  map.setRange(parameters_.map.min_range, parameters_.map.max_range);
  NODELET_INFO_STREAM("Goes on with the map in " << window.file << ", of " << map.size()
                                                 << " cells. What it was built with replaces the parameters");
  map_([&map](OccupancyMap& current) { current = std::move(map); });
}

// A map comes with all that it was built with, but for the limits of the range. OctoMap's files have the
// resolution alone.
std::string MappingNodelet::load(const std::string& path) {
  const WindowOptions& window = parameters_.window;
  std::error_code error;
  if (!window.file.empty() && std::filesystem::equivalent(path, window.file, error))
    throw std::invalid_argument(path + " is ~window/file, which holds the map already");
  OccupancyMap map = readMap(path, parameters_.map, parameters_.other_resolution);
  map.setRange(parameters_.map.min_range, parameters_.map.max_range);
  if (parameters_.map.color) map.setColor(true);
  std::ostringstream text;
  text << "Read " << map.size() << " cells of a map of " << map.options().resolution << " m from " << path
       << ". What it was built with replaces the parameters";
  replace(std::move(map));
  recent_scans_.clear();
  ++map_number_;
  return text.str();
}

void MappingNodelet::replace(OccupancyMap&& map) {
  const WindowOptions& window = parameters_.window;
  map_([&](OccupancyMap& current) {
    if (!window.file.empty()) {
      current = OccupancyMap(parameters_.map);  // nobody has the store open then
      try {
        map.keepIn(window);
      } catch (const std::exception&) {
        current = OccupancyMap::open(window, parameters_.map);
        throw;
      }
    }
    current = std::move(map);
    colored_ = current.options().color;
  });
}

// --------------------------------------------------------------------------------------------- while it runs

void MappingNodelet::reconfigure(const MappingParameters& changed) {
  map_([&](OccupancyMap& map) { map.setRange(changed.map.min_range, changed.map.max_range); });
  publisher_->setOptions(changed.display);
  publish_timer_.setPeriod(ros::WallDuration(1.0 / changed.publish_rate));
  parameters_ = changed;
}

void MappingNodelet::publish() {
  const ros::WallTime start = ros::WallTime::now();
  publisher_->publish();
  const double time = (ros::WallTime::now() - start).toSec();
  if (const std::string left_out = publisher_->leftOut(); !left_out.empty() && far_throttle_()) {
    NODELET_WARN_STREAM(left_out << ", as its edges have ~occupancy_max_size "
                                    "pixels at most. If far returns are false, "
                                    "set sensor_model/max_range");
  }
  const std::lock_guard<std::mutex> lock(publications_mutex_);
  ++publications_.count;
  publications_.time += time;
}

void MappingNodelet::report() {
  Nodelet::report();
  arrivals_->endReport();
  laser_faults_->endReport();
  activity_ = {};
  const std::lock_guard<std::mutex> lock(publications_mutex_);
  publications_ = {};
}

void MappingNodelet::diagnoseInput(StatusWrapper& status) {
  using diagnostic_msgs::DiagnosticStatus;
  const std::size_t waiting = arrivals_->queue().waiting(), dropped = arrivals_->drops().recent();
  if (dropped > 0) {
    status.summaryf(DiagnosticStatus::WARN, "%zu messages dropped", dropped);
  } else if (activity_.insertions == 0 && waiting > 0) {
    status.summaryf(DiagnosticStatus::WARN, "%zu messages wait for a transform to %s", waiting,
                    parameters_.display.frame_id.c_str());
  } else {
    status.summary(DiagnosticStatus::OK, activity_.insertions > 0 ? "Mapping" : "No input");
  }
  arrivals_->addTo(status, reportedTime());
  laser_faults_->addTo(status);
  status.add("Inserted", inserted_);
  status.add("Points mapped", points_.hits);
  status.add("Points left out: not finite", points_.non_finite);
  status.add("Points left out: too near", points_.too_near);
  status.add("Points left out: limits in z", points_outside_z_);
  status.add("Points left out: the robot's own body", points_of_body_);
  status.add("Points that only clear: the ground", points_of_ground_);
  status.add("Points left out: outside of the map", points_.outside);
  status.add("Points cut at max_range", points_.beyond_range);
}

void MappingNodelet::diagnoseMap(StatusWrapper& status) {
  const auto milliseconds = [](double sum, std::size_t count) { return count > 0 ? 1e3 * sum / count : 0.0; };
  map_([&status](const OccupancyMap& map) {
    const std::size_t cells = map.size();
    status.summaryf(diagnostic_msgs::DiagnosticStatus::OK, "%zu cells", cells);
    status.add("Cells", cells);
    status.addf("Memory (MiB)", "%.1f", static_cast<double>(map.memoryUsage()) / (1 << 20));
    status.add("Resolution (m)", map.options().resolution);
  });
  corrected_maps_->addTo(status);
  status.addf("Insertion, mean (ms)", "%.2f", milliseconds(activity_.insertion_time, activity_.insertions));
  status.addf("Insertion, longest (ms)", "%.2f", 1e3 * activity_.longest_insertion);
  const std::lock_guard<std::mutex> lock(publications_mutex_);
  status.addf("Publishing, mean (ms)", "%.2f", milliseconds(publications_.time, publications_.count));
}

}  // namespace rtree_occupancy_map

PLUGINLIB_EXPORT_CLASS(rtree_occupancy_map::MappingNodelet, nodelet::Nodelet)
