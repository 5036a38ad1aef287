// SPDX-License-Identifier: BSD-3-Clause
#include <gtest/gtest.h>
#include <mapping_common/testing/temp_dir.h>

#include <cmath>
#include <limits>
#include <stdexcept>

#include "rtree_occupancy_map/robot_body.h"

namespace rtree_occupancy_map {
namespace {

TEST(RobotBody, IsReadAsItIsWritten) {
  EXPECT_TRUE(parseRobotBody("").empty());
  EXPECT_TRUE(parseRobotBody(" ; ").empty());
  const auto boxes = parseRobotBody("base_link -0.4 -0.3 0 0.4 0.3 1.2;arm/tip 0 0 0 .1 .2 3e-1 ;");
  ASSERT_EQ(2u, boxes.size());
  EXPECT_EQ("base_link", boxes[0].frame);
  EXPECT_EQ(Eigen::Vector3d(-0.4, -0.3, 0.0), boxes[0].box.min());
  EXPECT_EQ(Eigen::Vector3d(0.4, 0.3, 1.2), boxes[0].box.max());
  EXPECT_EQ("arm/tip", boxes[1].frame);
  EXPECT_EQ(Eigen::Vector3d(0.1, 0.2, 0.3), boxes[1].box.max());
  for (const char* wrong : {"base_link", "base_link 1 2 3 4 5", "base_link 0 0 0 1 1 1 1", "0 0 0 1 1 1",
                            "base_link 0 0 0 1 1 x", "base_link 0 0 2 1 1 1", "base_link 0 0 0 1 1 inf"}) {
    try {
      parseRobotBody(std::string("a 0 0 0 1 1 1; ") + wrong);
      ADD_FAILURE() << wrong;
    } catch (const std::invalid_argument& e) {
      EXPECT_TRUE(mapping_common::mentions(e.what(), {wrong, "FRAME MIN_X"}));
    }
  }
}

TEST(RobotBody, TakesItsHitsOut) {
  // A box 2 m long along its x, which points along the map's y from (10, 0, 0) on.
  const Eigen::AlignedBox3d box(Eigen::Vector3d(0, -0.5, -0.5), Eigen::Vector3d(2, 0.5, 0.5));
  Eigen::Isometry3d pose(Eigen::AngleAxisd(M_PI / 2, Eigen::Vector3d::UnitZ()));
  pose.translation() = Eigen::Vector3d(10, 0, 0);
  const float nan = std::numeric_limits<float>::quiet_NaN();
  Scan scan;
  scan.hits = {
      {10.0F, 1.9F, 0.0F}, {10.0F, 2.1F, 0.0F}, {nan, 0.0F, 0.0F}, {10.4F, 0.1F, 0.4F}, {0.0F, 0.0F, 0.0F}};
  scan.reflectivity = {0.0F, 1.0F, 2.0F, 3.0F, 4.0F};
  EXPECT_EQ(2u, removeHitsIn(box, pose, scan));
  ASSERT_EQ(3u, scan.hits.size());
  EXPECT_EQ((std::vector<float>{1.0F, 2.0F, 4.0F}), scan.reflectivity);
  EXPECT_EQ(2.1F, scan.hits[0].y());
  scan.reflectivity.clear();
  EXPECT_EQ(0u, removeHitsIn(box, pose, scan));
  EXPECT_EQ(3u, scan.hits.size());
}

}  // namespace
}  // namespace rtree_occupancy_map

int main(int argc, char** argv) {
  testing::InitGoogleTest(&argc, argv);
  return RUN_ALL_TESTS();
}
