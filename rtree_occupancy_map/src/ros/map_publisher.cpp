// SPDX-License-Identifier: BSD-3-Clause
#include "rtree_occupancy_map/ros/map_publisher.h"

#include <algorithm>
#include <sstream>

#include "rtree_occupancy_map/ros/cell_conversion.h"

namespace rtree_occupancy_map {
namespace {

using Subscriber = ros::SingleSubscriberPublisher;

// A patch is meant for the projected map's extent, but doesn't say which one that is, and it goes by another
// topic than the map. To a subscriber that is slower than both, such as RViz while it draws a large map, the
// order is lost: the next patch lands in the map of before. So for this long after the extent changed, the
// map is sent as a whole in place of patches.
constexpr double kWholeMapAfterResize = 3.0;  // s

// A map that is sent as a whole takes one part in so many of the time at most.
constexpr double kWholeMapShare = 20.0;

}  // namespace

MapPublisher::MapPublisher(ros::NodeHandle& node, const DisplayOptions& options, const SharedMap& map)
    : map_(map),
      options_(mapping_common::validate(options)),
      occupied_{{}, {options.frame_id, MarkerCache::Show::kOccupied}},
      free_{{}, {options.frame_id, MarkerCache::Show::kFree}},
      cells_{{}, {}},
      octomap_binary_{{}, Octree(OctomapFormat::kBinary)},
      octomap_full_{{}, Octree(OctomapFormat::kFull)} {
  const std::lock_guard<std::mutex> lock(mutex_);
  advertiseMarkers(node, "occupied_cells_vis_array", occupied_);
  if (options.publish_free_space) advertiseMarkers(node, "free_cells_vis_array", free_);

  cells_updates_ = node.advertise<sensor_msgs::PointCloud2>("occupied_cells_centers_updates", 10);
  advertiseWhole(node, "occupied_cells_centers", cells_);
  advertiseWhole(node, "octomap_binary", octomap_binary_);
  advertiseWhole(node, "octomap_full", octomap_full_);

  projection_updates_ =
      node.advertise<map_msgs::OccupancyGridUpdate>("projected_map_updates", 10, [this](const Subscriber&) {
        const std::lock_guard<std::mutex> lock(mutex_);
        startProjection();
      });
  projection_ =
      node.advertise<nav_msgs::OccupancyGrid>("projected_map", 1, [this](const Subscriber& subscriber) {
        const std::lock_guard<std::mutex> lock(mutex_);
        publishChanges();
        startProjection();
        if (options_.latch) subscriber.publish(projected_map_.grid());
      });
}

template <class Content>
void MapPublisher::advertiseWhole(ros::NodeHandle& node, const std::string& topic, Whole<Content>& whole) {
  using Message = decltype(messageOf(whole.content));
  whole.publisher = node.advertise<Message>(topic, 1, [this, &whole](const Subscriber& subscriber) {
    const std::lock_guard<std::mutex> lock(mutex_);
    publishChanges();
    if (whole.active) {
      update(whole);
    } else {
      whole.content.update(map_.snapshot());
      whole.active = true;
      whole.last = ros::WallTime::now();
    }
    if (options_.latch) subscriber.publish(messageOf(whole.content));
  });
}

template <class Content>
void MapPublisher::update(Whole<Content>& whole) const {
  whole.content.update(map_.snapshot({whole.changed.begin(), whole.changed.end()}));
}

template <class Content>
void MapPublisher::publishWhole(Whole<Content>& whole, const std::vector<Block>& changed) {
  if (!whole.active) return;
  if (whole.publisher.getNumSubscribers() == 0) {
    whole.content.clear();
    whole.changed.clear();
    whole.active = false;
    return;
  }
  whole.changed.insert(changed.begin(), changed.end());
  if (whole.changed.empty() || !due(whole.last, whole.cost)) return;
  const ros::WallTime start = ros::WallTime::now();
  update(whole);
  whole.changed.clear();
  whole.publisher.publish(messageOf(whole.content));
  whole.last = ros::WallTime::now();
  whole.cost = whole.last - start;
}

template <class Content>
void MapPublisher::restartWhole(Whole<Content>& whole, const MapSnapshot& all) {
  if (!whole.active) return;
  whole.content.clear();
  whole.changed.clear();
  whole.content.update(all);
  whole.publisher.publish(messageOf(whole.content));
  whole.last = ros::WallTime::now();
}

void MapPublisher::advertiseMarkers(ros::NodeHandle& node, const std::string& topic, Markers& markers) {
  markers.publisher = node.advertise<visualization_msgs::MarkerArray>(
      topic, 10, [this, &markers](const Subscriber& subscriber) {
        const std::lock_guard<std::mutex> lock(mutex_);
        const MapSnapshot all = map_.snapshot();
        publishMarkers(markers, all);  // or the others would miss what the cache takes for shown
        markers.active = true;
        if (options_.latch) subscriber.publish(markers.cache.all(all, options_.color));
      });
}

void MapPublisher::setOptions(const DisplayOptions& options) {
  const std::lock_guard<std::mutex> lock(mutex_);
  if (mapping_common::same(options, options_)) return;
  options_ = mapping_common::validate(options);
  restartAll();
}

void MapPublisher::changed(const std::vector<Block>& blocks, const ros::Time& stamp) {
  const std::lock_guard<std::mutex> lock(changes_mutex_);
  stamp_ = stamp;
  changed_.insert(blocks.begin(), blocks.end());
}

void MapPublisher::publish() {
  const std::lock_guard<std::mutex> lock(mutex_);
  publishChanges();
}

void MapPublisher::restart() {
  const std::lock_guard<std::mutex> lock(mutex_);
  restartAll();
}

bool MapPublisher::isActive() const {
  return occupied_.active || free_.active || cells_.active || octomap_binary_.active ||
         octomap_full_.active || projection_active_ || cells_updates_.getNumSubscribers() > 0;
}

void MapPublisher::publishChanges() {
  std::vector<Block> blocks;
  {
    const std::lock_guard<std::mutex> lock(changes_mutex_);
    blocks.assign(changed_.begin(), changed_.end());
    changed_.clear();
  }
  if (!isActive()) return;
  const MapSnapshot changed = map_.snapshot(blocks);
  publishMarkers(occupied_, changed);
  publishMarkers(free_, changed);
  if (!blocks.empty() && cells_updates_.getNumSubscribers() > 0) {
    sensor_msgs::PointCloud2 cloud = occupiedCloud(changed);
    cloud.header = header();
    cells_updates_.publish(cloud);
  }
  publishWhole(cells_, blocks);
  publishWhole(octomap_binary_, blocks);
  publishWhole(octomap_full_, blocks);
  publishProjection(changed);
}

void MapPublisher::restartAll() {
  {
    const std::lock_guard<std::mutex> lock(changes_mutex_);
    changed_.clear();
  }
  if (!isActive()) return;
  const MapSnapshot all = map_.snapshot();
  for (Markers* markers : {&occupied_, &free_}) {
    if (markers->active) markers->publisher.publish(markers->cache.restart(all, options_.color));
  }
  restartWhole(cells_, all);
  restartWhole(octomap_binary_, all);
  restartWhole(octomap_full_, all);
  if (projection_active_) {
    projection_active_ = false;
    startProjection();
    sendProjection();
  }
}

void MapPublisher::publishMarkers(Markers& markers, const MapSnapshot& changed) {
  if (!markers.active) return;
  if (markers.publisher.getNumSubscribers() == 0) {
    markers.cache.clear();
    markers.active = false;
    return;
  }
  const auto message = markers.cache.changes(changed, options_.color);
  if (!message.markers.empty()) markers.publisher.publish(message);
}

void MapPublisher::publishProjection(const MapSnapshot& changed) {
  if (!projection_active_) return;
  if (projection_.getNumSubscribers() + projection_updates_.getNumSubscribers() == 0) {
    projected_map_.clear();
    projection_active_ = false;
    return;
  }
  map_msgs::OccupancyGridUpdate patch;
  const bool grown = projected_map_.update(changed, header(), patch), differs = patch.width > 0;
  if (grown) last_resize_ = ros::WallTime::now();
  const bool patches = ros::WallTime::now() - last_resize_ >= ros::WallDuration(kWholeMapAfterResize);
  projection_changed_ = projection_changed_ || differs;
  if (differs && patches) projection_updates_.publish(patch);
  if (grown || (differs && !patches) || (projection_changed_ && due(last_projection_, {}))) sendProjection();
}

void MapPublisher::startProjection() {
  if (projection_active_) return;
  projected_map_.rebuild(map_.snapshot(), options_.occupancy_min_z, options_.occupancy_max_z,
                         options_.occupancy_max_size, header());
  projection_active_ = true;
  projection_changed_ = false;
  last_projection_ = last_resize_ = ros::WallTime::now();
}

void MapPublisher::sendProjection() {
  projection_.publish(projected_map_.grid());
  projection_changed_ = false;
  last_projection_ = ros::WallTime::now();
}

std::string MapPublisher::leftOut() const {
  const std::lock_guard<std::mutex> lock(mutex_);
  if (!projected_map_.leavesOut()) return "";
  const auto& info = projected_map_.grid().info;
  std::ostringstream text;
  text << "projected_map shows " << info.width * info.resolution << " m x " << info.height * info.resolution
       << " m of " << projected_map_.wholeSize().x() << " m x " << projected_map_.wholeSize().y() << " m";
  return text.str();
}

std_msgs::Header MapPublisher::header() const {
  std_msgs::Header header;
  header.frame_id = options_.frame_id;
  const std::lock_guard<std::mutex> lock(changes_mutex_);
  header.stamp = stamp_;
  return header;
}

sensor_msgs::PointCloud2 MapPublisher::messageOf(const OccupiedCloud& cloud) const {
  sensor_msgs::PointCloud2 message = cloud.cloud();
  message.header = header();
  return message;
}

OctomapMessage MapPublisher::messageOf(const Octree& octree) const {
  return toMessage(octree.data(), octree.format(), octree.resolution(), header());
}

bool MapPublisher::due(const ros::WallTime& last, const ros::WallDuration& cost) const {
  return ros::WallTime::now() - last >=
         std::max(ros::WallDuration(options_.full_map_period), cost * kWholeMapShare);
}

}  // namespace rtree_occupancy_map
