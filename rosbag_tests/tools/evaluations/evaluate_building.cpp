// SPDX-License-Identifier: BSD-3-Clause
//
// Drives through a simulated building, with SLAM, its loops, those of a camera, and a pose graph, as the
// nodelets do it but as fast as it goes: how far the corrected map is from where it should be, and how many
// loops are wrong.
#include <ibuild_loop_closure/loop_detector.h>
#include <ibuild_loop_closure/ros/key_frames.h>
#include <intensity_hector_slam/ros/bag_runner.h>
#include <laser_intensity_calib/calibration_file.h>
#include <laser_intensity_calib/incidence.h>
#include <laser_intensity_calib/models.h>
#include <laser_intensity_calib/ros/conversions.h>
#include <mapping_common/files.h>
#include <mapping_common/markdown_table.h>
#include <mapping_common/progress.h>
#include <mapping_common/tool.h>
#include <mapping_simulation/ros/simulation_bag.h>
#include <pose_graph/appearance.h>
#include <pose_graph/graph_keeper.h>
#include <pose_graph/maps.h>
#include <pose_graph/undistortion.h>
#include <rosbag/bag.h>
#include <rosbag/view.h>
#include <rosbag_tests/evaluations/trajectory_metrics.h>

#include <algorithm>
#include <boost/program_options.hpp>
#include <cmath>
#include <cstdio>
#include <filesystem>
#include <iostream>
#include <map>
#include <random>
#include <set>
#include <sstream>
#include <stdexcept>
#include <string>
#include <vector>

namespace po = boost::program_options;
namespace fs = std::filesystem;
namespace slam = intensity_hector_slam;
namespace calib = laser_intensity_calib;
namespace loops = ibuild_loop_closure;
using namespace rosbag_tests;
using mapping_simulation::Trajectory;
using pose_graph::EdgeState;
using pose_graph::EdgeType;

