// SPDX-License-Identifier: BSD-3-Clause
//
// Builds an occupancy map from point clouds and laser scans. Everything but the reception of transforms
// happens in the nodelet's single-threaded callback queue, so that nothing here needs a lock.
#include <mapping_common/nodelet.h>
#include <mapping_common/transform_queue.h>
#include <mapping_msgs/LoadMap.h>
#include <mapping_msgs/SaveMap.h>
#include <rtree_occupancy_map/BoundingBoxQuery.h>
#include <rtree_occupancy_map/CastRay.h>
#include <rtree_occupancy_map/CellsInBox.h>
#include <std_srvs/Empty.h>
#include <tf2_eigen/tf2_eigen.h>
#include <tf2_ros/transform_listener.h>

#include <algorithm>
#include <cmath>
#include <memory>
#include <pluginlib/class_list_macros.hpp>
#include <sstream>
#include <stdexcept>
#include <string>
#include <utility>
#include <vector>

#include "rtree_occupancy_map/ros/cell_conversion.h"
#include "rtree_occupancy_map/ros/map_publisher.h"
#include "rtree_occupancy_map/ros/parameters.h"
#include "rtree_occupancy_map/ros/scan_conversion.h"

namespace rtree_occupancy_map {
namespace {

// Why a message was dropped: the order of the names given to drops_.
enum Reason { kNoTransform, kMalformed, kEmpty, kTimeJump };

// Stamps of one topic may be out of order by this much before time is said to have jumped back.
const ros::Duration kOutOfOrder(1.0);

// One input topic.
template <class Message>
struct Input {
  ros::Subscriber subscriber;
  std::unique_ptr<mapping_common::TransformQueue<Message>> queue;
  ros::Time last_stamp;
  std::size_t received = 0;  // since the last diagnostics
};

// What happened since the last diagnostics.
struct Activity {
  std::size_t insertions = 0, publications = 0;
  double insertion_time = 0.0, longest_insertion = 0.0;  // s
  double publication_time = 0.0;
};

bool isEmpty(const sensor_msgs::PointCloud2& cloud) {
  return cloud.width == 0 || cloud.height == 0;
}
bool isEmpty(const sensor_msgs::LaserScan& scan) {
  return scan.ranges.empty();
}

}  // namespace

class MappingNodelet : public mapping_common::Nodelet {
 public:
  ~MappingNodelet() override;

 private:
  void start(mapping_common::Parameters& reader) override;
  template <class Message>
  void listen(Input<Message>& input, const std::string& topic);

  template <class Message>
  void arrived(Input<Message>& input, const boost::shared_ptr<const Message>& message);
  template <class Message>
  void insert(const Message& message);
  void timeJumpedBack(const ros::Duration& by);
  void drop(Reason reason, const std::string& why, std::size_t count = 1);

  bool saveMap(mapping_msgs::SaveMap::Request& request, mapping_msgs::SaveMap::Response& response);
  bool loadMap(mapping_msgs::LoadMap::Request& request, mapping_msgs::LoadMap::Response& response);
  bool reset(std_srvs::Empty::Request&, std_srvs::Empty::Response&);
  bool clearBox(BoundingBoxQuery::Request& request, BoundingBoxQuery::Response&);
  bool cellsInBox(CellsInBox::Request& request, CellsInBox::Response& response);
  bool castRay(CastRay::Request& request, CastRay::Response& response);
  bool isBox(const geometry_msgs::Point& min, const geometry_msgs::Point& max) const;

  std::string load(const std::string& path);
  void reconfigure(const MappingParameters& changed);
  void publish();
  void report() override;
  void diagnoseInput(StatusWrapper& status);
  void diagnoseMap(StatusWrapper& status);

  OccupancyMap map_;
  std::unique_ptr<MapPublisher> publisher_;
  MappingParameters parameters_;
  std::string save_on_shutdown_;  // empty until the nodelet has started

  tf2_ros::Buffer tf_buffer_;
  Input<sensor_msgs::PointCloud2> clouds_;
  Input<sensor_msgs::LaserScan> scans_;
  std::unique_ptr<tf2_ros::TransformListener> tf_listener_;  // gone before the filters that it feeds

  std::vector<ros::ServiceServer> services_;
  ros::WallTimer publish_timer_;

