// SPDX-License-Identifier: BSD-3-Clause
#include "rtree_occupancy_map/ros/parameters.h"

#include <limits>
#include <stdexcept>

namespace rtree_occupancy_map {
double maxRange(double parameter) {
  return parameter == -1.0 ? std::numeric_limits<double>::infinity() : parameter;
}

MappingParameters readMappingParameters(mapping_common::Parameters& p) {
  constexpr double kInfinity = std::numeric_limits<double>::infinity();
  MappingParameters m;
  Options& o = m.map;
  // The checks of others don't know what a parameter is called here.
  const auto check = [](const std::string& name, const auto& statement) {
    try {
      statement();
    } catch (const std::invalid_argument& e) {
      throw std::invalid_argument('~' + name + ": " + e.what());
    }
  };
  const auto option = [&](const std::string& name, double& value) {
    value = p.get(name, value);
    check(name, [&] { o.validate(); });
  };
  const auto choice = [&](const std::string& name, const std::string& fallback, auto& value,
                          const auto& parse) {
    const std::string text = p.get(name, fallback);
    check(name, [&] { value = parse(text); });
  };

  option("resolution", o.resolution);
  choice("sensor_model/type", "beam", o.sensor_model, parseSensorModel);
  option("sensor_model/hit", o.prob_hit);
  option("sensor_model/miss", o.prob_miss);
  option("sensor_model/min", o.clamping_min);
  option("sensor_model/max", o.clamping_max);
  option("sensor_model/prior", o.prior);
  option("sensor_model/occupancy_threshold", o.occupancy_threshold);
  option("sensor_model/min_range", o.min_range);
  o.max_range = maxRange(p.get("sensor_model/max_range", -1.0));
  check("sensor_model/max_range", [&o] { o.validate(); });
  choice("fusion/rule", "equal", o.fusion_rule, parseFusionRule);
  choice("fusion/strategy", "block", o.fusion_strategy, parseFusionStrategy);
  o.search_order = p.get("fusion/search_order", o.search_order);
  check("fusion/search_order", [&o] { o.validate(); });
  option("fusion/samples_per_metre", o.samples_per_metre);
  o.seed = p.get("seed", 1, 0, std::numeric_limits<int>::max());
  o.dynamic = p.get("dynamic", o.dynamic);
  o.reflectivity = p.get("reflectivity", o.reflectivity);
  o.tree.min_entries = p.get("tree/min_entries", o.tree.min_entries);
  o.tree.max_entries = p.get("tree/max_entries", o.tree.max_entries);
  check("tree", [&o] { o.validate(); });
  choice("tree/split", "quadratic", o.tree.split, parseSplitMethod);

  m.scan.min_z = p.get("pointcloud_min_z", -kInfinity, -kInfinity, kInfinity);
  m.scan.max_z = p.get("pointcloud_max_z", kInfinity, m.scan.min_z, kInfinity);
  m.scan.no_return_clears = p.get("no_return_clears", m.scan.no_return_clears);
  m.queue_size = p.get("queue_size", m.queue_size, 1, 10000);
  m.transform_tolerance = p.get("transform_tolerance", m.transform_tolerance, 0.0, 10.0);

  DisplayOptions& d = m.display;
  d.frame_id = p.get("frame_id", d.frame_id);
  if (d.frame_id.empty()) mapping_common::rejectParameter("frame_id", "''", "allowed is the name of a frame");
  m.publish_rate = p.get("publish_rate", m.publish_rate, 0.1, 100.0);
  d.full_map_period = p.get("full_map_period", d.full_map_period, 0.0, 1e6);
  d.latch = p.get("latch", d.latch);
  d.publish_free_space = p.get("publish_free_space", d.publish_free_space);
  m.color_mode = p.get("color_mode", m.color_mode);
  check("color_mode", [&] { d.color.mode = parseColorMode(m.color_mode); });
  d.color.min = p.get("color_min", d.color.min);
  d.color.max = p.get("color_max", d.color.max);
  d.occupancy_min_z = p.get("occupancy_min_z", d.occupancy_min_z);
  d.occupancy_max_z = p.get("occupancy_max_z", d.occupancy_max_z);
  d.validate();

  m.map_file = p.get("map_file", m.map_file);
  m.save_on_shutdown = p.get("save_on_shutdown", m.save_on_shutdown);
  return m;
}

}  // namespace rtree_occupancy_map