namespace {

const char kUsage[] =
    "Usage: evaluate_building --world WORLD.yaml --laser SENSOR.yaml --camera SENSOR.yaml --calibration "
    "FILE\n"
    "         --out DIR [options]\n"
    "\n"
    "For each seed, simulates a drive, runs SLAM over its scans with their reflectivities and without, "
    "finds\n"
    "loops in the images, and puts all into a pose graph as it comes: as it is, with some of the camera's "
    "loops\n"
    "replaced by false ones, and without reflectivities. DIR/building.csv gets a row for each when it is "
    "done:\n"
    "how far any point of the corrected map is from where it would be along the true way, and how many "
    "loops\n"
    "are wrong.\n";

constexpr double kWrongDistance = 0.5, kWrongAngle = 0.1745;  // m, rad, that a wrong loop is off by
constexpr double kFarPlace = 3.0;                             // m, from the right place to a false one
constexpr double kStart = 1000.0;                             // s
constexpr double kSettled = 1.0;                              // s, until key poses around an image are known

struct Arguments {
  std::string world, laser, camera, calibration, out;
  int seeds = 20;
  std::uint32_t first = 1;
  double max_range = 5.0, false_loops = 0.2, translation_noise = 0.02, rotation_noise = 0.01;
};

bool parse(int argc, char** argv, Arguments& a) {
  po::options_description all("Options");
  auto add = all.add_options();
  add("help,h", "print this");
  add("world", po::value(&a.world)->required(), "YAML file of the world, with a trajectory");
  add("laser", po::value(&a.laser)->required(), "YAML file of a planar scanner");
  add("camera", po::value(&a.camera)->required(), "YAML file of a camera");
  add("calibration", po::value(&a.calibration)->required(), "of the scanner, as calibrate writes it");
  add("out", po::value(&a.out)->required(), "folder to write");
  add("seeds", po::value(&a.seeds)->default_value(a.seeds), "drives");
  add("first", po::value(&a.first)->default_value(a.first),
      "seed: of the world's textures, noise and odometry");
  add("max-range", po::value(&a.max_range)->default_value(a.max_range),
      "m, of the scanner: less lets the way drift");
  add("false-loops", po::value(&a.false_loops)->default_value(a.false_loops),
      "share of the camera's loops that is replaced by false ones");
  add("translation-noise", po::value(&a.translation_noise)->default_value(a.translation_noise),
      "drift of the odometry (m per square root of a metre)");
  add("rotation-noise", po::value(&a.rotation_noise)->default_value(a.rotation_noise),
      "drift of the odometry (rad per square root of a metre, or of a radian turned)");
  if (!mapping_common::parseArguments(argc, argv, kUsage, all)) return false;
  if (a.seeds < 1) throw po::error("--seeds must be at least 1");
  if (!(a.false_loops >= 0.0 && a.false_loops <= 1.0)) throw po::error("--false-loops must be in [0, 1]");
  return true;
}

std::int64_t nanoseconds(double seconds) {
  return std::llround(1e9 * seconds);
}
pose_graph::Pose toGraph(const slam::Pose& pose) {
  return pose_graph::planarPose(pose.x(), pose.y(), pose.z());
}
pose_graph::Pose toGraph(const Eigen::Isometry3d& pose) {
  const Eigen::Matrix3d r = pose.rotation();
  return pose_graph::planarPose(pose.translation().x(), pose.translation().y(), std::atan2(r(1, 0), r(0, 0)));
}

/// An edge by appearance, between the times of two images (ns).
struct CameraLoop {
  std::int64_t from = 0, to = 0;
  bool is_false = false;
};

struct Drive {
  std::string bag;  // of scans with reflectivities and odometry in tf
  Trajectory truth;
  std::vector<CameraLoop> camera_loops;
  std::vector<std::int64_t> images;  // key frames, ns
};

Drive simulateDrive(const Arguments& a, std::uint32_t seed, mapping_common::Progress& progress) {
  Drive drive;
  drive.bag = a.out + "/drive.bag";
  const std::string raw = a.out + "/raw.bag";
  mapping_simulation::Simulation simulation{mapping_simulation::loadWorld(a.world, seed),
                                            mapping_simulation::loadTrajectory(a.world),
                                            {},
                                            0.0,
                                            seed};
  loops::KeyFrameSelector key_frames;
  mapping_simulation::SensorConfig camera = mapping_simulation::loadSensor(a.camera);
  camera.rate = std::min(camera.rate, 1.0 / key_frames.options.min_interval);  // others wouldn't be looked at
  simulation.sensors = {mapping_simulation::loadSensor(a.laser), camera};
  simulation.duration = simulation.trajectory.endTime() - simulation.trajectory.startTime();
  mapping_simulation::SimulationBagOptions options;
  options.start_time = kStart;
  options.clock_rate = 0.0;
  options.odometry_noise = {a.translation_noise, a.rotation_noise};
  options.map_to_odom = false;
  loops::LoopDetector detector;
  mapping_simulation::writeSimulationBag(
      raw, simulation, options,
      [&](const mapping_simulation::SensorConfig& sensor, const mapping_simulation::Sweep& sweep) {
        const double passed = sweep.stamp - simulation.startTime();
        progress.show("seed ", seed, ": simulating, ", static_cast<int>(100.0 * passed / simulation.duration),
                      " %");
        if (sensor.type != mapping_simulation::SensorConfig::Type::kCamera) return;
        loops::Frame frame;
        frame.image = cv::Mat(sweep.image.height, sweep.image.width, CV_8UC1,
                              const_cast<std::uint8_t*>(sweep.image.data.data()))
                          .clone();
        frame.camera = loops::Camera{sensor.camera.fx, sensor.camera.fy, sensor.camera.cx, sensor.camera.cy};
        const std::int64_t stamp = nanoseconds(kStart + passed);
        if (!key_frames.select(1e-9 * static_cast<double>(stamp), std::nullopt, frame.image)) return;
        const loops::Detection found = detector.process(frame);
        drive.images.resize(found.image + 1);
        drive.images.back() = stamp;
        for (const loops::Loop& loop : found.earlier)
          drive.camera_loops.push_back({drive.images[loop.match], drive.images[loop.query]});
        if (found.accepted) drive.camera_loops.push_back({drive.images[found.best->match], stamp});
      });
  drive.truth = Trajectory(mapping_simulation::groundTruth(simulation, 1000.0, kStart));

  const calib::Calibration calibration = calib::loadCalibration(a.calibration);
  calib::ScanIncidence incidence;
  rosbag::Bag in(raw), out(drive.bag, rosbag::bagmode::Write);
  rosbag::View view(in);
  for (const rosbag::MessageInstance& message : view) {
    const auto scan = message.instantiate<sensor_msgs::LaserScan>();
    if (!scan) {
      if (message.getTopic().find("tf") != std::string::npos)
        out.write(message.getTopic(), message.getTime(), message);
      continue;
    }
    const calib::ScanArrays arrays = calib::readScan(*scan);
    const Eigen::ArrayXf result = calib::reflectivity(
        calibration, calib::ModelType::kLut, calib::OutsidePolicy::kDrop, arrays.ranges,
        incidence.estimate(arrays.ranges, scan->angle_min, scan->angle_increment), arrays.intensities);
    scan->intensities.assign(result.data(), result.data() + result.size());
    out.write("/scan", message.getTime(), *scan);
  }
  out.close();
  in.close();
  fs::remove(raw);
  return drive;
}

/// What SLAM made of the scans.
struct FrontEnd {
  slam::SlamParameters parameters;
  slam::BagResult result;
  std::map<std::int64_t, slam::Scan> scans;  // by their stamps, ns
};

FrontEnd runSlam(const Drive& drive, const Arguments& a, bool with_reflectivity) {
  FrontEnd front_end;
  front_end.parameters.scan.max_range = a.max_range;
  if (!with_reflectivity) front_end.parameters.slam.matcher.cost = "occupancy";
  front_end.parameters.resolve();
  slam::BagOptions bag;
  bag.bag = drive.bag;
  bag.scan_topic = "scan";
  bag.odom_frame = "odom";
  front_end.result = slam::runBag(bag, front_end.parameters, {}, [&](const slam::Scan& scan) {
    front_end.scans.emplace_hint(front_end.scans.end(), nanoseconds(scan.stamp), scan);
  });
  std::set<std::int64_t> keys;
  for (const slam::Edge& edge : front_end.result.edges)
    for (const slam::KeyPose& key : {edge.from, edge.to}) keys.insert(nanoseconds(key.stamp));
  for (auto i = front_end.scans.begin(); i != front_end.scans.end();)
    i = keys.count(i->first) ? std::next(i) : front_end.scans.erase(i);
  return front_end;
}

struct Counts {
  int accepted = 0, wrong = 0;
};

struct Outcome {
  std::size_t key_poses = 0, parts = 0;
  Counts laser, camera;
  int camera_found = 0, camera_matched = 0, false_ones = 0;
  double front_end = 0.0, corrected = 0.0, map = 0.0, map_mean = 0.0;  // m, greatest but for the last
};

/// The nodelet's work, in the order of time.
class Graph {
 public:
  Graph(const FrontEnd& front_end, const Drive& drive, const std::string& session)
      : front_end_(front_end), drive_(drive), keeper_(session, graph_) {}

