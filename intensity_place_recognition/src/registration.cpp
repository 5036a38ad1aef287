// SPDX-License-Identifier: BSD-3-Clause
#include "intensity_place_recognition/registration.h"

#include <Eigen/Cholesky>
#include <Eigen/LU>
#include <algorithm>
#include <cmath>
#include <numeric>
#include <opencv2/imgproc.hpp>

namespace intensity_place_recognition {
namespace {

constexpr float kCell = 0.75f;        // m, of the ground plan
constexpr float kFirstReach = 2.0f;   // m, of the nearest patches in the first iteration
constexpr float kLastReach = 0.5f;    // and the last
constexpr double kResidual = 0.1;     // m, from which on a patch counts less
constexpr double kLeastError = 1e-3;  // m, of a patch: no scan is better, even where two are the same
constexpr float kMatched = 0.5f;      // m between patches that are the same
constexpr float kMargin = 1.0f;       // m behind a point that says it isn't there
constexpr std::size_t kFewestPairs = 50;
constexpr std::size_t kRefined = 1750;  // patches at most that the pose is measured by

std::size_t nearest(const pcl::KdTreeFLANN<pcl::PointXYZ>& tree, const Eigen::Vector3f& point, float reach,
                    std::vector<int>& index, std::vector<float>& squared) {
  index.resize(1);
  squared.resize(1);
  const bool found =
      tree.nearestKSearch(pcl::PointXYZ(point.x(), point.y(), point.z()), 1, index, squared) > 0;
  return found && squared[0] < reach * reach ? static_cast<std::size_t>(index[0]) : SIZE_MAX;
}

pcl::KdTreeFLANN<pcl::PointXYZ> treeOf(const Shape& shape) {
  const auto cloud = pcl::make_shared<pcl::PointCloud<pcl::PointXYZ>>();
  for (const Patch& p : shape.patches()) cloud->push_back({p.point.x(), p.point.y(), p.point.z()});
  pcl::KdTreeFLANN<pcl::PointXYZ> tree;
  if (!cloud->empty()) tree.setInputCloud(cloud);
  return tree;
}

// How much stands where, seen from above: the root of the number of patches.
cv::Mat1f groundPlan(const Shape& shape, double yaw, int cells) {
  cv::Mat1f plan(cells, cells, 0.0f);
  const float c = static_cast<float>(std::cos(yaw)), s = static_cast<float>(std::sin(yaw));
  for (const Patch& p : shape.patches()) {
    if (p.isLevel()) continue;
    const int x = static_cast<int>(std::floor((c * p.point.x() - s * p.point.y()) / kCell)) + cells / 2;
    const int y = static_cast<int>(std::floor((s * p.point.x() + c * p.point.y()) / kCell)) + cells / 2;
    if (x >= 0 && y >= 0 && x < cells && y < cells) plan(y, x) += 1.0f;
  }
  cv::sqrt(plan, plan);
  return plan;
}

float reachOf(const Shape& shape) {
  float reach = 0.0f;
  for (const Patch& p : shape.patches()) reach = std::max(reach, p.point.head<2>().norm());
  return reach;
}

}  // namespace

Matrix6 informationAtQuery(const Registration& registration) {
  // With T the pose, exp(a) T = T exp(b) where a = Ad(T) b.
  const Eigen::Matrix3d r = registration.pose.rotation();
  const Eigen::Vector3d t = registration.pose.translation();
  Eigen::Matrix3d cross;
  cross << 0, -t.z(), t.y(), t.z(), 0, -t.x(), -t.y(), t.x(), 0;
  Matrix6 adjoint = Matrix6::Zero();
  adjoint << r, cross * r, Eigen::Matrix3d::Zero(), r;
  const Matrix6 information = adjoint.transpose() * registration.covariance.inverse() * adjoint;
  return 0.5 * (information + information.transpose());
}

Registrar::Registrar(const Shape& match, const RegistrationOptions& options)
    : match_(match), options_(options) {
  const int cells =
      2 * static_cast<int>(std::ceil((reachOf(match) + 2.0 * options.max_distance) / kCell)) + 2;
  ground_plan_ = groundPlan(match, 0.0, cells);
  cv::GaussianBlur(ground_plan_, ground_plan_, {3, 3}, 0.8);
}

Guess Registrar::guess(const Shape& query, const std::vector<double>& yaws) const {
  const int reach = static_cast<int>(std::ceil(options_.max_distance / kCell)), width = 2 * reach + 1;
  const int cells = ground_plan_.rows;
  const int steps = static_cast<int>(std::round(options_.yaw_reach / options_.yaw_step));
  Guess best;
  cv::Mat1f sum(width, width);
  for (const double about : yaws) {
    for (int step = -steps; step <= steps; ++step) {
      const double yaw = about + step * options_.yaw_step;
      const cv::Mat1f plan = groundPlan(query, yaw, cells);
      sum = 0.0f;
      for (int y = reach; y < cells - reach; ++y) {
        for (int x = reach; x < cells - reach; ++x) {
          const float weight = plan(y, x);
          if (weight == 0.0f) continue;
          for (int dy = -reach; dy <= reach; ++dy) {
            const float* from = ground_plan_[y + dy] + x - reach;
            float* to = sum[dy + reach];
            for (int dx = 0; dx < width; ++dx) to[dx] += weight * from[dx];
          }
        }
      }
      double highest;
      cv::Point at;
      cv::minMaxLoc(sum, nullptr, &highest, nullptr, &at);
      highest /= std::max(1e-9, cv::norm(plan) * cv::norm(ground_plan_));
      if (highest <= best.correlation) continue;
      best.correlation = highest;
      best.pose = Eigen::Isometry3d(Eigen::AngleAxisd(yaw, Eigen::Vector3d::UnitZ()));
      best.pose.translation() << (at.x - reach) * kCell, (at.y - reach) * kCell, 0.0;
    }
  }
  return best;
}

// Iterative closest points, point to plane.
bool Registrar::refine(const Shape& query, const Tree& tree, Registration& result) const {
  std::vector<int> index;
  std::vector<float> squared;
  Matrix6 information = Matrix6::Zero();
  const std::size_t stride = query.patches().size() / kRefined + 1;
  for (int i = 0; i < options_.iterations; ++i) {
    const float t = std::min(1.0f, 1.5f * static_cast<float>(i) / static_cast<float>(options_.iterations));
    const float reach = kFirstReach * std::pow(kLastReach / kFirstReach, t);
    information.setZero();
    Eigen::Matrix<double, 6, 1> gradient = Eigen::Matrix<double, 6, 1>::Zero();
    std::size_t pairs = 0;
    double weights = 0.0, errors = 0.0;
    const Eigen::Isometry3f pose = result.pose.cast<float>();
    for (std::size_t p = 0; p < query.patches().size(); p += stride) {
      const Patch& patch = query.patches()[p];
      const Eigen::Vector3f point = pose * patch.point;
      const std::size_t found = nearest(tree, point, reach, index, squared);
      if (found == SIZE_MAX) continue;
      const Patch& other = match_.patches()[found];
      const float alike = std::abs(other.normal.dot(pose.linear() * patch.normal));
      if (other.flatness < 0.3f || alike < 0.5f) continue;
      const Eigen::Vector3d normal = other.normal.cast<double>();
      const double error = normal.dot((point - other.point).cast<double>());
      const double weight = other.flatness * alike / (1.0 + error * error / (kResidual * kResidual));
      Eigen::Matrix<double, 6, 1> jacobian;
      jacobian << normal, (point.cast<double>()).cross(normal);
      information.selfadjointView<Eigen::Lower>().rankUpdate(jacobian, weight);
      gradient += weight * error * jacobian;
      weights += weight;
      errors += weight * error * error;
      ++pairs;
    }
    if (pairs < kFewestPairs) return false;
    information = Matrix6(information.selfadjointView<Eigen::Lower>());
    const Matrix6 damped = information + 1e-6 * weights * Matrix6::Identity();
    const Eigen::Matrix<double, 6, 1> step = -damped.ldlt().solve(gradient);
    Eigen::Isometry3d change = Eigen::Isometry3d::Identity();
    const Eigen::Vector3d turn = step.tail<3>();
    if (turn.norm() > 1e-12)
      change.linear() = Eigen::AngleAxisd(turn.norm(), turn.normalized()).toRotationMatrix();
    change.translation() = step.head<3>();
    result.pose = change * result.pose;
    // Patches next to each other err alike, so that they count as a tenth as many.
    result.covariance = 10.0 * std::max(errors / weights, kLeastError * kLeastError) * damped.inverse();
    if (t >= 1.0f && step.head<3>().norm() < 1e-3 && turn.norm() < 1e-4) break;
  }
  return true;
}

// Both scans must see what either sees.
void Registrar::judge(const Shape& query, const Tree& tree, Registration& result) const {
  const auto query_tree = treeOf(query);
  std::vector<int> index;
  std::vector<float> squared;
  std::size_t matched = 0, missing = 0, all = 0;
  std::vector<std::pair<float, float>> intensities;
  const auto look = [&](const Shape& from, const Shape& to, const pcl::KdTreeFLANN<pcl::PointXYZ>& tree,
                        const Eigen::Isometry3f& pose) {
    for (const Patch& patch : from.patches()) {
      const Eigen::Vector3f point = pose * patch.point;
      const std::size_t found = nearest(tree, point, kMatched, index, squared);
      if (found != SIZE_MAX) intensities.emplace_back(patch.intensity, to.patches()[found].intensity);
      if (patch.isLevel()) continue;
      ++all;
      if (found != SIZE_MAX)
        ++matched;
      else if (to.seesThrough(point, kMargin))
        ++missing;
    }
  };
  look(query, match_, tree, result.pose.cast<float>());
  look(match_, query, query_tree, result.pose.inverse().cast<float>());
  result.agreement =
      matched > 0 ? static_cast<double>(matched) / static_cast<double>(matched + missing) : 0.0;
  result.common = all > 0 ? static_cast<double>(matched + missing) / static_cast<double>(all) : 0.0;
  double a = 0.0, b = 0.0, aa = 0.0, bb = 0.0, ab = 0.0;
  const double n = std::max<double>(1.0, static_cast<double>(intensities.size()));
  for (const auto& [x, y] : intensities) a += x, b += y, aa += x * x, bb += y * y, ab += x * y;
  const double spread = std::sqrt(std::max(0.0, (aa - a * a / n) * (bb - b * b / n)));
  result.intensity = spread > 1e-9 ? (ab - a * b / n) / spread : 0.0;
}

Registration Registrar::operator()(const Shape& query, const Guess& guess) const {
  Registration result;
  result.pose = guess.pose;
  if (query.patches().size() < kFewestPairs || match_.patches().size() < kFewestPairs) return result;
  const Tree tree = treeOf(match_);
  if (!refine(query, tree, result)) return result;
  judge(query, tree, result);
  result.score = result.agreement * result.common;
  result.accepted = result.score >= options_.min_score && result.intensity >= options_.min_intensity &&
                    result.pose.translation().norm() <= options_.max_distance;
  return result;
}

}  // namespace intensity_place_recognition
