// SPDX-License-Identifier: BSD-3-Clause
#include <gtest/gtest.h>
#include <mapping_common/files.h>
#include <mapping_common/testing/tool_test.h>
#include <mapping_simulation/posed_scan.h>
#include <mapping_simulation/ros/conversions.h>
#include <mapping_simulation/ros/simulation_bag.h>
#include <mapping_simulation/testing/worlds.h>
#include <nav_msgs/Odometry.h>
#include <rosbag/bag.h>
#include <rosbag/view.h>
#include <rosgraph_msgs/Clock.h>
#include <sensor_msgs/point_cloud2_iterator.h>
#include <tf2_msgs/TFMessage.h>

#include <cmath>
#include <map>

namespace mapping_simulation {
namespace {

Simulation makeSimulation() {
  Simulation simulation{loadWorld(configFile("worlds/room_8x5.yaml")),
                        loadTrajectory(configFile("worlds/room_8x5.yaml")),
                        {loadSensor(configFile("simulator/hokuyo_utm30lx.yaml")),
                         loadSensor(configFile("simulator/velodyne_vlp16.yaml"))},
                        0.5,
                        1};
  simulation.sensors[0].beam.range_max = 4.0;  // so that some beams have no return
  simulation.sensors[1].columns = 90;
  simulation.sensors[1].angle_increment = 2 * M_PI / 90;
  return simulation;
}

template <typename Message>
std::vector<typename Message::ConstPtr> messages(const rosbag::Bag& bag, const std::string& topic) {
  std::vector<typename Message::ConstPtr> all;
  for (const rosbag::MessageInstance& m : rosbag::View(bag, rosbag::TopicQuery(topic))) {
    all.push_back(m.instantiate<Message>());
    EXPECT_TRUE(all.back()) << topic << " has type " << m.getDataType();
  }
  return all;
}

class SimulationBag : public testing::Test {
 protected:
  void write(const Simulation& simulation, const SimulationBagOptions& options = SimulationBagOptions()) {
    sweeps_ = writeSimulationBag(file_, simulation, options);
    bag_.open(file_, rosbag::bagmode::Read);
  }

