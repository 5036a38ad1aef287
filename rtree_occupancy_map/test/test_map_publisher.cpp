// SPDX-License-Identifier: BSD-3-Clause
//
// What the nodelet publishes: all of it to one who comes, later what changed, and nothing twice.
#include <dynamic_reconfigure/Reconfigure.h>
#include <map_msgs/OccupancyGridUpdate.h>
#include <nav_msgs/OccupancyGrid.h>
#include <ros/callback_queue.h>
#include <std_srvs/Empty.h>

#include <cstdio>
#include <iostream>
#include <memory>
#include <set>

#include "nodelet_fixture.h"
#include "rtree_occupancy_map/ros/octomap_message.h"

namespace rtree_occupancy_map {
namespace {

using visualization_msgs::MarkerArray;

class MapPublisher : public NodeletTest {
 protected:
  MapPublisher() {
    setParam("publish_free_space", true);
    setParam("full_map_period", 1000.0);
  }

  // A room around (x, 0, 0).
  void buildRoom(const std::string& sensor, double x, unsigned seed) {
    sendStaticPose(sensor, poseOf(x, 0, 0));
    publish(makeCloud(roomPoints({4, 3, 1.5}, 1000, seed)), sensor, poseOf(x, 0, 0));
    ASSERT_TRUE(waitForMap(reference_));
    spinFor(0.3);  // so that it is published by itself, most likely
  }

  std::vector<std::array<int, 6>> boxes(bool occupied) { return boxesOf(reference_, occupied); }
};

std::vector<std::array<int, 6>> boxesOf(const std::vector<MarkerArray>& messages) {
  MarkerDisplay display;
  for (const auto& message : messages) display.show(message);
  return display.boxes(0.2);
}

std::vector<std::array<int, 6>> boxesOf(const sensor_msgs::PointCloud2& cloud) {
  std::vector<std::array<int, 6>> boxes;
  for (std::size_t i = 0; i < cloud.width; ++i) {
    float v[8];
    std::memcpy(v, &cloud.data[i * cloud.point_step], sizeof(v));
    boxes.push_back(boxOf({v[0], v[1], v[2]}, {v[3], v[4], v[5]}, 0.2));
  }
  std::sort(boxes.begin(), boxes.end());
  return boxes;
}

// Subscribers of one process share a connection, so it takes another process to be another subscriber.
int printBoxes(const std::string& topic) {
  ros::NodeHandle node;
  Recorder<MarkerArray> recorder(node, topic);
  if (!recorder.waitForOne()) return 1;
  for (const auto& box : boxesOf(recorder.messages)) {
    for (const int value : box) std::cout << value << ' ';
  }
  return 0;
}

std::vector<std::array<int, 6>> boxesSeenByAnotherProcess(const std::string& topic) {
  const std::unique_ptr<FILE, int (*)(FILE*)> out(
      popen(("/proc/$PPID/exe --print-boxes " + topic).c_str(), "r"), pclose);
  std::vector<std::array<int, 6>> boxes;
  std::array<int, 6> b;
  while (fscanf(out.get(), "%d %d %d %d %d %d", &b[0], &b[1], &b[2], &b[3], &b[4], &b[5]) == 6) {
    boxes.push_back(b);
    ros::spinOnce();
  }
  return boxes;
}

// Voxels, as how cells fuse depends on the order of changes.
std::set<Voxel> voxelsIn(const std::vector<std::array<int, 6>>& boxes) {
  Voxels voxels;
  for (const auto& box : boxes) addVoxels(box, 0.0F, voxels);
  std::set<Voxel> set;
  for (const auto& [voxel, p] : voxels) set.insert(voxel);
  return set;
}

/// Until what was drawn are these boxes.
bool waitForBoxes(const Recorder<MarkerArray>& drawn, const std::vector<std::array<int, 6>>& boxes) {
  return waitFor([&, voxels = voxelsIn(boxes)] { return voxelsIn(boxesOf(drawn.messages)) == voxels; });
}

std::map<std::array<int, 2>, int> knownPixels(const nav_msgs::OccupancyGrid& grid) {
  std::map<std::array<int, 2>, int> pixels;
  const int x0 = static_cast<int>(std::lround(grid.info.origin.position.x / grid.info.resolution));
  const int y0 = static_cast<int>(std::lround(grid.info.origin.position.y / grid.info.resolution));
  for (std::size_t i = 0; i < grid.data.size(); ++i) {
    if (grid.data[i] != -1) {
      pixels[{x0 + static_cast<int>(i % grid.info.width), y0 + static_cast<int>(i / grid.info.width)}] =
          grid.data[i];
    }
  }
  return pixels;
}

std::map<std::array<int, 2>, int> projection(const OccupancyMap& map) {
  std::map<std::array<int, 2>, int> pixels;
  for (const auto& [voxel, probability] : voxelsOf(map)) {
    int& pixel = pixels[{voxel[0], voxel[1]}];
    pixel = std::max(pixel, probability >= 0.5F ? 100 : 0);
  }
  return pixels;
}

/// False, without a change, if the patch isn't within the grid.
bool patch(nav_msgs::OccupancyGrid& grid, const map_msgs::OccupancyGridUpdate& update) {
  if (update.x < 0 || update.y < 0 || update.x + update.width > grid.info.width ||
      update.y + update.height > grid.info.height)
    return false;
  for (std::size_t i = 0; i < update.data.size(); ++i)
    grid.data[(update.y + i / update.width) * grid.info.width + update.x + i % update.width] = update.data[i];
  return true;
}

// As RViz shows a map: of each topic only the last message waits while it draws.
class SlowDisplay {
 public:
  explicit SlowDisplay(ros::NodeHandle node) {
    node.setCallbackQueue(&queue_);
    map_ = node.subscribe<nav_msgs::OccupancyGrid>(
        "projected_map", 1, [this](const nav_msgs::OccupancyGrid::ConstPtr& map) { grid = *map; });
    updates_ = node.subscribe<map_msgs::OccupancyGridUpdate>(
        "projected_map_updates", 1, [this](const map_msgs::OccupancyGridUpdate::ConstPtr& update) {
          if (!grid.data.empty()) inside_ = patch(grid, *update) && inside_;
        });
  }
  /// What has come since the last call. False if a patch was outside of the map.
  bool draw() {
    queue_.callAvailable();
    return inside_;
  }
  nav_msgs::OccupancyGrid grid;

