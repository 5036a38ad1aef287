// SPDX-License-Identifier: BSD-3-Clause
#include "intensity_hector_slam/ros/map_publisher.h"

#include <nav_msgs/MapMetaData.h>

#include <exception>
#include <memory>

#include "intensity_hector_slam/ros/map_conversion.h"

namespace intensity_hector_slam {

MapPublisher::MapPublisher(ros::NodeHandle& node, const std::string& frame)
    : frame_(frame),
      map_(node.advertise<nav_msgs::OccupancyGrid>("map", 1, true)),
      metadata_(node.advertise<nav_msgs::MapMetaData>("map_metadata", 1, true)),
      reflectivity_map_(node.advertise<nav_msgs::OccupancyGrid>("reflectivity_map", 1, true)) {}

void MapPublisher::publish(const ros::Time& stamp, const GridMap& map) {
  if ((changed_.isEmpty() && !restarted_) || !worker_.isIdle()) return;
  const auto change = std::make_shared<Change>(Change{stamp, map.resolution(), map.box(), restarted_, {}});
  map.forTiles([&](const GridMap::Tile& tile, const Eigen::AlignedBox2i& cells) {
    if (restarted_ || changed_.intersects(cells))
      change->images.push_back({cells, occupancyOf(tile, cells), reflectivityOf(tile, cells)});
  });
  changed_.setEmpty();
  restarted_ = false;
  worker_.post([this, change]() -> mapping_common::Worker::Work {
    try {
      show(*change);
    } catch (const std::exception& e) {
      ROS_ERROR_STREAM_THROTTLE(10.0, "The map isn't published: " << e.what());
    }
    return nullptr;
  });
}

void MapPublisher::show(const Change& change) {
  if (change.restarted || !(shown_.min() == change.box.min() && shown_.max() == change.box.max())) {
    for (nav_msgs::OccupancyGrid* grid : {&occupancy_, &reflectivity_}) {
      nav_msgs::OccupancyGrid larger = unknownGrid(change.resolution, change.box);
      larger.header.frame_id = frame_;
      if (!change.restarted && !shown_.isEmpty()) draw(shown_, grid->data, change.box, larger);
      *grid = std::move(larger);
    }
    shown_ = change.box;
  }
  for (const Image& image : change.images) {
    draw(image.cells, image.occupancy, shown_, occupancy_);
    draw(image.cells, image.reflectivity, shown_, reflectivity_);
  }
  for (nav_msgs::OccupancyGrid* grid : {&occupancy_, &reflectivity_})
    grid->header.stamp = grid->info.map_load_time = change.stamp;
  map_.publish(occupancy_);
  metadata_.publish(occupancy_.info);
  reflectivity_map_.publish(reflectivity_);
}

}  // namespace intensity_hector_slam
