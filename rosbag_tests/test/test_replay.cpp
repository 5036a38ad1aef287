// SPDX-License-Identifier: BSD-3-Clause
//
// Recordings go through the mapping nodelet, and its map is the one that the map's core builds from the same
// recording: every voxel, state and log odds.
#include <diagnostic_msgs/DiagnosticArray.h>
#include <gtest/gtest.h>
#include <mapping_common/testing/recordings.h>
#include <mapping_msgs/SaveMap.h>
#include <mapping_simulation/ros/simulation_bag.h>
#include <mapping_simulation/testing/worlds.h>
#include <nodelet/NodeletLoad.h>
#include <nodelet/NodeletUnload.h>
#include <ros/ros.h>
#include <rosbag/bag.h>
#include <rosbag/view.h>
#include <rosgraph_msgs/Clock.h>
#include <rosgraph_msgs/Log.h>
#include <rtree_occupancy_map/CellsInBox.h>
#include <rtree_occupancy_map/ros/cell_conversion.h>
#include <rtree_occupancy_map/ros/scan_conversion.h>
#include <signal.h>
#include <sys/wait.h>
#include <tf2/buffer_core.h>
#include <tf2_eigen/tf2_eigen.h>
#include <tf2_msgs/TFMessage.h>
#include <unistd.h>

#include <algorithm>
#include <functional>
#include <map>
#include <string>
#include <vector>

#include "voxels.h"

namespace rosbag_tests {

using mapping_common::TempDir;
using mapping_simulation::configFile;
using mapping_simulation::loadSensor;
using mapping_simulation::loadTrajectory;
using mapping_simulation::loadWorld;
using mapping_simulation::Simulation;
using mapping_simulation::SimulationBagOptions;
using mapping_simulation::writeSimulationBag;

namespace {

using mapping_common::findRecording;
using mapping_common::withoutRecording;

using rtree_occupancy_map::OccupancyMap;

// The worlds are below, the probes above this height (m).
constexpr double kProbeHeight = 200.0;

const ros::Duration kWholeBag(3600.0);

/// Lets callbacks run until the condition holds. @return false if it didn't in time
bool waitFor(const std::function<bool()>& condition, double seconds = 20.0) {
  const ros::WallTime end = ros::WallTime::now() + ros::WallDuration(seconds);
  while (ros::ok()) {
    ros::spinOnce();
    if (condition()) return true;
    if (ros::WallTime::now() > end) return false;
    ros::WallDuration(0.002).sleep();
  }
  return false;
}

geometry_msgs::TransformStamped makeTransform(const std::string& parent, const std::string& child,
                                              const ros::Time& stamp, const Eigen::Vector3d& translation) {
  geometry_msgs::TransformStamped transform =
      tf2::eigenToTransform(Eigen::Isometry3d(Eigen::Translation3d(translation)));
  transform.header.frame_id = parent;
  transform.header.stamp = stamp;
  transform.child_frame_id = child;
  return transform;
}

void readTransforms(const rosbag::Bag& bag, tf2::BufferCore& transforms) {
  const std::vector<std::string> topics{"/tf", "/tf_static"};
  for (const rosbag::MessageInstance& m : rosbag::View(bag, rosbag::TopicQuery(topics))) {
    const auto tf = m.instantiate<tf2_msgs::TFMessage>();
    ASSERT_TRUE(tf);
    for (const auto& transform : tf->transforms)
      transforms.setTransform(transform, "bag", m.getTopic() == "/tf_static");
  }
}

// A single point, 1 m ahead.
void makeProbe(sensor_msgs::LaserScan& scan) {
  scan.angle_increment = 0.01f;
  scan.range_max = 10.0f;
  scan.ranges = {1.0f};
}
void makeProbe(sensor_msgs::PointCloud2& cloud) {
  const float point[3] = {1.0f, 0.0f, 0.0f};
  for (const char* name : {"x", "y", "z"}) {
    sensor_msgs::PointField field;
    field.name = name;
    field.datatype = sensor_msgs::PointField::FLOAT32;
    field.offset = static_cast<std::uint32_t>(4 * cloud.fields.size());
    field.count = 1;
    cloud.fields.push_back(field);
  }
  cloud.width = cloud.height = 1;
  cloud.point_step = cloud.row_step = sizeof(point);
  cloud.data.assign(reinterpret_cast<const std::uint8_t*>(point),
                    reinterpret_cast<const std::uint8_t*>(point) + sizeof(point));
}

/// A nodelet of its own for each test, in the manager /manager.
///
/// play() publishes a recording, and the map must come out exactly, so it must not depend on which of two
/// topics is received first. Therefore it sends no scan before the nodelet has dealt with all that came
/// before. To find out it sends a probe: a scan of one point, high above the world, whose transform comes
/// after those of the recording and that comes after the scans of its topic. When the probe is in the map, so
/// are they. A probe has no stamp, so that it plays no part in the nodelet's dealing with time.
class Replay : public testing::Test {
 protected:
  Replay()
      : test_(testing::UnitTest::GetInstance()->current_test_info()->name()),
        node_("/" + test_),
        name_("/" + test_ + "/mapping") {
    diagnostics_ = node_.subscribe<diagnostic_msgs::DiagnosticArray>(
        "/diagnostics", 100, [this](const diagnostic_msgs::DiagnosticArray::ConstPtr& message) {
          for (const auto& status : message->status) {
            if (status.name.find(test_ + "/mapping: Input") == std::string::npos) continue;
            nodelet_time_ = message->header.stamp;
            for (const auto& pair : status.values) input_[pair.key] = pair.value;
          }
        });
    log_ = node_.subscribe<rosgraph_msgs::Log>(
        "/rosout", 100, [this](const rosgraph_msgs::Log::ConstPtr& message) {
          if (message->name == "/manager" && message->level >= rosgraph_msgs::Log::WARN)
            warnings_.push_back(message->msg);
        });
  }
  ~Replay() override {
    nodelet::NodeletUnload unload;
    unload.request.name = name_;
    if (loaded_) ros::service::call("/manager/unload_nodelet", unload);
  }

