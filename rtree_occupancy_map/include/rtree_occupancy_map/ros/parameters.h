// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <rtree_occupancy_map/ground_filter.h>
#include <rtree_occupancy_map/options.h>
#include <rtree_occupancy_map/ros/map_formats.h>
#include <rtree_occupancy_map/ros/map_publisher.h>
#include <rtree_occupancy_map/ros/scan_conversion.h>
#include <rtree_occupancy_map/window.h>

#include <string>

namespace rtree_occupancy_map {

/// What the mapping nodelet is started with.
struct MappingParameters {
  Options map;
  WindowOptions window;
  double window_flush_period = 30.0;
  ScanLimits scan;
  DisplayOptions display;
  std::string map_file, save_on_shutdown;
  OtherResolution other_resolution = OtherResolution::kAdopt;
  std::string cloud_topics = "cloud_in";
  int queue_size = 10;
  std::string sensor_frame_id, robot_body;
  bool filter_ground = false;
  std::string base_frame_id = "base_footprint";
  GroundFilterOptions ground_filter;
  bool undistort = false;
  double transform_timeout = 0.5;
  double transform_tolerance = 0.0;
  double publish_rate = 2.0;
  double corrected_map_memory = 512.0;  ///< MiB

  void describe(mapping_common::OptionList& o) {
    o.section("the map");
    o("map_file", map_file, "",
      "path of a map to load at the start; its resolution, sensor model and fusion then replace those below. "
      "Empty: "
      "start with an empty map");
    o("other_resolution", other_resolution, "", "what becomes of a file whose resolution isn't that below");
    o("save_on_shutdown", save_on_shutdown, "",
      "path that the map is written to at the end, unless it is empty. Empty: don't");
    o("corrected_map_memory", corrected_map_memory, "MiB",
      "while somebody publishes corrected_cloud_map: of the last clouds and scans that went into the map, "
      "which "
      "are put "
      "into a corrected one where that lacks them; what exceeds this is lost then, with a warning")
        .within(0.0, 1e6);
    map.describe(o);
    o.group("window",
            "a rolling window around the sensor, so that a large map needs the memory of a small one",
            window);
    o("window_flush_period", window_flush_period, "s",
      "what has changed in memory is written to window/file this often, too, so that little is lost where "
      "the "
      "nodelet is killed; 0: not before it leaves the memory, or the end")
        .within(0.0, 1e6);
    o.require(!map.color || window.file.empty(), "color", "false with a rolling window, window/file");
    o.section("the input");
    o("cloud_topics", cloud_topics, "",
      "of point clouds, any number with spaces between them, or a list; each sensor has its own frame, and "
      "waits for "
      "nobody else's transforms")
        .notEmpty();
    o("queue_size", queue_size, "", "messages of each topic that wait for the map; the oldest is dropped")
        .within(1, 10000);
    o("sensor_frame_id", sensor_frame_id, "",
      "of clouds: the frame whose origin their beams start at, for clouds in another frame, such as those "
      "that "
      "LOAM has registered in the map's. Empty: the cloud's own frame");
    o("undistort", undistort, "",
      "true: the sensor moves during a sweep: each point, and its beam, is from where tf says that the "
      "sensor was "
      "at the point's time. Clouds need a field t, time, timestamp, offset_time, time_offset or time_stamp; "
      "scans "
      "have time_increment. Messages then wait for transforms until the end of their sweep");
    o("transform_timeout", transform_timeout, "s",
      "a message waits for transforms until later ones of its sensor have stamps later by this")
        .within(0.0, 10.0);
    o("transform_tolerance", transform_tolerance, "s",
      "a message waits until transforms this much later than its stamp are known")
        .within(0.0, 10.0);
    scan.describe(o);
    o("robot_body", robot_body, "m",
      "the robot's own parts: returns in these boxes are left out, and don't clear. Each is a frame and two "
      "corners in it, 'base_link -0.4 -0.3 0 0.4 0.3 1.2', with a ; between boxes");
    o("filter_ground", filter_ground, "",
      "true: returns from the ground clear and don't occupy, for planners that take all that is occupied for "
      "an "
      "obstacle");
    o("base_frame_id", base_frame_id, "", "filter_ground: a frame at whose z = 0 the ground is, z upwards")
        .notEmpty();
    o.group("ground_filter", "which returns are the ground", ground_filter);
    o.section("the output");
    o("publish_rate", publish_rate, "Hz", "what changed is published this often at most")
        .within(0.1, 100.0)
        .dynamic();
    display.describe(o);
  }
};

}  // namespace rtree_occupancy_map
