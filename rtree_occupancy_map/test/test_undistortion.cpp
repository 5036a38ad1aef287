// SPDX-License-Identifier: BSD-3-Clause
//
// Clouds and scans of a sensor that moves during a sweep, against what a simulated one has met.
#include <gtest/gtest.h>
#include <mapping_simulation/sensors.h>
#include <mapping_simulation/testing/worlds.h>

#include <algorithm>
#include <cmath>
#include <set>
#include <stdexcept>
#include <string>
#include <vector>

#include "rtree_occupancy_map/ros/scan_conversion.h"
#include "test_messages.h"

namespace rtree_occupancy_map {
namespace {

using mapping_simulation::SensorConfig;
using mapping_simulation::Sweep;
using mapping_simulation::Trajectory;
using sensor_msgs::PointField;

constexpr std::uint8_t kFloat = PointField::FLOAT32;
constexpr double kStamp = 1700000000.25;

// A lidar that turns by 90 degrees a second and drives 3 m/s, in a room of 20 m x 12 m.
class TurningLidar : public ::testing::Test {
 protected:
  TurningLidar() {
    lidar_.type = SensorConfig::Type::kLidar;
    lidar_.rate = 10.0;
    lidar_.columns = 900;
    lidar_.angle_increment = 2.0 * M_PI / lidar_.columns;
    lidar_.elevations.clear();
    for (int ring = 0; ring < 16; ++ring) lidar_.elevations.push_back((2.0 * ring - 15.0) * M_PI / 180.0);
    lidar_.mount = mapping_simulation::makePose(0.8, 0.2, 1.5);
    sweep_ = mapping_simulation::sweep(lidar_, room(), path_, 0.0, 1);
    for (int i = 0; i <= 10; ++i) frame_.add(0.01 * i, path_.at(0.01 * i) * lidar_.mount);
  }

  static mapping_simulation::World room() {
    using mapping_simulation::Shape;
    return mapping_simulation::World(
        {mapping_simulation::makeShape(Shape::Type::kBox, {20, 12, 4},
                                       mapping_simulation::makePose(2.1, 1.1, -0.1)),
         mapping_simulation::makeShape(Shape::Type::kCylinder, {0.4, 0.4, 4},
                                       mapping_simulation::makePose(5, -2, 0))});
  }

  // A field for the time, what is written there of a time (s), and the points row by row, as Ouster's are.
  template <class Write>
  sensor_msgs::PointCloud2 cloud(const Field& time, const Write& write) const {
    std::vector<std::vector<double>> points;
    const int rings = static_cast<int>(lidar_.elevations.size());
    for (int ring = 0; ring < rings; ++ring) {
      for (int column = 0; column < lidar_.columns; ++column) {
        const double range = sweep_.echoes[static_cast<std::size_t>(column * rings + ring)].range;
        const Eigen::Vector3d point = range * lidar_.direction(column, ring);
        points.push_back({point.x(), point.y(), point.z(), write(column * lidar_.timeIncrement())});
      }
    }
    auto message = makeCloud({{"x", kFloat}, {"y", kFloat}, {"z", kFloat}, time}, points);
    message.header.stamp = ros::Time(kStamp);
    return message;
  }
  sensor_msgs::PointCloud2 ouster() const {
    return cloud({"t", PointField::UINT32}, [](double time) { return 1e9 * time; });
  }

  // Each point with the pose of its own time.
  Scan truth() const {
    Scan scan;
    const int rings = static_cast<int>(lidar_.elevations.size());
    for (int column = 0; column < lidar_.columns; ++column) {
      const Eigen::Isometry3d pose = path_.at(column * lidar_.timeIncrement()) * lidar_.mount;
      for (int ring = 0; ring < rings; ++ring) {
        const double range = sweep_.echoes[static_cast<std::size_t>(column * rings + ring)].range;
        scan.hits.push_back((pose * (range * lidar_.direction(column, ring))).cast<float>());
        scan.hit_origins.push_back(pose.translation().cast<float>());
      }
    }
    scan.origin = scan.hit_origins.front();
    return scan;
  }