  void load(const std::string& frame_id) {
    frame_id_ = frame_id;
    ros::param::set(name_ + "/frame_id", frame_id);
    ros::param::set(name_ + "/queue_size", 1000);
    nodelet::NodeletLoad load;
    load.request.name = name_;
    load.request.type = "rtree_occupancy_map/MappingNodelet";
    ASSERT_TRUE(ros::service::waitForService("/manager/load_nodelet", 20000));
    ASSERT_TRUE(ros::service::call("/manager/load_nodelet", load) && load.response.success);
    loaded_ = true;
    cells_ = node_.serviceClient<rtree_occupancy_map::CellsInBox>(name_ + "/cells_in_box", true);
    ASSERT_TRUE(waitFor([this] { return log_.getNumPublishers() > 1 && !input_.empty(); }));
  }

  void advertise() {
    clock_publisher_ = node_.advertise<rosgraph_msgs::Clock>("/clock", 1000);
    tf_publisher_ = node_.advertise<tf2_msgs::TFMessage>("/tf", 1000);
    static_publisher_ = node_.advertise<tf2_msgs::TFMessage>("/tf_static", 10, true);
    clouds_ = node_.advertise<sensor_msgs::PointCloud2>("cloud_in", 1000);
    scans_ = node_.advertise<sensor_msgs::LaserScan>("scan", 1000);
    ASSERT_TRUE(waitFor([this] {
      return clock_publisher_.getNumSubscribers() > 1 && tf_publisher_.getNumSubscribers() > 0 &&
             static_publisher_.getNumSubscribers() > 0 && clouds_.getNumSubscribers() > 0 &&
             scans_.getNumSubscribers() > 0;
    }));
  }

  /// Publishes the transforms and the scans of a bag in their order, with a clock, and puts the scans into
  /// reference_. A scan whose transform comes later in the bag is published right after that one.
  void play(const std::string& file, const std::vector<geometry_msgs::TransformStamped>& mounts = {}) {
    const rosbag::Bag bag(file);
    tf2::BufferCore all(kWholeBag), published(kWholeBag);  // transforms of the bag
    readTransforms(bag, all);
    for (const auto& mount : mounts) all.setTransform(mount, "mount", true);
    std::vector<Pending> waiting;
    ASSERT_NO_FATAL_FAILURE(setTime(rosbag::View(bag).getBeginTime()));
    if (!mounts.empty()) {
      ASSERT_NO_FATAL_FAILURE(publishStatic(mounts, published));
    }
    for (const rosbag::MessageInstance& m : rosbag::View(bag)) {
      ASSERT_NO_FATAL_FAILURE(setTime(m.getTime()));
      if (const auto tf = m.instantiate<tf2_msgs::TFMessage>()) {
        if (m.getTopic() == "/tf_static") {
          ASSERT_NO_FATAL_FAILURE(publishStatic(tf->transforms, published));
          continue;
        }
        for (const auto& transform : tf->transforms) published.setTransform(transform, "bag");
        tf_publisher_.publish(*tf);
      } else if (const auto cloud = m.instantiate<sensor_msgs::PointCloud2>()) {
        waiting.push_back(makePending(*cloud, clouds_, clouds_sent_));
      } else if (const auto scan = m.instantiate<sensor_msgs::LaserScan>()) {
        waiting.push_back(makePending(*scan, scans_, scans_sent_));
      }
      for (auto p = waiting.begin(); p != waiting.end();) {
        const bool ready = published.canTransform(frame_id_, p->frame_id, p->stamp);
        const bool never = !all.canTransform(frame_id_, p->frame_id, p->stamp);
        if (ready || never) {
          ASSERT_NO_FATAL_FAILURE(p->send(ready ? &published : nullptr));
          without_transform_ += never;
          p = waiting.erase(p);
        } else {
          ++p;
        }
      }
    }
    EXPECT_TRUE(waiting.empty());
    ASSERT_NO_FATAL_FAILURE(settle());
  }

