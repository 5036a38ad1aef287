// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <ros/ros.h>
#include <rtree_occupancy_map/occupancy_map.h>
#include <rtree_occupancy_map/ros/marker_cache.h>
#include <rtree_occupancy_map/ros/octomap_message.h>
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
  double occupancy_min_z = -std::numeric_limits<double>::infinity();
  double occupancy_max_z = std::numeric_limits<double>::infinity();
  int occupancy_max_size = 5000;
  double full_map_period = 10.0;
  bool publish_free_space = false;
  bool latch = true;

  void describe(mapping_common::OptionList& o) {
    o("frame_id", frame_id, "", "fixed frame that the map is built in").notEmpty();
    o("full_map_period", full_map_period, "s",
      "a map that changed is sent as a whole this often at most: octomap_binary and octomap_full; "
      "occupied_cells_centers and projected_map for those who don't listen to their updates")
        .atLeast(0.0);
    o("latch", latch, "",
      "true: a new subscriber gets the whole map at once; false: what changes from then on");
    o("publish_free_space", publish_free_space, "", "true: free cells as markers, too");
    o("color_mode", color.mode, "", "what the colours of markers stand for").dynamic();
    o("color_min", color.min, "", "height (m) or reflectivity at the lower end of the colour scale")
        .dynamic();
    o("color_max", color.max, "", "the same at its upper end").dynamic();
    o("occupancy_min_z", occupancy_min_z, "m", "the projected map shows what is above").dynamic();
    o("occupancy_max_z", occupancy_max_z, "m", "and below").dynamic();
    o("occupancy_max_size", occupancy_max_size, "pixels",
      "longest edge of the projected map: what is farther out is left out, so that a few far returns don't "
      "make "
      "it too large for who receives it")
        .within(32, 65536);
    o.require(color.max > color.min, "color_max", "more than color_min");
    o.require(occupancy_max_z > occupancy_min_z, "occupancy_max_z", "more than occupancy_min_z");
  }
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
  /// Frame and topics stay as they are; where others differ all is sent anew.
  /// @throws std::invalid_argument that names the option, its value and what is allowed
  void setOptions(const DisplayOptions& options);
  const DisplayOptions& options() const { return options_; }
  /// Empty where nobody listens.
  const ProjectedMap& projectedMap() const { return projected_map_; }

 private:
  struct Markers {
    ros::Publisher publisher;
    MarkerCache cache;
    bool active = false;  // whether the cache is in use
  };

  // A topic that the whole map is sent to.
  struct Whole {
    ros::Publisher publisher;
    bool changed = false;  // since it was sent
    ros::WallTime last;    // when it was
  };

  template <class MakeMessage>
  void advertiseWhole(ros::NodeHandle& node, const std::string& topic, Whole& whole, const MakeMessage& make);
  template <class MakeMessage>
  void publishWhole(Whole& whole, bool changed, bool at_once, const MakeMessage& make);
  void publishWholes(bool changed, bool at_once);
  void advertiseMarkers(ros::NodeHandle& node, const std::string& topic, Markers& markers);
  void publishMarkers(Markers& markers, const std::vector<Block>& blocks);
  void publishCells(const std::vector<Block>& blocks);
  void publishProjection(const std::vector<Block>& blocks);
  void startProjection();
  void sendProjection();
  std_msgs::Header header() const;
  sensor_msgs::PointCloud2 cloudOf(const std::vector<Cell>& cells) const;
  sensor_msgs::PointCloud2 cloudOfAll() const;
  bool due(const ros::WallTime& last) const;

  const OccupancyMap& map_;
  DisplayOptions options_;
  std::set<Block> changed_;
  ros::Time stamp_;

  Markers occupied_, free_;
  Whole cells_, octomap_binary_, octomap_full_;
  ros::Publisher cells_updates_, projection_, projection_updates_;
  bool projection_changed_ = false;  // since it was sent as a whole
  ros::WallTime last_projection_;    // when it was
  ProjectedMap projected_map_;
  ros::WallTime last_resize_;  // when its extent became another one
  bool projection_active_ = false;
};

}  // namespace rtree_occupancy_map