  Outcome run(const std::vector<CameraLoop>& camera_loops) {
    std::size_t next_edge = 0, next_loop = 0;
    const auto& edges = front_end_.result.edges;
    for (const auto& entry : front_end_.result.entries) {
      const slam::Status status = entry.result.status;
      const std::int64_t stamp = nanoseconds(entry.stamp);
      if (status != slam::Status::kRejected && status != slam::Status::kEmpty)
        graph_.addFrontEndPose(stamp, toGraph(entry.result.pose));
      for (; next_edge < edges.size() && edges[next_edge].to.stamp <= entry.stamp; ++next_edge)
        add(edges[next_edge]);
      keepScans(stamp);
      for (; next_loop < camera_loops.size() && camera_loops[next_loop].to + nanoseconds(kSettled) < stamp;
           ++next_loop)
        match(camera_loops[next_loop]);
      optimise();
    }
    optimise();
    keeper_.update(graph_);
    keeper_.writer().flush();
    Outcome outcome = judge(camera_loops);
    outcome.camera_found = static_cast<int>(camera_loops.size());
    outcome.camera_matched = matched_;
    return outcome;
  }

 private:
  void add(const slam::Edge& edge) {
    pose_graph::Measurement m;
    m.from_stamp = nanoseconds(edge.from.stamp);
    m.to_stamp = nanoseconds(edge.to.stamp);
    m.type = edge.type == slam::EdgeType::kConsecutive ? EdgeType::kConsecutive : EdgeType::kLoopClosure;
    m.transform = toGraph(edge.transform);
    const Eigen::Matrix3d information = informationAtEnd(edge);
    m.information.setZero();
    constexpr int kRows[] = {0, 1, 5};
    for (int r = 0; r < 3; ++r)
      for (int c = 0; c < 3; ++c) m.information(kRows[r], kRows[c]) = information(r, c);
    m.source = "edges";
    graph_.add(m);
  }

