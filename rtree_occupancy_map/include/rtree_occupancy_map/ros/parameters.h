// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <mapping_common/parameters.h>
#include <rtree_occupancy_map/options.h>
#include <rtree_occupancy_map/ros/map_publisher.h>
#include <rtree_occupancy_map/ros/scan_conversion.h>

#include <string>

namespace rtree_occupancy_map {

/// What the mapping nodelet is started with; config/mapping.yaml explains each.
struct MappingParameters {
  Options map;
  ScanLimits scan;
  DisplayOptions display;
  std::string color_mode = "height";
  std::string map_file;
  std::string save_on_shutdown;
  int queue_size = 10;
  double transform_tolerance = 0.0;  ///< s
  double publish_rate = 2.0;         ///< Hz
};

/// @throws std::invalid_argument that names the parameter, its value and the allowed range
MappingParameters readMappingParameters(mapping_common::Parameters& parameters);

/// -1, as in octomap_server, stands for no limit: infinity.
double maxRange(double parameter);

}  // namespace rtree_occupancy_map
