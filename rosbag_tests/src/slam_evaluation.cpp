// SPDX-License-Identifier: BSD-3-Clause
#include <intensity_hector_slam/key_poses.h>
#include <mapping_common/files.h>
#include <rosbag_tests/slam_evaluation.h>

#include <Eigen/Cholesky>
#include <algorithm>
#include <array>
#include <chrono>
#include <cmath>
#include <iomanip>
#include <map>
#include <ostream>
#include <utility>

#include "json.h"

namespace rosbag_tests {
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

struct Summary {
  std::size_t runs = 0, lost = 0, scans = 0, rejected = 0, unobservable = 0;
  std::vector<double> delta_translation, delta_rotation, translation, max_translation, rotation,
      normalized;  // if not lost
  double seconds = 0.0;
};

Summary summarize(const std::vector<SlamRun>& runs, const std::string& scenario,
                  intensity_hector_slam::Cost cost) {
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

double shareWithin(const std::vector<double>& values, double limit) {
  const auto within = [&](double value) { return std::abs(value) <= limit; };
  return static_cast<double>(std::count_if(values.begin(), values.end(), within)) / values.size();
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
      run.normalized_errors.insert(run.normalized_errors.end(), errors.begin(), errors.end());
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
  std::vector<std::pair<std::string, intensity_hector_slam::Cost>> rows;
  for (const SlamRun& run : runs) {
    const std::pair<std::string, intensity_hector_slam::Cost> row(run.scenario, run.cost);
    if (std::find(rows.begin(), rows.end(), row) == rows.end()) rows.push_back(row);
  }
  out << "| scenario | cost | map lost | delta error (mm) | delta error (deg) | absolute error, mean (m) | "
         "greatest (m) |"
         " absolute error, mean (deg) | errors within 1, 2, 3 sigma (%) | rejected (%) | unobservable (%) | "
         "ms per "
         "scan |\n"
         "|---|---|---:|---:|---:|---:|---:|---:|---:|---:|---:|---:|\n";
  for (const auto& row : rows) {
    const Summary s = summarize(runs, row.first, row.second);
    const auto cell = [&](double value, int digits) {
      out << ' ';
      if (std::isfinite(value))
        out << std::fixed << std::setprecision(digits) << value << " |";
      else
        out << "- |";
    };
    const auto mean = [](const std::vector<double>& values) { return momentsOf(values).mean; };
    out << "| " << row.first << " | " << toString(row.second) << " | " << s.lost << " of " << s.runs << " |";
    cell(1e3 * mean(s.delta_translation), 2);
    cell(kDegrees * mean(s.delta_rotation), 3);
    cell(mean(s.translation), 3);
    cell(momentsOf(s.max_translation).max, 3);
    cell(kDegrees * mean(s.rotation), 3);
    out << ' ';
    for (const double sigmas : {1.0, 2.0, 3.0}) {
      if (!s.normalized.empty())
        out << std::setprecision(1) << 100.0 * shareWithin(s.normalized, sigmas);
      else
        out << '-';
      out << (sigmas < 3.0 ? " / " : " |");
    }
    cell(100.0 * s.rejected / s.scans, 1);
    cell(100.0 * s.unobservable / s.scans, 1);
    cell(1e3 * s.seconds / s.scans, 2);
    out << '\n';
  }
}

std::string runsToJson(const std::vector<SlamRun>& runs) {
  std::vector<std::string> objects;
  for (const SlamRun& run : runs) {
    std::vector<std::string> normalized;
    for (const double error : run.normalized_errors) normalized.push_back(jsonNumber(error));
    objects.push_back(JsonObject()
                          .add("scenario", run.scenario)
                          .add("cost", toString(run.cost))
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

std::string errorsToJson(const SlamRun& run) {
  return JsonObject().raw("delta", errorsToJson(run.delta)).raw("absolute", errorsToJson(run.absolute)).str();
}

void writeMapPicture(const std::string& file, const GridMap& map, const std::vector<TimedPose>& truth,
                     const std::vector<TimedPose>& estimate) {
  const Eigen::AlignedBox2i known = map.knownCells();
  const Eigen::Vector2i min = known.isEmpty() ? Eigen::Vector2i(0, 0) : known.min();
  const Eigen::Vector2i size =
      known.isEmpty() ? Eigen::Vector2i(1, 1) : Eigen::Vector2i(known.max() - min + Eigen::Vector2i(1, 1));
  std::vector<Color> pixels(static_cast<std::size_t>(size.x()) * size.y());
  const auto pixel = [&](int x, int y) -> Color& {
    return pixels[static_cast<std::size_t>(size.y() - 1 - y) * size.x() + x];
  };
  for (int y = 0; y < size.y(); ++y)
    for (int x = 0; x < size.x(); ++x) pixel(x, y) = colorOf(map, min.x() + x, min.y() + y);
  const Eigen::Isometry3d to_map =
      truth.empty() ? Eigen::Isometry3d::Identity() : truth.front().pose.inverse();
  const auto draw = [&](const std::vector<TimedPose>& way, const Color& color) {
    for (const TimedPose& timed : way) {
      const Eigen::Vector2d point = (to_map * timed.pose).translation().head<2>() - map.origin();
      const Eigen::Array2i at = (point.array() / map.resolution()).floor().cast<int>() - min.array();
      if ((at >= 0).all() && (at < size.array()).all()) pixel(at.x(), at.y()) = color;
    }
  };
  draw(truth, {0, 160, 0});
  draw(estimate, {220, 0, 220});
  mapping_common::writeFile(file, [&](std::ostream& out) {
    out << "P6\n" << size.x() << ' ' << size.y() << "\n255\n";
    out.write(reinterpret_cast<const char*>(pixels.data()), static_cast<std::streamsize>(3 * pixels.size()));
  });
}

}  // namespace rosbag_tests
