// SPDX-License-Identifier: BSD-3-Clause
#include "intensity_hector_slam/ros/reconfiguration.h"

#include <string>

namespace intensity_hector_slam {

SlamConfig startConfig(mapping_common::Parameters& reader, const SlamParameters& parameters) {
  SlamConfig config;
  config.cost = reader.get<std::string>("cost", "combined");
  config.occupancy_weight = parameters.slam.matcher.occupancy_weight;
  config.reflectivity_weight = parameters.slam.matcher.reflectivity_weight;
  config.robust_kernel = reader.get<std::string>("robust_kernel", "cauchy");
  config.robust_scale = parameters.slam.matcher.robust_scale;
  config.search = reader.get<std::string>("search", "when_unsure");
  config.localization = parameters.slam.localization;
  config.map_update_distance_thresh = parameters.slam.update_distance;
  config.map_update_angle_thresh = parameters.slam.update_angle;
  config.max_contradiction = parameters.slam.max_contradiction;
  config.map_pub_period = parameters.map_pub_period;
  return config;
}

SlamOptions reconfigured(SlamOptions options, const SlamConfig& config) {
  options.matcher.cost = parseCost(config.cost);
  options.matcher.occupancy_weight = config.occupancy_weight;
  options.matcher.reflectivity_weight = config.reflectivity_weight;
  options.matcher.robust_kernel = parseRobustKernel(config.robust_kernel);
  options.matcher.robust_scale = config.robust_scale;
  options.matcher.search = parseSearch(config.search);
  options.localization = config.localization;
  options.update_distance = config.map_update_distance_thresh;
  options.update_angle = config.map_update_angle_thresh;
  options.max_contradiction = config.max_contradiction;
  options.validate();
  return options;
}

}  // namespace intensity_hector_slam
