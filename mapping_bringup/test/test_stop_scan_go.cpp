// SPDX-License-Identifier: BSD-3-Clause
//
// stop_scan_go.launch over simulated terrestrial scans: where each was taken, and the 3D map, against the
// truth.
#include <mapping_common/testing/nodelet_test.h>
#include <mapping_common/testing/temp_dir.h>
#include <mapping_common/testing/tool_test.h>
#include <mapping_simulation/trajectory.h>
#include <nav_msgs/Path.h>
#include <sensor_msgs/PointCloud2.h>
#include <sensor_msgs/point_cloud2_iterator.h>
#include <tf2_eigen/tf2_eigen.h>

#include <array>
#include <cmath>
#include <csignal>
#include <fstream>
#include <set>
#include <string>
#include <vector>

using mapping_common::Recorder;
using mapping_common::waitFor;
using mapping_simulation::TimedPose;

namespace {

constexpr int kStations = 9;
constexpr double kVoxel = 0.2;  // m

/// A launch file of mapping_bringup that runs beside the test.
class Launched {
 public:
  Launched(const std::string& arguments, const std::string& log) : log_(log) {
    const std::string pid = log + ".pid";
    EXPECT_EQ(
        0, std::system(
               ("roslaunch mapping_bringup " + arguments + " >" + log + " 2>&1 & echo $! >" + pid).c_str()));
    std::ifstream(pid) >> process_;
  }
  ~Launched() {
    kill(process_, SIGINT);
    waitFor([&] { return kill(process_, 0) != 0; }, 30.0);
  }
  std::string log() const { return mapping_common::readFile(log_); }

 private:
  std::string log_;
  pid_t process_ = 0;
};

using Voxel = std::array<int, 3>;
Voxel voxelOf(const Eigen::Vector3d& p) {
  const Eigen::Vector3d v = (p / kVoxel).array().floor();
  return {static_cast<int>(v.x()), static_cast<int>(v.y()), static_cast<int>(v.z())};
}

/// Of all points, and around them.
std::set<Voxel> voxelsOf(const std::string& folder, const std::vector<TimedPose>& truth) {
  std::set<Voxel> voxels;
  for (std::size_t i = 0; i < truth.size(); ++i) {
    std::ifstream in(folder + "/scan_00" + std::to_string(i + 1) + ".ptx");
    std::size_t columns = 0, rows = 0;
    in >> columns >> rows;
    double number = 0.0;
    for (int k = 0; k < 12 + 16; ++k) in >> number;
    const Eigen::Isometry3d pose = truth.front().pose.inverse() * truth[i].pose;
    for (Eigen::Vector3d p; in >> p.x() >> p.y() >> p.z() >> number;)
      if (!p.isZero(0.0)) voxels.insert(voxelOf(pose * p));
  }
  std::set<Voxel> around;
  for (const Voxel& v : voxels)
    for (int i = 0; i < 27; ++i) around.insert({v[0] + i % 3 - 1, v[1] + i / 3 % 3 - 1, v[2] + i / 9 - 1});
  return around;
}

TEST(StopScanGo, PlacesAllScansAndMakesTheMap) {
  const mapping_common::TempDir dir;
  const std::string scans = dir.path("scans");
  const mapping_common::Ran simulated = mapping_common::run(
      "rosrun mapping_simulation simulate_stations --seed 2 --stations " + std::to_string(kStations) +
      " --sensor $(rospack find mapping_simulation)/config/simulator/terrestrial_scanner.yaml --out " +
      scans);
  ASSERT_EQ(0, simulated.code) << simulated.said();
  const std::vector<TimedPose> truth = mapping_simulation::loadTrajectory(scans + "/truth.tum").poses();
  ASSERT_EQ(static_cast<std::size_t>(kStations), truth.size());

  ros::NodeHandle node;
  Recorder<nav_msgs::Path> paths(node, "graph_path");
  Recorder<sensor_msgs::PointCloud2> maps(node, "occupied_cells_centers");
  const Launched launched("stop_scan_go.launch rate:=20 file:=" + scans, dir.path("log"));
  const bool all = waitFor(
      [&] { return !paths.messages.empty() && paths.messages.back().poses.size() == kStations; }, 300.0);
  ASSERT_TRUE(all) << (paths.messages.empty() ? 0 : paths.messages.back().poses.size())
                   << " scans were placed\n"
                   << launched.log();
  double farthest = 0.0, most = 0.0;
  const auto compare = [&](const nav_msgs::Path& path) {
    farthest = most = 0.0;
    for (std::size_t i = 0; i < truth.size(); ++i) {
      Eigen::Isometry3d pose;
      tf2::fromMsg(path.poses[i].pose, pose);
      const Eigen::Isometry3d error = (truth.front().pose.inverse() * truth[i].pose).inverse() * pose;
      farthest = std::max(farthest, error.translation().norm());
      most = std::max(most, Eigen::AngleAxisd(error.linear()).angle());
    }
  };
  // The last registrations come later.
  EXPECT_TRUE(waitFor([&] {
    compare(paths.messages.back());
    return farthest < 0.05 && most < 0.003;
  })) << farthest
      << " m, " << most << " rad";
  EXPECT_EQ("map", paths.messages.back().header.frame_id);

  const std::set<Voxel> expected = voxelsOf(scans, truth);
  const auto inside = [&](const sensor_msgs::PointCloud2& map) {
    std::size_t count = 0;
    for (sensor_msgs::PointCloud2ConstIterator<float> p(map, "x"); p != p.end(); ++p)
      count += expected.count(voxelOf({p[0], p[1], p[2]}));
    return static_cast<double>(count) / std::max(1u, map.width * map.height);
  };
  ASSERT_TRUE(waitFor([&] { return !maps.messages.empty() && maps.messages.back().width > 5000; }));
  EXPECT_TRUE(waitFor([&] { return inside(maps.messages.back()) > 0.99; })) << inside(maps.messages.back());
  RecordProperty("error_mm", static_cast<int>(1e3 * farthest));
  std::cout << "Farthest from the truth: " << farthest << " m, " << most << " rad; "
            << maps.messages.back().width << " cells\n";
}

}  // namespace

int main(int argc, char** argv) {
  testing::InitGoogleTest(&argc, argv);
  ros::init(argc, argv, "test_stop_scan_go");
  return RUN_ALL_TESTS();
}
