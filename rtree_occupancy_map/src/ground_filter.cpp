// SPDX-License-Identifier: BSD-3-Clause
#include "rtree_occupancy_map/ground_filter.h"

#include <pcl/console/print.h>
#include <pcl/point_types.h>
#include <pcl/sample_consensus/ransac.h>
#include <pcl/sample_consensus/sac_model_perpendicular_plane.h>

#include <algorithm>
#include <cmath>
#include <iterator>
#include <optional>
#include <vector>

namespace rtree_occupancy_map {
namespace {

using Cloud = pcl::PointCloud<pcl::PointXYZ>;

// A plane is found in every n-th point, so many at most, and by so many tries.
constexpr std::size_t kMostPoints = 10000;
constexpr int kTries = 200;
// What is left to search in, after planes that weren't the ground.
constexpr std::size_t kLeastPoints = 10;

// PCL says on standard error where there is no plane.
class Quiet {
 public:
  Quiet() : level_(pcl::console::getVerbosityLevel()) {
    pcl::console::setVerbosityLevel(pcl::console::L_ALWAYS);
  }
  ~Quiet() { pcl::console::setVerbosityLevel(level_); }
  Quiet(const Quiet&) = delete;
  Quiet& operator=(const Quiet&) = delete;

 private:
  pcl::console::VERBOSITY_LEVEL level_;
};

// n x + d = 0 with |n| = 1, in the cloud's frame.
std::optional<Eigen::Vector4f> groundIn(const Cloud::ConstPtr& cloud, const GroundFilterOptions& options) {
  const Quiet quiet;
  using Model = pcl::SampleConsensusModelPerpendicularPlane<pcl::PointXYZ>;
  const Model::Ptr model(new Model(cloud));
  model->setAxis(Eigen::Vector3f::UnitZ());
  model->setEpsAngle(options.angle);
  std::vector<int> left(cloud->size());
  for (std::size_t i = 0; i < left.size(); ++i) left[i] = static_cast<int>(i);
  while (left.size() > kLeastPoints) {
    model->setIndices(left);
    pcl::RandomSampleConsensus<pcl::PointXYZ> ransac(model, options.distance);
    ransac.setMaxIterations(kTries);
    if (!ransac.computeModel()) break;
    Eigen::VectorXf plane, refined;
    std::vector<int> inliers, rest;
    ransac.getModelCoefficients(plane);
    ransac.getInliers(inliers);
    model->optimizeModelCoefficients(inliers, plane, refined);
    if (std::abs(refined[3]) <= options.plane_distance) return Eigen::Vector4f(refined);
    std::sort(inliers.begin(), inliers.end());
    std::set_difference(left.begin(), left.end(), inliers.begin(), inliers.end(), std::back_inserter(rest));
    if (rest.size() == left.size()) break;
    left = std::move(rest);
  }
  return std::nullopt;
}

}  // namespace

std::size_t clearGround(const GroundFilterOptions& options, const Eigen::Isometry3d& base_in_map,
                        Scan& scan) {
  const Eigen::Isometry3f to_base = base_in_map.inverse().cast<float>();
  const Cloud::Ptr cloud(new Cloud);
  const std::size_t every = 1 + scan.hits.size() / kMostPoints;
  for (std::size_t i = 0; i < scan.hits.size(); i += every) {
    const Eigen::Vector3f point = to_base * scan.hits[i];
    if (point.allFinite()) cloud->emplace_back(point.x(), point.y(), point.z());
  }
  const std::optional<Eigen::Vector4f> plane = groundIn(cloud, options);
  const Eigen::Vector4f ground = plane ? *plane : Eigen::Vector4f::UnitZ();
  const double distance = plane ? options.distance : options.plane_distance;

  if (!scan.hit_origins.empty()) scan.miss_origins.resize(scan.misses.size(), scan.origin);
  std::size_t i = 0;
  return removeHits(
      [&](const Eigen::Vector3f& hit) {
        const std::size_t number = i++;
        const bool is_ground = std::abs(ground.dot((to_base * hit).homogeneous())) <= distance;
        if (is_ground) {
          scan.misses.push_back(hit);
          if (!scan.hit_origins.empty()) scan.miss_origins.push_back(scan.hit_origins[number]);
        }
        return is_ground;
      },
      scan);
}

}  // namespace rtree_occupancy_map
