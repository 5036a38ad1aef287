// SPDX-License-Identifier: BSD-3-Clause
#include <intensity_hector_slam/key_poses.h>
#include <mapping_common/files.h>
#include <mapping_common/markdown_table.h>
#include <rosbag_tests/evaluations/slam_evaluation.h>

#include <Eigen/Cholesky>
#include <algorithm>
#include <array>
#include <chrono>
#include <cmath>
#include <iomanip>
#include <map>
#include <numeric>
#include <ostream>
#include <sstream>
#include <utility>

#include "json.h"

namespace rosbag_tests {

using mapping_simulation::TimedPose;
using mapping_simulation::Trajectory;

namespace {

using intensity_hector_slam::GridMap;
using intensity_hector_slam::Pose;
using intensity_hector_slam::SlamResult;
using intensity_hector_slam::Status;

constexpr double kDegrees = 180.0 / M_PI;

Eigen::Isometry3d toIsometry(const Pose& pose) {
  return Eigen::Translation3d(pose.x(), pose.y(), 0.0) *
         Eigen::Isometry3d(Eigen::AngleAxisd(pose.z(), Eigen::Vector3d::UnitZ()));
}

Pose toPose(const Eigen::Isometry3d& pose) {
  return {pose.translation().x(), pose.translation().y(), std::atan2(pose(1, 0), pose(0, 0))};
}

// Of an edge between the poses at two indices, in units of its standard deviations.
Eigen::Vector3d normalizedError(const intensity_hector_slam::Edge& edge,
                                const std::vector<TimedPose>& truth) {
  const auto true_pose = [&](const intensity_hector_slam::KeyPose& key) {
    return toPose(truth[static_cast<std::size_t>(key.stamp)].pose);
  };
  Pose error = edge.transform - intensity_hector_slam::between(true_pose(edge.from), true_pose(edge.to));
  error.z() = intensity_hector_slam::wrapAngle(error.z());
  return edge.information.llt().matrixU() * error;
}

void count(Status status, SlamRun& run) {
  ++run.scans;
  run.rejected += status == Status::kRejected;
  run.unobservable += status == Status::kUnobservable;
  run.empty += status == Status::kEmpty;
}

using Color = std::array<unsigned char, 3>;

// Hue from blue (0) over green to red (1).
Color hue(double value) {
  const double h = 4.0 * std::clamp(value, 0.0, 1.0);
  const auto ramp = [](double x) {
    return static_cast<unsigned char>(std::lround(255.0 * std::clamp(x, 0.0, 1.0)));
  };
  return {ramp(h - 2.0), ramp(h < 2.0 ? h : 4.0 - h), ramp(2.0 - h)};
}

Color colorOf(const GridMap& map, int x, int y) {
  const GridMap::Cell& cell = map.cell(x, y);
  if (!GridMap::isKnown(cell)) return {190, 190, 190};
  if (GridMap::isFree(cell)) return {255, 255, 255};
  return map.count(x, y) == 0 ? Color{0, 0, 0} : hue(cell.reflectivity);
}

// Those that are known; of an empty map one.
Eigen::AlignedBox2i picturedCells(const GridMap& map) {
  const Eigen::AlignedBox2i known = map.knownCells();
  return known.isEmpty() ? Eigen::AlignedBox2i(Eigen::Vector2i(0, 0), Eigen::Vector2i(0, 0)) : known;
}

struct Summary {
  std::size_t runs = 0, lost = 0, scans = 0, rejected = 0, unobservable = 0;
  std::vector<double> delta_translation, delta_rotation, translation, max_translation, rotation,
      normalized;  // if not lost
  double seconds = 0.0;
};

Summary summarize(const std::vector<SlamRun>& runs, const std::string& scenario, const std::string& cost) {
  Summary s;
  for (const SlamRun& run : runs) {
    if (run.scenario != scenario || run.cost != cost) continue;
    ++s.runs;
    s.lost += run.lost();
    s.scans += run.scans;
    s.rejected += run.rejected;
    s.unobservable += run.unobservable;
    s.seconds += run.seconds_per_scan * run.scans;
    if (run.lost()) continue;
    s.delta_translation.push_back(run.delta.translation().mean);
    s.delta_rotation.push_back(run.delta.rotation().mean);
    s.translation.push_back(run.absolute.translation().mean);
    s.rotation.push_back(run.absolute.rotation().mean);
    s.max_translation.push_back(run.absolute.translation().max);
    s.normalized.insert(s.normalized.end(), run.normalized_errors.begin(), run.normalized_errors.end());
  }
  return s;
}

std::string number(double value, int digits) {
  if (!std::isfinite(value)) return "-";
  std::ostringstream out;
  out << std::fixed << std::setprecision(digits) << value;
  return out.str();
}

double shareWithin(const std::vector<double>& values, double limit) {
  const auto within = [&](double value) { return std::abs(value) <= limit; };
  return static_cast<double>(std::count_if(values.begin(), values.end(), within)) / values.size();
}

double deviationOf(const std::vector<double>& values) {
  return std::sqrt(std::inner_product(values.begin(), values.end(), values.begin(), 0.0) / values.size());
}

}  // namespace

SlamRun runSlam(const SlamRecording& recording, const intensity_hector_slam::SlamOptions& options,
                const LossCriterion& criterion, intensity_hector_slam::MultiMap* map) {
  using Clock = std::chrono::steady_clock;
  SlamRun run;
  run.cost = options.matcher.cost;
  if (recording.scans.empty()) return run;
  intensity_hector_slam::Slam slam(options);
  intensity_hector_slam::KeyPoses key_poses;
  const Eigen::Isometry3d start = recording.truth.front().pose;
  Clock::duration busy{0};
  for (std::size_t i = 0; i < recording.scans.size(); ++i) {
    const auto before = Clock::now();
    const SlamResult result = slam.process(recording.scans[i]);
    busy += Clock::now() - before;
    count(result.status, run);
    run.poses.push_back({recording.truth[i].time, start * toIsometry(result.pose)});
    if (result.status == Status::kUnobservable) key_poses.breakChain();
    if (const auto edge = key_poses.add(static_cast<double>(i), result)) {
      const Eigen::Vector3d errors = normalizedError(*edge, recording.truth);
      run.normalized_errors.insert(run.normalized_errors.end(), errors.data(), errors.data() + errors.size());
    }
  }
  run.seconds_per_scan = std::chrono::duration<double>(busy).count() / run.scans;
  const Trajectory truth(recording.truth), estimate(run.poses);
  run.delta = deltaErrors(truth, estimate, 0.0);
  run.absolute = absoluteErrors(truth, estimate, 0.0, Alignment::kRigid);
  for (const PoseError& error : absoluteErrors(truth, estimate, 0.0, Alignment::kNone).errors) {
    if (error.translation <= criterion.distance && error.rotation <= criterion.angle) continue;
    run.lost_after = error.time - recording.truth.front().time;
    break;
  }
  if (map) *map = slam.map();
  return run;
}

void printTable(std::ostream& out, const std::vector<SlamRun>& runs) {
  std::vector<std::pair<std::string, std::string>> rows;
  for (const SlamRun& run : runs) {
    const std::pair<std::string, std::string> row(run.scenario, run.cost);
    if (std::find(rows.begin(), rows.end(), row) == rows.end()) rows.push_back(row);
  }
  std::vector<std::vector<std::string>> table = {
      {"scenario", "cost", "lost", "delta (mm)", "delta (deg)", "error (m)", "greatest (m)", "error (deg)",
       "1, 2, 3 sigma (%)", "whitened", "rejected (%)", "unobservable (%)", "ms per scan"}};
  const auto mean = [](const std::vector<double>& values) { return momentsOf(values).mean; };
  for (const auto& [scenario, cost] : rows) {
    const Summary s = summarize(runs, scenario, cost);
    std::string within;
    for (const double sigmas : {1.0, 2.0, 3.0}) {
      const double share = s.normalized.empty() ? NAN : shareWithin(s.normalized, sigmas);
      within += (within.empty() ? "" : " / ") + number(100.0 * share, 1);
    }
    table.push_back({scenario, cost, std::to_string(s.lost) + " of " + std::to_string(s.runs),
                     number(1e3 * mean(s.delta_translation), 2), number(kDegrees * mean(s.delta_rotation), 3),
                     number(mean(s.translation), 3), number(momentsOf(s.max_translation).max, 3),
                     number(kDegrees * mean(s.rotation), 3), within, number(deviationOf(s.normalized), 2),
                     number(100.0 * s.rejected / s.scans, 1), number(100.0 * s.unobservable / s.scans, 1),
                     number(1e3 * s.seconds / s.scans, 2)});
  }
  out << mapping_common::markdownTable(table, 2);
}

std::string runsToJson(const std::vector<SlamRun>& runs) {
  std::vector<std::string> objects;
  for (const SlamRun& run : runs) {
    std::vector<std::string> normalized;
    for (const double error : run.normalized_errors) normalized.push_back(jsonNumber(error));
    objects.push_back(JsonObject()
                          .add("scenario", run.scenario)
                          .add("cost", run.cost)
                          .add("seed", run.seed)
                          .add("lost_after_s", run.lost_after)
                          .add("scans", run.scans)
                          .add("rejected", run.rejected)
                          .add("unobservable", run.unobservable)
                          .add("empty", run.empty)
                          .add("delta_translation_mean_m", run.delta.translation().mean)
                          .add("delta_translation_max_m", run.delta.translation().max)
                          .add("delta_rotation_mean_rad", run.delta.rotation().mean)
                          .add("delta_rotation_max_rad", run.delta.rotation().max)
                          .add("translation_mean_m", run.absolute.translation().mean)
                          .add("translation_max_m", run.absolute.translation().max)
                          .add("rotation_mean_rad", run.absolute.rotation().mean)
                          .add("rotation_max_rad", run.absolute.rotation().max)
                          .add("seconds_per_scan", run.seconds_per_scan)
                          .raw("normalized_errors", jsonArray(normalized))
                          .str());
  }
  return jsonArray(objects);
}

std::string runToJson(const SlamRun& run, const GridMap& map) {
  const Eigen::AlignedBox2i cells = picturedCells(map);
  const Eigen::Vector2d corner = map.resolution() * cells.min().cast<double>();
  return JsonObject()
      .raw("delta", errorsToJson(run.delta))
      .raw("absolute", errorsToJson(run.absolute))
      .add("lost_after_s", run.lost_after)
      .raw("map",
           JsonObject().add("x", corner.x()).add("y", corner.y()).add("resolution", map.resolution()).str())
      .str();
}

void writeMapPicture(const std::string& file, const GridMap& map) {
  const Eigen::AlignedBox2i cells = picturedCells(map);
  const Eigen::Vector2i size = cells.sizes() + Eigen::Vector2i(1, 1);
  std::string pixels;
  for (int y = cells.max().y(); y >= cells.min().y(); --y) {
    for (int x = cells.min().x(); x <= cells.max().x(); ++x) {
      const Color color = colorOf(map, x, y);
      pixels.append(color.begin(), color.end());
    }
  }
  mapping_common::writeFile(file, [&](std::ostream& out) {
    out << "P6\n" << size.x() << ' ' << size.y() << "\n255\n" << pixels;
  });
}

void writeSeen(const std::string& file, const SlamRecording& recording) {
  constexpr std::size_t kPoints = 20000;  // about
  std::size_t all = 0, at = 0;
  for (const intensity_hector_slam::Scan& scan : recording.scans) all += scan.points.size();
  const std::size_t step = std::max<std::size_t>(1, all / kPoints);
  mapping_common::writeFile(file, [&](std::ostream& out) {
    out << "x,y\n" << std::fixed << std::setprecision(3);
    for (std::size_t i = 0; i < recording.scans.size(); ++i) {
      for (const Eigen::Vector2f& end : recording.scans[i].points) {
        if (at++ % step != 0) continue;
        const Eigen::Vector3d seen = recording.truth[i].pose * Eigen::Vector3d(end.x(), end.y(), 0.0);
        out << seen.x() << ',' << seen.y() << '\n';
      }
    }
  });
}

}  // namespace rosbag_tests
