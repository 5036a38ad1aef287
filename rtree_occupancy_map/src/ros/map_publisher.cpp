// SPDX-License-Identifier: BSD-3-Clause
#include "rtree_occupancy_map/ros/map_publisher.h"

#include "rtree_occupancy_map/ros/cell_conversion.h"

namespace rtree_occupancy_map {
namespace {

using Subscriber = ros::SingleSubscriberPublisher;

// A patch is meant for the projected map's extent, but doesn't say which one that is, and it goes by another
// topic than the map. To a subscriber that is slower than both, such as RViz while it draws a large map, the
// order is lost: the next patch lands in the map of before. So for this long after the extent changed, the
// map is sent as a whole in place of patches.
constexpr double kWholeMapAfterResize = 3.0;  // s

}  // namespace

MapPublisher::MapPublisher(ros::NodeHandle& node, const DisplayOptions& options, const OccupancyMap& map)
    : map_(map),
      options_(mapping_common::validate(options)),
      occupied_{{}, {options.frame_id, MarkerCache::Show::kOccupied}},
      free_{{}, {options.frame_id, MarkerCache::Show::kFree}} {
  advertiseMarkers(node, "occupied_cells_vis_array", occupied_);
  if (options.publish_free_space) advertiseMarkers(node, "free_cells_vis_array", free_);

  cells_updates_ = node.advertise<sensor_msgs::PointCloud2>("occupied_cells_centers_updates", 10);
  advertiseWhole(node, "occupied_cells_centers", cells_, [this] { return cloudOfAll(); });
  advertiseWhole(node, "octomap_binary", octomap_binary_,
                 [this] { return toMessage(map_, OctomapFormat::kBinary, header()); });
  advertiseWhole(node, "octomap_full", octomap_full_,
                 [this] { return toMessage(map_, OctomapFormat::kFull, header()); });

  projection_updates_ = node.advertise<map_msgs::OccupancyGridUpdate>(
      "projected_map_updates", 10, [this](const Subscriber&) { startProjection(); });
  projection_ =
      node.advertise<nav_msgs::OccupancyGrid>("projected_map", 1, [this](const Subscriber& subscriber) {
        publish();
        startProjection();
        if (options_.latch) subscriber.publish(projected_map_.grid());
      });
}

template <class MakeMessage>
void MapPublisher::advertiseWhole(ros::NodeHandle& node, const std::string& topic, Whole& whole,
                                  const MakeMessage& make) {
  const auto welcome = [this, &whole, make](const Subscriber& subscriber) {
    if (whole.publisher.getNumSubscribers() == 1) whole.last = ros::WallTime::now();
    if (options_.latch) subscriber.publish(make());
  };
  whole.publisher = node.advertise<decltype(make())>(topic, 1, welcome);
}

template <class MakeMessage>
void MapPublisher::publishWhole(Whole& whole, bool changed, bool at_once, const MakeMessage& make) {
  whole.changed = whole.publisher.getNumSubscribers() > 0 && (whole.changed || changed);
  if (!whole.changed || !(at_once || due(whole.last))) return;
  whole.publisher.publish(make());
  whole.changed = false;
  whole.last = ros::WallTime::now();
}

void MapPublisher::publishWholes(bool changed, bool at_once) {
  publishWhole(cells_, changed, at_once, [this] { return cloudOfAll(); });
  publishWhole(octomap_binary_, changed, at_once,
               [this] { return toMessage(map_, OctomapFormat::kBinary, header()); });
  publishWhole(octomap_full_, changed, at_once,
               [this] { return toMessage(map_, OctomapFormat::kFull, header()); });
}

void MapPublisher::advertiseMarkers(ros::NodeHandle& node, const std::string& topic, Markers& markers) {
  markers.publisher = node.advertise<visualization_msgs::MarkerArray>(
      topic, 10, [this, &markers](const Subscriber& subscriber) {
        publish();
        markers.active = true;
        if (options_.latch) subscriber.publish(markers.cache.all(map_, options_.color));
      });
}

void MapPublisher::setOptions(const DisplayOptions& options) {
  if (mapping_common::same(options, options_)) return;
  options_ = mapping_common::validate(options);
  restart();
}

void MapPublisher::changed(const std::vector<Block>& blocks, const ros::Time& stamp) {
  stamp_ = stamp;
  changed_.insert(blocks.begin(), blocks.end());
}

void MapPublisher::publish() {
  const std::vector<Block> blocks(changed_.begin(), changed_.end());
  changed_.clear();
  publishMarkers(occupied_, blocks);
  publishMarkers(free_, blocks);
  publishCells(blocks);
  publishWholes(!blocks.empty(), false);
  publishProjection(blocks);
}

void MapPublisher::restart() {
  changed_.clear();
  for (Markers* markers : {&occupied_, &free_}) {
    if (markers->active) markers->publisher.publish(markers->cache.restart(map_, options_.color));
  }
  publishWholes(true, true);
  if (projection_active_) {
    projection_active_ = false;
    startProjection();
    sendProjection();
  }
}

void MapPublisher::publishMarkers(Markers& markers, const std::vector<Block>& blocks) {
  if (!markers.active) return;
  if (markers.publisher.getNumSubscribers() == 0) {
    markers.cache.clear();
    markers.active = false;
    return;
  }
  const auto message = markers.cache.changes(map_, blocks, options_.color);
  if (!message.markers.empty()) markers.publisher.publish(message);
}

void MapPublisher::publishCells(const std::vector<Block>& blocks) {
  if (!blocks.empty() && cells_updates_.getNumSubscribers() > 0) {
    std::vector<Cell> cells;
    for (const Block& block : blocks) appendOccupied(map_, block, cells);
    cells_updates_.publish(cloudOf(cells));
  }
}

void MapPublisher::publishProjection(const std::vector<Block>& blocks) {
  if (!projection_active_) return;
  if (projection_.getNumSubscribers() + projection_updates_.getNumSubscribers() == 0) {
    projected_map_.clear();
    projection_active_ = false;
    return;
  }
  map_msgs::OccupancyGridUpdate patch;
  const bool grown = projected_map_.update(map_, blocks, header(), patch), changed = patch.width > 0;
  if (grown) last_resize_ = ros::WallTime::now();
  const bool patches = ros::WallTime::now() - last_resize_ >= ros::WallDuration(kWholeMapAfterResize);
  projection_changed_ = projection_changed_ || changed;
  if (changed && patches) projection_updates_.publish(patch);
  if (grown || (changed && !patches) || (projection_changed_ && due(last_projection_))) sendProjection();
}

void MapPublisher::startProjection() {
  if (projection_active_) return;
  projected_map_.rebuild(map_, options_.occupancy_min_z, options_.occupancy_max_z,
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

std_msgs::Header MapPublisher::header() const {
  std_msgs::Header header;
  header.frame_id = options_.frame_id;
  header.stamp = stamp_;
  return header;
}

sensor_msgs::PointCloud2 MapPublisher::cloudOf(const std::vector<Cell>& cells) const {
  sensor_msgs::PointCloud2 cloud = toPointCloud2(map_, cells);
  cloud.header = header();
  return cloud;
}

sensor_msgs::PointCloud2 MapPublisher::cloudOfAll() const {
  std::vector<Cell> cells;
  map_.visitOccupied([&cells](const Cell& cell) {
    cells.push_back(cell);
    return true;
  });
  return cloudOf(cells);
}

bool MapPublisher::due(const ros::WallTime& last) const {
  return ros::WallTime::now() - last >= ros::WallDuration(options_.full_map_period);
}

}  // namespace rtree_occupancy_map
