// SPDX-License-Identifier: BSD-3-Clause
#include <geometry_msgs/PoseStamped.h>
#include <mapping_common/files.h>
#include <mapping_common/testing/message_fuzz.h>
#include <mapping_common/testing/nodelet_test.h>
#include <mapping_common/testing/temp_dir.h>
#include <mapping_msgs/CorrectedMap.h>
#include <mapping_msgs/LoadMap.h>
#include <mapping_msgs/SaveMap.h>
#include <nav_msgs/Path.h>
#include <pose_graph/AddEdge.h>
#include <pose_graph/DeleteEdge.h>
#include <pose_graph/Event.h>
#include <sensor_msgs/point_cloud2_iterator.h>
#include <std_srvs/Trigger.h>
#include <tf2_eigen/tf2_eigen.h>
#include <tf2_ros/static_transform_broadcaster.h>
#include <tf2_ros/transform_listener.h>

#include <algorithm>
#include <cmath>
#include <map>
#include <string>
#include <vector>

#include "pose_graph/ros/conversions.h"
#include "recorded_room.h"

namespace pose_graph {
namespace {

using mapping_common::Recorder;
using mapping_common::spinFor;
using mapping_common::waitFor;
using mapping_msgs::EdgeConstraint;

constexpr double kStart = 1000.0;  // s
constexpr int kPerRound = 30;

// Rounds in a room, a key pose each second, with odometry that drifts.
class PoseGraphNodeletTest : public mapping_common::NodeletTest {
 protected:
  PoseGraphNodeletTest()
      : NodeletTest("pose_graph/PoseGraphNodelet", "graph"),
        edges_(node_.advertise<EdgeConstraint>("edges", 1000)),
        loops_(node_.advertise<EdgeConstraint>("loop_closures", 1000)),
        poses_(node_.advertise<geometry_msgs::PoseStamped>("pose", 1000)),
        scans_(node_.advertise<sensor_msgs::LaserScan>("scan", 1000)),
        paths_(node_, "graph_path"),
        markers_(node_, "graph"),
        events_(node_, "graph_events") {
    setParam("publish_period", 0.05);
    setParam("rebuild_period", 0.0);
    setParam("base_frame", test_ + "_base");
  }
  bool load() {
    if (!NodeletTest::load()) return false;
    return waitFor([&] {
      return edges_.getNumSubscribers() > 0 && loops_.getNumSubscribers() > 0 &&
             poses_.getNumSubscribers() > 0 && scans_.getNumSubscribers() > 0;
    });
  }

  static ros::Time stamp(double i) { return ros::Time(kStart + i); }
  static Pose truth(double i) {
    const double angle = 2.0 * M_PI * i / kPerRound;
    return planarPose(2.0 * std::cos(angle), 2.0 * std::sin(angle), angle + M_PI / 2.0);
  }
  // As odometry has it: it turns too far.
  static Pose drifted(int i) {
    Pose pose = truth(0);
    for (int k = 0; k < i; ++k) pose = pose * step(k);
    return pose;
  }
  static Pose step(int i) { return truth(i).inverse() * truth(i + 1) * planarPose(0.0, 0.0, 0.006); }