  /// Inserts the scans of a bag's topic into reference_ with the transforms that are in the bag.
  void insertFromBag(const std::string& file, const std::string& topic) {
    const rosbag::Bag bag(file);
    tf2::BufferCore transforms(kWholeBag);
    readTransforms(bag, transforms);
    for (const rosbag::MessageInstance& m : rosbag::View(bag, rosbag::TopicQuery(topic))) {
      const auto cloud = m.instantiate<sensor_msgs::PointCloud2>();
      ASSERT_TRUE(cloud);
      insert(*cloud, transforms);
    }
  }

  /// The nodelet's map against the reference.
  void expectMapOfTheCore() {
    mapping_msgs::SaveMap save;
    save.request.path = dir_.path("map");
    ASSERT_TRUE(ros::service::call(name_ + "/save_map", save));
    ASSERT_TRUE(save.response.success) << save.response.message;
    const OccupancyMap map = OccupancyMap::load(save.request.path);
    EXPECT_EQ(map.options().resolution, reference_.options().resolution);
    const rtree_occupancy_map::VoxelBox world =
        reference_.boxOf({-1e5, -1e5, -1e5}, {1e5, 1e5, kProbeHeight - 2.0});
    const auto expected = knownVoxels(reference_, world);
    EXPECT_EQ(expected.size(), knownVoxels(reference_).size());
    const auto occupied = std::count_if(expected.begin(), expected.end(),
                                        [](const KnownVoxel& voxel) { return voxel.occupied; });
    EXPECT_GT(occupied, 100);
    EXPECT_GT(static_cast<std::ptrdiff_t>(expected.size()) - occupied, 1000);
    EXPECT_TRUE(sameVoxels(knownVoxels(map, world), expected));
  }

  /// Of the latest diagnostics.
  long counted(const std::string& what) const {
    const auto found = input_.find(what);
    return found == input_.end() ? -1 : std::stol(found->second);
  }
  bool warned(const std::string& part) const {
    return std::any_of(warnings_.begin(), warnings_.end(),
                       [&](const std::string& w) { return w.find(part) != std::string::npos; });
  }

  const std::string test_;
  ros::NodeHandle node_;
  const std::string name_;
  TempDir dir_;
  OccupancyMap reference_;
  std::size_t inserted_ = 0;           // into reference_
  std::size_t without_transform_ = 0;  // scans that couldn't be
  std::size_t clouds_sent_ = 0, scans_sent_ = 0, settled_ = 0, probes_ = 0;
  std::vector<std::string> warnings_;
  std::map<std::string, std::string> input_;  // the nodelet's diagnostics

 private:
  struct Pending {
    std::string frame_id;
    ros::Time stamp;
    std::function<void(const tf2::BufferCore*)> send;  // into the reference, too, if there are transforms
  };

  template <class Message>
  Pending makePending(const Message& message, const ros::Publisher& publisher, std::size_t& sent) {
    return {message.header.frame_id, message.header.stamp,
            [this, message, &publisher, &sent](const tf2::BufferCore* transforms) {
              ASSERT_NO_FATAL_FAILURE(settle());
              publisher.publish(message);
              last_topic_is_clouds_ = &publisher == &clouds_;
              ++sent;
              if (transforms != nullptr) insert(message, *transforms);
            }};
  }

  template <class Message>
  void insert(const Message& message, const tf2::BufferCore& transforms) {
    const auto transform =
        transforms.lookupTransform(frame_id_, message.header.frame_id, message.header.stamp);
    reference_.insertScan(rtree_occupancy_map::toScan(message, tf2::transformToEigen(transform), {}).scan);
    ++inserted_;
  }

  void publishStatic(const std::vector<geometry_msgs::TransformStamped>& transforms,
                     tf2::BufferCore& buffer) {
    for (const auto& transform : transforms) buffer.setTransform(transform, "bag", true);
    settle(static_publisher_, transforms);
  }

