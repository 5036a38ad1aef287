// SPDX-License-Identifier: BSD-3-Clause
//
// A robot drives along a room of 8 m x 5 m without odometry: SLAM tells where it is, and its scans go into a
// 3D map.
#include <intensity_hector_slam/slam.h>
#include <rtree_occupancy_map/occupancy_map.h>

#include <algorithm>
#include <cmath>
#include <cstdio>

namespace {

// What a scanner at the robot's pose (x, y, theta) sees of the room: ends of its beams, in the robot's frame
// (m).
intensity_hector_slam::Scan scanOfTheRoom(const Eigen::Vector3d& pose) {
  intensity_hector_slam::Scan scan;
  for (int i = 0; i < 720; ++i) {
    const double angle = 2.0 * M_PI * (i + 0.5) / 720;
    const double cosine = std::cos(angle + pose.z()), sine = std::sin(angle + pose.z());
    const double x_wall = cosine > 0.0 ? 4.0 : -4.0, y_wall = sine > 0.0 ? 2.5 : -2.5;
    const double range = std::min((x_wall - pose.x()) / cosine, (y_wall - pose.y()) / sine);
    scan.points.emplace_back(range * std::cos(angle), range * std::sin(angle));
  }
  return scan;
}

}  // namespace

int main() {
  intensity_hector_slam::SlamOptions slam_options;
  slam_options.matcher.cost = "occupancy";
  intensity_hector_slam::Slam slam(slam_options);
  rtree_occupancy_map::Options map_options;
  map_options.resolution = 0.1;
  rtree_occupancy_map::OccupancyMap map(map_options);

  double worst = 0.0;
  for (int i = 0; i < 50; ++i) {
    const Eigen::Vector3d truth(0.02 * i, 0.01 * i, 0.01 * i);
    intensity_hector_slam::Scan scan = scanOfTheRoom(truth);
    scan.stamp = 0.1 * i;
    const Eigen::Vector3d pose = slam.process(scan).pose;
    worst = std::max(worst, (pose - truth).head<2>().norm());

    rtree_occupancy_map::Scan beams;
    beams.origin = Eigen::Vector3f(static_cast<float>(pose.x()), static_cast<float>(pose.y()), 0.35F);
    for (const auto& point : scan.points) {
      const Eigen::Vector2d end = Eigen::Rotation2Dd(pose.z()) * point.cast<double>() + pose.head<2>();
      beams.hits.emplace_back(static_cast<float>(end.x()), static_cast<float>(end.y()), 0.35F);
    }
    map.insertScan(beams);
  }
  const rtree_occupancy_map::RayHit wall = map.castRay({0.0, 0.0, 0.35}, Eigen::Vector3d::UnitX(), 10.0);
  std::printf("poses right within %.3f m, %zu cells, the wall ahead is at x = %.2f m\n", worst,
              map.statistics().cells, wall.point.x());
  return worst < 0.05 && std::abs(wall.point.x() - 4.0) < 0.1 ? 0 : 1;
}