  EdgeConstraint edge(double from, double to, const Pose& transform, std::uint8_t type, double sigma) const {
    EdgeConstraint message;
    message.from_stamp = stamp(from);
    message.to_stamp = message.header.stamp = stamp(to);
    message.frame_id = test_ + "_base";
    message.type = type;
    message.has_transform = true;
    message.transform = toMessage(transform);
    for (int i = 0; i < 6; ++i) message.information[7 * i] = 1.0 / (sigma * sigma);
    message.similarity = 0.5F;
    return message;
  }
  EdgeConstraint consecutive(int i) const {
    return edge(i, i + 1, step(i), EdgeConstraint::CONSECUTIVE, 0.02);
  }
  EdgeConstraint loop(int from, int to, const Pose& error = {}) const {
    return edge(from, to, truth(from).inverse() * truth(to) * error, EdgeConstraint::LOOP_CLOSURE, 0.005);
  }
  void publishPose(int i) {
    geometry_msgs::PoseStamped pose;
    pose.header.stamp = stamp(i);
    pose.header.frame_id = "map";
    pose.pose = toMessage(drifted(i));
    poses_.publish(pose);
  }
  sensor_msgs::LaserScan scanOf(int i, float scale = 1.0F) const {
    const auto seen = lookAtRoom(truth(i), kStart + i);
    sensor_msgs::LaserScan scan;
    scan.header.stamp = stamp(i);
    scan.header.frame_id = test_ + "_base";
    scan.angle_increment = static_cast<float>(2.0 * M_PI / seen.points.size());
    scan.angle_min = 0.5F * scan.angle_increment;
    scan.angle_max = scan.angle_min + (seen.points.size() - 1) * scan.angle_increment;
    scan.range_min = 0.1F;
    scan.range_max = 30.0F;
    for (std::size_t k = 0; k < seen.points.size(); ++k) {
      scan.ranges.push_back(scale * seen.points[k].norm());
      scan.intensities.push_back(seen.reflectivities[k]);
    }
    return scan;
  }
  void publishScan(int i, float scale = 1.0F) { scans_.publish(scanOf(i, scale)); }
  sensor_msgs::PointCloud2 cloudOf(int i) const {
    const auto points = cloudOfRoom(truth(i), 0.0).hits;
    sensor_msgs::PointCloud2 cloud;
    cloud.header.stamp = stamp(i);
    cloud.header.frame_id = test_ + "_base";
    sensor_msgs::PointCloud2Modifier(cloud).setPointCloud2FieldsByString(1, "xyz");
    sensor_msgs::PointCloud2Modifier(cloud).resize(points.size());
    sensor_msgs::PointCloud2Iterator<float> x(cloud, "x");
    for (const Eigen::Vector3f& point : points) {
      x[0] = point.x(), x[1] = point.y(), x[2] = point.z();
      ++x;
    }
    return cloud;
  }
  void drive(int from, int to) {
    for (int i = from; i < to; ++i) {
      if (i == 0) publishPose(0), publishScan(0);
      publishPose(i + 1);
      publishScan(i + 1);
      edges_.publish(consecutive(i));
      spinFor(0.005);
    }
    EXPECT_TRUE(waitFor([&] { return length() > static_cast<std::size_t>(to); })) << length();
  }
  std::size_t length() const { return paths_.messages.empty() ? 0 : paths_.messages.back().poses.size(); }
  double worstError() const {
    double worst = 0.0;
    for (const auto& pose : paths_.messages.back().poses) {
      const Pose& there = truth((pose.header.stamp - stamp(0)).toSec());
      worst = std::max(worst, (toPose(pose.pose).translation - there.translation).norm());
    }
    return worst;
  }
  std::size_t count(const std::string& event) const {
    return std::count_if(events_.messages.begin(), events_.messages.end(),
                         [&](const Event& message) { return message.event == event; });
  }
  std::size_t lines(const std::string& ns) const {
    if (markers_.messages.empty()) return 0;
    for (const auto& marker : markers_.messages.back().markers)
      if (marker.ns == ns) return marker.points.size() / 2;
    return 0;
  }
  template <class Service>
  std::string callFile(const std::string& name, const std::string& path, bool success = true) {
    Service service;
    service.request.path = path;
    EXPECT_TRUE(ros::service::call(name_ + "/" + name, service));
    EXPECT_EQ(success, service.response.success) << service.response.message;
    return service.response.message;
  }