  // As rosbag play --clock does. Where time begins or jumps back, it waits until the nodelet knows.
  void setTime(const ros::Time& time) {
    if (time == time_) return;
    const bool jump = time_.isZero() || time < time_;
    if (jump) {
      ros::spinOnce();
      nodelet_time_ = ros::Time();  // it may have been the same time before
    }
    rosgraph_msgs::Clock message;
    message.clock = time;
    clock_publisher_.publish(message);
    time_ = time;
    if (jump) {
      ASSERT_TRUE(waitFor([&] { return nodelet_time_ == time; })) << nodelet_time_;
    }
  }

  // Waits until all that was published has been dealt with.
  void settle() { settle(tf_publisher_, {}); }
  void settle(const ros::Publisher& publisher,
              const std::vector<geometry_msgs::TransformStamped>& transforms) {
    ++settled_;
    const Eigen::Vector3d position(0.1, 0.1, kProbeHeight + 0.1 + static_cast<double>(settled_));
    const Eigen::Vector3d end = position + Eigen::Vector3d::UnitX();
    rtree_occupancy_map::CellsInBox query;
    query.request.min = query.request.max = rtree_occupancy_map::toPoint(end);
    query.request.max.x += 0.01;
    query.request.max.y += 0.01;
    query.request.max.z += 0.01;
    query.request.occupied_only = true;
    const auto arrived = [&] { return cells_.call(query) && !query.response.cells.empty(); };
    // A probe that came before its transform is at the place of the one before, or dropped: the next one,
    // then.
    const ros::WallTime give_up = ros::WallTime::now() + ros::WallDuration(20.0);
    do {
      tf2_msgs::TFMessage tf;
      tf.transforms = transforms;
      const ros::Time stamp = time_ + ros::Duration(0, static_cast<int>(probes_));
      tf.transforms.push_back(makeTransform(frame_id_, test_ + "_probe", stamp, position));
      publisher.publish(tf);
      if (last_topic_is_clouds_) {
        publishProbe(clouds_, sensor_msgs::PointCloud2());
      } else {
        publishProbe(scans_, sensor_msgs::LaserScan());
      }
      if (waitFor(arrived, 0.05)) return;
    } while (ros::WallTime::now() < give_up);
    FAIL() << "probe " << settled_ << " is not in the map";
  }

  // The first one has a stamp, so that it waits for its transform.
  template <class Message>
  void publishProbe(const ros::Publisher& publisher, Message message) {
    makeProbe(message);
    message.header.frame_id = test_ + "_probe";
    if (probes_ == 0) message.header.stamp = time_;
    publisher.publish(message);
    ++probes_;
  }