  // Once the front end's poses of the whole sweep are there.
  void keepScans(std::int64_t now) {
    const auto& nodes = graph_.graph().nodes();
    for (; kept_ < nodes.size() && nodes[kept_].stamp + 100'000'000 < now; ++kept_) {
      const auto scan = front_end_.scans.find(nodes[kept_].stamp);
      if (scan == front_end_.scans.end()) continue;
      pose_graph::KeyData data = pose_graph::toKeyData(
          undistorted(scan->second, scan->first, graph_.frontEnd(), front_end_.parameters.slam));
      data.key_pose = nodes[kept_].id;
      data.stamp = scan->first;
      data.frame = "base_link";
      keeper_.update(graph_);
      keeper_.writer().put(std::move(data));
    }
  }

  // As PoseGraphNodelet::tryToMatch.
  void match(const CameraLoop& loop) {
    const auto from = graph_.attach(loop.from), to = graph_.attach(loop.to);
    if (!from || !to || from->node == to->node) return;
    keeper_.update(graph_);
    keeper_.writer().flush();
    const std::size_t first = std::min(from->node, to->node), second = std::max(from->node, to->node);
    const auto& nodes = graph_.graph().nodes();
    const pose_graph::ScanMatch match =
        matchScans(pose_graph::Session(keeper_.path()), graph_.graph(), nodes[first].id, nodes[second].id,
                   graph_.drift(first, second), front_end_.parameters.slam, front_end_.parameters.loop, {});
    if (!match.sure) return;
    ++matched_;
    pose_graph::Measurement m;
    m.from_stamp = nodes[first].stamp;
    m.to_stamp = nodes[second].stamp;
    m.type = EdgeType::kLoopClosure;
    m.transform = match.transform;
    m.information = match.information;
    m.source = "loop_closures";
    graph_.add(m);
  }

  void optimise() {
    while (auto task = graph_.begin()) {
      task->run();
      graph_.finish(std::move(*task));
    }
  }

  pose_graph::Pose truthAt(std::int64_t stamp) const {
    return toGraph(drive_.truth.at(1e-9 * static_cast<double>(stamp)));
  }

