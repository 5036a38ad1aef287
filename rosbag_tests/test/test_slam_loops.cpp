// SPDX-License-Identifier: BSD-3-Clause
#include <gtest/gtest.h>
#include <mapping_common/testing/recordings.h>
#include <mapping_common/testing/tool_test.h>

#include <regex>

namespace rosbag_tests {
namespace {

class SlamLoops : public mapping_common::ToolTest {
 protected:
  SlamLoops() : ToolTest(EVALUATE_SLAM_LOOPS) {}
};

// Wheels that count backwards as forwards, a scan each metre, and cells at which the map was lost when
// odometry was believed wherever a scan fitted well.
TEST_F(SlamLoops, EveryThirdScanOfARecordingIsEnough) {
  const std::string name = "laser2d_carmen/fr079", log = mapping_common::findRecording(name + ".clf.gz"),
                    relations = mapping_common::findRecording(name + ".relations");
  if (log.empty() || relations.empty()) GTEST_SKIP() << mapping_common::withoutRecording(name);
  const std::string bag = dir_.path("fr079.bag"), stamps = dir_.path("stamps");
  ASSERT_EQ(0, mapping_common::run(CARMEN_TO_BAG " " + log + " " + bag + " --stamps " + stamps).code);
  const std::string out = outputOf("--bag " + bag +
                                   " --scan /scan --odom odom --config " PACKAGE_DIR
                                   "/../intensity_hector_slam/config/slam_carmen.yaml --relations " +
                                   relations + " --stamps " + stamps + " --resolutions 0.05 --every 3");
  // The mean errors of the front end and with loops, each followed by the greatest.
  const std::regex row(R"(\| +([0-9.]+) \([0-9.]+\) \| +([0-9.]+) \([0-9.]+\) \|)");
  std::smatch errors;
  ASSERT_TRUE(std::regex_search(out, errors, row)) << out;
  EXPECT_LT(std::stod(errors[1]), 0.06);
  EXPECT_LT(std::stod(errors[2]), 0.06);
}

}  // namespace
}  // namespace rosbag_tests