  std::string frame_id_;
  bool loaded_ = false, last_topic_is_clouds_ = true;
  ros::Time time_, nodelet_time_;
  ros::Subscriber diagnostics_, log_;
  ros::ServiceClient cells_;
  ros::Publisher clock_publisher_, tf_publisher_, static_publisher_, clouds_, scans_;
};

Simulation makeSimulation(const std::string& world, double duration) {
  Simulation simulation{loadWorld(configFile(world)),
                        loadTrajectory(configFile(world)),
                        {loadSensor(configFile("simulator/velodyne_vlp16.yaml"))},
                        duration,
                        5};
  simulation.sensors[0].columns = 450;
  simulation.sensors[0].angle_increment = 2 * M_PI / 450;
  return simulation;
}

SimulationBagOptions withDrift() {
  SimulationBagOptions options;
  options.odometry_noise = {0.03, 0.02};  // map -> odom changes, too
  return options;
}

TEST_F(Replay, CloudsAndScansOfARoom) {
  Simulation simulation = makeSimulation("worlds/room_8x5.yaml", 2.05);
  simulation.sensors.push_back(loadSensor(configFile("simulator/hokuyo_utm30lx.yaml")));
  simulation.sensors[1].beam.range_max = 4.0;  // so that some beams have no return
  const std::string bag = dir_.path("room.bag");
  writeSimulationBag(bag, simulation, withDrift());
  ASSERT_NO_FATAL_FAILURE(load("map"));
  ASSERT_NO_FATAL_FAILURE(advertise());
  ASSERT_NO_FATAL_FAILURE(play(bag));
  EXPECT_EQ(clouds_sent_, 20u);
  EXPECT_EQ(scans_sent_, 82u);
  EXPECT_EQ(without_transform_, 0u);
  expectMapOfTheCore();
  EXPECT_TRUE(waitFor([this] { return counted("Inserted") == static_cast<long>(inserted_ + probes_); }))
      << counted("Inserted");
  for (const char* reason : {"no transform", "malformed", "empty", "time jump"})
    EXPECT_EQ(counted(std::string("Dropped: ") + reason), 0) << reason;
  EXPECT_FALSE(warned("Dropped"));
  EXPECT_FALSE(warned("Time jumped back"));
}

// Time jumps back and all comes again.
TEST_F(Replay, TwiceInARow) {
  Simulation simulation = makeSimulation("worlds/room_8x5.yaml", 2.05);
  simulation.sensors[0].columns = 90;
  simulation.sensors[0].angle_increment = 2 * M_PI / 90;
  const std::string bag = dir_.path("room.bag");
  writeSimulationBag(bag, simulation, withDrift());
  ASSERT_NO_FATAL_FAILURE(load("map"));
  ASSERT_NO_FATAL_FAILURE(advertise());
  ASSERT_NO_FATAL_FAILURE(play(bag));
  expectMapOfTheCore();
  EXPECT_FALSE(warned("Time jumped back"));
  ASSERT_NO_FATAL_FAILURE(play(bag));
  EXPECT_EQ(clouds_sent_, 40u);
  EXPECT_EQ(inserted_, 40u);
  expectMapOfTheCore();
  EXPECT_TRUE(waitFor([this] { return warned("Time jumped back"); }));
}

// As users do it. Only clouds, as the order of two topics is open then; their transforms come well before
// them.
TEST_F(Replay, CloudsOfAStreetByRosbagPlay) {
  const std::string bag = dir_.path("street.bag");
  SimulationBagOptions options = withDrift();
  options.start_time = 2e9;  // later than that of any other test: time must not jump back
  const std::size_t clouds = writeSimulationBag(bag, makeSimulation("worlds/street.yaml", 2.5), options);
  ASSERT_EQ(clouds, 25u);
  ASSERT_NO_FATAL_FAILURE(load("map"));

  const std::string remapping = "/velodyne_points:=/" + test_ + "/cloud_in";
  const pid_t player = fork();
  ASSERT_GE(player, 0);
  if (player == 0) {
    setpgid(0, 0);
    execlp("rosbag", "rosbag", "play", "--quiet", "--clock", "--keep-alive", "--wait-for-subscribers",
           bag.c_str(), "--topics", "/tf", "/tf_static", "/velodyne_points", remapping.c_str(), nullptr);
    _exit(127);
  }
  const bool all = waitFor([&] { return counted("Inserted") >= 25; }, 40.0);
  EXPECT_TRUE(all) << counted("Inserted") << " clouds inserted, " << counted("Waiting for transforms")
                   << " wait";
  int status = 0;
  kill(-player, SIGINT);
  if (!waitFor([&] { return waitpid(player, &status, WNOHANG) == player; }, 10.0)) {
    kill(-player, SIGKILL);
    waitpid(player, &status, 0);
  }
  EXPECT_FALSE(WIFEXITED(status) && WEXITSTATUS(status) == 127) << "rosbag isn't there";

  insertFromBag(bag, "/velodyne_points");
  EXPECT_EQ(inserted_, 25u);
  expectMapOfTheCore();
}

// 36 s of a robot with a slow planar scanner, odometry and no map frame. The recording lacks where the
// scanner is.
TEST_F(Replay, RecordedScansWithOdometry) {
  const std::string name = "rosbags_2d/rplidar_scan_tf.bag", bag = findRecording(name);
  if (bag.empty()) GTEST_SKIP() << withoutRecording(name);
  ASSERT_NO_FATAL_FAILURE(load("odom"));
  ASSERT_NO_FATAL_FAILURE(advertise());
  ASSERT_NO_FATAL_FAILURE(play(bag, {makeTransform("base_link", "laser", ros::Time(), {0.2, 0.0, 0.3})}));
  EXPECT_EQ(scans_sent_, 232u);
  EXPECT_EQ(without_transform_, 1u);  // from before the first odometry
  EXPECT_EQ(inserted_, 231u);
  expectMapOfTheCore();
  // That one waited until transforms of its time were out of the question.
  EXPECT_TRUE(waitFor([this] {
    return counted("Dropped: no transform") == 1 && counted("Waiting for transforms") == 0;
  })) << counted("Dropped: no transform")
      << ' ' << counted("Waiting for transforms");
  EXPECT_FALSE(warned("Time jumped back"));
}

}  // namespace
}  // namespace rosbag_tests

int main(int argc, char** argv) {
  testing::InitGoogleTest(&argc, argv);
  ros::init(argc, argv, "test_replay");
  ros::NodeHandle keep_alive;
  return RUN_ALL_TESTS();
}
