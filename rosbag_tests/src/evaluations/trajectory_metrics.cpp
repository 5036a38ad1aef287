// SPDX-License-Identifier: BSD-3-Clause
#include <rosbag_tests/evaluations/trajectory_metrics.h>

#include <algorithm>
#include <cmath>
#include <iomanip>
#include <ostream>

#include "../converters/file_utils.h"
#include "json.h"

namespace rosbag_tests {

using mapping_simulation::TimedPose;
using mapping_simulation::Trajectory;

namespace {

constexpr double kSameTime = 1e-5;  // s
constexpr double kDegrees = 180.0 / M_PI;

long long microseconds(double stamp) {
  return std::llround(1e6 * stamp);
}

PoseError errorOf(double time, const Eigen::Isometry3d& truth, const Eigen::Isometry3d& pose) {
  const Eigen::Isometry3d error = truth.inverse() * pose;
  return {time, error.translation().norm(), Eigen::AngleAxisd(error.linear()).angle()};
}

Moments of(const std::vector<PoseError>& errors, const std::function<double(const PoseError&)>& value) {
  std::vector<double> values;
  for (const PoseError& error : errors) values.push_back(value(error));
  return momentsOf(std::move(values));
}

struct Pair {
  double time;
  Eigen::Isometry3d reference, estimate;
};

std::vector<Pair> associate(const Trajectory& reference, const Trajectory& estimate, double max_gap) {
  std::vector<Pair> pairs;
  for (const TimedPose& timed : estimate.poses()) {
    if (const auto truth = poseAt(reference, timed.time, max_gap))
      pairs.push_back({timed.time, *truth, timed.pose});
  }
  return pairs;
}

// Umeyama's solution without scale has a closed form in the plane.
Eigen::Isometry3d rigidAlignment(const std::vector<Pair>& pairs) {
  Eigen::Vector3d reference = Eigen::Vector3d::Zero(), estimate = Eigen::Vector3d::Zero();
  for (const Pair& pair : pairs) {
    reference += pair.reference.translation() / pairs.size();
    estimate += pair.estimate.translation() / pairs.size();
  }
  double cosine = 0.0, sine = 0.0;
  for (const Pair& pair : pairs) {
    const Eigen::Vector3d r = pair.reference.translation() - reference,
                          e = pair.estimate.translation() - estimate;
    cosine += e.x() * r.x() + e.y() * r.y();
    sine += e.x() * r.y() - e.y() * r.x();
  }
  const Eigen::Matrix3d rotation =
      Eigen::AngleAxisd(std::atan2(sine, cosine), Eigen::Vector3d::UnitZ()).toRotationMatrix();
  Eigen::Isometry3d alignment = Eigen::Isometry3d::Identity();
  alignment.linear() = rotation;
  alignment.translation() = reference - rotation * estimate;
  return alignment;
}

std::string toJson(const Moments& m) {
  return JsonObject()
      .add("mean", m.mean)
      .add("deviation", m.deviation)
      .add("median", m.median)
      .add("max", m.max)
      .str();
}

}  // namespace

Moments momentsOf(std::vector<double> values) {
  const double nan = std::numeric_limits<double>::quiet_NaN();
  if (values.empty()) return {nan, nan, nan, nan};
  std::sort(values.begin(), values.end());
  const std::size_t n = values.size();
  double sum = 0.0, squares = 0.0;
  for (const double value : values) sum += value;
  for (const double value : values) squares += (value - sum / n) * (value - sum / n);
  return {sum / n, std::sqrt(squares / n), 0.5 * (values[(n - 1) / 2] + values[n / 2]), values.back()};
}

std::optional<Eigen::Isometry3d> poseAt(const Trajectory& trajectory, double time, double max_gap) {
  const auto& poses = trajectory.poses();
  const auto next = std::lower_bound(poses.begin(), poses.end(), time,
                                     [](const TimedPose& pose, double t) { return pose.time < t; });
  if (next != poses.end() && next->time - time <= kSameTime) return next->pose;
  if (next != poses.begin() && time - std::prev(next)->time <= kSameTime) return std::prev(next)->pose;
  if (next == poses.begin() || next == poses.end() || next->time - std::prev(next)->time > max_gap) return {};
  return trajectory.at(time);
}

Moments PoseErrors::translation() const {
  return of(errors, [](const PoseError& e) { return e.translation; });
}
Moments PoseErrors::rotation() const {
  return of(errors, [](const PoseError& e) { return e.rotation; });
}
Moments PoseErrors::squaredTranslation() const {
  return of(errors, [](const PoseError& e) { return e.translation * e.translation; });
}
Moments PoseErrors::squaredRotation() const {
  return of(errors, [](const PoseError& e) { return e.rotation * e.rotation; });
}

std::vector<Relation> readRelations(const std::string& file) {
  std::vector<Relation> relations;
  forEachLine(readFileBytes(file), file, [&](const std::string& line, const std::string& where) {
    std::vector<double> v;
    const bool numbers = parseNumbers(line, v);
    if (numbers && v.empty()) return;
    if (!numbers || v.size() != 8 ||
        !std::all_of(v.begin(), v.end(), [](double x) { return std::isfinite(x); }))
      fail(where, "'" + line + "' must be from to x y z roll pitch yaw");
    const Eigen::Quaterniond rotation = Eigen::AngleAxisd(v[7], Eigen::Vector3d::UnitZ()) *
                                        Eigen::AngleAxisd(v[6], Eigen::Vector3d::UnitY()) *
                                        Eigen::AngleAxisd(v[5], Eigen::Vector3d::UnitX());
    relations.push_back({v[0], v[1], Eigen::Translation3d(v[2], v[3], v[4]) * rotation});
  });
  if (relations.empty()) fail(file, "no relation");
  return relations;
}

StampMap::StampMap(const std::string& file) {
  forEachLine(readFileBytes(file), file, [&](const std::string& line, const std::string& where) {
    std::vector<double> v;
    const bool numbers = parseNumbers(line, v);
    if (numbers && v.empty()) return;
    if (!numbers || v.size() != 2) fail(where, "'" + line + "' must be stamp original");
    stamps_[microseconds(v[1])] = v[0];
  });
}

double StampMap::operator()(double original) const {
  const auto found = stamps_.find(microseconds(original));
  return found == stamps_.end() ? original : found->second;
}

PoseErrors relationErrors(const Trajectory& trajectory, const std::vector<Relation>& relations,
                          double max_gap, const StampMap& stamps) {
  PoseErrors result;
  for (const Relation& relation : relations) {
    const auto from = poseAt(trajectory, stamps(relation.from), max_gap);
    const auto to = poseAt(trajectory, stamps(relation.to), max_gap);
    if (from && to)
      result.errors.push_back(errorOf(relation.to, relation.pose, from->inverse() * *to));
    else
      ++result.unmatched;
  }
  return result;
}

PoseErrors deltaErrors(const Trajectory& reference, const Trajectory& estimate, double max_gap) {
  const std::vector<Pair> pairs = associate(reference, estimate, max_gap);
  PoseErrors result;
  result.unmatched = estimate.poses().size() - pairs.size();
  for (std::size_t i = 1; i < pairs.size(); ++i) {
    result.errors.push_back(errorOf(pairs[i].time, pairs[i - 1].reference.inverse() * pairs[i].reference,
                                    pairs[i - 1].estimate.inverse() * pairs[i].estimate));
  }
  return result;
}

PoseErrors absoluteErrors(const Trajectory& reference, const Trajectory& estimate, double max_gap,
                          Alignment alignment) {
  const std::vector<Pair> pairs = associate(reference, estimate, max_gap);
  PoseErrors result;
  result.unmatched = estimate.poses().size() - pairs.size();
  if (pairs.empty()) return result;
  Eigen::Isometry3d to_reference = Eigen::Isometry3d::Identity();
  if (alignment == Alignment::kFirst) to_reference = pairs[0].reference * pairs[0].estimate.inverse();
  if (alignment == Alignment::kRigid) to_reference = rigidAlignment(pairs);
  for (const Pair& pair : pairs)
    result.errors.push_back(errorOf(pair.time, pair.reference, to_reference * pair.estimate));
  return result;
}

void printErrors(std::ostream& out, const std::string& name, const PoseErrors& errors) {
  const auto row = [&](const char* what, const Moments& m, double scale) {
    out << std::left << std::setw(32) << what << std::right << std::fixed << std::setprecision(4);
    for (const double value : {m.mean, m.deviation, m.median, m.max}) out << std::setw(12) << scale * value;
    out << '\n';
  };
  out << name << ": " << errors.errors.size() << " used, " << errors.unmatched << " without a pose\n"
      << std::setw(44) << "mean" << std::setw(12) << "deviation" << std::setw(12) << "median" << std::setw(12)
      << "max" << '\n';
  row("translation, absolute (m)", errors.translation(), 1.0);
  row("rotation, absolute (deg)", errors.rotation(), kDegrees);
  row("translation, squared (m^2)", errors.squaredTranslation(), 1.0);
  row("rotation, squared (deg^2)", errors.squaredRotation(), kDegrees * kDegrees);
}

std::string errorsToJson(const PoseErrors& errors) {
  std::vector<std::string> time, translation, rotation;
  for (const PoseError& error : errors.errors) {
    time.push_back(jsonNumber(error.time));
    translation.push_back(jsonNumber(error.translation));
    rotation.push_back(jsonNumber(error.rotation));
  }
  return JsonObject()
      .add("used", errors.errors.size())
      .add("unmatched", errors.unmatched)
      .raw("translation_m", toJson(errors.translation()))
      .raw("rotation_rad", toJson(errors.rotation()))
      .raw("squared_translation_m2", toJson(errors.squaredTranslation()))
      .raw("squared_rotation_rad2", toJson(errors.squaredRotation()))
      .raw("errors", JsonObject()
                         .raw("time_s", jsonArray(time))
                         .raw("translation_m", jsonArray(translation))
                         .raw("rotation_rad", jsonArray(rotation))
                         .str())
      .str();
}

}  // namespace rosbag_tests
