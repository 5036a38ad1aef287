// SPDX-License-Identifier: BSD-3-Clause
#include <pcl/kdtree/kdtree_flann.h>
#include <pcl/point_cloud.h>
#include <pcl/point_types.h>

#include <Eigen/Eigenvalues>
#include <algorithm>
#include <array>
#include <limits>
#include <map>
#include <stdexcept>
#include <string>
#include <vector>

#include "laser_intensity_calib/incidence.h"

namespace laser_intensity_calib {
namespace {

constexpr float kNan = std::numeric_limits<float>::quiet_NaN();
using Cloud = pcl::PointCloud<pcl::PointXYZ>;

// Whether a point can have neighbours: squared distances to others of that kind are finite, too. FLANN
// doesn't write the neighbours that are infinitely far, and Debian 11's PCL takes what is in memory for them.
bool isUsable(const Eigen::Vector3f& point) {
  return (point.array().abs() < 1e18F).all();
}

// Sorted, so that the result doesn't depend on a hash.
Cloud::Ptr thin(const Cloud& cloud, double leaf) {
  std::map<std::array<int, 3>, std::pair<Eigen::Vector3d, int>> voxels;
  for (const pcl::PointXYZ& point : cloud) {
    std::array<int, 3> key;
    for (int axis = 0; axis < 3; ++axis) {
      key[axis] = static_cast<int>(std::clamp(std::floor(point.data[axis] / leaf), -1e9, 1e9));
    }
    auto& [sum, count] = voxels.try_emplace(key, Eigen::Vector3d::Zero(), 0).first->second;
    sum += point.getVector3fMap().cast<double>();
    ++count;
  }
  Cloud::Ptr thinned(new Cloud);
  for (const auto& [key, voxel] : voxels) {
    const Eigen::Vector3f mean = (voxel.first / voxel.second).cast<float>();
    thinned->emplace_back(mean.x(), mean.y(), mean.z());
  }
  return thinned;
}

// The normal of the plane through the points, zero where they don't tell it to within max_error.
Eigen::Vector3d normalOf(const std::vector<Eigen::Vector3f>& points, double max_error) {
  const int count = static_cast<int>(points.size());
  if (count < 4) return Eigen::Vector3d::Zero();
  Eigen::Vector3d sum = Eigen::Vector3d::Zero();
  Eigen::Matrix3d squares = Eigen::Matrix3d::Zero();
  for (const Eigen::Vector3f& point : points) {
    const Eigen::Vector3d d = (point - points[0]).cast<double>();
    sum += d;
    squares += d * d.transpose();
  }
  const Eigen::Matrix3d covariance = squares / count - sum * sum.transpose() / (count * count);
  Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d> solver;
  solver.computeDirect(covariance);
  const Eigen::Vector3d values = solver.eigenvalues().cwiseMax(0.0);
  // About the axis along which the plane is worse determined; points on a line determine none.
  const double variance = values[0] / (values[1] * (count - 3));
  if (!(values[1] > 1e-3 * values[2]) || !(variance <= max_error * max_error)) return Eigen::Vector3d::Zero();
  return solver.eigenvectors().col(0);
}

// Finds the neighbours of points by a k-d tree.
class Search {
 public:
  Search(const Eigen::Matrix3Xf& points, const CloudIncidenceOptions& options)
      : points_(points), options_(options), neighborhood_(new Cloud) {
    for (Eigen::Index i = 0; i < points.cols(); ++i) {
      if (isUsable(points.col(i))) neighborhood_->emplace_back(points(0, i), points(1, i), points(2, i));
    }
    if (options.leaf > 0.0) neighborhood_ = thin(*neighborhood_, options.leaf);
    if (!neighborhood_->empty()) tree_.setInputCloud(neighborhood_);
  }
  void operator()(Eigen::Index i, std::vector<Eigen::Vector3f>& neighbors) {
    const pcl::PointXYZ point(points_(0, i), points_(1, i), points_(2, i));
    tree_.nearestKSearch(point, options_.neighbors, found_, distances_);
    for (std::size_t k = 0; k < found_.size(); ++k) {
      if (distances_[k] > options_.radius * options_.radius) break;  // sorted
      neighbors.push_back((*neighborhood_)[found_[k]].getVector3fMap());
    }
  }