  TempDir dir_;
  std::string file_ = dir_.path("simulation.bag");
  rosbag::Bag bag_;
  std::size_t sweeps_ = 0;
};

TEST_F(SimulationBag, HasAllTopicsInOrder) {
  write(makeSimulation());
  std::map<std::string, int> counts;
  std::map<std::string, ros::Time> stamps;
  ros::Time receipt;
  for (const rosbag::MessageInstance& m : rosbag::View(bag_)) {
    ++counts[m.getTopic()];
    EXPECT_GE(m.getTime(), receipt);
    receipt = m.getTime();
    ros::Time stamp = m.getTime();
    if (const auto scan = m.instantiate<sensor_msgs::LaserScan>()) stamp = scan->header.stamp;
    if (const auto cloud = m.instantiate<sensor_msgs::PointCloud2>()) stamp = cloud->header.stamp;
    EXPECT_LE(stamp, receipt);
    EXPECT_GT(stamp, stamps[m.getTopic()]);
    stamps[m.getTopic()] = stamp;
  }
  const std::map<std::string, int> expected{{"/clock", 51},   {"/ground_truth", 51}, {"/odom", 51},
                                            {"/scan", 20},    {"/tf", 51},           {"/velodyne_points", 5},
                                            {"/tf_static", 1}};
  EXPECT_EQ(counts, expected);
  EXPECT_EQ(sweeps_, 25u);
  EXPECT_NEAR(messages<rosgraph_msgs::Clock>(bag_, "/clock").back()->clock.toSec(), 1000.5, 1e-6);
  EXPECT_FALSE(std::filesystem::exists(file_ + ".part"));
}

TEST_F(SimulationBag, ScansAreTheSweeps) {
  const Simulation simulation = makeSimulation();
  write(simulation);
  std::vector<PlanarScan> scans;
  std::vector<PosedScan> clouds;
  simulate(simulation, [&](const SensorConfig& sensor, const Sweep& sweep) {
    if (sensor.type == SensorConfig::Type::kPlanar) {
      scans.push_back(toPlanarScan(sensor, sweep));
    } else {
      clouds.push_back(toPosedScan(sensor, sweep));
    }
  });
  const auto scan_messages = messages<sensor_msgs::LaserScan>(bag_, "/scan");
  ASSERT_EQ(scan_messages.size(), scans.size());
  int without_return = 0;
  for (std::size_t i = 0; i < scans.size(); ++i) {
    const sensor_msgs::LaserScan& m = *scan_messages[i];
    EXPECT_EQ(m.header.frame_id, "laser");
    EXPECT_NEAR(m.header.stamp.toSec(), 1000.0 + scans[i].stamp, 1e-6);
    EXPECT_EQ(m.ranges, scans[i].ranges);
    EXPECT_EQ(m.intensities, scans[i].intensities);
    EXPECT_FLOAT_EQ(m.angle_max, m.angle_min + 1080 * m.angle_increment);
    EXPECT_FLOAT_EQ(m.time_increment, 0.025 / 1440);
    for (float range : m.ranges) {
      EXPECT_TRUE(range == INFINITY || (range >= m.range_min && range <= m.range_max)) << range;
      without_return += range == INFINITY;
    }
  }
  EXPECT_GT(without_return, 1000);

  const auto cloud_messages = messages<sensor_msgs::PointCloud2>(bag_, "/velodyne_points");
  ASSERT_EQ(cloud_messages.size(), clouds.size());
  for (std::size_t i = 0; i < clouds.size(); ++i) {
    EXPECT_EQ(cloud_messages[i]->header.frame_id, "velodyne");
    ASSERT_EQ(cloud_messages[i]->width * cloud_messages[i]->height, 16u * 90u);
    sensor_msgs::PointCloud2ConstIterator<float> point(*cloud_messages[i], "x");
    int index = 0;
    for (const pcl::PointXYZI& expected : clouds[i].cloud) {
      EXPECT_FLOAT_EQ(point[4], 0.1f / 90 * (index++ % 90));  // time since the stamp
      if (std::isnan(expected.x))
        EXPECT_TRUE(std::isnan(point[0]));
      else
        EXPECT_EQ(Eigen::Vector3f(point[0], point[1], point[2]), expected.getVector3fMap());
      EXPECT_EQ(point[3], expected.intensity);
      ++point;
    }
  }
}

TEST_F(SimulationBag, FramesComposeToTheTruth) {
  const Simulation simulation = makeSimulation();
  SimulationBagOptions options;
  options.odometry_noise = {0.05, 0.05};
  write(simulation, options);
  const auto tf = messages<tf2_msgs::TFMessage>(bag_, "/tf");
  const auto odom = messages<nav_msgs::Odometry>(bag_, "/odom");
  const auto truth = messages<nav_msgs::Odometry>(bag_, "/ground_truth");
  ASSERT_EQ(tf.size(), odom.size());
  ASSERT_EQ(tf.size(), truth.size());
  for (std::size_t i = 0; i < tf.size(); ++i) {
    ASSERT_EQ(tf[i]->transforms.size(), 2u);
    const auto& map_odom = tf[i]->transforms[0];
    const auto& odom_base = tf[i]->transforms[1];
    EXPECT_EQ(map_odom.header.frame_id, "map");
    EXPECT_EQ(map_odom.child_frame_id, "odom");
    EXPECT_EQ(odom_base.header.frame_id, "odom");
    EXPECT_EQ(odom_base.child_frame_id, "base_link");
    EXPECT_EQ(odom_base.header.stamp, truth[i]->header.stamp);
    const Eigen::Isometry3d pose = simulation.trajectory.at(truth[i]->header.stamp.toSec() - 1000.0);
    const Eigen::Isometry3d odom_pose = fromTransform(odom_base.transform);
    EXPECT_TRUE((fromTransform(map_odom.transform) * odom_pose).isApprox(pose, 1e-6));
    EXPECT_TRUE(fromPose(truth[i]->pose.pose).isApprox(pose, 1e-6));
    EXPECT_TRUE(fromPose(odom[i]->pose.pose).isApprox(odom_pose, 1e-9));
    EXPECT_EQ(odom[i]->header.frame_id, "odom");
    EXPECT_EQ(truth[i]->header.frame_id, "map");
    EXPECT_EQ(truth[i]->child_frame_id, "base_link");
    EXPECT_NEAR(truth[i]->twist.twist.linear.x, 0.5, 0.01);
  }
  EXPECT_GT((fromPose(odom.back()->pose.pose).translation() - fromPose(truth.back()->pose.pose).translation())
                .norm(),
            1e-3);
}

TEST_F(SimulationBag, MountsAreLatched) {
  const Simulation simulation = makeSimulation();
  write(simulation);
  const auto mounts = messages<tf2_msgs::TFMessage>(bag_, "/tf_static");
  ASSERT_EQ(mounts.size(), 1u);
  ASSERT_EQ(mounts[0]->transforms.size(), 2u);
  for (std::size_t i = 0; i < 2; ++i) {
    EXPECT_EQ(mounts[0]->transforms[i].header.frame_id, "base_link");
    EXPECT_EQ(mounts[0]->transforms[i].child_frame_id, simulation.sensors[i].frame_id);
    EXPECT_TRUE(
        fromTransform(mounts[0]->transforms[i].transform).isApprox(simulation.sensors[i].mount, 1e-9));
  }
  rosbag::View view(bag_, rosbag::TopicQuery("/tf_static"));
  const auto header = view.getConnections().front()->header;
  ASSERT_TRUE(header->count("latching"));
  EXPECT_EQ((*header)["latching"], "1");
}

TEST_F(SimulationBag, ClockAndMapFrameCanBeLeftOut) {
  SimulationBagOptions options;
  options.clock_rate = 0.0;
  options.map_to_odom = false;
  options.odometry_rate = 20.0;
  options.start_time = 5.0;
  write(makeSimulation(), options);
  EXPECT_TRUE(messages<rosgraph_msgs::Clock>(bag_, "/clock").empty());
  const auto tf = messages<tf2_msgs::TFMessage>(bag_, "/tf");
  ASSERT_EQ(tf.size(), 11u);
  ASSERT_EQ(tf[0]->transforms.size(), 1u);
  EXPECT_EQ(tf[0]->transforms[0].header.frame_id, "odom");
  EXPECT_EQ(tf[0]->transforms[0].header.stamp, ros::Time(5.0));
}

TEST_F(SimulationBag, RefusesWhatMakesNoSense) {
  Simulation simulation = makeSimulation();
  SimulationBagOptions options;
  options.start_time = 0.0;
  expectError([&] { writeSimulationBag(file_, simulation, options); }, "start time");
  simulation.sensors[1].topic = "scan";
  expectError([&] { writeSimulationBag(file_, simulation); }, "topic 'scan' is taken twice");
  simulation.sensors[1].topic = "points";
  simulation.sensors[1].frame_id = "laser";
  expectError([&] { writeSimulationBag(file_, simulation); }, "frame 'laser' is taken twice");
  simulation.sensors.pop_back();
  simulation.duration = 0.0;
  expectError([&] { writeSimulationBag(file_, simulation); }, "duration must be positive");
  simulation.duration = 1.0;
  expectError([&] { writeSimulationBag("/nowhere/a.bag", simulation); }, "/nowhere/a.bag");
  EXPECT_TRUE(std::filesystem::is_empty(dir_.path()));
}

mapping_common::Ran runTool(const std::string& arguments) {
  return mapping_common::run(std::string(SIMULATE) + ' ' + arguments);
}

TEST(Tool, WritesABagAndTheGroundTruthAndRepeatsItself) {
  const TempDir dir;
  const std::string arguments = "--world " + configFile("worlds/laboratory.yaml") + " --sensor " +
                                configFile("simulator/sick_lms291.yaml") + " --duration 0.2 --seed 4";
  const std::string tum = dir.path("truth.tum");
  const mapping_common::Ran first =
      runTool(arguments + " --out " + dir.path("a.bag") + " --ground-truth " + tum);
  ASSERT_EQ(first.code, 0) << first.said();
  ASSERT_EQ(runTool(arguments + " --out " + dir.path("b.bag")).code, 0);
  rosbag::Bag a(dir.path("a.bag")), b(dir.path("b.bag"));
  const auto scans = messages<sensor_msgs::LaserScan>(a, "/scan"),
             again = messages<sensor_msgs::LaserScan>(b, "/scan");
  ASSERT_EQ(scans.size(), 15u);
  ASSERT_EQ(again.size(), 15u);
  for (std::size_t i = 0; i < scans.size(); ++i) EXPECT_EQ(scans[i]->ranges, again[i]->ranges);
  const Trajectory truth = loadTrajectory(tum),
                   expected = loadTrajectory(configFile("worlds/laboratory.yaml"));
  EXPECT_TRUE(truth.at(1000.1).isApprox(expected.at(0.1), 1e-6));
}

TEST(Tool, WritesImagesToABagAndToFolders) {
  const TempDir dir;
  const std::string small = dir.write("camera.yaml", R"(
type: camera
topic: eye/image_raw
frame_id: eye
mount: {position: [0, 0, 1.5]}
rate: 10
width: 32
height: 24
field_of_view_deg: 60
encoding: rgb8
noise: 2
)");
  const auto arguments = [&](int world_seed) {
    return "--world " + configFile("worlds/street_walk.yaml") + " --sensor " + small +
           " --duration 0.25 --world-seed " + std::to_string(world_seed);
  };
  const auto run = [&](const std::string& more) {
    const mapping_common::Ran outcome = runTool(more);
    EXPECT_EQ(outcome.code, 0) << outcome.said();
  };
  run(arguments(1) + " --out " + dir.path("a.bag") + " --images " + dir.path("a"));
  run(arguments(1) + " --images " + dir.path("b"));
  run(arguments(2) + " --images " + dir.path("c"));
  const auto bytes = [&](const std::string& name) { return mapping_common::readFile(dir.path(name)); };
  EXPECT_EQ(bytes("a/eye/image_raw/000002.png"), bytes("b/eye/image_raw/000002.png"));
  EXPECT_NE(bytes("a/eye/image_raw/000002.png"), bytes("c/eye/image_raw/000002.png"));
  EXPECT_FALSE(std::filesystem::exists(dir.path("a/eye/image_raw/000003.png")));
  const Trajectory poses = loadTrajectory(dir.path("a/eye/image_raw.tum"));
  ASSERT_EQ(poses.poses().size(), 3u);
  const SensorConfig sensor = loadSensor(small);
  const Trajectory path = loadTrajectory(configFile("worlds/street_walk.yaml"));
  EXPECT_TRUE(poses.at(0.2).isApprox(path.at(0.2) * sensor.mount, 1e-6));

  const rosbag::Bag bag(dir.path("a.bag"));
  const auto images = messages<sensor_msgs::Image>(bag, "/eye/image_raw");
  const auto infos = messages<sensor_msgs::CameraInfo>(bag, "/eye/camera_info");
  ASSERT_EQ(images.size(), 3u);
  ASSERT_EQ(infos.size(), 3u);
  EXPECT_EQ(images[1]->header.stamp, ros::Time(1000.1));
  EXPECT_EQ(images[1]->header.stamp, infos[1]->header.stamp);
  EXPECT_EQ(images[1]->header.frame_id, "eye");
  EXPECT_EQ(images[1]->encoding, "rgb8");
  EXPECT_EQ(images[1]->step, 96u);
  EXPECT_EQ(images[1]->data.size(), 96u * 24u);
  EXPECT_DOUBLE_EQ(infos[1]->K[0], sensor.camera.fx);
  EXPECT_DOUBLE_EQ(infos[1]->P[6], 11.5);
}

TEST(Tool, BadInputHasAMessageAndAnExitCodeAndLeavesNoFile) {
  const TempDir dir;
  const std::string world = " --world " + configFile("worlds/laboratory.yaml");
  const std::string sensor = " --sensor " + configFile("simulator/sick_lms291.yaml");
  const std::string out = " --out " + dir.path("a.bag");
  const auto expect = [&](const std::string& arguments, int code, const std::string& message) {
    const mapping_common::Ran outcome = runTool(arguments);
    EXPECT_EQ(outcome.code, code) << arguments;
    EXPECT_NE(outcome.said().find(message), std::string::npos) << outcome.said();
    EXPECT_FALSE(std::filesystem::exists(dir.path("a.bag")));
  };
  expect("--help", 0, "Usage: simulate");
  expect("", 2, "required");
  expect(world + sensor, 2, "give --out, --images or both");
  expect(world + sensor + out + " --duration -1", 2, "--duration must be");
  expect(world + sensor + out + " --colour red", 2, "colour");
  expect(world + sensor + out + " --seed x", 2, "seed");
  expect(" --world /nowhere.yaml" + sensor + out, 1, "/nowhere.yaml: can't be read");
  expect(world + sensor + sensor + out, 1, "topic 'scan' is taken twice");
  const std::string bad = dir.write("bad.yaml", "objects:\n  - {type: blob}\n");
  expect(" --world " + bad + sensor + out, 1, bad + ":2: type is 'blob'");
  const std::string single = dir.write("single.yaml", "trajectory: {poses: [[0, 0, 0, 0]]}");
  expect(world + sensor + out + " --trajectory " + single, 1, "give --duration");
}

}  // namespace
}  // namespace mapping_simulation

int main(int argc, char** argv) {
  testing::InitGoogleTest(&argc, argv);
  return RUN_ALL_TESTS();
}
