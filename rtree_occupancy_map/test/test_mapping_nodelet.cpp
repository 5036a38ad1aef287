// SPDX-License-Identifier: BSD-3-Clause
//
// The nodelet's input, services and parameters, against a map built from the same scans.
#include <dynamic_reconfigure/Reconfigure.h>
#include <mapping_common/testing/message_fuzz.h>
#include <mapping_common/testing/temp_dir.h>
#include <mapping_msgs/CorrectedMap.h>
#include <mapping_msgs/LoadMap.h>
#include <mapping_msgs/SaveMap.h>
#include <nav_msgs/OccupancyGrid.h>
#include <rtree_occupancy_map/BoundingBoxQuery.h>
#include <rtree_occupancy_map/CastRay.h>
#include <std_srvs/Empty.h>
#include <unistd.h>
#include <visualization_msgs/MarkerArray.h>

#include <cstdlib>
#include <fstream>
#include <limits>

#include "nodelet_fixture.h"
#include "rtree_occupancy_map/octomap_file.h"
#include "rtree_occupancy_map/ros/octomap_message.h"

namespace rtree_occupancy_map {
namespace {

constexpr float kNan = std::numeric_limits<float>::quiet_NaN();
constexpr float kInf = std::numeric_limits<float>::infinity();

sensor_msgs::PointCloud2 room(unsigned seed) {
  return makeCloud(roomPoints({4, 3, 1.5}, 1000, seed));
}

class MappingNodelet : public NodeletTest {
 protected:
  // Three clouds from different places.
  void buildMap() {
    for (unsigned i = 0; i < 3; ++i) {
      const std::string sensor = "sensor" + std::to_string(i);
      const auto pose = poseOf(2.3 * i, 0.4 * i, 0.1 * i, 0.3 * i);
      sendStaticPose(sensor, pose);
      publish(room(i), sensor, pose);
      ASSERT_TRUE(waitForMap(reference_)) << i;
    }
  }

