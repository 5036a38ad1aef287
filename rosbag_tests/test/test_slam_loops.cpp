// SPDX-License-Identifier: BSD-3-Clause
#include <gtest/gtest.h>
#include <mapping_common/testing/recordings.h>
#include <mapping_common/testing/tool_test.h>

#include <algorithm>
#include <array>
#include <regex>
#include <string>
#include <vector>

namespace rosbag_tests {
namespace {

class SlamLoops : public mapping_common::ToolTest {
 protected:
  SlamLoops() : ToolTest(EVALUATE_SLAM_LOOPS) {}
};

// Wheels that count backwards as forwards, and a scan each metre: maps are lost where odometry is believed
// wherever a scan fits well. By chance one in a dozen is, anyway, so that one of two has to be right.
TEST_F(SlamLoops, EveryThirdScanOfARecordingIsEnough) {
  const std::string name = "laser2d_carmen/fr079", log = mapping_common::findRecording(name + ".clf.gz"),
                    relations = mapping_common::findRecording(name + ".relations");
  if (log.empty() || relations.empty()) GTEST_SKIP() << mapping_common::withoutRecording(name);
  const std::string bag = dir_.path("fr079.bag"), stamps = dir_.path("stamps");
  ASSERT_EQ(0, mapping_common::run(CARMEN_TO_BAG " " + log + " " + bag + " --stamps " + stamps).code);
  const std::string out = outputOf("--bag " + bag +
                                   " --scan /scan --odom odom --config " PACKAGE_DIR
                                   "/../intensity_hector_slam/config/slam_carmen.yaml --relations " +
                                   relations + " --stamps " + stamps + " --resolutions 0.05 0.051 --every 3");
  // The mean errors of the front end and with loops, each followed by the greatest.
  const std::regex row(R"(\| +([0-9.]+) \([0-9.]+\) \| +([0-9.]+) \([0-9.]+\) \|)");
  std::array<std::vector<double>, 2> errors;
  for (std::sregex_iterator match(out.begin(), out.end(), row), end; match != end; ++match)
    for (std::size_t i = 0; i < errors.size(); ++i) errors[i].push_back(std::stod((*match)[i + 1]));
  for (const std::vector<double>& rows : errors) {
    ASSERT_EQ(2u, rows.size()) << out;
    EXPECT_LT(std::min(rows[0], rows[1]), 0.06) << out;
  }
}

}  // namespace
}  // namespace rosbag_tests
