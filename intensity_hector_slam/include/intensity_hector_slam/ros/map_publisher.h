// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <intensity_hector_slam/grid_map.h>
#include <mapping_common/worker.h>
#include <nav_msgs/OccupancyGrid.h>
#include <ros/ros.h>

#include <Eigen/Geometry>
#include <string>
#include <vector>

namespace intensity_hector_slam {

/// Publishes what a map shows, in a thread of its own: who calls only takes the cells that have changed, so
/// that no scan waits for messages of the whole map to be made and sent.
class MapPublisher {
 public:
  /// Advertises map, map_metadata and reflectivity_map, of nav_msgs, for whoever comes late, too.
  MapPublisher(ros::NodeHandle& node, const std::string& frame);

  /// These cells may have changed.
  void changed(const Eigen::AlignedBox2i& cells) { changed_.extend(cells); }
  /// The map is another.
  void restart() { restarted_ = true; }
  /// Publishes what has changed, if anything has. While the last is still being sent, it is left for the next
  /// call.
  void publish(const ros::Time& stamp, const GridMap& map);

 private:
  // Of a tile, row by row, as the messages have them.
  struct Image {
    Eigen::AlignedBox2i cells;
    std::vector<std::int8_t> occupancy, reflectivity;
  };
  struct Change {
    ros::Time stamp;
    double resolution;
    Eigen::AlignedBox2i box;  // of the whole map
    bool restarted;
    std::vector<Image> images;
  };
  void show(const Change& change);

  const std::string frame_;
  ros::Publisher map_, metadata_, reflectivity_map_;
  Eigen::AlignedBox2i changed_;
  bool restarted_ = true;

  // Of the worker's thread.
  Eigen::AlignedBox2i shown_;
  nav_msgs::OccupancyGrid occupancy_, reflectivity_;

  mapping_common::Worker worker_{10};  // the last, as it uses all others
};

}  // namespace intensity_hector_slam
