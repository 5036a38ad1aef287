// SPDX-License-Identifier: BSD-3-Clause
//
// simulate_city as a user runs it.
#include <gtest/gtest.h>
#include <mapping_common/files.h>
#include <mapping_common/testing/tool_test.h>
#include <mapping_simulation/testing/worlds.h>

#include <cstring>
#include <filesystem>
#include <sstream>
#include <string>

namespace mapping_simulation {
namespace {

class SimulateCity : public mapping_common::ToolTest {
 protected:
  SimulateCity() : ToolTest(SIMULATE_CITY) {}
};

TEST_F(SimulateCity, WritesCloudsImagesAndPosesOfAllVisits) {
  const std::string out = dir_.path("city");
  outputOf("--sensor " + configFile("simulator/velodyne_vlp16.yaml") + " --sensor " +
               configFile("simulator/camera_front.yaml") + " --places 2 --out " + out,
           0);
  std::istringstream visits(mapping_common::readFile(out + "/visits.csv"));
  std::string line;
  std::getline(visits, line);
  EXPECT_EQ("number,place,visit,night", line);
  int rows = 0;
  while (std::getline(visits, line)) ++rows;
  EXPECT_EQ(4, rows);
  for (int i = 0; i < 4; ++i) {
    const std::string number = "/00000" + std::to_string(i);
    const std::string cloud = mapping_common::readFile(out + "/velodyne_points" + number + ".bin");
    EXPECT_EQ(0u, cloud.size() % 16);
    EXPECT_GT(cloud.size(), 16u * 10000u);
    float values[4];
    std::memcpy(values, cloud.data(), sizeof(values));
    EXPECT_GT(std::hypot(values[0], values[1], values[2]), 0.4f);
    EXPECT_GT(std::filesystem::file_size(out + "/front" + number + ".png"), 1000u);
  }
  std::istringstream poses(mapping_common::readFile(out + "/velodyne_points/poses.txt"));
  for (int i = 0; i < 4; ++i) {
    int number;
    double value[12];
    poses >> number;
    for (double& v : value) poses >> v;
    ASSERT_TRUE(poses);
    EXPECT_EQ(i, number);
    EXPECT_NEAR(0.9, value[11], 1e-9);  // the mount's height
  }
}

TEST_F(SimulateCity, SaysWhatIsWrong) {
  EXPECT_NE(std::string::npos, outputOf("--out " + dir_.path("city"), 2).find("--sensor"));
  const std::string planar = configFile("simulator/hokuyo_utm30lx.yaml");
  EXPECT_NE(std::string::npos,
            outputOf("--sensor " + planar + " --out " + dir_.path("city"), 1).find("planar"));
  const std::string camera = " --sensor " + configFile("simulator/camera_front.yaml");
  EXPECT_NE(
      std::string::npos,
      outputOf(camera + camera + " --out " + dir_.path("city"), 1).find("two sensors with the topic front"));
}

}  // namespace
}  // namespace mapping_simulation