  ros::Publisher edges_, loops_, poses_, scans_;
  Recorder<nav_msgs::Path> paths_;
  Recorder<visualization_msgs::MarkerArray> markers_;
  Recorder<Event> events_;
};

TEST_F(PoseGraphNodeletTest, LoopsCorrectThePath) {
  ASSERT_TRUE(load());
  drive(0, 45);
  EXPECT_GT(worstError(), 0.2);
  EXPECT_TRUE(waitFor([&] { return lines("consecutive") == 45u; })) << lines("consecutive");
  for (int i = 30; i <= 45; i += 3) loops_.publish(loop(i - 30, i));
  EXPECT_TRUE(waitFor([&] { return count("accepted") == 6; })) << count("accepted");
  EXPECT_TRUE(waitFor([&] { return worstError() < 0.05; })) << worstError();
  EXPECT_TRUE(waitFor([&] { return lines("loop_closure") == 6; }));
  expectDiagnostic("Graph", "Loops: accepted", "6");
  expectDiagnostic("Graph", "Key poses", "46");
  // A wrong one is refused, drawn, and bends nothing.
  loops_.publish(loop(8, 35, planarPose(0.6, 0.4, 0.3)));
  EXPECT_TRUE(waitFor([&] { return count("refused") == 1; }));
  EXPECT_TRUE(waitFor([&] { return lines("pending") == 1; }));
  EXPECT_LT(worstError(), 0.05);
  EXPECT_EQ("loop_closures", events_.messages.back().source);
  EXPECT_EQ(stamp(35), events_.messages.back().to_stamp);
}

TEST_F(PoseGraphNodeletTest, LoopsOfACameraAreOfTheBody) {
  tf2_ros::StaticTransformBroadcaster broadcaster;
  ASSERT_TRUE(load());
  drive(0, 45);
  const Pose camera{{0.2, 0.1, 0.4}, {0.5, -0.5, 0.5, -0.5}};
  EdgeConstraint message = loop(5, 40);
  message.frame_id = test_ + "_camera";
  message.transform = toMessage(camera.inverse() * toPose(message.transform) * camera);
  loops_.publish(message);
  expectDiagnostic("Edges", "Waiting for transforms or scans", "1");
  geometry_msgs::TransformStamped mounted;
  mounted.header.frame_id = test_ + "_base";
  mounted.child_frame_id = message.frame_id;
  mounted.transform.translation.x = 0.2;
  mounted.transform.translation.y = 0.1;
  mounted.transform.translation.z = 0.4;
  mounted.transform.rotation = toMessage(camera).orientation;
  broadcaster.sendTransform(mounted);
  EXPECT_TRUE(waitFor([&] { return count("accepted") == 1; }));
  EXPECT_TRUE(waitFor([&] { return worstError() < 0.2; })) << worstError();
}

TEST_F(PoseGraphNodeletTest, WhatIsLateOrDoubledOrMalformedIsSaid) {
  setParam("graph/wait", 3.0);
  ASSERT_TRUE(load());
  for (int i = 0; i < 20; ++i)
    if (i != 15) edges_.publish(consecutive(i));
  EXPECT_TRUE(waitFor([&] { return length() == 21; }));
  EXPECT_TRUE(waitFor([&] { return count("new part") == 1; }));
  expectDiagnostic("Graph", "Parts", "2");
  edges_.publish(consecutive(15));
  expectDiagnostic("Graph", "Parts", "1");
  EXPECT_EQ(1u, count("joined"));
  edges_.publish(consecutive(17));
  expectDiagnostic("Edges", "Not taken: doubled", "1");

  std::vector<EdgeConstraint> bad(8, loop(2, 12));
  bad[0].information[1] = 1e5;
  bad[1].information[0] = std::nan("");
  bad[2].transform.position.x = std::nan("");
  bad[3].transform.orientation = {};
  bad[4].from_stamp = ros::Time();
  bad[5].to_stamp = ros::Time(4294967295U, 0);
  bad[6].type = 7;
  bad[7].information.fill(0.0);
  for (const EdgeConstraint& message : bad) loops_.publish(message);
  expectDiagnostic("Edges", "Not taken: malformed", "8");

  loops_.publish(loop(3, 23));  // of a pose that comes
  loops_.publish(loop(3, 90));  // and of one that doesn't
  expectDiagnostic("Edges", "Waiting for stamps", "2");
  for (int i = 20; i < 25; ++i) edges_.publish(consecutive(i));
  expectDiagnostic("Edges", "Waiting for stamps", "0");
  expectDiagnostic("Edges", "Not taken: unknown stamps", "1");
  EXPECT_EQ(1u, count("expired"));
  expectDiagnostic("Nodelet", "Callbacks that failed", "0");
}

TEST_F(PoseGraphNodeletTest, TimeJumpsBack) {
  ASSERT_TRUE(load());
  drive(0, 40);
  loops_.publish(loop(1, 60));
  expectDiagnostic("Edges", "Waiting for stamps", "1");
  publishPose(0);
  expectDiagnostic("Edges", "Waiting for stamps", "0");
  for (int i = 0; i < 20; ++i) {
    publishPose(i + 1);
    edges_.publish(consecutive(i));
    spinFor(0.01);
  }
  EXPECT_TRUE(waitFor([&] { return length() == 41 + 21; })) << length();
  expectDiagnostic("Edges", "Not taken: time jump", "1");
  expectDiagnostic("Graph", "Parts", "2");
  loops_.publish(loop(2, 15));
  EXPECT_TRUE(waitFor([&] { return count("accepted") + count("refused") == 1; }));
}

TEST_F(PoseGraphNodeletTest, ServicesRepairAndKeepTheGraph) {
  const mapping_common::TempDir dir;
  setParam("session_file", dir.path("session.db"));
  ASSERT_TRUE(load());
  drive(0, 45);
  AddEdge add;
  add.request.edge = loop(5, 40);
  ASSERT_TRUE(ros::service::call(name_ + "/add_edge", add));
  EXPECT_TRUE(add.response.success) << add.response.message;
  EXPECT_TRUE(waitFor([&] { return lines("by_hand") == 1 && worstError() < 0.2; }));
  add.request.edge.has_transform = false;
  ASSERT_TRUE(ros::service::call(name_ + "/add_edge", add));
  EXPECT_EQ("it has no transform", add.response.message);

  const std::string saved = dir.path("saved.db");
  EXPECT_EQ("Wrote the session to " + saved, callFile<mapping_msgs::SaveMap>("save", saved));
  EXPECT_TRUE(isSession(saved));
  EXPECT_EQ(46u, Session(saved).keyPoses().size());
  EXPECT_EQ("Wrote 46 poses to " + dir.path("a.g2o"),
            callFile<mapping_msgs::SaveMap>("export", dir.path("a.g2o")));
  EXPECT_NE(std::string::npos, mapping_common::readFile(dir.path("a.g2o")).find("EDGE_SE2 5 40"));
  callFile<mapping_msgs::SaveMap>("export", dir.path("a.tum"));
  callFile<mapping_msgs::SaveMap>("export", dir.path("a.txt"), false);

  DeleteEdge erase;
  erase.request.from_stamp = stamp(5);
  erase.request.to_stamp = stamp(40);
  ASSERT_TRUE(ros::service::call(name_ + "/delete_edge", erase));
  EXPECT_TRUE(erase.response.success);
  EXPECT_TRUE(waitFor([&] { return lines("by_hand") == 0 && worstError() > 0.2; })) << worstError();
  ASSERT_TRUE(ros::service::call(name_ + "/delete_edge", erase));
  EXPECT_EQ("there is no edge of these stamps", erase.response.message);
  std_srvs::Trigger optimise;
  ASSERT_TRUE(ros::service::call(name_ + "/optimise", optimise));
  EXPECT_TRUE(optimise.response.success);

  callFile<mapping_msgs::LoadMap>("load", dir.path("none.db"), false);
  callFile<mapping_msgs::LoadMap>("load", dir.write("foreign.db", "nothing"), false);
  callFile<mapping_msgs::LoadMap>("load", saved);
  EXPECT_TRUE(waitFor([&] { return lines("by_hand") == 1 && worstError() < 0.2; }));
}

TEST_F(PoseGraphNodeletTest, SessionsGoOn) {
  const mapping_common::TempDir dir;
  setParam("session_file", dir.path("session.db"));
  ASSERT_TRUE(load());
  drive(0, 35);
  loops_.publish(loop(2, 32));
  EXPECT_TRUE(waitFor([&] { return count("accepted") == 1; }));
  const auto scans = [&] { return Session(dir.path("session.db")).amounts()[DataKind::kScan].count; };
  EXPECT_TRUE(waitFor([&] { return scans() == 36; })) << scans();
  unload();
  EXPECT_EQ(36u, scans());
  ASSERT_TRUE(load());
  EXPECT_TRUE(waitFor([&] { return length() == 36; }));
  expectDiagnostic("Graph", "Loops: accepted", "1");
  edges_.publish(consecutive(20));  // that is in it
  drive(35, 40);
  expectDiagnostic("Graph", "Parts", "1");
  expectDiagnostic("Edges", "Not taken: doubled", "1");
}

// Known by appearance: the scans tell the rest.
TEST_F(PoseGraphNodeletTest, ScansGiveATransformToAppearances) {
  const mapping_common::TempDir dir;
  setParam("appearance/scans", 10);
  ASSERT_TRUE(load());
  drive(0, 40);
  EdgeConstraint seen = loop(4, 35, {});
  seen.has_transform = false;
  seen.transform = {};
  seen.information.fill(0.0);
  loops_.publish(seen);
  loops_.publish(seen);
  EXPECT_TRUE(waitFor([&] { return count("accepted") == 1; }));
  EXPECT_TRUE(waitFor([&] { return worstError() < 0.2; })) << worstError();
  expectDiagnostic("Edges", "Edges by appearance that got a transform", "1");
  expectDiagnostic("Edges", "Not taken: doubled", "1");
  // Key poses that see something else.
  for (int i = 40; i < 45; ++i) {
    publishPose(i + 1);
    publishScan(i + 1, 0.3F);
    edges_.publish(consecutive(i));
  }
  seen.to_stamp = stamp(44);
  loops_.publish(seen);
  expectDiagnostic("Edges", "Not taken: scans don't match", "1");
  // The session tells what became of them.
  const std::string saved = dir.path("saved.db");
  callFile<mapping_msgs::SaveMap>("save", saved);
  std::map<EdgeState, int> states;
  for (const SessionEdge& edge : Session(saved).edges()) {
    if (!edge.transform) ++states[edge.state];
  }
  EXPECT_EQ((std::map<EdgeState, int>{{EdgeState::kAccepted, 1}, {EdgeState::kRevoked, 1}}), states);
}

TEST_F(PoseGraphNodeletTest, MapsAreMadeAnew) {
  Recorder<mapping_msgs::CorrectedMap> maps(node_, "corrected_map");
  ASSERT_TRUE(load());
  drive(0, 45);
  for (int i = 30; i <= 45; i += 3) loops_.publish(loop(i - 30, i));
  // The first may be of some of the loops.
  const auto error = [&] {
    const Pose corrected = toPose(maps.messages.back().correction) * drifted(45);
    return (corrected.translation - truth(45).translation).norm();
  };
  ASSERT_TRUE(waitFor([&] { return count("accepted") == 6; })) << count("accepted");
  ASSERT_TRUE(waitFor([&] { return !maps.messages.empty() && error() < 0.05; }));
  const mapping_msgs::CorrectedMap& message = maps.messages.back();
  EXPECT_EQ(stamp(45), message.header.stamp);
  const mapping_common::TempDir dir;
  const auto map = intensity_hector_slam::MultiMap::load(
      dir.write("a.map", std::string(message.data.begin(), message.data.end())));
  const auto occupied = [&](double x, double y) {
    const auto* cell = map.level(0).find({x, y});
    return cell != nullptr && intensity_hector_slam::GridMap::isOccupied(*cell);
  };
  int walls = 0;
  for (double y = -3.0; y <= 3.0; y += 0.5)
    for (double x = 4.9; x < 5.2; x += 0.025) walls += occupied(x, y) || occupied(-x, y) ? 1 : 0;
  EXPECT_GE(walls, 13);
  EXPECT_FALSE(occupied(4.0, 0.0));
}

// The 3D map gets its poses by tf: it must be told from when on these are those of the corrected map.
TEST_F(PoseGraphNodeletTest, CloudMapsWaitForTheFrontEnd) {
  Recorder<mapping_msgs::CorrectedMap> grids(node_, "corrected_map"), maps(node_, "corrected_cloud_map");
  ros::Publisher clouds = node_.advertise<sensor_msgs::PointCloud2>("cloud", 100);
  ASSERT_TRUE(load());
  ASSERT_TRUE(waitFor([&] { return clouds.getNumSubscribers() > 0; }));
  for (int i = 0; i < 45; i += 5) {
    drive(i, i + 5);
    clouds.publish(cloudOf(i + 5));
    spinFor(0.1);
  }
  loops_.publish(loop(10, 40));
  ASSERT_TRUE(waitFor([&] { return !grids.messages.empty(); }));
  spinFor(0.2);
  EXPECT_TRUE(maps.messages.empty());
  geometry_msgs::PoseStamped pose;
  pose.header.stamp = stamp(45.1);
  pose.pose = toMessage(toPose(grids.messages.back().correction) * drifted(45));
  poses_.publish(pose);
  ASSERT_TRUE(waitFor([&] { return !maps.messages.empty(); }));
  EXPECT_EQ(stamp(45.1), maps.messages.back().corrected_from);
  EXPECT_EQ(stamp(45), maps.messages.back().header.stamp);
  const mapping_common::TempDir dir;
  const auto& data = maps.messages.back().data;
  const auto map =
      rtree_occupancy_map::OccupancyMap::load(dir.write("a.map", std::string(data.begin(), data.end())));
  EXPECT_GT(map.size(), 100u);
}

TEST_F(PoseGraphNodeletTest, TfIsPublishedWhereAskedFor) {
  setParam("publish_tf", true);
  setParam("map_frame", test_ + "_map");
  setParam("odom_frame", test_ + "_odom");
  tf2_ros::StaticTransformBroadcaster broadcaster;
  tf2_ros::Buffer buffer;
  tf2_ros::TransformListener listener(buffer);
  geometry_msgs::TransformStamped odometry;
  odometry.header.frame_id = test_ + "_odom";
  odometry.child_frame_id = test_ + "_base";
  odometry.transform.translation.x = 7.0;
  odometry.transform.rotation.w = 1.0;
  broadcaster.sendTransform(odometry);
  ASSERT_TRUE(load());
  drive(0, 45);
  for (int i = 30; i <= 45; i += 3) loops_.publish(loop(i - 30, i));
  EXPECT_TRUE(waitFor([&] { return count("accepted") == 6 && worstError() < 0.05; }));
  publishPose(46);
  const auto where = [&] {
    return toPose(
        tf2::transformToEigen(buffer.lookupTransform(test_ + "_map", test_ + "_base", ros::Time(0))));
  };
  ASSERT_TRUE(waitFor([&] { return buffer.canTransform(test_ + "_map", test_ + "_base", stamp(46)); }));
  EXPECT_LT((where().translation - truth(46).translation).norm(), 0.08);
}

TEST_F(PoseGraphNodeletTest, SurvivesAnything) {
  setParam("rebuild_period", 1.0);
  ros::Publisher clouds = node_.advertise<sensor_msgs::PointCloud2>("cloud", 100);
  ASSERT_TRUE(load());
  ASSERT_TRUE(waitFor([&] { return clouds.getNumSubscribers() > 0; }));
  drive(0, 40);
  const sensor_msgs::LaserScan good_scan = scanOf(41);
  const sensor_msgs::PointCloud2 good_cloud = cloudOf(41);
  mapping_common::fuzz({test_ + "_base", "map"}, [&](mapping_common::MessageFuzz& fuzz) {
    const int i = fuzz.pick<int>({0, 1, 5, 20, 39, 41, 42});
    EdgeConstraint message =
        fuzz.pick<int>({0, 1}) == 0 ? consecutive(i) : loop(fuzz.pick<int>({0, 3, 10}), i);
    fuzz.spoil(message);
    (fuzz.pick<int>({0, 1}) == 0 ? edges_ : loops_).publish(message);
    geometry_msgs::PoseStamped pose;
    pose.header.stamp = stamp(i);
    pose.pose = toMessage(truth(i));
    fuzz.spoil(pose);
    poses_.publish(pose);
    sensor_msgs::LaserScan scan = good_scan;
    scan.header.stamp = stamp(i);
    fuzz.spoil(scan);
    scans_.publish(scan);
    sensor_msgs::PointCloud2 cloud = good_cloud;
    cloud.header.stamp = stamp(i);
    fuzz.spoil(cloud);
    clouds.publish(cloud);
  });
  expectDiagnostic("Nodelet", "Callbacks that failed", "0");
}

}  // namespace
}  // namespace pose_graph

int main(int argc, char** argv) {
  testing::InitGoogleTest(&argc, argv);
  ros::init(argc, argv, "test_pose_graph_nodelet");
  ros::NodeHandle node;
  return RUN_ALL_TESTS();
}
