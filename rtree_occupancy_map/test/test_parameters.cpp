// SPDX-License-Identifier: BSD-3-Clause
#include <gtest/gtest.h>
#include <yaml-cpp/yaml.h>

#include <cmath>
#include <stdexcept>

#include "rtree_occupancy_map/ros/parameters.h"

namespace rtree_occupancy_map {
namespace {

using XmlRpc::XmlRpcValue;

XmlRpcValue fromYaml(const YAML::Node& node) {
  XmlRpcValue value;
  if (node.IsMap()) {
    for (const auto& member : node) value[member.first.as<std::string>()] = fromYaml(member.second);
  } else if (node.Tag() == "!") {  // quoted
    value = XmlRpcValue(node.as<std::string>());
  } else if (bool flag; YAML::convert<bool>::decode(node, flag)) {
    value = XmlRpcValue(flag);
  } else if (int whole; YAML::convert<int>::decode(node, whole)) {
    value = XmlRpcValue(whole);
  } else if (double number; YAML::convert<double>::decode(node, number)) {
    value = XmlRpcValue(number);
  } else {
    value = XmlRpcValue(node.as<std::string>());
  }
  return value;
}

std::set<std::string> leafs(const YAML::Node& node, const std::string& prefix = "") {
  std::set<std::string> names;
  for (const auto& member : node) {
    const auto name = prefix + member.first.as<std::string>();
    if (member.second.IsMap()) {
      names.merge(leafs(member.second, name + "/"));
    } else {
      names.insert(name);
    }
  }
  return names;
}

MappingParameters read(const std::string& yaml) {
  mapping_common::Parameters reader(fromYaml(YAML::Load(yaml)));
  const auto parameters = readMappingParameters(reader);
  reader.rejectUnknown({"reconfigure/"});
  return parameters;
}

void expectRejected(const std::string& yaml, const std::vector<std::string>& texts) {
  try {
    read(yaml);
    ADD_FAILURE() << "accepted: " << yaml;
  } catch (const std::invalid_argument& e) {
    for (const std::string& text : texts)
      EXPECT_NE(std::string::npos, std::string(e.what()).find(text)) << e.what();
  }
}

TEST(Parameters, NothingSetGivesTheDefaults) {
  const auto p = read("{}");
  const Options o;
  EXPECT_EQ(o.resolution, p.map.resolution);
  EXPECT_EQ(o.prob_hit, p.map.prob_hit);
  EXPECT_EQ(o.fusion_rule, p.map.fusion_rule);
  EXPECT_EQ(o.fusion_strategy, p.map.fusion_strategy);
  EXPECT_EQ(o.sensor_model, p.map.sensor_model);
  EXPECT_EQ(o.tree.split, p.map.tree.split);
  EXPECT_EQ(o.seed, p.map.seed);
  EXPECT_TRUE(std::isinf(p.map.max_range));
}

TEST(Parameters, EachReachesItsOption) {
  const auto p = read(R"(
    {frame_id: odom, resolution: 1, map_file: /a, save_on_shutdown: /b, reflectivity: true, dynamic: false, seed: 7,
     sensor_model: {type: endpoint, hit: 0.8, miss: 0.3, min: 0.1, max: 0.9, prior: 0.4, occupancy_threshold: 0.6,
                    min_range: 2, max_range: 30},
     fusion: {rule: thesis, strategy: expansion, search_order: xyz, samples_per_metre: 2},
     tree: {min_entries: 20, max_entries: 50, split: rstar},
     queue_size: 3, transform_tolerance: 0.1, pointcloud_min_z: -1, pointcloud_max_z: 2, no_return_clears: false,
     publish_rate: 5, full_map_period: 20, latch: false, publish_free_space: true, color_mode: reflectivity,
     color_min: 10, color_max: 20, occupancy_min_z: 0.1, occupancy_max_z: 1.5, reconfigure: {color_min: 3}})");
  EXPECT_EQ("odom", p.display.frame_id);
  EXPECT_EQ(1.0, p.map.resolution);
  EXPECT_EQ("/a", p.map_file);
  EXPECT_EQ("/b", p.save_on_shutdown);
  EXPECT_TRUE(p.map.reflectivity);
  EXPECT_FALSE(p.map.dynamic);
  EXPECT_EQ(7u, p.map.seed);
  EXPECT_EQ(SensorModel::kEndPoint, p.map.sensor_model);
  EXPECT_EQ(0.8, p.map.prob_hit);
  EXPECT_EQ(0.3, p.map.prob_miss);
  EXPECT_EQ(0.1, p.map.clamping_min);
  EXPECT_EQ(0.9, p.map.clamping_max);
  EXPECT_EQ(0.4, p.map.prior);
  EXPECT_EQ(0.6, p.map.occupancy_threshold);
  EXPECT_EQ(2.0, p.map.min_range);
  EXPECT_EQ(30.0, p.map.max_range);
  EXPECT_EQ(FusionRule::kThesis, p.map.fusion_rule);
  EXPECT_EQ(FusionStrategy::kExpansion, p.map.fusion_strategy);
  EXPECT_EQ("xyz", p.map.search_order);
  EXPECT_EQ(2.0, p.map.samples_per_metre);
  EXPECT_EQ(20, p.map.tree.min_entries);
  EXPECT_EQ(50, p.map.tree.max_entries);
  EXPECT_EQ(SplitMethod::kRStar, p.map.tree.split);
  EXPECT_EQ(3, p.queue_size);
  EXPECT_EQ(0.1, p.transform_tolerance);
  EXPECT_EQ(-1.0, p.scan.min_z);
  EXPECT_EQ(2.0, p.scan.max_z);
  EXPECT_FALSE(p.scan.no_return_clears);
  EXPECT_EQ(5.0, p.publish_rate);
  EXPECT_EQ(20.0, p.display.full_map_period);
  EXPECT_FALSE(p.display.latch);
  EXPECT_TRUE(p.display.publish_free_space);
  EXPECT_EQ("reflectivity", p.color_mode);
  EXPECT_EQ(ColorMode::kReflectivity, p.display.color.mode);
  EXPECT_EQ(10.0, p.display.color.min);
  EXPECT_EQ(20.0, p.display.color.max);
  EXPECT_EQ(0.1, p.display.occupancy_min_z);
  EXPECT_EQ(1.5, p.display.occupancy_max_z);
}

TEST(Parameters, RejectionNamesParameterValueAndWhatIsAllowed) {
  expectRejected("resolution: 0", {"~resolution", "is 0,", "more than 0"});
  expectRejected("resolution: fine", {"~resolution", "fine", "a number"});
  expectRejected("sensor_model: {hit: 1.5}", {"~sensor_model/hit", "1.5", "0.5 to"});
  expectRejected("sensor_model: {hit: true}", {"~sensor_model/hit", "a number"});
  expectRejected("sensor_model: {miss: 0.6}", {"~sensor_model/miss", "0.6", "to 0.5"});
  expectRejected("sensor_model: {min: 0.5}", {"~sensor_model/min", "0.5", "below 0.5"});
  expectRejected("sensor_model: {max: 0.4}", {"~sensor_model/max", "0.4", "above 0.5"});
  expectRejected("sensor_model: {prior: 0.05}", {"~sensor_model/prior", "0.05", "between"});
  expectRejected("sensor_model: {occupancy_threshold: 0.99}", {"~sensor_model/occupancy_threshold", "0.99"});
  expectRejected("sensor_model: {type: laser}", {"~sensor_model/type", "laser", "beam | endpoint"});
  expectRejected("sensor_model: {min_range: -1}", {"~sensor_model/min_range", "-1"});
  expectRejected("sensor_model: {max_range: -2}", {"~sensor_model/max_range", "-2"});
  expectRejected("sensor_model: {min_range: 5, max_range: 4}",
                 {"~sensor_model/max_range", "4", "more than min_range"});
  expectRejected("fusion: {rule: some}", {"~fusion/rule", "some", "thesis | equal"});
  expectRejected("fusion: {strategy: some}", {"~fusion/strategy", "some", "block | expansion | none"});
  expectRejected("fusion: {search_order: xx}", {"~fusion/search_order", "xx", "permutation"});
  expectRejected("fusion: {samples_per_metre: -1}", {"~fusion/samples_per_metre", "-1"});
  expectRejected("seed: -1", {"~seed", "-1", "0 to"});
  expectRejected("dynamic: 1", {"~dynamic", "1", "true or false"});
  expectRejected("tree: {min_entries: 9}", {"~tree", "min_entries", "9"});
  expectRejected("tree: {max_entries: 300}", {"~tree", "max_entries", "300"});
  expectRejected("tree: {max_entries: 16.5}", {"~tree/max_entries", "16.5", "an integer"});
  expectRejected("tree: {split: half}", {"~tree/split", "half", "quadratic | linear | rstar"});
  expectRejected("queue_size: 0", {"~queue_size", "0", "1 to"});
  expectRejected("transform_tolerance: -0.1", {"~transform_tolerance", "-0.1", "0 to"});
  expectRejected("{pointcloud_min_z: 2, pointcloud_max_z: 1}", {"~pointcloud_max_z", "1", "2 to inf"});
  expectRejected("publish_rate: 0", {"~publish_rate", "0", "0.1 to 100"});
  expectRejected("publish_rate: .nan", {"~publish_rate", "nan", "0.1 to 100"});
  expectRejected("full_map_period: -1", {"~full_map_period", "-1", "0 to"});
  expectRejected("color_mode: pink", {"color_mode", "pink", "height | occupancy | reflectivity"});
  expectRejected("{color_min: 3, color_max: 3}", {"color_max", "3", "more than color_min"});
  expectRejected("{occupancy_min_z: 3, occupancy_max_z: 2}",
                 {"occupancy_max_z", "2", "more than occupancy_min_z"});
  expectRejected("frame_id: ''", {"~frame_id", "''"});
  expectRejected("frame_id: true", {"~frame_id", "1", "a string"});
}

TEST(Parameters, UnknownOnesAreRejected) {
  expectRejected("resolutoin: 0.1", {"unknown: ~resolutoin (~resolution?);", "~resolution"});
  expectRejected("sensor_model: {hits: 0.7}", {"unknown: ~sensor_model/hits (", "~sensor_model/hit,"});
  expectRejected("sensor_model: beam", {"unknown: ~sensor_model (", "~sensor_model/type"});
  expectRejected("resolution: {x: 1}", {"unknown: ~resolution/x ("});
}

TEST(Parameters, TheShippedFileHoldsThemAllWithTheirDefaults) {
  const YAML::Node file = YAML::LoadFile(PACKAGE_DIR "/config/mapping.yaml");
  mapping_common::Parameters shipped(fromYaml(file)), unset{XmlRpcValue()};
  const auto p = readMappingParameters(shipped), q = readMappingParameters(unset);
  EXPECT_EQ(shipped.names(), leafs(file));
  const auto tuple = [](const MappingParameters& m) {
    const Options& o = m.map;
    return std::make_tuple(
        o.resolution, o.prob_hit, o.prob_miss, o.clamping_min, o.clamping_max, o.prior, o.occupancy_threshold,
        o.min_range, o.max_range, o.sensor_model, o.fusion_rule, o.fusion_strategy, o.search_order,
        o.samples_per_metre, o.seed, o.dynamic, o.reflectivity,
        std::make_tuple(o.tree.min_entries, o.tree.max_entries, o.tree.split, m.scan.min_z, m.scan.max_z,
                        m.scan.no_return_clears, m.map_file, m.save_on_shutdown, m.queue_size,
                        m.transform_tolerance, m.publish_rate, m.color_mode, m.display.frame_id,
                        m.display.color.min, m.display.color.max, m.display.occupancy_min_z,
                        m.display.occupancy_max_z, m.display.full_map_period, m.display.publish_free_space,
                        m.display.latch));
  };
  EXPECT_EQ(tuple(q), tuple(p));
}

}  // namespace
}  // namespace rtree_occupancy_map
