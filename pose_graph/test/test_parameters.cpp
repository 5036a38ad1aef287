// SPDX-License-Identifier: BSD-3-Clause
#include <gtest/gtest.h>
#include <mapping_common/testing/parameters.h>
#include <mapping_common/testing/temp_dir.h>

#include "pose_graph/ros/parameters.h"

namespace pose_graph {
namespace {

TEST(Parameters, AreSoundAndDocumented) {
  mapping_common::expectSound<PoseGraphParameters>();
  mapping_common::expectDocumented<PoseGraphParameters>("pose_graph/PoseGraphNodelet",
                                                        PACKAGE_DIR "/config/pose_graph.yaml",
                                                        PACKAGE_DIR "/docs/parameters.md");
}

TEST(Parameters, AreRejectedByName) {
  const mapping_common::TempDir dir;
  const auto rejection = [&](const std::string& yaml) {
    return mapping_common::rejection<PoseGraphParameters>(dir.write("a.yaml", yaml));
  };
  EXPECT_EQ("~front_end_pose is 'gps', allowed is topic | tf", rejection("front_end_pose: gps"));
  EXPECT_EQ("~graph/confidence is 1, allowed is above 0.5 to below 1", rejection("graph: {confidence: 1.0}"));
}

}  // namespace
}  // namespace pose_graph