 private:
  ros::CallbackQueue queue_;
  ros::Subscriber map_, updates_;
  bool inside_ = true;
};

TEST_F(MapPublisher, OneWhoComesLateGetsItAll) {
  ASSERT_TRUE(load());
  buildRoom("sensor", 0.0, 1);
  Recorder<MarkerArray> occupied(node_, "occupied_cells_vis_array"), free(node_, "free_cells_vis_array");
  Recorder<sensor_msgs::PointCloud2> cells(node_, "occupied_cells_centers");
  Recorder<nav_msgs::OccupancyGrid> grid(node_, "projected_map");
  ASSERT_TRUE(waitFor([&] {
    return !occupied.messages.empty() && !free.messages.empty() && !cells.messages.empty() &&
           !grid.messages.empty();
  }));
  EXPECT_EQ(voxelsIn(boxes(true)), voxelsIn(boxesOf(occupied.messages)));
  EXPECT_EQ(voxelsIn(boxes(false)), voxelsIn(boxesOf(free.messages)));
  EXPECT_EQ(voxelsIn(boxes(true)), voxelsIn(boxesOf(cells.messages[0])));
  EXPECT_EQ(projection(reference_), knownPixels(grid.messages[0]));
  EXPECT_EQ(map_frame_, cells.messages[0].header.frame_id);
  EXPECT_EQ(map_frame_, grid.messages[0].header.frame_id);
  spinFor(0.5);
  EXPECT_EQ(1u, occupied.messages.size());
  EXPECT_EQ(1u, free.messages.size());
  EXPECT_EQ(1u, cells.messages.size());
  EXPECT_EQ(1u, grid.messages.size());
}

TEST_F(MapPublisher, LaterMessagesHoldWhatChanged) {
  ASSERT_TRUE(load());
  buildRoom("here", 0.0, 1);
  Recorder<MarkerArray> occupied(node_, "occupied_cells_vis_array"), free(node_, "free_cells_vis_array");
  Recorder<sensor_msgs::PointCloud2> cells(node_, "occupied_cells_centers"),
      cells_updates(node_, "occupied_cells_centers_updates");
  ASSERT_TRUE(waitFor(
      [&] { return !occupied.messages.empty() && !free.messages.empty() && !cells.messages.empty(); }));
  spinFor(0.5);
  const std::size_t occupied_before = occupied.messages.size(), free_before = free.messages.size();

  buildRoom("there", 64.0, 2);  // other blocks
  EXPECT_TRUE(waitForBoxes(occupied, boxes(true)));
  EXPECT_TRUE(waitForBoxes(free, boxes(false)));
  ASSERT_TRUE(waitFor([&] { return !cells_updates.messages.empty(); }));
  for (const auto* recorder : {&occupied, &free}) {
    for (std::size_t i = recorder == &occupied ? occupied_before : free_before; i < recorder->messages.size();
         ++i) {
      for (const auto& marker : recorder->messages[i].markers) {
        EXPECT_EQ(visualization_msgs::Marker::ADD, marker.action);
        for (const auto& p : marker.points) ASSERT_GT(p.x, 32.0);
      }
    }
  }
  const auto update = boxesOf(cells_updates.messages.back());
  ASSERT_FALSE(update.empty());
  for (const auto& box : update) EXPECT_GT(box[0], 32 / 0.2);
  EXPECT_EQ(1u, cells.messages.size());  // not due within full_map_period

  // Fused, split and vanished cells within blocks that are shown already.
  for (unsigned i = 3; i < 8; ++i) buildRoom("here", 0.0, i);
  EXPECT_TRUE(waitForBoxes(occupied, boxes(true)));
  EXPECT_TRUE(waitForBoxes(free, boxes(false)));
}

TEST_F(MapPublisher, AnotherSubscriberIsNoBotherToTheFirst) {
  ASSERT_TRUE(load());
  buildRoom("here", 0.0, 1);
  Recorder<MarkerArray> first(node_, "occupied_cells_vis_array");
  ASSERT_TRUE(waitFor([&] { return !first.messages.empty(); }));
  EXPECT_EQ(voxelsIn(boxes(true)),
            voxelsIn(boxesSeenByAnotherProcess(node_.resolveName("occupied_cells_vis_array"))));
  EXPECT_EQ(1u, first.messages.size());
}

TEST_F(MapPublisher, AnotherSubscriberSwallowsNothingOfWhatTheFirstIsYetToSee) {
  setParam("publish_rate", 0.2);
  ASSERT_TRUE(load());
  Recorder<MarkerArray> first(node_, "occupied_cells_vis_array");
  ASSERT_TRUE(waitFor([&] { return !first.messages.empty(); }));
  buildRoom("here", 0.0, 1);  // within the 5 s between two publications, most likely
  const auto seen = boxesSeenByAnotherProcess(node_.resolveName("occupied_cells_vis_array"));
  EXPECT_EQ(voxelsIn(boxes(true)), voxelsIn(seen));
  EXPECT_TRUE(waitForBoxes(first, boxes(true)));
}

TEST_F(MapPublisher, CellsAreSentAsAWholeNowAndThen) {
  setParam("full_map_period", 0.5);
  ASSERT_TRUE(load());
  Recorder<sensor_msgs::PointCloud2> cells(node_, "occupied_cells_centers");
  Recorder<nav_msgs::OccupancyGrid> grid(node_, "projected_map");
  ASSERT_TRUE(waitFor([&] { return !cells.messages.empty() && !grid.messages.empty(); }));
  buildRoom("here", 0.0, 1);
  buildRoom("here", 0.0, 2);
  EXPECT_TRUE(waitFor([&] { return voxelsIn(boxesOf(cells.messages.back())) == voxelsIn(boxes(true)); }));
  EXPECT_TRUE(waitFor([&] { return knownPixels(grid.messages.back()) == projection(reference_); }));
  spinFor(1.0);
  const std::size_t sent = cells.messages.size(), grids = grid.messages.size();
  spinFor(1.0);
  EXPECT_EQ(sent, cells.messages.size());  // nothing changed
  EXPECT_EQ(grids, grid.messages.size());
}

TEST_F(MapPublisher, ProjectionGrowsAndIsPatched) {
  ASSERT_TRUE(load());
  Recorder<nav_msgs::OccupancyGrid> grids(node_, "projected_map");
  Recorder<map_msgs::OccupancyGridUpdate> updates(node_, "projected_map_updates");
  ASSERT_TRUE(waitFor([&] { return !grids.messages.empty(); }));
  EXPECT_TRUE(knownPixels(grids.messages[0]).empty());
  const auto waitForWhole = [&] {
    return waitFor([&] { return knownPixels(grids.messages.back()) == projection(reference_); });
  };
  const ros::WallTime before = ros::WallTime::now();
  buildRoom("here", 0.0, 1);
  ASSERT_TRUE(waitForWhole());  // grown
  EXPECT_EQ(2u, grids.messages.size());
  buildRoom("here", 0.0, 2);
  // As a whole, because it has just grown; on a machine that is too slow for that, patched already.
  if (ros::WallTime::now() - before < ros::WallDuration(2.0)) {
    ASSERT_TRUE(waitForWhole());
    EXPECT_TRUE(updates.messages.empty());
  }
  spinFor(3.0);

  const std::size_t wholes = grids.messages.size();
  for (unsigned i = 3; i < 6; ++i) buildRoom("here", 0.0, i);
  nav_msgs::OccupancyGrid grid = grids.messages.back();
  std::size_t patches = 0;
  EXPECT_TRUE(waitFor([&] {
    for (; patches < updates.messages.size(); ++patches) {
      const auto& update = updates.messages[patches];
      EXPECT_EQ(std::size_t{update.width} * update.height, update.data.size());
      EXPECT_TRUE(patch(grid, update));
    }
    return knownPixels(grid) == projection(reference_);
  }));
  EXPECT_EQ(wholes, grids.messages.size());
  EXPECT_GT(patches, 0u);
}

TEST_F(MapPublisher, NoPatchOvertakesTheMapItIsFor) {
  ASSERT_TRUE(load());
  SlowDisplay display(node_);
  ASSERT_TRUE(waitFor([&] { return display.draw() && !display.grid.data.empty(); }));
  buildRoom("here", 0.0, 1);
  ASSERT_TRUE(display.draw());
  buildRoom("here", 0.0, 2);
  buildRoom("there", -64.0, 3);  // Where (0, 0) is in the map's data moves.
  buildRoom("there", -64.0, 4);
  EXPECT_TRUE(waitFor([&] { return display.draw() && knownPixels(display.grid) == projection(reference_); }));
  EXPECT_TRUE(display.draw());
}

TEST_F(MapPublisher, ResetTakesEverythingOffTheDisplay) {
  ASSERT_TRUE(load());
  buildRoom("here", 0.0, 1);
  Recorder<MarkerArray> occupied(node_, "occupied_cells_vis_array");
  Recorder<sensor_msgs::PointCloud2> cells(node_, "occupied_cells_centers");
  Recorder<nav_msgs::OccupancyGrid> grid(node_, "projected_map");
  ASSERT_TRUE(waitFor(
      [&] { return !occupied.messages.empty() && !cells.messages.empty() && !grid.messages.empty(); }));
  std_srvs::Empty reset;
  ASSERT_TRUE(ros::service::call(name_ + "/reset", reset));
  EXPECT_TRUE(waitFor([&] { return boxesOf(occupied.messages).empty(); }));
  EXPECT_TRUE(waitFor([&] { return cells.messages.back().width == 0; }));
  EXPECT_TRUE(waitFor([&] { return knownPixels(grid.messages.back()).empty(); }));
}

TEST_F(MapPublisher, ColoursAndHeightsCanBeReconfigured) {
  ASSERT_TRUE(load());
  buildRoom("here", 0.0, 1);
  Recorder<MarkerArray> occupied(node_, "occupied_cells_vis_array");
  Recorder<nav_msgs::OccupancyGrid> grid(node_, "projected_map");
  ASSERT_TRUE(waitFor([&] { return !occupied.messages.empty() && !grid.messages.empty(); }));
  dynamic_reconfigure::Reconfigure call;
  call.request.config.strs.resize(1);
  call.request.config.strs[0].name = "color_mode";
  call.request.config.strs[0].value = "occupancy";
  call.request.config.doubles.resize(1);
  call.request.config.doubles[0].name = "occupancy_max_z";
  call.request.config.doubles[0].value = -100.0;
  ASSERT_TRUE(ros::service::call(name_ + "/set_parameters", call));
  ASSERT_TRUE(waitFor([&] { return occupied.messages.size() > 1 && grid.messages.size() > 1; }));
  std::set<float> greens;
  MarkerDisplay display;
  for (const auto& message : occupied.messages) display.show(message);
  for (const auto& [id, marker] : display.markers()) {
    for (const auto& c : marker.colors) greens.insert(c.g);
  }
  EXPECT_EQ(1u, greens.size());  // after one scan all occupied cells are equally likely to be
  EXPECT_EQ(voxelsIn(boxes(true)), voxelsIn(boxesOf(occupied.messages)));
  EXPECT_TRUE(knownPixels(grid.messages.back()).empty());
  call.request.config.strs[0].value = "pink";
  ASSERT_TRUE(ros::service::call(name_ + "/set_parameters", call));
  for (const auto& s : call.response.config.strs) EXPECT_EQ("occupancy", s.value) << s.name;
}

TEST_F(MapPublisher, WithoutLatchOnlyChangesAreSent) {
  setParam("latch", false);
  ASSERT_TRUE(load());
  Recorder<sensor_msgs::PointCloud2> updates(node_, "occupied_cells_centers_updates");
  ASSERT_TRUE(updates.waitForLink());
  buildRoom("here", 0.0, 1);
  ASSERT_TRUE(waitFor([&] { return !updates.messages.empty(); }));
  Recorder<MarkerArray> occupied(node_, "occupied_cells_vis_array");
  ASSERT_TRUE(occupied.waitForLink());
  spinFor(1.0);
  EXPECT_TRUE(occupied.messages.empty());
  buildRoom("there", 64.0, 2);
  EXPECT_TRUE(waitFor([&] { return !occupied.messages.empty(); }));
  for (const auto& box : boxesOf(occupied.messages)) EXPECT_GT(box[0], 32 / 0.2);
}

// ------------------------------------------------------------------------------------------- OctoMap's
// topics

TEST_F(MapPublisher, OctomapsAreTheWholeMap) {
  setParam("full_map_period", 0.0);
  ASSERT_TRUE(load());
  buildRoom("a", 0.0, 1);
  for (const OctomapFormat format : {OctomapFormat::kBinary, OctomapFormat::kFull}) {
    const bool binary = format == OctomapFormat::kBinary;
    const std::string name = binary ? "octomap_binary" : "octomap_full";
    const auto expectCurrent = [&](const OctomapMessage& message) {
      EXPECT_EQ(binary, message.binary == 1);
      EXPECT_EQ("OcTree", message.id);
      EXPECT_EQ(0.2, message.resolution);
      EXPECT_EQ(map_frame_, message.header.frame_id);
      EXPECT_TRUE(toOctomap(reference_, format).bytes == message.data);
    };
    Recorder<OctomapMessage> recorder(node_, name);
    ASSERT_TRUE(recorder.waitForOne());
    expectCurrent(recorder.messages.back());
    const std::size_t before = recorder.messages.size();
    buildRoom(binary ? "b" : "c", binary ? 2.0 : 4.0, 2);
    const auto bytes = toOctomap(reference_, format).bytes;
    ASSERT_TRUE(
        waitFor([&] { return recorder.messages.size() > before && recorder.messages.back().data == bytes; }));
    expectCurrent(recorder.messages.back());

    GetOctomap service;
    ASSERT_TRUE(ros::service::call(node_.resolveName(name), service));
    expectCurrent(service.response.map);
    const std::size_t idle = recorder.messages.size();
    spinFor(0.3);
    EXPECT_EQ(idle, recorder.messages.size());  // nothing changed
  }
}

// What who has the package octomap_msgs expects.
TEST_F(MapPublisher, OctomapsAreThoseOfOctomapMsgs) {
  EXPECT_STREQ("octomap_msgs/Octomap", ros::message_traits::datatype<OctomapMessage>());
  EXPECT_STREQ("9a45536b45c5e409cd49f04bb2d9999f", ros::message_traits::md5sum<OctomapMessage>());
  EXPECT_STREQ("octomap_msgs/GetOctomap", ros::service_traits::datatype<GetOctomap::Request>());
  EXPECT_STREQ("be9d2869d24fe40d6bc21ac21f6bb2c5", ros::service_traits::md5sum<GetOctomap::Response>());
  OctomapMessage message;
  message.header.frame_id = "map";
  message.binary = 1;
  message.id = "OcTree";
  message.resolution = 0.5;
  message.data = std::string("\0\xff", 2);
  const ros::SerializedMessage bytes = ros::serialization::serializeMessage(message);
  // Length, header (seq, stamp, string), bool, string, float64, int8[].
  const std::string expected(
      "\x2c\0\0\0"
      "\0\0\0\0"
      "\0\0\0\0\0\0\0\0"
      "\3\0\0\0map"
      "\1"
      "\6\0\0\0OcTree"
      "\0\0\0\0\0\0\xe0\x3f"
      "\2\0\0\0"
      "\0\xff",
      48);
  EXPECT_EQ(expected, std::string(reinterpret_cast<const char*>(bytes.buf.get()), bytes.num_bytes));
}

}  // namespace
}  // namespace rtree_occupancy_map

int main(int argc, char** argv) {
  const std::string command = argc > 1 ? argv[1] : "";
  if (command == "--print-boxes") {
    ros::init(argc, argv, "another_subscriber", ros::init_options::AnonymousName);
    return rtree_occupancy_map::printBoxes(argv[2]);
  }
  ::testing::InitGoogleTest(&argc, argv);
  ros::init(argc, argv, "test_map_publisher");
  ros::NodeHandle keep_alive;
  return RUN_ALL_TESTS();
}