  // The greatest distance of a point from the walls and the pillar.
  static double farthestFromWalls(const Scan& scan) {
    double farthest = 0.0;
    for (const Eigen::Vector3f& hit : scan.hits) {
      const Eigen::Vector3d p = hit.cast<double>() - room_center_;
      const double pillar = std::abs((hit.head<2>().cast<double>() - Eigen::Vector2d(5, -2)).norm() - 0.2);
      farthest = std::max(farthest, std::min({std::abs(10 - std::abs(p.x())), std::abs(6 - std::abs(p.y())),
                                              std::abs(2 - std::abs(p.z())), pillar}));
    }
    return farthest;
  }
  // Of the voxels that either map knows, how many are occupied in one alone.
  static double differing(const Scan& a, const Scan& b) {
    const auto occupied = [](const Scan& scan) {
      OccupancyMap map;
      map.insertScan(scan);
      std::set<Voxel> voxels;
      map.visitOccupied([&voxels](const Cell& c) {
        for (int x = c.box.min[0]; x < c.box.max[0]; ++x)
          for (int y = c.box.min[1]; y < c.box.max[1]; ++y)
            for (int z = c.box.min[2]; z < c.box.max[2]; ++z) voxels.insert({x, y, z});
        return true;
      });
      return voxels;
    };
    const std::set<Voxel> in_a = occupied(a), in_b = occupied(b);
    std::vector<Voxel> either, one;
    std::set_union(in_a.begin(), in_a.end(), in_b.begin(), in_b.end(), std::back_inserter(either));
    std::set_symmetric_difference(in_a.begin(), in_a.end(), in_b.begin(), in_b.end(),
                                  std::back_inserter(one));
    return static_cast<double>(one.size()) / static_cast<double>(either.size());
  }

