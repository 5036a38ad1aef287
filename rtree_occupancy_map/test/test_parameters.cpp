// SPDX-License-Identifier: BSD-3-Clause
#include <gtest/gtest.h>
#include <mapping_common/testing/parameters.h>
#include <mapping_common/testing/temp_dir.h>

#include <cmath>

#include "rtree_occupancy_map/ros/parameters.h"

namespace rtree_occupancy_map {
namespace {

using mapping_common::mentions;

MappingParameters read(const std::string& yaml) {
  const mapping_common::TempDir dir;
  MappingParameters parameters;
  mapping_common::assign(parameters, mapping_common::loadYaml(dir.write("a.yaml", yaml)));
  return parameters;
}

std::string rejection(const std::string& yaml) {
  const mapping_common::TempDir dir;
  return mapping_common::rejection<MappingParameters>(dir.write("a.yaml", yaml));
}

TEST(Parameters, AreSoundAndDocumented) {
  mapping_common::expectSound<MappingParameters>();
  mapping_common::expectDocumented<MappingParameters>("rtree_occupancy_map/MappingNodelet",
                                                      PACKAGE_DIR "/config/mapping.yaml",
                                                      PACKAGE_DIR "/docs/parameters.md");
}

TEST(Parameters, ReachTheirOptions) {
  const auto p = read(R"(
    {resolution: 1, sensor_model: {type: endpoint, hit: 0.8, min_range: 2, max_range: 30},
     fusion: {rule: thesis, strategy: expansion}, tree: {min_entries: 20, max_entries: 50, split: rstar},
     color_mode: reflectivity})");
  EXPECT_EQ(1.0, p.map.resolution);
  EXPECT_EQ(SensorModel::kEndPoint, p.map.sensor_model);
  EXPECT_EQ(0.8, p.map.prob_hit);
  EXPECT_EQ(2.0, p.map.min_range);
  EXPECT_EQ(30.0, p.map.max_range);
  EXPECT_EQ(FusionRule::kThesis, p.map.fusion_rule);
  EXPECT_EQ(FusionStrategy::kExpansion, p.map.fusion_strategy);
  EXPECT_EQ(20, p.map.tree.min_entries);
  EXPECT_EQ("rstar", p.map.tree.split);
  EXPECT_EQ(ColorMode::kReflectivity, p.display.color.mode);
  EXPECT_EQ(0.0, p.display.color.min);
  EXPECT_TRUE(std::isinf(read("sensor_model: {max_range: -1}").map.max_range));
}

TEST(Parameters, RejectionNamesParameterValueAndWhatIsAllowed) {
  EXPECT_TRUE(
      mentions(rejection("resolution: 0"), {"~resolution is 0, allowed is above 0 to below 1000000 m"}));
  EXPECT_TRUE(mentions(rejection("resolution: fine"), {"~resolution is 'fine', expected is a number"}));
  EXPECT_TRUE(mentions(rejection("sensor_model: {hit: 1.5}"),
                       {"~sensor_model/hit is 1.5, allowed is 0.5 to below 1"}));
  EXPECT_TRUE(mentions(rejection("sensor_model: {prior: 0.05}"), {"~sensor_model/prior is 0.05", "between"}));
  EXPECT_TRUE(mentions(rejection("sensor_model: {occupancy_threshold: 0.99}"),
                       {"~sensor_model/occupancy_threshold is 0.99", "between"}));
  EXPECT_TRUE(mentions(rejection("sensor_model: {type: laser}"),
                       {"~sensor_model/type is 'laser', allowed is beam | endpoint"}));
  EXPECT_TRUE(mentions(rejection("sensor_model: {max_range: -2}"), {"~sensor_model/max_range is -2"}));
  EXPECT_TRUE(mentions(rejection("sensor_model: {min_range: 5, max_range: 4}"),
                       {"~sensor_model/max_range is 4, allowed is more than min_range"}));
  EXPECT_TRUE(mentions(rejection("fusion: {search_order: xx}"), {"~fusion/search_order is 'xx'", "zxy"}));
  EXPECT_TRUE(
      mentions(rejection("tree: {min_entries: 9}"), {"~tree/min_entries is 9, allowed is 1 to half"}));
  EXPECT_TRUE(mentions(rejection("{pointcloud_min_z: 2, pointcloud_max_z: 1}"), {"~pointcloud_max_z is 1"}));
  EXPECT_TRUE(
      mentions(rejection("{color_min: 3, color_max: 3}"), {"~color_max is 3", "more than color_min"}));
  EXPECT_TRUE(mentions(rejection("{occupancy_min_z: 3, occupancy_max_z: 2}"), {"~occupancy_max_z is 2"}));
  EXPECT_TRUE(mentions(rejection("frame_id: ''"), {"~frame_id is ''"}));
  EXPECT_TRUE(mentions(rejection("resolutoin: 0.1"), {"unknown: ~resolutoin (~resolution?);"}));
  EXPECT_TRUE(
      mentions(rejection("sensor_model: {hits: 0.7}"), {"unknown: ~sensor_model/hits (~sensor_model/hit?)"}));
}

}  // namespace
}  // namespace rtree_occupancy_map
