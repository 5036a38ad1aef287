// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <ros/ros.h>
#include <rtree_occupancy_map/occupancy_map.h>
#include <rtree_occupancy_map/ros/marker_cache.h>
#include <rtree_occupancy_map/ros/projected_map.h>
#include <sensor_msgs/PointCloud2.h>

#include <limits>
#include <set>
#include <string>
#include <vector>

namespace rtree_occupancy_map {

struct DisplayOptions {
  std::string frame_id = "map";
  ColorScale color;
  double occupancy_min_z = -std::numeric_limits<double>::infinity();  ///< m, limits of the projected map
  double occupancy_max_z = std::numeric_limits<double>::infinity();
  double full_map_period = 10.0;    ///< s, a map that changed is sent as a whole this often at most
  bool publish_free_space = false;  ///< free cells as markers
  bool latch = true;                ///< a new subscriber gets the whole map at once

  /// @throws std::invalid_argument that names the parameter, its value and the allowed range
  void validate() const;
};

/// Publishes a map: markers, cells, projection. A new subscriber gets everything once, later messages hold
/// what changed, and what nobody listens to costs nothing. (To ROS, all subscribers of a topic in one process
/// are one.) All calls must come from the thread of the handle's callbacks.
class MapPublisher {
 public:
  /// @param map stays where it is for as long as the publisher lives
  MapPublisher(ros::NodeHandle& node, const DisplayOptions& options, const OccupancyMap& map);

  /// As the map was at `stamp`, these blocks changed.
  void changed(const std::vector<Block>& blocks, const ros::Time& stamp);
  /// Sends what changed since the last call.
  void publish();
  /// Sends everything to everyone: the map is another one, or looks different.
  void restart();
  /// Frame and topics stay as they are. @throws std::invalid_argument as DisplayOptions::validate
  void setOptions(const DisplayOptions& options);
  const DisplayOptions& options() const { return options_; }

 private:
  struct Markers {
    ros::Publisher publisher;
    MarkerCache cache;
    bool active = false;  // whether the cache is in use
  };

  void advertiseMarkers(ros::NodeHandle& node, const std::string& topic, Markers& markers);
  void publishMarkers(Markers& markers, const std::vector<Block>& blocks);
  void publishCells(const std::vector<Block>& blocks);
  void publishProjection(const std::vector<Block>& blocks);
  void startProjection();
  void sendCells();
  void sendProjection();
  std_msgs::Header header() const;
  sensor_msgs::PointCloud2 cloudOf(const std::vector<Cell>& cells) const;
  bool due(const ros::WallTime& last) const;

  const OccupancyMap& map_;
  DisplayOptions options_;
  std::set<Block> changed_;
  ros::Time stamp_;

  Markers occupied_, free_;
  ros::Publisher cells_, cells_updates_, projection_, projection_updates_;
  bool cells_changed_ = false, projection_changed_ = false;  // since they were sent as a whole
  ros::WallTime last_cells_, last_projection_;               // when they were
  ProjectedMap projected_map_;
  bool projection_active_ = false;
};

}  // namespace rtree_occupancy_map