  Outcome judge(const std::vector<CameraLoop>& camera_loops) const {
    Outcome outcome;
    const pose_graph::Graph& graph = graph_.graph();
    outcome.key_poses = graph.nodes().size();
    outcome.parts = graph_.parts();
    for (const CameraLoop& loop : camera_loops) outcome.false_ones += loop.is_false;
    for (std::size_t e = 0; e < graph.edges().size(); ++e) {
      const pose_graph::Edge& edge = graph.edges()[e];
      const pose_graph::EdgeRecord& record = graph_.records()[e];
      if (edge.type == EdgeType::kConsecutive || record.state != EdgeState::kAccepted) continue;
      const pose_graph::Pose is =
          truthAt(graph.nodes()[edge.from].stamp).inverse() * truthAt(graph.nodes()[edge.to].stamp);
      const pose_graph::Pose error = is.inverse() * edge.transform;
      Counts& counts = record.source == "edges" ? outcome.laser : outcome.camera;
      ++counts.accepted;
      counts.wrong += error.translation.norm() > kWrongDistance || std::abs(error.yaw()) > kWrongAngle;
    }
    std::vector<mapping_simulation::TimedPose> poses;
    for (const pose_graph::Node& node : graph.nodes())
      poses.push_back({1e-9 * static_cast<double>(node.stamp),
                       Eigen::Translation3d(node.pose.translation) * Eigen::Isometry3d(node.pose.rotation)});
    std::vector<mapping_simulation::TimedPose> before = poses;
    for (auto& pose : before) {
      const auto there = graph_.frontEnd().at(nanoseconds(pose.time));
      if (there) pose.pose = Eigen::Translation3d(there->translation) * Eigen::Isometry3d(there->rotation);
    }
    const auto greatest = [&](const std::vector<mapping_simulation::TimedPose>& way) {
      return absoluteErrors(drive_.truth, Trajectory(way), 0.5, Alignment::kRigid).translation().max;
    };
    outcome.front_end = greatest(before);
    outcome.corrected = greatest(poses);
    judgeMap(graph, outcome);
    return outcome;
  }

  // Points of all key scans along the graph's poses, against those along the true way, after the rigid motion
  // that fits best (Umeyama 1991).
  void judgeMap(const pose_graph::Graph& graph, Outcome& outcome) const {
    std::vector<Eigen::Vector3d> is, should;
    for (const pose_graph::Node& node : graph.nodes()) {
      const auto scan = front_end_.scans.find(node.stamp);
      if (scan == front_end_.scans.end()) continue;
      const pose_graph::Pose truth = truthAt(node.stamp);
      for (std::size_t i = 0; i < scan->second.points.size(); i += 10) {
        const Eigen::Vector3d point(scan->second.points[i].x(), scan->second.points[i].y(), 0.0);
        is.push_back(node.pose.rotation * point + node.pose.translation);
        should.push_back(truth.rotation * point + truth.translation);
      }
    }
    const auto matrix = [](const std::vector<Eigen::Vector3d>& points) {
      return Eigen::Matrix3Xd(Eigen::Map<const Eigen::Matrix3Xd>(points.front().data(), 3, points.size()));
    };
    const Eigen::Matrix3Xd a = matrix(is), b = matrix(should);
    const Eigen::Isometry3d fit(Eigen::umeyama(a, b, false));
    const Eigen::Matrix3Xd error = fit * a - b;
    outcome.map = error.colwise().norm().maxCoeff();
    outcome.map_mean = error.colwise().norm().mean();
  }