  inline static const Eigen::Vector3d room_center_{2.1, 1.1, 1.9};  // a box stands on its origin
  const Trajectory path_{{{0.0, mapping_simulation::makePose(0, 0, 0, 0.3)},
                          {0.1, mapping_simulation::makePose(0.3, 0.05, 0, 0.3 + 0.05 * M_PI)}}};
  SensorConfig lidar_;
  Sweep sweep_;
  SensorPath frame_;
};

TEST_F(TurningLidar, PointsAndBeamsAreWhereTheyWere) {
  const Scan undistorted = toScan(ouster(), frame_, frame_, {}).scan, expected = truth();
  ASSERT_EQ(expected.hits.size(), undistorted.hits.size());
  ASSERT_EQ(expected.hits.size(), undistorted.hit_origins.size());
  EXPECT_LT(farthestFromWalls(undistorted), 0.005);
  EXPECT_LT(differing(undistorted, expected), 0.01);
  // Between the walls nothing else, and the beams' origins along the way.
  EXPECT_LT((undistorted.hit_origins.front() - expected.hit_origins.front()).norm(), 1e-3F);
  EXPECT_LT((undistorted.hit_origins.back() - expected.hit_origins.back()).norm(), 1e-3F);
  EXPECT_GT((expected.hit_origins.back() - expected.hit_origins.front()).norm(), 0.2F);

  const Scan distorted = toScan(ouster(), path_.at(0.0) * lidar_.mount, {}).scan;
  EXPECT_GT(farthestFromWalls(distorted), 0.5);
  EXPECT_GT(differing(distorted, expected), 0.3);
}

TEST_F(TurningLidar, TimesAreAsDriversWriteThem) {
  const auto check = [&](const sensor_msgs::PointCloud2& cloud) {
    const auto times = sweepTimesOf(cloud);
    EXPECT_NEAR(0.0, times.first, 1e-6);
    EXPECT_NEAR(0.1, times.last, 2e-4);
    const Scan scan = toScan(cloud, frame_, frame_, {}).scan;
    EXPECT_EQ(sweep_.echoes.size(), scan.hits.size());
    EXPECT_LT(farthestFromWalls(scan), 0.005);
  };
  check(cloud({"time", kFloat}, [](double time) { return time; }));  // Velodyne
  check(cloud({"timestamp", PointField::FLOAT64},
              [](double time) { return kStamp + time; }));  // Hesai, RoboSense
  check(
      cloud({"timestamp", PointField::FLOAT64}, [](double time) { return 1e9 * (kStamp + time); }));  // Livox
  check(cloud({"offset_time", PointField::UINT32}, [](double time) { return 1e9 * time; }));          // Livox
  check(cloud({"time_offset", PointField::FLOAT64}, [](double time) { return time; }));
}

TEST_F(TurningLidar, AStampAtTheEndOfTheSweepHasTimesBeforeIt) {
  auto message = cloud({"time", kFloat}, [](double time) { return time - 0.1; });
  const auto times = sweepTimesOf(message);
  EXPECT_NEAR(-0.1, times.first, 1e-6);
  EXPECT_NEAR(0.0, times.last, 2e-4);
  SensorPath path;
  for (int i = 0; i <= 10; ++i) path.add(0.01 * i - 0.1, path_.at(0.01 * i) * lidar_.mount);
  EXPECT_LT(farthestFromWalls(toScan(message, path, path, {}).scan), 0.005);
}

TEST_F(TurningLidar, RegisteredCloudsHaveBeamsFromTheSensor) {
  auto registered = makeCloud({{5, 0, 1}, {5, 1, 1}});
  registered = makeCloud({{"x", kFloat}, {"y", kFloat}, {"z", kFloat}, {"t", PointField::UINT32}},
                         {{5, 0, 1, 0}, {5, 1, 1, 1e8}});
  SensorPath map;
  map.add(0.0, Eigen::Isometry3d::Identity());
  const Scan scan = toScan(registered, map, frame_, {}).scan;
  ASSERT_EQ(2u, scan.hits.size());
  EXPECT_EQ(Eigen::Vector3f(5, 0, 1), scan.hits[0]);
  EXPECT_LT((scan.hit_origins[0].cast<double>() - frame_.at(0.0).translation()).norm(), 1e-3);
  EXPECT_LT((scan.hit_origins[1].cast<double>() - frame_.at(0.1).translation()).norm(), 1e-3);
}

TEST_F(TurningLidar, LaserScansHaveTheirTimeIncrement) {
  SensorConfig laser = lidar_;
  laser.type = SensorConfig::Type::kPlanar;
  laser.elevations = {0.0};
  laser.beam.range_max = 9.0;  // some see nothing
  const auto planar = toPlanarScan(laser, mapping_simulation::sweep(laser, room(), path_, 0.0, 1));
  sensor_msgs::LaserScan message;
  message.angle_min = static_cast<float>(planar.angle_min);
  message.angle_increment = static_cast<float>(planar.angle_increment);
  message.time_increment = static_cast<float>(planar.time_increment);
  message.range_min = static_cast<float>(planar.range_min);
  message.range_max = static_cast<float>(planar.range_max);
  message.ranges = planar.ranges;
  const auto times = sweepTimesOf(message);
  EXPECT_EQ(0.0, times.first);
  EXPECT_NEAR(0.1, times.last, 2e-4);
  const Scan scan = toScan(message, mapping_common::LaserScans().read(message), frame_, {}).scan;
  EXPECT_LT(farthestFromWalls(scan), 0.005);
  EXPECT_GT(farthestFromWalls(toScan(message, path_.at(0.0) * laser.mount, {}).scan), 0.3);
  ASSERT_FALSE(scan.misses.empty());
  ASSERT_EQ(scan.misses.size(), scan.miss_origins.size());
  for (std::size_t i = 0; i < scan.misses.size(); ++i)
    EXPECT_NEAR(9.0, (scan.misses[i] - scan.miss_origins[i]).norm(), 1e-3) << i;
}

TEST_F(TurningLidar, SaysWhatIsWrongWithTimes) {
  const auto why = [](const sensor_msgs::PointCloud2& cloud) {
    try {
      sweepTimesOf(cloud);
    } catch (const std::invalid_argument& e) {
      return std::string(e.what());
    }
    return std::string();
  };
  EXPECT_NE(std::string::npos, why(makeCloud({{1, 2, 3}})).find("no field t, time, timestamp"));
  // Microseconds, and the clock of a sensor that counts from when it was switched on.
  EXPECT_NE(std::string::npos,
            why(cloud({"time", kFloat}, [](double t) { return 1e6 * t; })).find("field time"));
  EXPECT_NE(
      std::string::npos,
      why(cloud({"timestamp", PointField::FLOAT64}, [](double t) { return 5000.0 + t; })).find("clock"));
}

TEST_F(TurningLidar, WhatWasNotMeasuredHasNoTime) {
  const float nan = std::nanf("");
  auto message = makeCloud({{"x", kFloat}, {"y", kFloat}, {"z", kFloat}, {"timestamp", PointField::FLOAT64}},
                           {{nan, nan, nan, 0.0}, {1, 2, 3, kStamp + 0.05}});
  message.header.stamp = ros::Time(kStamp);
  const auto times = sweepTimesOf(message);
  EXPECT_NEAR(0.05, times.first, 1e-6);
  EXPECT_NEAR(0.05, times.last, 1e-6);
  EXPECT_EQ(2u, toScan(message, frame_, frame_, {}).scan.hits.size());
}

TEST(SensorPath, InterpolatesAndStaysAtItsEnds) {
  SensorPath path;
  path.add(1.0, mapping_simulation::makePose(0, 0, 0, 0.2));
  path.add(2.0, mapping_simulation::makePose(2, 0, 4, 0.6));
  path.add(4.0, mapping_simulation::makePose(2, 0, 4, 1.0));
  EXPECT_TRUE(path.at(0.0).isApprox(mapping_simulation::makePose(0, 0, 0, 0.2)));
  EXPECT_TRUE(path.at(1.25).isApprox(mapping_simulation::makePose(0.5, 0, 1, 0.3)));
  EXPECT_TRUE(path.at(2.0).isApprox(mapping_simulation::makePose(2, 0, 4, 0.6)));
  EXPECT_TRUE(path.at(3.0).isApprox(mapping_simulation::makePose(2, 0, 4, 0.8)));
  EXPECT_TRUE(path.at(9.0).isApprox(mapping_simulation::makePose(2, 0, 4, 1.0)));
}

// Scans from several places at once are what each part would be alone, with a voxel that a beam ends in free
// to nobody.
TEST(BeamsFromSeveralPlaces, CrossWhatEachCrosses) {
  OccupancyMap map;
  Scan scan;
  scan.hits = {{5.1F, 0.1F, 0.1F}, {5.1F, 3.1F, 0.1F}};
  scan.hit_origins = {{0.1F, 0.1F, 0.1F}, {0.1F, 3.1F, 0.1F}};
  scan.misses = {{0.1F, -4.9F, 0.1F}};
  scan.miss_origins = {{5.1F, -4.9F, 0.1F}};
  scan.origin = {0.1F, 0.1F, 0.1F};
  map.insertScan(scan);
  for (double x = 0.1; x < 5.0; x += 0.2) {
    for (const double y : {0.1, 3.1, -4.9})
      EXPECT_EQ(x < 0.15 && y < -1.0, map.stateAt({x, y, 0.1}) != VoxelState::kFree) << x << ' ' << y;
    EXPECT_EQ(VoxelState::kUnknown, map.stateAt({x, 1.5, 0.1}));
  }
  EXPECT_EQ(VoxelState::kOccupied, map.stateAt({5.1, 0.1, 0.1}));
  EXPECT_EQ(VoxelState::kOccupied, map.stateAt({5.1, 3.1, 0.1}));

  scan.hit_origins.pop_back();
  EXPECT_THROW(map.insertScan(scan), std::invalid_argument);
  scan.hit_origins.push_back({0.0F, std::nanf(""), 0.0F});
  EXPECT_THROW(map.insertScan(scan), std::invalid_argument);
}

}  // namespace
}  // namespace rtree_occupancy_map
