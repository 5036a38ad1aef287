// SPDX-License-Identifier: BSD-3-Clause
#include <gtest/gtest.h>
#include <mapping_common/testing/temp_dir.h>
#include <yaml-cpp/yaml.h>

#include <set>

#include "intensity_hector_slam/ros/parameters.h"

namespace intensity_hector_slam {
namespace {

const std::string kConfig = PACKAGE_DIR "/config/slam.yaml";

SlamParameters read(const std::string& yaml) {
  const mapping_common::TempDir dir;
  mapping_common::Parameters reader(loadYaml(dir.write("test.yaml", yaml)));
  const SlamParameters parameters = readSlamParameters(reader);
  reader.rejectUnknown();
  return parameters;
}

void expectRejected(const std::string& yaml, const std::string& message) {
  try {
    read(yaml);
    ADD_FAILURE() << "accepted: " << yaml;
  } catch (const std::invalid_argument& e) {
    EXPECT_NE(std::string::npos, std::string(e.what()).find(message)) << e.what();
  }
}

void leafs(const YAML::Node& node, const std::string& prefix, std::set<std::string>& names) {
  for (const auto& member : node) {
    const auto name = prefix + member.first.as<std::string>();
    if (member.second.IsMap()) {
      leafs(member.second, name + "/", names);
    } else {
      names.insert(name);
    }
  }
}

// All of them, and with the defaults that the code has.
TEST(Parameters, AreThoseOfTheFileThatShips) {
  mapping_common::Parameters shipped(loadYaml(kConfig)), none{XmlRpc::XmlRpcValue()};
  const SlamParameters a = readSlamParameters(shipped), b = readSlamParameters(none);
  EXPECT_NO_THROW(shipped.rejectUnknown());
  std::set<std::string> names;
  leafs(YAML::LoadFile(kConfig), "", names);
  EXPECT_EQ(shipped.names(), names);

  const auto options = [](const SlamParameters& p) {
    const MapOptions& map = p.slam.map;
    const MatcherOptions& m = p.slam.matcher;
    return std::vector<double>{map.resolution,
                               map.size_x,
                               map.size_y,
                               map.start_x,
                               map.start_y,
                               double(map.grow),
                               map.max_size,
                               double(map.levels),
                               map.update_factor_free,
                               map.update_factor_occupied,
                               map.clear_margin,
                               map.min_probability,
                               map.max_probability,
                               double(map.max_count),
                               double(m.cost),
                               m.occupancy_weight,
                               m.reflectivity_weight,
                               double(m.robust_kernel),
                               m.robust_scale,
                               double(m.max_iterations),
                               double(m.max_halvings),
                               m.max_step_distance,
                               m.max_step_angle,
                               m.min_step_distance,
                               m.min_step_angle,
                               m.coarse_step,
                               m.coarse_spacing,
                               m.min_cost_change,
                               double(m.coarse_points),
                               m.surface_length,
                               m.min_observability,
                               m.min_texture,
                               m.min_geometry,
                               m.auto_max_spacing,
                               m.auto_min_known,
                               m.sigma,
                               m.covariance_scale,
                               m.covariance_floor,
                               m.unobservable_distance,
                               m.unobservable_angle,
                               double(m.search),
                               m.search_gap,
                               m.search_motion_distance,
                               m.search_motion_angle,
                               m.search_distance,
                               m.search_angle,
                               double(m.search_points),
                               double(p.slam.guess),
                               double(p.slam.localization),
                               double(p.slam.deskew),
                               p.slam.update_distance,
                               p.slam.update_angle,
                               p.slam.update_period,
                               double(p.slam.min_points),
                               p.slam.max_contradiction,
                               p.slam.max_correction_distance,
                               p.slam.max_correction_angle,
                               p.slam.max_speed,
                               p.slam.max_turn_rate,
                               p.slam.max_acceleration,
                               p.slam.max_angular_acceleration,
                               p.slam.max_gap,
                               p.scan.min_range,
                               p.scan.max_range,
                               p.scan.min_z,
                               p.scan.max_z,
                               p.scan.reflectivity_scale,
                               p.scan.max_median_reflectivity,
                               p.key_pose_distance,
                               p.key_pose_angle,
                               p.map_pub_period,
                               p.transform_timeout,
                               double(p.scan_subscriber_queue_size)};
  };
  EXPECT_EQ(options(b), options(a));
  EXPECT_EQ(b.odom_frame, a.odom_frame);
  EXPECT_EQ(b.pub_map_odom_transform, a.pub_map_odom_transform);
}

TEST(Parameters, AreCheckedByName) {
  expectRejected("map_resolution: 0", "~map_resolution is 0, allowed is 0.001 to 10");
  expectRejected("cost: intensity",
                 "~cost is 'intensity', allowed is occupancy | reflectivity | combined | auto");
  expectRejected("robust_scale: -1.0", "~robust_scale is -1, allowed is");
  expectRejected("update_factor_free: 0.6", "~update_factor_free is 0.6, allowed is");
  expectRejected("map_multi_res_levels: 2.5", "~map_multi_res_levels is 2.5, expected is an integer");
  expectRejected("laser_max_dist: 0.1", "~laser_max_dist is 0.1, allowed is");
  expectRejected("base_frame: ''", "~base_frame is ''");
  expectRejected("search: sometimes", "~search is 'sometimes'");
  expectRejected("guess: luck", "~guess is 'luck'");
  expectRejected("localization: true", "without a map_file");
  expectRejected("map_resolutoin: 0.1", "map_resolutoin");
}

TEST(Parameters, OdometryIsInAFrameOfItsOwn) {
  EXPECT_TRUE(read("odom_frame: odom").usesOdometry());
  EXPECT_FALSE(read("odom_frame: base_link").usesOdometry());
  EXPECT_FALSE(read("guess: constant_velocity").usesOdometry());
}

TEST(Parameters, OfHectorMappingAreUnderstood) {
  EXPECT_FALSE(read("use_tf_pose_start_estimate: false").usesOdometry());
  EXPECT_EQ(Guess::kConstantVelocity, read("use_tf_pose_start_estimate: false").slam.guess);
  EXPECT_TRUE(read("use_tf_pose_start_estimate: true").usesOdometry());
  EXPECT_EQ(Guess::kLastPose, read("{use_tf_pose_start_estimate: true, guess: last_pose}").slam.guess);
  EXPECT_TRUE(read("{pub_drawings: false, pub_debug_output: false}").warnings.empty());
  EXPECT_EQ(2u, read("{pub_drawings: true, pub_debug_output: true}").warnings.size());
  EXPECT_EQ("base_link", read("base_frame: /base_link").base_frame);
  expectRejected("base_frame: /", "~base_frame is '/'");
  // Whole numbers for any, as rosparam and roslaunch make them; map_size in cells of the finest level.
  const SlamParameters p = read("{map_resolution: 1, map_size: 2048, map_start_x: 0, laser_max_dist: 30}");
  EXPECT_EQ(2048.0, p.slam.map.size_x);
  EXPECT_EQ(0.0, p.slam.map.start_x);
}

TEST(Parameters, WhatIsNoYamlIsSaid) {
  const mapping_common::TempDir dir;
  const std::string path = dir.write("bad.yaml", "a: [1, 2\nb: }");
  EXPECT_TRUE(
      mapping_common::mentions(mapping_common::errorOf([&] { loadYaml(path); }), {"bad.yaml", "line"}));
  EXPECT_NE("", mapping_common::errorOf([] { loadYaml("/nowhere.yaml"); }));
}

}  // namespace
}  // namespace intensity_hector_slam