  const FrontEnd& front_end_;
  const Drive& drive_;
  pose_graph::OnlineGraph graph_;
  pose_graph::GraphKeeper keeper_;
  std::size_t kept_ = 0;  // nodes whose scans are in the session, or aren't there
  int matched_ = 0;
};

// The earlier image becomes another one, that shows another place.
std::vector<CameraLoop> withFalseLoops(const Drive& drive, double share, std::uint32_t seed) {
  std::vector<CameraLoop> result = drive.camera_loops;
  std::mt19937 random(seed);
  std::vector<std::size_t> order(result.size());
  for (std::size_t i = 0; i < order.size(); ++i) order[i] = i;
  for (std::size_t i = order.size(); i > 1; --i) std::swap(order[i - 1], order[random() % i]);
  const auto count = static_cast<std::size_t>(std::ceil(share * static_cast<double>(result.size())));
  const auto where = [&](std::int64_t stamp) -> Eigen::Vector3d {
    return drive.truth.at(1e-9 * static_cast<double>(stamp)).translation();
  };
  for (std::size_t i = 0; i < count; ++i) {
    CameraLoop& loop = result[order[i]];
    std::vector<std::int64_t> others;
    for (const std::int64_t image : drive.images)
      if (image < loop.to && (where(image) - where(loop.to)).norm() > kFarPlace) others.push_back(image);
    if (others.empty()) continue;
    loop = {others[random() % others.size()], loop.to, true};
  }
  return result;
}

const std::vector<std::string> kHeader = {"seed",          "condition",     "key poses",     "parts",
                                          "laser loops",   "of them wrong", "false put in",  "camera found",
                                          "matched",       "camera kept",   "of them wrong", "front end (m)",
                                          "corrected (m)", "map (m)",       "map, mean (m)"};

std::vector<std::string> row(std::uint32_t seed, const std::string& condition, const Outcome& o) {
  const auto metres = [](double value) {
    char text[40];
    std::snprintf(text, sizeof(text), "%.3f", value);
    return std::string(text);
  };
  const auto number = [](auto value) { return std::to_string(value); };
  return {number(seed),
          condition,
          number(o.key_poses),
          number(o.parts),
          number(o.laser.accepted),
          number(o.laser.wrong),
          number(o.false_ones),
          number(o.camera_found),
          number(o.camera_matched),
          number(o.camera.accepted),
          number(o.camera.wrong),
          metres(o.front_end),
          metres(o.corrected),
          metres(o.map),
          metres(o.map_mean)};
}

std::string csv(const std::vector<std::vector<std::string>>& rows) {
  std::ostringstream text;
  for (const auto& cells : rows)
    for (std::size_t i = 0; i < cells.size(); ++i) text << cells[i] << (i + 1 < cells.size() ? "," : "\n");
  return text.str();
}

void run(const Arguments& a) {
  fs::create_directories(a.out);
  std::vector<std::vector<std::string>> rows = {kHeader};
  mapping_common::Progress progress("evaluate_building");
  for (std::uint32_t seed = a.first; seed < a.first + static_cast<std::uint32_t>(a.seeds); ++seed) {
    const Drive drive = simulateDrive(a, seed, progress);
    const auto add = [&](const std::string& condition, const FrontEnd& front_end,
                         const std::vector<CameraLoop>& camera_loops) {
      const std::string session = a.out + "/building.session";
      for (const char* ending : {"", "-wal", "-shm"}) fs::remove(session + ending);
      progress.show("seed ", seed, ": the graph, ", condition);
      rows.push_back(row(seed, condition, Graph(front_end, drive, session).run(camera_loops)));
      mapping_common::writeFile(a.out + "/building.csv", [&](std::ostream& out) { out << csv(rows); });
    };
    for (const bool with_reflectivity : {true, false}) {
      progress.show("seed ", seed, ": SLAM", with_reflectivity ? "" : " without reflectivities");
      const FrontEnd front_end = runSlam(drive, a, with_reflectivity);
      add(with_reflectivity ? "all" : "without reflectivities", front_end, drive.camera_loops);
      if (with_reflectivity) add("false loops", front_end, withFalseLoops(drive, a.false_loops, seed));
    }
    fs::remove(drive.bag);
  }
  progress.say(a.seeds, " seeds");
  std::cout << mapping_common::markdownTable(rows, 2);
}

}  // namespace

int main(int argc, char** argv) {
  return mapping_common::runTool(argc, argv, "evaluate_building", kUsage, parse, run);
}