  template <class Service>
  typename Service::Response callWithPath(const std::string& service, const std::string& path) {
    Service call;
    call.request.path = path;
    EXPECT_TRUE(ros::service::call(name_ + "/" + service, call));
    EXPECT_FALSE(call.response.message.empty());
    return call.response;
  }
};

// -------------------------------------------------------------------------------------------------------
// input

TEST_F(MappingNodelet, BuildsTheMapThatTheCoreBuilds) {
  ASSERT_TRUE(load());
  buildMap();
  expectDiagnostic("Input", "Inserted", "3");
  expectDiagnostic("Input", "Points mapped", "3000");
  expectDiagnostic("Map", "Cells", std::to_string(reference_.tree().size()));
}

TEST_F(MappingNodelet, SkipsNonFinitePoints) {
  ASSERT_TRUE(load());
  sendStaticPose("sensor", poseOf(0, 0, 0));
  publish(makeCloud({{kNan, 0, 0}, {2, kInf, 0}, {1, 2, 0.5}, {0, 0, -kInf}}), "sensor", poseOf(0, 0, 0));
  EXPECT_TRUE(waitForMap(reference_));
  EXPECT_GT(reference_.tree().size(), 0u);
  expectDiagnostic("Input", "Points left out: not finite", "3");
}

TEST_F(MappingNodelet, DropsEmptyAndMalformedMessagesAndGoesOn) {
  ASSERT_TRUE(load());
  sendStaticPose("sensor", poseOf(0, 0, 0));
  publish(room(1), "sensor", poseOf(0, 0, 0));
  ASSERT_TRUE(waitForMap(reference_));

  send(makeCloud(std::vector<Eigen::Vector3f>()), "sensor");
  send(sensor_msgs::LaserScan(), "sensor");
  auto without_x = room(2), truncated = room(3), beyond = room(4), nameless = room(5);
  without_x.fields.erase(without_x.fields.begin());
  send(without_x, "sensor");
  truncated.data.resize(truncated.data.size() / 2);
  send(truncated, "sensor");
  beyond.fields[0].offset = 1000;
  send(beyond, "sensor");
  clouds_.publish(nameless);  // no frame_id
  sensor_msgs::LaserScan scan;
  scan.ranges = {1, 2};
  scan.range_max = 10;
  scan.intensities = {1};
  send(scan, "sensor");
  expectDiagnostic("Input", "Dropped: empty", "2");
  expectDiagnostic("Input", "Dropped: malformed", "5");
  expectDiagnostic("Input", "Dropped: no transform", "0");
  EXPECT_EQ(voxelsOf(reference_), voxels());

  constexpr std::uint8_t kFloat = sensor_msgs::PointField::FLOAT32;
  publish(makeCloud({{"ring", sensor_msgs::PointField::UINT16},
                     {"x", kFloat},
                     {"y", kFloat},
                     {"z", kFloat},
                     {"t", kFloat}},
                    {{1, 2, 3, 1, 0.1}}),
          "sensor", poseOf(0, 0, 0));
  EXPECT_TRUE(waitForMap(reference_));
}

TEST_F(MappingNodelet, WaitsForATransformThatComesLate) {
  ASSERT_TRUE(load());
  const auto pose = poseOf(1, 2, 0.5, 0.7);
  publish(room(1), "sensor", pose);
  expectDiagnostic("Input", "Waiting for transforms", "1");
  EXPECT_TRUE(voxels().empty());
  sendStaticPose("sensor", pose);
  EXPECT_TRUE(waitForMap(reference_));
  expectDiagnostic("Input", "Waiting for transforms", "0");
}

TEST_F(MappingNodelet, CountsWhatWaitedInVain) {
  setParam("transform_timeout", 0.15);
  ASSERT_TRUE(load());
  const ros::Time now = ros::Time::now();
  for (unsigned i = 0; i < 5; ++i) send(room(i), "nowhere", now + ros::Duration(0.1 * i));
  expectDiagnostic("Input", "Dropped: no transform", "3");
  EXPECT_EQ("2", diagnostic("Input", "Waiting for transforms"));
  EXPECT_TRUE(voxels().empty());
}

TEST_F(MappingNodelet, GoesOnWhenTimeJumpsBack) {
  ASSERT_TRUE(load());
  const ros::Time now = ros::Time::now(), before = now - ros::Duration(3600.0);
  const auto first = poseOf(0, 0, 0), second = poseOf(3, 1, 0);
  sendPose("sensor", first, now);
  publish(room(1), "sensor", first, now);
  ASSERT_TRUE(waitForMap(reference_));

  send(room(2), "sensor", now + ros::Duration(1.0));  // waits, as its transform doesn't come
  expectDiagnostic("Input", "Waiting for transforms", "1");
  publish(room(3), "sensor", second, before);
  expectDiagnostic("Input", "Dropped: time jump", "1");
  sendPose("sensor", second, before);
  EXPECT_TRUE(waitForMap(reference_));
  expectDiagnostic("Input", "Dropped: no transform", "0");
}

TEST_F(MappingNodelet, ExtremeStampsAreCountedAndEndNothing) {
  ASSERT_TRUE(load());
  sendStaticPose("sensor", poseOf(0, 0, 0));
  send(room(1), "sensor", ros::Time(4000000000U));
  send(room(1), "sensor", ros::Time(1000000000U));
  send(room(1), "sensor", ros::Time(4294967295U, 999999999U));
  send(room(1), "nowhere", ros::Time(4294967295U));
  expectDiagnostic("Input", "Dropped: malformed", "3");
  expectDiagnostic("Input", "Inserted", "1");
  expectDiagnostic("Nodelet", "Callbacks that failed", "0");
}

TEST_F(MappingNodelet, ALateSensorIsNoJumpOfTime) {
  ASSERT_TRUE(load());
  const ros::Time start = ros::Time::now();
  for (int i = 0; i < 20; ++i) {
    const ros::Time stamp = start + ros::Duration(0.1 * i);
    for (const char* sensor : {"early", "late"}) {
      sendPose(sensor, poseOf(0, 0, 0), stamp - ros::Duration(1.5));
      sendPose(sensor, poseOf(0, 0, 0), stamp);
    }
    spinFor(0.01);
    send(room(1), "early", stamp);
    send(room(1), "late", stamp - ros::Duration(1.5));
  }
  expectDiagnostic("Input", "Inserted", "40");
  expectDiagnostic("Input", "Dropped: time jump", "0");
  expectDiagnostic("Input", "Dropped: no transform", "0");
}

TEST_F(MappingNodelet, SurvivesWhateverArrives) {
  setParam("sensor_model/max_range", 100.0);
  ASSERT_TRUE(load());
  Recorder<nav_msgs::OccupancyGrid> projection(node_, "projected_map");
  Recorder<visualization_msgs::MarkerArray> markers(node_, "occupied_cells_vis_array");
  ros::Publisher corrected = node_.advertise<mapping_msgs::CorrectedMap>("corrected_cloud_map", 10);
  ASSERT_TRUE(waitFor([&] { return corrected.getNumSubscribers() > 0; }));
  mapping_msgs::CorrectedMap empty;
  empty.header.frame_id = map_frame_;
  empty.correction.orientation.w = 1.0;
  const std::string bytes = OccupancyMap().toBytes();
  empty.data.assign(bytes.begin(), bytes.end());
  for (const char* sensor : {"a", "b"}) sendStaticPose(sensor, poseOf(1, 2, 0.5));
  const std::vector<std::string> frames = {frame("a"), frame("b")};
  mapping_common::fuzz(frames, [&](mapping_common::MessageFuzz& fuzz) {
    const std::string sensor = fuzz.pick<std::string>({"a", "b"});
    switch (fuzz.pick<int>({0, 0, 0, 1, 1, 1, 2, 3, 3, 3})) {
      case 0: {
        sensor_msgs::PointCloud2 cloud = room(1);
        cloud.header.frame_id = frame(sensor);
        cloud.header.stamp = ros::Time::now();
        fuzz.spoil(cloud);
        return clouds_.publish(cloud);
      }
      case 1: {
        sensor_msgs::LaserScan scan;
        scan.header.frame_id = frame(sensor);
        scan.header.stamp = ros::Time::now();
        scan.angle_increment = 0.01F;
        scan.range_max = 30.0F;
        scan.ranges.assign(100, 5.0F);
        scan.intensities.assign(100, 0.5F);
        fuzz.spoil(scan);
        return scans_.publish(scan);
      }
      case 2: {
        mapping_msgs::CorrectedMap map = empty;
        map.header.stamp = ros::Time::now();
        fuzz.spoil(map);
        return corrected.publish(map);
      }
      default: {
        tf2_msgs::TFMessage message;
        message.transforms = {transformOf("moving", poseOf(0, 0, 0), ros::Time::now())};
        fuzz.spoil(message);
        return tf_.publish(message);
      }
    }
  });
  for (const char* input : {"Clouds (Hz)", "Scans (Hz)"}) expectQuiet("Input", input);
  sendStaticPose("good", poseOf(0.1, 0.1, 0.1));
  std_srvs::Empty reset;
  ASSERT_TRUE(ros::service::call(name_ + "/reset", reset));
  reference_.setRange(0.0, 100.0);
  publish(room(2), "good", poseOf(0.1, 0.1, 0.1));
  EXPECT_TRUE(waitForMap(reference_));
}

TEST_F(MappingNodelet, BeamsOfCloudsStartAtTheSensor) {
  setParam("sensor_frame_id", frame("lidar"));
  ASSERT_TRUE(load());
  const auto pose = poseOf(2.3, 0.4, 0.1, 0.3);
  const auto cloud = room(1);
  const Scan expected = toScan(cloud, pose, {}).scan;
  auto registered = makeCloud(expected.hits);
  registered.header.frame_id = map_frame_;  // as LOAM publishes them
  registered.header.stamp = ros::Time::now();
  clouds_.publish(registered);
  expectDiagnostic("Input", "Waiting for transforms", "1");
  sendStaticPose("lidar", pose);
  reference_.insertScan(expected);
  EXPECT_TRUE(waitForMap(reference_));
}

TEST_F(MappingNodelet, WarnsOfCloudsInTheMapsFrame) {
  mapping_common::LogRecorder log(node_);
  ASSERT_TRUE(load());
  ASSERT_TRUE(log.waitForLink());
  auto cloud = room(1);
  cloud.header.frame_id = map_frame_;
  cloud.header.stamp = ros::Time::now();
  clouds_.publish(cloud);
  EXPECT_TRUE(log.waitFor("set ~sensor_frame_id"));
  expectDiagnostic("Input", "Inserted", "1");
}

TEST_F(MappingNodelet, ScanWithoutReturnClears) {
  ASSERT_TRUE(load());
  const auto pose = poseOf(0.1, 0.1, 0.1);
  sendStaticPose("laser", pose);
  sensor_msgs::LaserScan scan;
  scan.angle_min = -0.5F;
  scan.angle_increment = 0.01F;
  scan.range_min = 0.1F;
  scan.range_max = 8.0F;
  for (int i = 0; i < 100; ++i) scan.ranges.push_back(5.0F + 0.001F * static_cast<float>(i % 7));
  publish(scan, "laser", pose);
  ASSERT_TRUE(waitForMap(reference_));
  EXPECT_FALSE(cellsInBox(1000.0, true).cells.empty());

  scan.ranges.assign(100, kInf);
  for (int i = 0; i < 3; ++i) {
    publish(scan, "laser", pose);
    ASSERT_TRUE(waitForMap(reference_));
  }
  EXPECT_TRUE(cellsInBox(1000.0, true).cells.empty());
  EXPECT_EQ(VoxelState::kFree, reference_.stateAt({7.5, 0.1, 0.1}));

  scan.range_max = 0.0F;
  publish(scan, "laser", pose);
  expectDiagnostic("Input", "Not as it says: range_max", "1");
}

TEST_F(MappingNodelet, ScanWithoutReturnClearsOnlyIfAskedTo) {
  setParam("no_return_clears", false);
  ASSERT_TRUE(load());
  sendStaticPose("laser", poseOf(0, 0, 0));
  sensor_msgs::LaserScan scan;
  scan.range_max = 8.0F;
  scan.angle_increment = 0.01F;
  scan.ranges.assign(10, kInf);
  send(scan, "laser");
  expectDiagnostic("Input", "Inserted", "1");
  EXPECT_TRUE(voxels().empty());
}

TEST_F(MappingNodelet, LeavesTheRobotsOwnBodyOut) {
  setParam("robot_body", frame("base") + " -0.5 -0.5 -0.5 0.5 0.5 0.5; " + frame("nowhere") + " 0 0 0 1 1 1");
  ASSERT_TRUE(load());
  sendStaticPose("lidar", poseOf(5, 1, 0.5, 1.0));
  sendStaticPose("base", poseOf(5, 1, 0.5, 0.3));
  std::vector<Eigen::Vector3f> wall, all;
  for (int i = 0; i < 100; ++i) {
    wall.emplace_back(3.0F, 0.05F * static_cast<float>(i - 50), 0.0F);
    all.push_back(wall.back());
    all.emplace_back(0.004F * static_cast<float>(i), 0.1F, -0.2F);
  }
  send(makeCloud(all), "lidar");
  reference_.insertScan(toScan(makeCloud(wall), poseOf(5, 1, 0.5, 1.0), {}).scan);
  EXPECT_TRUE(waitForMap(reference_));
  expectDiagnostic("Input", "Points left out: the robot's own body", "100");
}

// ----------------------------------------------------------------------------------------------------
// services

TEST_F(MappingNodelet, SavesAndLoads) {
  ASSERT_TRUE(load());
  buildMap();
  const mapping_common::TempDir directory;
  EXPECT_TRUE(callWithPath<mapping_msgs::SaveMap>("save_map", directory.path("map")).success);
  EXPECT_EQ(voxelsOf(reference_), voxelsOf(OccupancyMap::load(directory.path("map"))));

  std_srvs::Empty reset;
  ASSERT_TRUE(ros::service::call(name_ + "/reset", reset));
  EXPECT_TRUE(voxels().empty());
  EXPECT_TRUE(callWithPath<mapping_msgs::LoadMap>("load_map", directory.path("map")).success);
  EXPECT_EQ(voxelsOf(reference_), voxels());

  // What fails leaves the map as it is.
  std::ofstream(directory.path("foreign")) << "no map";
  for (const std::string& path :
       {directory.path("foreign"), directory.path("missing"), std::string("relative"), std::string()}) {
    EXPECT_FALSE(callWithPath<mapping_msgs::LoadMap>("load_map", path).success) << path;
    EXPECT_EQ(voxelsOf(reference_), voxels());
  }
  EXPECT_FALSE(callWithPath<mapping_msgs::SaveMap>("save_map", directory.path("missing/map")).success);
  EXPECT_FALSE(callWithPath<mapping_msgs::SaveMap>("save_map", "relative").success);
  const auto foreign = callWithPath<mapping_msgs::SaveMap>("save_map", directory.path("map.bz"));
  EXPECT_FALSE(foreign.success);
  EXPECT_NE(std::string::npos, foreign.message.find(".bt and .ot (OctoMap)")) << foreign.message;
  EXPECT_NE(0, access(directory.path("map.bz").c_str(), F_OK));

  // The ending says the format.
  EXPECT_TRUE(callWithPath<mapping_msgs::SaveMap>("save_map", directory.path("map.ot")).success);
  EXPECT_EQ(voxelsOf(reference_), voxelsOf(readOctomap(directory.path("map.ot"))));
  ASSERT_TRUE(ros::service::call(name_ + "/reset", reset));
  EXPECT_TRUE(callWithPath<mapping_msgs::LoadMap>("load_map", directory.path("map.ot")).success);
  EXPECT_EQ(voxelsOf(reference_), voxels());

  // The loaded map goes on.
  sendStaticPose("later", poseOf(1, 1, 0.2));
  publish(room(7), "later", poseOf(1, 1, 0.2));
  EXPECT_TRUE(waitForMap(reference_));
}

TEST_F(MappingNodelet, SavesAtTheEndAndStartsWithAMap) {
  const mapping_common::TempDir directory;
  setParam("save_on_shutdown", directory.path("map"));
  ASSERT_TRUE(load());
  buildMap();
  unload();
  ASSERT_TRUE(waitFor([&] { return access(directory.path("map").c_str(), F_OK) == 0; }));
  setParam("save_on_shutdown", std::string());
  setParam("map_file", directory.path("map"));
  ASSERT_TRUE(load());
  EXPECT_EQ(voxelsOf(reference_), voxels());
}

TEST_F(MappingNodelet, KeepsInAFileWhatIsFar) {
  const mapping_common::TempDir directory;
  const std::string store = directory.path("map.db"), copy = directory.path("copy.map");
  setParam("window/file", store);
  setParam("window/distance", 0.0);
  setParam("window/memory", 1000.0);
  setParam("window_flush_period", 0.2);
  ASSERT_TRUE(load());
  buildMap();
  EXPECT_TRUE(waitFor([&] { return voxelsOf(OccupancyMap::load(store)) == voxelsOf(reference_); }));
  EXPECT_TRUE(callWithPath<mapping_msgs::SaveMap>("save_map", copy).success);
  EXPECT_EQ(voxelsOf(reference_), voxelsOf(OccupancyMap::load(copy)));
  EXPECT_FALSE(callWithPath<mapping_msgs::SaveMap>("save_map", store).success);
  EXPECT_FALSE(callWithPath<mapping_msgs::LoadMap>("load_map", store).success);
  EXPECT_EQ(voxelsOf(reference_), voxels());
  unload();
  ASSERT_TRUE(waitFor([&] { return voxelsOf(OccupancyMap::load(store)) == voxelsOf(reference_); }));

  // The next run goes on.
  setParam("window/memory", 0.0);
  ASSERT_TRUE(load());
  EXPECT_EQ(voxelsOf(reference_), voxels());
  sendStaticPose("later", poseOf(1, 1, 0.2));
  publish(room(7), "later", poseOf(1, 1, 0.2));
  EXPECT_TRUE(waitForMap(reference_));
  EXPECT_TRUE(callWithPath<mapping_msgs::LoadMap>("load_map", copy).success);
  EXPECT_EQ(voxelsOf(OccupancyMap::load(copy)), voxels());
  std_srvs::Empty reset;
  ASSERT_TRUE(ros::service::call(name_ + "/reset", reset));
  EXPECT_TRUE(voxels().empty());
  unload();

  // It isn't overwritten unasked.
  setParam("map_file", copy);
  const std::string why = whyNotLoaded();
  EXPECT_NE(std::string::npos, why.find("~window/file is '" + store + "', which holds a map already")) << why;
  setParam("map_file", std::string());
  setParam("resolution", 0.3);
  setParam("other_resolution", std::string("refuse"));
  EXPECT_NE(std::string::npos, whyNotLoaded().find("of 0.2 m"));
}

sensor_msgs::PointCloud2 coloredRoom(unsigned seed) {
  using sensor_msgs::PointField;
  std::vector<std::vector<double>> points;
  for (const auto& p : roomPoints({4, 3, 1.5}, 1000, seed))
    points.push_back(
        {p.x(), p.y(), p.z(), static_cast<double>(packedColor({100, 200, 50}) + points.size() % 50)});
  constexpr std::uint8_t kFloat = PointField::FLOAT32;
  return makeCloud({{"x", kFloat}, {"y", kFloat}, {"z", kFloat}, {"rgba", PointField::UINT32}}, points);
}

TEST_F(MappingNodelet, ColoursWhatItMaps) {
  const mapping_common::TempDir directory;
  const std::string file = directory.path("colors.map"), plain = directory.path("plain.map");
  setParam("color", true);
  setParam("color_mode", std::string("color"));
  setParam("full_map_period", 0.0);
  ASSERT_TRUE(load());
  reference_.setColor(true);
  sendStaticPose("sensor", poseOf(0.1, 0.2, 0.3));
  const auto insert = [this](unsigned seed) {
    send(coloredRoom(seed), "sensor");
    ScanLimits limits;
    limits.color = true;
    reference_.insertScan(toScan(coloredRoom(seed), poseOf(0.1, 0.2, 0.3), limits).scan);
  };
  const auto expectColors = [&] {
    ASSERT_TRUE(callWithPath<mapping_msgs::SaveMap>("save_map", file).success);
    const std::vector<ColoredVoxel> actual = OccupancyMap::load(file).coloredVoxels(),
                                    expected = reference_.coloredVoxels();
    ASSERT_EQ(expected.size(), actual.size());
    EXPECT_GT(expected.size(), 100u);
    for (std::size_t i = 0; i < expected.size(); ++i) {
      EXPECT_EQ(expected[i].voxel, actual[i].voxel);
      EXPECT_TRUE(expected[i].color == actual[i].color);
    }
  };
  insert(1);
  ASSERT_TRUE(waitForMap(reference_));
  expectColors();
  Recorder<OctomapMessage> octomaps(node_, "octomap_full");
  Recorder<sensor_msgs::PointCloud2> cells(node_, "occupied_cells_centers");
  Recorder<visualization_msgs::MarkerArray> markers(node_, "occupied_cells_vis_array");
  ASSERT_TRUE(waitFor(
      [&] { return !octomaps.messages.empty() && !cells.messages.empty() && !markers.messages.empty(); }));
  EXPECT_EQ("ColorOcTree", octomaps.messages.back().id);
  EXPECT_TRUE(toOctomap(reference_, OctomapFormat::kFull).bytes == octomaps.messages.back().data);
  EXPECT_EQ(occupiedCloud(reference_).data, cells.messages.back().data);
  EXPECT_EQ("rgb", cells.messages.back().fields.back().name);
  for (const auto& marker : markers.messages.back().markers)
    for (const auto& color : marker.colors) EXPECT_NEAR(100.0, 255 * color.r, 0.1);

  // A map without colours gets some from then on.
  reference_.setColor(false);
  reference_.save(plain);
  reference_.setColor(true);
  ASSERT_TRUE(callWithPath<mapping_msgs::LoadMap>("load_map", plain).success);
  insert(2);
  ASSERT_TRUE(waitForMap(reference_));
  expectColors();
}

TEST_F(MappingNodelet, HasNoColoursInAWindow) {
  const mapping_common::TempDir directory;
  const std::string file = directory.path("colors.map");
  setParam("color", true);
  setParam("window/file", directory.path("map.db"));
  const std::string why = whyNotLoaded();
  EXPECT_NE(std::string::npos, why.find("~color is true, allowed is false with a rolling window")) << why;
  setParam("color", false);
  ASSERT_TRUE(load());
  buildMap();
  OccupancyMap colored;
  colored.setColor(true);
  colored.save(file);
  EXPECT_FALSE(callWithPath<mapping_msgs::LoadMap>("load_map", file).success);
  EXPECT_EQ(voxelsOf(reference_), voxels());
}

TEST_F(MappingNodelet, ClearsABox) {
  ASSERT_TRUE(load());
  buildMap();
  BoundingBoxQuery query;
  query.request.min = toPoint({-10, -10, -10});
  query.request.max = toPoint({2, 10, 10});
  ASSERT_TRUE(ros::service::call(name_ + "/clear_bbx", query));
  const Voxels before = voxels();
  EXPECT_FALSE(reference_.clearBox(toEigen(query.request.min), toEigen(query.request.max)).empty());
  EXPECT_EQ(voxelsOf(reference_), before);
  std::swap(query.request.min, query.request.max);
  EXPECT_FALSE(ros::service::call(name_ + "/clear_bbx", query));
  query.request.min.x = kNan;
  EXPECT_FALSE(ros::service::call(name_ + "/clear_bbx", query));
  EXPECT_EQ(before, voxels());
}

TEST_F(MappingNodelet, ListsCellsInABox) {
  setParam("reflectivity", true);
  ASSERT_TRUE(load());
  sendStaticPose("sensor", poseOf(0.1, 0.1, 0.1));
  constexpr std::uint8_t kFloat = sensor_msgs::PointField::FLOAT32;
  send(makeCloud({{"x", kFloat}, {"y", kFloat}, {"z", kFloat}, {"intensity", kFloat}},
                 {{3, 0, 0, 40}, {3, 0, 0, 60}}),
       "sensor");
  ASSERT_TRUE(waitFor([this] { return !voxels().empty(); }));
  const auto occupied = cellsInBox(10.0, true).cells, all = cellsInBox(10.0, false).cells;
  ASSERT_EQ(1u, occupied.size());
  EXPECT_GT(all.size(), 1u);
  EXPECT_TRUE(occupied[0].occupied);
  EXPECT_FLOAT_EQ(0.7F, occupied[0].probability);
  EXPECT_FLOAT_EQ(50.0F, occupied[0].reflectivity);
  EXPECT_EQ(2u, occupied[0].returns);
  EXPECT_NEAR(3.0, occupied[0].min.x, 1e-6);
  EXPECT_NEAR(3.2, occupied[0].max.x, 1e-6);
  EXPECT_TRUE(cellsInBox(1.0, true).cells.empty());
  CellsInBox query;
  query.request.min.y = 1.0;
  EXPECT_FALSE(ros::service::call(name_ + "/cells_in_box", query));
}

TEST_F(MappingNodelet, CastsRays) {
  ASSERT_TRUE(load());
  buildMap();
  for (const bool ignore_unknown : {true, false}) {
    for (const Eigen::Vector3d& direction :
         {Eigen::Vector3d(1, 0.2, 0), Eigen::Vector3d(-1, 2, 0.1), Eigen::Vector3d(0, 0, 1)}) {
      for (const double range : {0.5, 30.0}) {
        CastRay ray;
        ray.request.origin = toPoint({0.1, 0.1, 0.1});
        ray.request.direction.x = direction.x();
        ray.request.direction.y = direction.y();
        ray.request.direction.z = direction.z();
        ray.request.max_range = range;
        ray.request.ignore_unknown = ignore_unknown;
        ASSERT_TRUE(ros::service::call(name_ + "/cast_ray", ray));
        const RayHit hit = reference_.castRay({0.1, 0.1, 0.1}, direction, range, ignore_unknown);
        EXPECT_EQ(static_cast<int>(hit.result), ray.response.result);
        EXPECT_LT((hit.point - toEigen(ray.response.point)).norm(), 1e-9);
        if (hit.result == RayHit::Result::kOccupied) {
          // The nodelet's cells are the same as far as the voxels go, not in how they fused.
          EXPECT_TRUE(ray.response.cell.occupied);
          EXPECT_TRUE(((toEigen(ray.response.cell.min) - hit.point).array() < 1e-6).all());
          EXPECT_TRUE(((hit.point - toEigen(ray.response.cell.max)).array() < 1e-6).all());
        }
      }
    }
  }
  CastRay nowhere;
  nowhere.request.max_range = 1.0;
  EXPECT_FALSE(ros::service::call(name_ + "/cast_ray", nowhere));
}

// --------------------------------------------------------------------------------------------------
// parameters

TEST_F(MappingNodelet, DoesNotStartWithAWrongValue) {
  setParam("sensor_model/hit", 1.5);
  const std::string why = whyNotLoaded();
  EXPECT_NE(std::string::npos, why.find("~sensor_model/hit")) << why;
  EXPECT_NE(std::string::npos, why.find("1.5")) << why;
  EXPECT_NE(std::string::npos, why.find("0.5 to below 1")) << why;
  setParam("sensor_model/hit", 0.7);
  EXPECT_TRUE(load());  // the manager is none the worse for it
}

TEST_F(MappingNodelet, DoesNotStartWithAnUnknownParameter) {
  setParam("sensor_model/maxrange", 10.0);
  const std::string why = whyNotLoaded();
  EXPECT_NE(std::string::npos, why.find("unknown: ~sensor_model/maxrange")) << why;
  EXPECT_NE(std::string::npos, why.find("rosparam delete " + name_ + "/sensor_model/maxrange")) << why;
}

TEST_F(MappingNodelet, DoesNotStartWithoutItsMapFile) {
  setParam("map_file", std::string("/nowhere/map"));
  const std::string why = whyNotLoaded();
  EXPECT_NE(std::string::npos, why.find("/nowhere/map")) << why;
}

TEST_F(MappingNodelet, RangeCanBeReconfigured) {
  ASSERT_TRUE(load());
  const auto set = [this](const std::string& name, double value) {
    dynamic_reconfigure::Reconfigure call;
    call.request.config.doubles.resize(1);
    call.request.config.doubles[0].name = name;
    call.request.config.doubles[0].value = value;
    EXPECT_TRUE(ros::service::call(name_ + "/set_parameters", call));
    for (const auto& d : call.response.config.doubles) {
      if (d.name == name) return d.value;
    }
    return std::nan("");
  };
  EXPECT_EQ(2.0, set("max_range", 2.0));
  EXPECT_EQ(0.0, set("min_range", 3.0));  // beyond max_range: stays as it was
  reference_.setRange(0.0, 2.0);
  sendStaticPose("sensor", poseOf(0, 0, 0));
  publish(room(1), "sensor", poseOf(0, 0, 0));
  EXPECT_TRUE(waitForMap(reference_));
  EXPECT_EQ(-1.0, set("max_range", -1.0));
  reference_.setRange(0.0, kInf);
  publish(room(2), "sensor", poseOf(0, 0, 0));
  EXPECT_TRUE(waitForMap(reference_));
  // What was reconfigured is a parameter under its own name, with which the nodelet starts.
  EXPECT_EQ(1.0, set("min_range", 1.0));
  double min_range = 0.0;
  EXPECT_TRUE(ros::param::get(name_ + "/sensor_model/min_range", min_range));
  EXPECT_EQ(1.0, min_range);
  EXPECT_FALSE(ros::param::has(name_ + "/min_range"));
  unload();
  EXPECT_TRUE(load());
}

}  // namespace
}  // namespace rtree_occupancy_map

int main(int argc, char** argv) {
  ::testing::InitGoogleTest(&argc, argv);
  ros::init(argc, argv, "test_mapping_nodelet");
  ros::NodeHandle keep_alive;
  return RUN_ALL_TESTS();
}
