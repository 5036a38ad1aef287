// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <ros/ros.h>
#include <rtree_occupancy_map/map_snapshot.h>
#include <rtree_occupancy_map/ros/cell_conversion.h>
#include <rtree_occupancy_map/ros/marker_cache.h>
#include <rtree_occupancy_map/ros/octomap_message.h>
#include <rtree_occupancy_map/ros/projected_map.h>
#include <sensor_msgs/PointCloud2.h>

#include <limits>
#include <mutex>
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
      "a map that changed is sent as a whole this often at most, less often where that takes more than a "
      "twentieth of the time: octomap_binary and octomap_full; occupied_cells_centers and projected_map for "
      "those who don't listen to their updates")
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

/// Publishes a map: markers, cells, projection, octrees. A new subscriber gets everything once, later
/// messages hold what changed, and what nobody listens to costs nothing. (To ROS, all subscribers of a topic
/// in one process are one.) Messages are made from copies of what changed, so that the map can change
/// meanwhile, and all calls may come from any thread.
class MapPublisher {
 public:
  /// @param node its callbacks are called when somebody subscribes
  /// @param map stays where it is for as long as the publisher lives
  MapPublisher(ros::NodeHandle& node, const DisplayOptions& options, const SharedMap& map);

  /// As the map was at `stamp`, these blocks changed. Doesn't wait for messages that are being made.
  void changed(const std::vector<Block>& blocks, const ros::Time& stamp);
  /// Sends what changed since the last call.
  void publish();
  /// Sends everything to everyone: the map is another one, or looks different.
  void restart();
  /// Frame and topics stay as they are; where others differ all is sent anew.
  /// @throws std::invalid_argument that names the option, its value and what is allowed
  void setOptions(const DisplayOptions& options);
  /// What the projected map leaves out, in words; empty if that is nothing, or nobody listens.
  std::string leftOut() const;

 private:
  struct Markers {
    ros::Publisher publisher;
    MarkerCache cache;
    bool active = false;  // whether the cache is in use
  };

  // A topic that the whole map is sent to, with what is kept of it while somebody listens.
  template <class Content>
  struct Whole {
    ros::Publisher publisher;
    Content content;
    bool active = false;        // whether the content is in use
    std::set<Block> changed{};  // since it was sent to all
    ros::WallTime last{};       // when it was sent
    ros::WallDuration cost{};   // of making and sending it then
  };

  template <class Content>
  void advertiseWhole(ros::NodeHandle& node, const std::string& topic, Whole<Content>& whole);
  template <class Content>
  void publishWhole(Whole<Content>& whole, const std::vector<Block>& changed);
  template <class Content>
  void restartWhole(Whole<Content>& whole, const MapSnapshot& all);
  template <class Content>
  void update(Whole<Content>& whole) const;
  sensor_msgs::PointCloud2 messageOf(const OccupiedCloud& cloud) const;
  OctomapMessage messageOf(const Octree& octree) const;
  void advertiseMarkers(ros::NodeHandle& node, const std::string& topic, Markers& markers);
  void publishChanges();
  void restartAll();
  void publishMarkers(Markers& markers, const MapSnapshot& changed);
  void publishProjection(const MapSnapshot& changed);
  void startProjection();
  void sendProjection();
  bool isActive() const;
  std_msgs::Header header() const;
  bool due(const ros::WallTime& last, const ros::WallDuration& cost) const;

  const SharedMap& map_;
  mutable std::mutex mutex_;  // of all below but for changed_ and stamp_
  DisplayOptions options_;
  Markers occupied_, free_;
  Whole<OccupiedCloud> cells_;
  Whole<Octree> octomap_binary_, octomap_full_;
  ros::Publisher cells_updates_, projection_, projection_updates_;
  bool projection_changed_ = false;  // since it was sent as a whole
  ros::WallTime last_projection_;    // when it was
  ProjectedMap projected_map_;
  ros::WallTime last_resize_;  // when its extent became another one
  bool projection_active_ = false;

  mutable std::mutex changes_mutex_;
  std::set<Block> changed_;
  ros::Time stamp_;
};

}  // namespace rtree_occupancy_map