 private:
  const Eigen::Matrix3Xf& points_;
  const CloudIncidenceOptions& options_;
  Cloud::Ptr neighborhood_;
  pcl::KdTreeFLANN<pcl::PointXYZ> tree_;
  std::vector<int> found_;
  std::vector<float> distances_;
};

// Those of an organised cloud by rows and columns.
class Window {
 public:
  Window(const Eigen::Matrix3Xf& points, Eigen::Index width, const CloudIncidenceOptions& options)
      : points_(points), width_(width), height_(points.cols() / width), options_(options) {}
  void operator()(Eigen::Index i, std::vector<Eigen::Vector3f>& neighbors) const {
    const Eigen::Index row = i / width_, column = i % width_;
    const Eigen::Index last_row = std::min(height_ - 1, row + options_.rows);
    const Eigen::Index last_column = std::min(width_ - 1, column + options_.columns);
    const auto max_distance = static_cast<float>(options_.radius * options_.radius);
    for (Eigen::Index r = std::max<Eigen::Index>(0, row - options_.rows); r <= last_row; ++r) {
      for (Eigen::Index c = std::max<Eigen::Index>(0, column - options_.columns); c <= last_column; ++c) {
        const auto point = points_.col(r * width_ + c);
        if ((point - points_.col(i)).squaredNorm() <= max_distance) neighbors.emplace_back(point);  // not NaN
      }
    }
  }

 private:
  const Eigen::Matrix3Xf& points_;
  const Eigen::Index width_, height_;
  const CloudIncidenceOptions& options_;
};

template <class Neighbors>
void estimate(const Eigen::Matrix3Xf& points, const Eigen::Matrix3Xf& viewpoints, double max_error,
              Neighbors&& find, Eigen::ArrayXf& incidence) {
  std::vector<Eigen::Vector3f> neighbors;
  for (Eigen::Index i = 0; i < points.cols(); ++i) {
    if (!isUsable(points.col(i))) continue;
    neighbors.clear();
    find(i, neighbors);
    const Eigen::Vector3d normal = normalOf(neighbors, max_error);
    const Eigen::Vector3f beam = points.col(i) - viewpoints.col(viewpoints.cols() == 1 ? 0 : i);
    const double length = beam.norm();
    if (normal.isZero() || !(length > 0.0)) continue;
    // Turned towards the sensor, so that alpha is never more than a right angle.
    const double cosine = std::abs(normal.dot(beam.cast<double>())) / length;
    incidence[i] = static_cast<float>(std::acos(std::min(1.0, cosine)));
  }
}

void checkViewpoints(const Eigen::Matrix3Xf& points, const Eigen::Matrix3Xf& viewpoints) {
  if (viewpoints.cols() == 1 || viewpoints.cols() == points.cols()) return;
  throw std::invalid_argument(std::to_string(viewpoints.cols()) + " viewpoints for " +
                              std::to_string(points.cols()) + " points, expected one or as many");
}

}  // namespace

Eigen::ArrayXf cloudRanges(const Eigen::Matrix3Xf& points, const Eigen::Matrix3Xf& viewpoints) {
  checkViewpoints(points, viewpoints);
  if (viewpoints.cols() == points.cols()) return (points - viewpoints).colwise().norm();
  return (points.colwise() - viewpoints.col(0)).colwise().norm();
}

Eigen::ArrayXf cloudIncidence(const Eigen::Matrix3Xf& points, const Eigen::Matrix3Xf& viewpoints,
                              const CloudIncidenceOptions& options, Eigen::Index width) {
  mapping_common::validate(options);
  checkViewpoints(points, viewpoints);
  if (width < 0 || (width > 0 && points.cols() % width != 0)) {
    throw std::invalid_argument(std::to_string(points.cols()) + " points, no whole rows of " +
                                std::to_string(width));
  }
  Eigen::ArrayXf incidence = Eigen::ArrayXf::Constant(points.cols(), kNan);
  if (width > 0 && width < points.cols() && options.rows > 0) {
    estimate(points, viewpoints, options.max_error, Window(points, width, options), incidence);
  } else if (points.cols() > 0) {
    estimate(points, viewpoints, options.max_error, Search(points, options), incidence);
  }
  return incidence;
}

}  // namespace laser_intensity_calib