  Activity activity_;
  mapping_common::DropCounts drops_{{"no transform", "malformed", "empty", "time jump"}};
  InsertReport points_;  // sums over all scans
  std::size_t inserted_ = 0, points_outside_z_ = 0, points_below_minimum_ = 0;
};

MappingNodelet::~MappingNodelet() {
  if (save_on_shutdown_.empty() || map_.tree().size() == 0) return;
  try {
    map_.save(save_on_shutdown_);
    NODELET_INFO_STREAM("Wrote " << map_.tree().size() << " cells to " << save_on_shutdown_);
  } catch (const std::exception& e) {
    NODELET_ERROR_STREAM("The map is lost: " << e.what());
  }
}

void MappingNodelet::start(mapping_common::Parameters& reader) {
  ros::NodeHandle& node = getNodeHandle();
  ros::NodeHandle& private_node = getPrivateNodeHandle();
  reader.read(parameters_);
  map_ = OccupancyMap(parameters_.map);
  if (!parameters_.map_file.empty()) NODELET_INFO_STREAM(load(parameters_.map_file));
  publisher_ = std::make_unique<MapPublisher>(node, parameters_.display, map_);
  // Wall time: what a bag brought is shown and reported while it is paused, too.
  publish_timer_ = node.createWallTimer(ros::WallDuration(1.0 / parameters_.publish_rate),
                                        [this](const ros::WallTimerEvent&) { publish(); });
  allowReconfiguration<MappingParameters>(parameters_,
                                          [this](const MappingParameters& changed) { reconfigure(changed); });

  tf_listener_ = std::make_unique<tf2_ros::TransformListener>(tf_buffer_, node, false);
  listen(clouds_, "cloud_in");
  listen(scans_, "scan");
  services_ = {private_node.advertiseService("save_map", &MappingNodelet::saveMap, this),
               private_node.advertiseService("load_map", &MappingNodelet::loadMap, this),
               private_node.advertiseService("reset", &MappingNodelet::reset, this),
               private_node.advertiseService("clear_bbx", &MappingNodelet::clearBox, this),
               private_node.advertiseService("cells_in_box", &MappingNodelet::cellsInBox, this),
               private_node.advertiseService("cast_ray", &MappingNodelet::castRay, this)};

  startDiagnostics("none", {{"Input", [this](StatusWrapper& status) { diagnoseInput(status); }},
                            {"Map", [this](StatusWrapper& status) { diagnoseMap(status); }}});
  save_on_shutdown_ = parameters_.save_on_shutdown;
}

// --------------------------------------------------------------------------------------------------------
// input

template <class Message>
void MappingNodelet::listen(Input<Message>& input, const std::string& topic) {
  input.queue = std::make_unique<mapping_common::TransformQueue<Message>>(
      tf_buffer_, std::vector<std::string>{parameters_.display.frame_id}, parameters_.queue_size,
      parameters_.transform_tolerance, getNodeHandle(), [this](const Message& message) { insert(message); },
      [this](const Message& message, const std::string& why) {
        drop(message.header.frame_id.empty() ? kMalformed : kNoTransform, why);
      });
  using Pointer = boost::shared_ptr<const Message>;
  input.subscriber = getNodeHandle().subscribe<Message>(
      topic, parameters_.queue_size, [this, &input](const Pointer& message) { arrived(input, message); });
}

template <class Message>
void MappingNodelet::arrived(Input<Message>& input, const boost::shared_ptr<const Message>& message) {
  ++input.received;
  const ros::Time stamp = message->header.stamp;
  if (!stamp.isZero()) {  // zero: whatever transform is the latest
    if (stamp + kOutOfOrder < input.last_stamp) timeJumpedBack(input.last_stamp - stamp);
    input.last_stamp = stamp;
  }
  if (isEmpty(*message)) {
    drop(kEmpty, "nothing was measured in it");
    return;
  }
  input.queue->add(message);
}

// Transforms and waiting messages are of another time now; the map stays.
void MappingNodelet::timeJumpedBack(const ros::Duration& by) {
  NODELET_WARN_STREAM("Time jumped back by " << by << " s: transforms are forgotten, the map goes on");
  // With simulated time the listener has done so already, and may have heard of new ones since.
  if (!ros::Time::isSimTime()) tf_buffer_.clear();
  const std::size_t waiting = clouds_.queue->clear() + scans_.queue->clear();
  clouds_.last_stamp = scans_.last_stamp = ros::Time();
  if (waiting > 0) drop(kTimeJump, "it waited for a transform", waiting);
}

template <class Message>
void MappingNodelet::insert(const Message& message) {
  const std_msgs::Header& header = message.header;
  try {
    const auto transform =
        tf_buffer_.lookupTransform(parameters_.display.frame_id, header.frame_id, header.stamp);
    const ConvertedScan converted = toScan(message, tf2::transformToEigen(transform), parameters_.scan);
    const ros::WallTime start = ros::WallTime::now();
    const InsertReport report = map_.insertScan(converted.scan);
    const double time = (ros::WallTime::now() - start).toSec();
    publisher_->changed(report.changed_blocks, header.stamp);

    ++inserted_;
    ++activity_.insertions;
    activity_.insertion_time += time;
    activity_.longest_insertion = std::max(activity_.longest_insertion, time);
    points_.hits += report.hits;
    points_.non_finite += report.non_finite;
    points_.too_near += report.too_near + converted.below_minimum;
    points_.beyond_range += report.beyond_range;
    points_.outside += report.outside;
    points_outside_z_ += converted.outside_z;
  } catch (const tf2::TransformException& e) {
    drop(kNoTransform, e.what());
  } catch (const std::invalid_argument& e) {
    drop(kMalformed, e.what());
  }
}

void MappingNodelet::drop(Reason reason, const std::string& why, std::size_t count) {
  drops_.add(reason, count);
  NODELET_WARN_STREAM_THROTTLE(
      5.0, "Dropped a message (" << drops_.name(reason) << "): " << why << ". So far: " << drops_.text());
}

// -----------------------------------------------------------------------------------------------------
// services

bool MappingNodelet::saveMap(mapping_msgs::SaveMap::Request& request,
                             mapping_msgs::SaveMap::Response& response) {
  mapping_common::answer(request.path, response, [&] {
    map_.save(request.path);
    return "Wrote " + std::to_string(map_.tree().size()) + " cells to " + request.path;
  });
  return true;
}

bool MappingNodelet::loadMap(mapping_msgs::LoadMap::Request& request,
                             mapping_msgs::LoadMap::Response& response) {
  mapping_common::answer(request.path, response, [&] {
    const std::string text = load(request.path);
    publisher_->restart();
    return text;
  });
  return true;
}

// A map comes with all that it was built with, but for the limits of the range.
std::string MappingNodelet::load(const std::string& path) {
  OccupancyMap map = OccupancyMap::load(path, map_.options());
  map.setRange(parameters_.map.min_range, parameters_.map.max_range);
  map_ = std::move(map);
  std::ostringstream text;
  text << "Read " << map_.tree().size() << " cells of a map of " << map_.options().resolution << " m from "
       << path << ". Its resolution, sensor model and fusion replace those of the parameters";
  return text.str();
}

bool MappingNodelet::reset(std_srvs::Empty::Request&, std_srvs::Empty::Response&) {
  map_.clear();
  publisher_->restart();
  return true;
}

bool MappingNodelet::clearBox(BoundingBoxQuery::Request& request, BoundingBoxQuery::Response&) {
  if (!isBox(request.min, request.max)) return false;
  publisher_->changed(map_.clearBox(toEigen(request.min), toEigen(request.max)), ros::Time::now());
  return true;
}

bool MappingNodelet::cellsInBox(CellsInBox::Request& request, CellsInBox::Response& response) {
  if (!isBox(request.min, request.max)) return false;
  map_.visitBox(toEigen(request.min), toEigen(request.max), [&](const Cell& cell) {
    if (!request.occupied_only || map_.isOccupied(cell)) response.cells.push_back(toMessage(map_, cell));
    return true;
  });
  return true;
}

bool MappingNodelet::castRay(CastRay::Request& request, CastRay::Response& response) {
  try {
    const RayHit hit = map_.castRay(toEigen(request.origin), toEigen(request.direction), request.max_range,
                                    request.ignore_unknown);
    response.point = toPoint(hit.point);
    switch (hit.result) {
      case RayHit::Result::kOccupied:
        response.result = CastRay::Response::OCCUPIED;
        response.cell = toMessage(map_, hit.cell);
        break;
      case RayHit::Result::kUnknown:
        response.result = CastRay::Response::UNKNOWN;
        break;
      case RayHit::Result::kNothing:
        response.result = CastRay::Response::NOTHING;
        break;
    }
    return true;
  } catch (const std::invalid_argument& e) {
    NODELET_ERROR_STREAM("cast_ray: " << e.what());
    return false;
  }
}

bool MappingNodelet::isBox(const geometry_msgs::Point& min, const geometry_msgs::Point& max) const {
  if ((toEigen(min).array() <= toEigen(max).array()).all()) return true;
  NODELET_ERROR_STREAM("No box: min is " << toEigen(min).transpose() << ", max is "
                                         << toEigen(max).transpose()
                                         << ", allowed is min <= max along each axis");
  return false;
}

// --------------------------------------------------------------------------------------------- while it runs

void MappingNodelet::reconfigure(const MappingParameters& changed) {
  map_.setRange(changed.map.min_range, changed.map.max_range);
  publisher_->setOptions(changed.display);
  publish_timer_.setPeriod(ros::WallDuration(1.0 / changed.publish_rate));
  parameters_ = changed;
}

void MappingNodelet::publish() {
  const ros::WallTime start = ros::WallTime::now();
  publisher_->publish();
  ++activity_.publications;
  activity_.publication_time += (ros::WallTime::now() - start).toSec();
}

void MappingNodelet::report() {
  Nodelet::report();
  drops_.endReport();
  clouds_.received = scans_.received = 0;
  activity_ = {};
}

void MappingNodelet::diagnoseInput(StatusWrapper& status) {
  using diagnostic_msgs::DiagnosticStatus;
  const double seconds = reportedTime();
  const std::size_t waiting = clouds_.queue->waiting() + scans_.queue->waiting();
  if (drops_.recent() > 0) {
    status.summaryf(DiagnosticStatus::WARN, "%zu messages dropped", drops_.recent());
  } else if (activity_.insertions == 0 && waiting > 0) {
    status.summaryf(DiagnosticStatus::WARN, "%zu messages wait for a transform to %s", waiting,
                    parameters_.display.frame_id.c_str());
  } else {
    status.summary(DiagnosticStatus::OK, activity_.insertions > 0 ? "Mapping" : "No input");
  }
  status.addf("Clouds (Hz)", "%.1f", static_cast<double>(clouds_.received) / seconds);
  status.addf("Scans (Hz)", "%.1f", static_cast<double>(scans_.received) / seconds);
  status.add("Inserted", inserted_);
  status.add("Waiting for a transform", waiting);
  drops_.addTo(status, "Dropped");
  status.add("Points mapped", points_.hits);
  status.add("Points left out: not finite", points_.non_finite);
  status.add("Points left out: too near", points_.too_near);
  status.add("Points left out: limits in z", points_outside_z_);
  status.add("Points left out: outside of the map", points_.outside);
  status.add("Points cut at max_range", points_.beyond_range);
}

void MappingNodelet::diagnoseMap(StatusWrapper& status) {
  const auto milliseconds = [](double sum, std::size_t count) { return count > 0 ? 1e3 * sum / count : 0.0; };
  status.summaryf(diagnostic_msgs::DiagnosticStatus::OK, "%zu cells", map_.tree().size());
  status.add("Cells", map_.tree().size());
  status.addf("Memory (MiB)", "%.1f", static_cast<double>(map_.memoryUsage()) / (1 << 20));
  status.add("Resolution (m)", map_.options().resolution);
  status.addf("Insertion, mean (ms)", "%.2f", milliseconds(activity_.insertion_time, activity_.insertions));
  status.addf("Insertion, longest (ms)", "%.2f", 1e3 * activity_.longest_insertion);
  status.addf("Publishing, mean (ms)", "%.2f",
              milliseconds(activity_.publication_time, activity_.publications));
}

}  // namespace rtree_occupancy_map

PLUGINLIB_EXPORT_CLASS(rtree_occupancy_map::MappingNodelet, nodelet::Nodelet)
