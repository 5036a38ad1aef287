// SPDX-License-Identifier: BSD-3-Clause
//
// simulate_stations as a user runs it.
#include <gtest/gtest.h>
#include <mapping_common/files.h>
#include <mapping_common/testing/tool_test.h>
#include <mapping_simulation/testing/worlds.h>
#include <mapping_simulation/trajectory.h>

#include <Eigen/Geometry>
#include <cmath>
#include <sstream>
#include <string>
#include <vector>

namespace mapping_simulation {
namespace {

class SimulateStations : public mapping_common::ToolTest {
 protected:
  SimulateStations() : ToolTest(SIMULATE_STATIONS) {}
};

// The points of a file that were measured, in the map.
std::vector<Eigen::Vector3d> pointsOf(const std::string& file, const Eigen::Isometry3d& pose) {
  std::istringstream in(mapping_common::readFile(file));
  std::size_t columns = 0, rows = 0;
  in >> columns >> rows;
  double number = 0.0;
  for (int i = 0; i < 12 + 16; ++i) in >> number;
  std::vector<Eigen::Vector3d> points;
  for (std::size_t i = 0; i < columns * rows; ++i) {
    Eigen::Vector3d point;
    in >> point.x() >> point.y() >> point.z() >> number;
    EXPECT_TRUE(number >= 0.0 && number <= 1.0);
    if (!point.isZero(0.0)) points.push_back(pose * point);
  }
  EXPECT_TRUE(in) << file << " is shorter than it says";
  return points;
}

TEST_F(SimulateStations, WritesScansThatFitAtTheirTruePoses) {
  const std::string out = dir_.path("scans");
  outputOf("--sensor " + configFile("simulator/velodyne_vlp16.yaml") + " --world " +
           configFile("worlds/building.yaml") + " --stations 3 --step 4 --tilt 3 --out " + out);
  const std::vector<TimedPose> truth = loadTrajectory(out + "/truth.tum").poses();
  ASSERT_EQ(3u, truth.size());
  for (std::size_t i = 0; i < truth.size(); ++i) {
    EXPECT_EQ(static_cast<double>(i + 1), truth[i].time);
    if (i > 0) {
      const double apart = (truth[i].pose.translation() - truth[i - 1].pose.translation()).norm();
      EXPECT_LT(apart, 4.2);
      EXPECT_GT(apart, 2.0) << "the way bends";
    }
    std::size_t inside = 0, on_the_floor = 0;
    const auto points = pointsOf(out + "/scan_00" + std::to_string(i + 1) + ".ptx", truth[i].pose);
    for (const Eigen::Vector3d& p : points) {
      inside += p.x() > -0.2 && p.x() < 30.2 && p.y() > -0.2 && p.y() < 20.2 && p.z() > -0.2 && p.z() < 3.2;
      on_the_floor += std::abs(p.z()) < 0.05;
    }
    EXPECT_GT(points.size(), 10000u);
    EXPECT_GT(inside, 0.99 * points.size()) << "of the floor of 30 m x 20 m";
    EXPECT_GT(on_the_floor, 100u);
  }
}

TEST_F(SimulateStations, SaysWhatIsWrong) {
  EXPECT_NE(std::string::npos, outputOf("--out " + dir_.path("scans"), 2).find("--sensor"));
  const std::string lidar = "--sensor " + configFile("simulator/velodyne_vlp16.yaml"),
                    out = " --out " + dir_.path("scans");
  EXPECT_NE(std::string::npos,
            outputOf("--sensor " + configFile("simulator/hokuyo_utm30lx.yaml") + out, 1).find("3D scanner"));
  EXPECT_NE(std::string::npos,
            outputOf(lidar + " --world " + configFile("worlds/building.yaml") + " --step 500" + out, 1)
                .find("too short"));
}

}  // namespace
}  // namespace mapping_simulation
