// SPDX-License-Identifier: BSD-3-Clause
#include <mapping_common/files.h>
#include <mapping_common/text.h>
#include <mapping_simulation/trajectory.h>

#include <algorithm>
#include <cmath>
#include <iomanip>
#include <random>
#include <stdexcept>

#include "trajectory_yaml.h"

namespace mapping_simulation {

Trajectory::Trajectory(std::vector<TimedPose> poses, bool loop) : poses_(std::move(poses)), loop_(loop) {
  if (poses_.size() < (loop ? 2u : 1u)) {
    throw std::invalid_argument(loop ? "a looping trajectory needs two poses" : "a trajectory needs a pose");
  }
  for (std::size_t i = 1; i < poses_.size(); ++i) {
    if (!(poses_[i].time > poses_[i - 1].time)) {
      throw std::invalid_argument("time of pose " + std::to_string(i + 1) + " isn't after the one before");
    }
  }
}

Eigen::Isometry3d Trajectory::at(double time) const {
  if (loop_ && time > endTime()) time = startTime() + std::fmod(time - startTime(), endTime() - startTime());
  const auto next = std::upper_bound(poses_.begin(), poses_.end(), time,
                                     [](double t, const TimedPose& pose) { return t < pose.time; });
  if (next == poses_.begin()) return poses_.front().pose;
  if (next == poses_.end()) return poses_.back().pose;
  const TimedPose& a = *std::prev(next);
  const TimedPose& b = *next;
  const double s = (time - a.time) / (b.time - a.time);
  Eigen::Isometry3d pose(Eigen::Quaterniond(a.pose.linear()).slerp(s, Eigen::Quaterniond(b.pose.linear())));
  pose.translation() = (1.0 - s) * a.pose.translation() + s * b.pose.translation();
  return pose;
}

Trajectory driveThrough(const std::vector<Waypoint>& waypoints, bool closed) {
  if (waypoints.size() < 2) throw std::invalid_argument("a path needs two waypoints");
  std::vector<Waypoint> points = waypoints;
  if (closed) points.push_back(points.front());
  const std::size_t last = points.size() - 1;

  std::vector<Eigen::Vector3d> chords(last);
  std::vector<double> knots(last);  // length of each piece in the spline's parameter
  for (std::size_t i = 0; i <= last; ++i) {
    if (!(points[i].speed > 0.0)) {
      throw std::invalid_argument("speed at waypoint " + std::to_string(i + 1) + " isn't positive");
    }
    if (i == last) break;
    chords[i] = points[i + 1].position - points[i].position;
    knots[i] = std::sqrt(chords[i].norm());
    if (!(knots[i] > 0.0))
      throw std::invalid_argument("waypoint " + std::to_string(i + 1) + " equals the next one");
  }
  std::vector<Eigen::Vector3d> tangents(points.size());
  for (std::size_t i = 0; i <= last; ++i) {
    const bool end = i == 0 || i == last;
    if (end && !closed) {
      tangents[i] = chords[std::min(i, last - 1)] / knots[std::min(i, last - 1)];
    } else {
      const std::size_t before = i == 0 ? last - 1 : i - 1, after = i == last ? 0 : i;
      tangents[i] = chords[before] / knots[before] + chords[after] / knots[after] -
                    (chords[before] + chords[after]) / (knots[before] + knots[after]);
    }
  }

  constexpr double kStep = 0.05;  // m between samples, small against the turning radius of any robot
  std::vector<TimedPose> poses;
  double yaw = 0.0;
  for (std::size_t i = 0; i < last; ++i) {
    const int samples = std::max(8, static_cast<int>(std::ceil(chords[i].norm() / kStep)));
    const Eigen::Vector3d m0 = tangents[i] * knots[i], m1 = tangents[i + 1] * knots[i];
    for (int k = poses.empty() ? 0 : 1; k <= samples; ++k) {
      const double s = static_cast<double>(k) / samples, q = 1.0 - s;
      // Cubic Hermite basis and its derivative.
      const Eigen::Vector3d position = (1.0 + 2.0 * s) * q * q * points[i].position + s * q * q * m0 +
                                       s * s * (3.0 - 2.0 * s) * points[i + 1].position - s * s * q * m1;
      const Eigen::Vector3d along =
          6.0 * s * q * chords[i] + q * (1.0 - 3.0 * s) * m0 + s * (3.0 * s - 2.0) * m1;
      if (along.head<2>().norm() > 1e-9) yaw = std::atan2(along.y(), along.x());
      TimedPose pose;
      pose.pose = Eigen::Translation3d(position) * Eigen::AngleAxisd(yaw, Eigen::Vector3d::UnitZ());
      if (!poses.empty()) {
        const double middle = s - 0.5 / samples;
        const double speed = (1.0 - middle) * points[i].speed + middle * points[i + 1].speed;
        pose.time = poses.back().time + (position - poses.back().pose.translation()).norm() / speed;
      }
      poses.push_back(pose);
    }
  }
  return Trajectory(std::move(poses), closed);
}

Trajectory swaying(const Trajectory& path, const Sway& sway, std::uint64_t seed) {
  constexpr double kStep = 0.05;  // s
  std::mt19937_64 random(seed);
  std::normal_distribution<double> gauss;
  using Vector5d = Eigen::Matrix<double, 5, 1>;
  const Vector5d deviations =
      (Vector5d() << sway.side, sway.height, sway.roll, sway.pitch, sway.yaw).finished();
  const auto draw = [&] {
    return deviations.cwiseProduct(Vector5d::NullaryExpr([&] { return gauss(random); })).eval();
  };
  std::vector<double> times;
  for (const TimedPose& pose : path.poses()) {  // its own poses are kept, since it may jump
    while (!times.empty() && times.back() + 1.5 * kStep < pose.time) times.push_back(times.back() + kStep);
    times.push_back(pose.time);
  }
  std::vector<TimedPose> poses;
  Vector5d off = draw();
  for (double time : times) {
    const double keep = poses.empty() ? 1.0 : std::exp((poses.back().time - time) / sway.memory);
    off = keep * off + std::sqrt(1.0 - keep * keep) * draw();
    const Eigen::Isometry3d pose = path.at(time) * Eigen::Translation3d(0.0, off[0], off[1]) *
                                   Eigen::AngleAxisd(off[4], Eigen::Vector3d::UnitZ()) *
                                   Eigen::AngleAxisd(off[3], Eigen::Vector3d::UnitY()) *
                                   Eigen::AngleAxisd(off[2], Eigen::Vector3d::UnitX());
    poses.push_back({time, pose});
  }
  return Trajectory(std::move(poses));
}

namespace {

Trajectory readPath(const YamlMap& map) {
  if (map.has("poses") == map.has("waypoints")) map.fail(map.node(), "give either poses or waypoints");
  try {
    if (map.has("poses")) {
      std::vector<TimedPose> poses;
      for (const YAML::Node& node : map.sequence("poses")) {
        std::vector<double> v =
            map.numbers(node, "a pose [t, x, y, z, (roll, pitch,) yaw]", {-1e9, 1e9}, 4, 7);
        if (v.size() == 6)
          map.fail(node, "a pose has t x y z, t x y z yaw or t x y z roll pitch yaw, not 6 numbers");
        if (v.size() == 5) v.insert(v.begin() + 4, 2, 0.0);
        v.resize(7);
        poses.push_back({v[0], Eigen::Translation3d(v[1], v[2], v[3]) * fromRpyDegrees(v[4], v[5], v[6])});
      }
      const bool loop = map.flag("loop", false);
      return Trajectory(poses, loop);
    }
    const Limits speeds{1e-3, 1e3, "m/s"};
    const double speed = map.number("speed", speeds, 1.0);
    std::vector<Waypoint> waypoints;
    for (const YAML::Node& node : map.sequence("waypoints")) {
      const std::vector<double> v = map.numbers(node, "a waypoint [x, y, z, (speed)]", kMetres, 3, 4);
      if (v.size() == 4 && !(v[3] >= speeds.min))
        map.fail(node[3], "speed of a waypoint must be at least 0.001 m/s");
      waypoints.push_back({Eigen::Vector3d(v.data()), v.size() == 4 ? v[3] : speed});
    }
    const bool closed = map.flag("closed", false);
    return driveThrough(waypoints, closed);
  } catch (const std::invalid_argument& e) {
    map.fail(map.node(), e.what());
  }
}

}  // namespace

Trajectory readTrajectory(const YamlMap& map) {
  Trajectory path = readPath(map);
  if (map.has("sway")) {
    const YamlMap node = map.map("sway");
    const auto degrees = [&node](const char* key) {
      return node.number(key, {0.0, 90.0, "deg"}, 0.0) * M_PI / 180.0;
    };
    Sway sway;
    sway.side = node.number("side", {0.0, 10.0, "m"}, sway.side);
    sway.height = node.number("height", {0.0, 10.0, "m"}, sway.height);
    sway.roll = degrees("roll_deg");
    sway.pitch = degrees("pitch_deg");
    sway.yaw = degrees("yaw_deg");
    sway.memory = node.number("memory", {0.05, 1e3, "s"}, sway.memory);
    path = swaying(path, sway, node.integer("seed", {0, 1e9}, 0));
    node.finish();
  }
  map.finish();
  return path;
}

namespace {

Trajectory readTum(const std::string& file) {
  std::vector<TimedPose> poses;
  mapping_common::forEachLine(
      mapping_common::readFile(file), file, [&](const std::string& line, const std::string& where) {
        std::vector<double> v;
        const bool numbers = mapping_common::parseNumbers(line, v);
        if (numbers && v.empty()) return;
        if (!numbers || v.size() != 8) v.assign(8, NAN);
        const Eigen::Quaterniond rotation(v[7], v[4], v[5], v[6]);
        const Eigen::Vector3d position(v[1], v[2], v[3]);
        if (!position.allFinite() || !(std::abs(rotation.norm() - 1.0) <= 1e-2)) {
          throw std::runtime_error(where + ": '" + line +
                                   "' must be time x y z and a unit quaternion qx qy qz qw");
        }
        poses.push_back({v[0], Eigen::Translation3d(position) * rotation.normalized()});
      });
  try {
    return Trajectory(std::move(poses));
  } catch (const std::invalid_argument& e) {
    throw std::runtime_error(file + ": " + e.what());
  }
}

}  // namespace

Trajectory loadTrajectory(const std::string& file) {
  if (file.size() > 4 && file.compare(file.size() - 4, 4, ".tum") == 0) return readTum(file);
  return readTrajectory(YamlMap::load(file).map("trajectory"));
}

void writeTum(const std::string& file, const std::vector<TimedPose>& poses) {
  mapping_common::writeFile(file, [&](std::ostream& out) {
    out << std::fixed << std::setprecision(9) << "# time x y z qx qy qz qw\n";
    for (const TimedPose& timed : poses) {
      const Eigen::Vector3d p = timed.pose.translation();
      const Eigen::Quaterniond q(timed.pose.linear());
      out << timed.time << ' ' << p.x() << ' ' << p.y() << ' ' << p.z() << ' ' << q.x() << ' ' << q.y() << ' '
          << q.z() << ' ' << q.w() << '\n';
    }
  });
}

}  // namespace mapping_simulation
