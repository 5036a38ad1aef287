// SPDX-License-Identifier: BSD-3-Clause
#include <gtest/gtest.h>
#include <mapping_common/files.h>
#include <mapping_common/testing/temp_dir.h>

#include "pose_graph/maps.h"
#include "recorded_room.h"

namespace pose_graph {
namespace {

namespace slam = intensity_hector_slam;
namespace rtree = rtree_occupancy_map;
using mapping_common::errorOf;
using mapping_common::mentions;

slam::SlamOptions slamOptions() {
  slam::SlamOptions options;
  options.map.resolution = 0.05;
  options.map.size = 256;
  return options;
}

class Maps : public testing::Test {
 protected:
  // A session whose poses drift, and its graph with those that are right.
  void SetUp() override {
    SessionWriter writer(path_, true);
    writeRun(writer, room_, planarPose(0.05, 0.02, 0.01));
    writer.flush();
    graph_ = readGraph(Session(path_)).graph;
    drifted_ = graph_;
    for (std::size_t i = 0; i < room_.size(); ++i) graph_.setPose(i, room_[i]);
  }
  mapping_common::TempDir dir_;
  const std::string path_ = dir_.path("room.session");
  const std::vector<Pose> room_ = circle();
  Graph graph_{true}, drifted_{true};
};

TEST_F(Maps, KeyDataAreWhatTheyWere) {
  slam::Scan scan = lookAtRoom({}, 5.0);
  scan.origin = {0.1F, -0.2F};
  scan.times.assign(scan.points.size(), 0.01F);
  scan.free = {{1.0F, 2.0F}};
  scan.free_times = {0.02F};
  const KeyData data = toKeyData(scan);
  EXPECT_EQ(5000000000, data.stamp);
  const slam::Scan read = toScan(data);
  EXPECT_EQ(scan.stamp, read.stamp);
  EXPECT_EQ(scan.origin, read.origin);
  EXPECT_EQ(scan.points, read.points);
  EXPECT_EQ(scan.reflectivities, read.reflectivities);
  EXPECT_EQ(scan.times, read.times);
  EXPECT_EQ(scan.free, read.free);
  EXPECT_EQ(scan.free_times, read.free_times);
  rtree::Scan cloud = cloudOfRoom({}, 6.0);
  cloud.hit_origins.assign(cloud.hits.size(), Eigen::Vector3f(0, 0, 1));
  const rtree::Scan same = toCloud(toKeyData(cloud));
  EXPECT_EQ(cloud.hits, same.hits);
  EXPECT_EQ(cloud.hit_origins, same.hit_origins);
  EXPECT_EQ(cloud.reflectivity, same.reflectivity);
}

TEST_F(Maps, DamagedKeyDataAreRefused) {
  KeyData data = toKeyData(lookAtRoom({}, 5.0));
  data.key_pose = 7;
  EXPECT_TRUE(mentions(errorOf([&] { toCloud(data); }), {"scan at key pose 7 isn't a cloud"}));
  const std::string whole = data.data;
  for (const std::size_t size : {std::size_t{0}, std::size_t{7}, std::size_t{20}, whole.size() / 2}) {
    data.data = whole.substr(0, size);
    EXPECT_TRUE(mentions(errorOf([&] { toScan(data); }), {"scan at key pose 7"})) << size;
  }
  data.data = whole;
  data.format = 9;
  EXPECT_TRUE(mentions(errorOf([&] { toScan(data); }), {"its format is 9"}));
  rtree::Scan cloud = cloudOfRoom({}, 5.0);
  cloud.reflectivity.pop_back();
  EXPECT_TRUE(mentions(errorOf([&] { toCloud(toKeyData(cloud)); }), {"don't agree"}));
}

TEST_F(Maps, SaysWhichScanCantGoIntoTheMap) {
  const std::string path = dir_.path("nan.session");
  {
    SessionWriter writer(path, true);
    writer.put(KeyPose{4, writer.beginRun(0, ""), 0, {}, {}, false});
    slam::Scan scan = lookAtRoom({}, 5.0);
    scan.points[3].x() = NAN;
    KeyData data = toKeyData(scan);
    data.key_pose = 4;
    writer.put(data);
  }
  const Session session(path);
  EXPECT_TRUE(mentions(errorOf([&] { buildGridMap(session, readGraph(session).graph, slamOptions()); }),
                       {path.c_str(), "scan at key pose 4 can't go into the map"}));
}

TEST_F(Maps, AGridMapIsThatOfTheCorrectedPoses) {
  slam::Slam direct(slamOptions());
  for (std::size_t i = 0; i < room_.size(); ++i) {
    const auto at = room_[i];
    direct.insert(lookAtRoom(at, 100.0 + i), {at.translation.x(), at.translation.y(), at.yaw()});
  }
  const Session session(path_);
  std::vector<double> shares;
  const auto built = buildGridMap(session, graph_, slamOptions(), [&](double share) {
    shares.push_back(share);
    return true;
  });
  ASSERT_TRUE(built);
  EXPECT_TRUE(direct.map() == built->map);
  EXPECT_EQ(room_.size(), built->inserted);
  EXPECT_EQ(111000000000, built->last_stamp);
  EXPECT_EQ(room_.size(), shares.size());
  EXPECT_EQ(1.0, shares.back());

  // Of the poses as they drifted, walls are where there are none.
  const auto wrong = buildGridMap(session, drifted_, slamOptions());
  const auto occupied = [](const slam::MultiMap& map) {
    std::size_t count = 0;
    map.level(0).forTiles([&](const slam::GridMap::Tile& tile, const auto&) {
      count += std::count_if(tile.cells.begin(), tile.cells.end(), slam::GridMap::isOccupied);
    });
    return count;
  };
  EXPECT_GT(occupied(wrong->map), 1.3 * occupied(built->map));
}

TEST_F(Maps, AnOccupancyMapIsThatOfTheCorrectedPoses) {
  rtree::Options options;
  options.resolution = 0.1;
  options.reflectivity = true;
  rtree::OccupancyMap direct(options);
  for (std::size_t i = 0; i < room_.size(); ++i) {
    rtree::Scan cloud = cloudOfRoom(room_[i], 100.0 + i);
    const Eigen::Isometry3f to_map =
        (Eigen::Translation3d(room_[i].translation) * room_[i].rotation).cast<float>();
    cloud.origin = to_map * cloud.origin;
    for (auto& hit : cloud.hits) hit = to_map * hit;
    direct.insertScan(cloud);
  }
  const auto built = buildOccupancyMap(Session(path_), graph_, options);
  ASSERT_TRUE(built);
  EXPECT_EQ(direct.size(), built->map.size());
  direct.visitAll([&](const rtree::Cell& cell) {
    const auto there = built->map.cellAt(built->map.center(cell.box));
    EXPECT_TRUE(there && there->log_odds == cell.log_odds &&
                there->reflectivity.hits == cell.reflectivity.hits);
    if (cell.reflectivity.hits > 0) {
      EXPECT_EQ(cell.reflectivity.mean, there->reflectivity.mean);
    }
    return !HasFailure();
  });
}

TEST_F(Maps, TheMapOfAPlanarScannerIsFlat) {
  const std::string path = dir_.path("flat.session");
  {
    SessionWriter writer(path, true);
    writer.put(KeyPose{0, writer.beginRun(0, ""), 0, {}, {}, false});
    KeyData data = toKeyData(lookAtRoom({}, 1.0));
    data.sensor.translation.z() = 0.55;
    writer.put(data);
  }
  rtree::Options options;
  options.resolution = 0.1;
  const Session session(path);
  const auto built = buildOccupancyMap(session, readGraph(session).graph, options);
  const auto bounds = built->map.bounds();
  EXPECT_EQ(5, bounds.min[2]);
  EXPECT_EQ(6, bounds.max[2]);
  EXPECT_EQ(rtree::VoxelState::kOccupied, built->map.stateAt({5.05, 0.05, 0.55}));
}

TEST_F(Maps, BuildingCanBeEnded) {
  const Session session(path_);
  int calls = 0;
  const auto twice = [&](double) { return ++calls < 3; };
  EXPECT_FALSE(buildGridMap(session, graph_, slamOptions(), twice));
  EXPECT_EQ(3, calls);
  EXPECT_FALSE(buildOccupancyMap(session, graph_, {}, [](double) { return false; }));
  EXPECT_FALSE(buildCloud(session, graph_, 0.1, [](double) { return false; }));
}

TEST_F(Maps, ACloudHasAPointForEachVoxel) {
  const Session session(path_);
  const auto all = buildCloud(session, graph_), voxels = buildCloud(session, graph_, 0.25);
  EXPECT_EQ(room_.size() * 3 * 360, all->size());
  EXPECT_LT(voxels->size(), 1000U);
  for (const auto& points : {*all, *voxels}) {
    for (const CloudPoint& p : points) {
      const double to_x = std::abs(std::abs(p.position.x()) - 5.03),
                   to_y = std::abs(std::abs(p.position.y()) - 4.03);
      EXPECT_LT(std::min(to_x, to_y), points.size() == all->size() ? 1e-4 : 0.13);  // in a corner
      EXPECT_TRUE(p.intensity >= 0.3F && p.intensity <= 0.8F);
    }
  }
  writePcd(dir_.path("room.pcd"), *all);
  const std::string pcd = mapping_common::readFile(dir_.path("room.pcd"));
  const std::size_t header = pcd.find("DATA binary\n") + 12;
  EXPECT_TRUE(mentions(pcd.substr(0, header), {"FIELDS x y z intensity", "POINTS 12960"}));
  EXPECT_EQ(header + 16 * all->size(), pcd.size());
}

}  // namespace
}  // namespace pose_graph
