// SPDX-License-Identifier: BSD-3-Clause
#include <gtest/gtest.h>
#include <mapping_common/testing/parameters.h>
#include <mapping_common/testing/temp_dir.h>

#include "intensity_hector_slam/ros/parameters.h"

namespace intensity_hector_slam {
namespace {

SlamParameters read(const std::string& yaml) {
  const mapping_common::TempDir dir;
  SlamParameters parameters;
  mapping_common::assign(parameters, mapping_common::loadYaml(dir.write("test.yaml", yaml)), {}, "~");
  parameters.resolve();
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

TEST(Parameters, AreSoundAndDocumented) {
  mapping_common::expectSound<SlamParameters>();
  mapping_common::expectDocumented<SlamParameters>(
      "intensity_hector_slam/SlamNodelet and of slam_bag", PACKAGE_DIR "/config/slam.yaml",
      PACKAGE_DIR "/docs/parameters.md", "Names are those of hector_mapping where it has the like.");
}

TEST(Parameters, OfOtherFilesThatShipAreRead) {
  for (const char* name : {"slam_carmen", "slam_street"}) {
    SlamParameters parameters;
    EXPECT_NO_THROW(mapping_common::assign(
        parameters, mapping_common::loadYaml(PACKAGE_DIR "/config/" + std::string(name) + ".yaml")));
  }
}

TEST(Parameters, AreCheckedByName) {
  expectRejected("map_resolution: 0", "~map_resolution is 0, allowed is 0.001 to 10");
  expectRejected("cost: intensity", "~cost is 'intensity', allowed is occupancy | reflectivity | ");
  expectRejected("{occupancy_weight: 0, reflectivity_weight: 0}",
                 "~occupancy_weight is 0, allowed is more than 0");
  expectRejected("min_step_angle: 0.2", "~min_step_angle is 0.2, allowed is 0 to max_step_angle");
  expectRejected("{map_size: 8, map_multi_res_levels: 3}", "~map_size is 8, allowed is at least");
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
  EXPECT_TRUE(read("{pub_drawings: false, pub_debug_output: false}").warnings().empty());
  EXPECT_EQ(2u, read("{pub_drawings: true, pub_debug_output: true}").warnings().size());
  EXPECT_EQ("base_link", read("base_frame: /base_link").base_frame);
  expectRejected("base_frame: /", "~base_frame is '/'");
  // Whole numbers for any, as rosparam and roslaunch make them; map_size in cells of the finest level.
  const SlamParameters p = read("{map_resolution: 1, map_size: 2048, map_start_x: 0, laser_max_dist: 30}");
  EXPECT_EQ(2048, p.slam.map.size);
  EXPECT_EQ(0.0, p.slam.map.start_x);
}

}  // namespace
}  // namespace intensity_hector_slam
