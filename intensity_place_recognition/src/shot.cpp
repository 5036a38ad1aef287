// SPDX-License-Identifier: BSD-3-Clause
//
// Bags of words over SHOT of the cloud, and over SHOT with intensities as colours (4.5.2, 4.6.2): the cloud
// is thinned by a grid of psi, and described within 5 psi around key points, which are evenly spread.
#include <pcl/features/normal_3d.h>
#include <pcl/features/shot.h>
#include <pcl/search/kdtree.h>

#include <algorithm>
#include <cmath>
#include <numeric>
#include <tuple>

#include "intensity_place_recognition/local_description.h"
#include "intensity_place_recognition/vector_vocabulary.h"

namespace intensity_place_recognition {
namespace {

using Point = pcl::PointXYZRGBA;
using Points = pcl::PointCloud<Point>;
using Normals = pcl::PointCloud<pcl::Normal>;

constexpr double kSupport = 5.0;  // psi

// The mean of the points of each cube; the colour is the rank of its intensity.
Points::Ptr thinned(const Scene& scene, double psi, double radius) {
  struct Cell {
    std::uint64_t cube;
    const pcl::PointXYZI* point;
  };
  std::vector<Cell> cells;
  const float side = static_cast<float>(psi), reach = static_cast<float>(radius);
  const auto coordinate = [&](float x) { return static_cast<std::uint64_t>((x + reach) / side); };
  for (const pcl::PointXYZI& p : scene.cloud) {
    const float range = p.getVector3fMap().norm();
    if (!(range >= scene.min_range && range < reach)) continue;
    cells.push_back({(coordinate(p.z) << 42) + (coordinate(p.y) << 21) + coordinate(p.x), &p});
  }
  std::stable_sort(cells.begin(), cells.end(), [](const Cell& a, const Cell& b) { return a.cube < b.cube; });
  Points::Ptr result(new Points);
  std::vector<float> intensities;
  for (std::size_t i = 0; i < cells.size();) {
    Eigen::Vector3f sum = Eigen::Vector3f::Zero();
    float intensity = 0.0f;
    const std::size_t first = i;
    for (; i < cells.size() && cells[i].cube == cells[first].cube; ++i) {
      sum += cells[i].point->getVector3fMap();
      intensity += cells[i].point->intensity;
    }
    const auto count = static_cast<float>(i - first);
    Point point;
    point.getVector3fMap() = sum / count;
    result->push_back(point);
    intensities.push_back(intensity / count);
  }
  std::vector<std::size_t> order(intensities.size());
  std::iota(order.begin(), order.end(), 0);
  std::sort(order.begin(), order.end(), [&](std::size_t a, std::size_t b) {
    return std::make_pair(intensities[a], a) < std::make_pair(intensities[b], b);
  });
  for (std::size_t i = 0; i < order.size(); ++i) {
    Point& p = (*result)[order[i]];
    p.r = p.g = p.b = static_cast<std::uint8_t>(256 * i / order.size());
    p.a = 255;
  }
  return result;
}

// One in each cube of half the support's radius, the nearest `most`.
Points::Ptr keyPoints(const Points& cloud, const Normals& normals, double radius, int most) {
  const float side = static_cast<float>(0.5 * radius);
  std::vector<std::pair<Eigen::Vector3i, int>> cubes;
  for (int i = 0; i < static_cast<int>(cloud.size()); ++i)
    if (normals[i].curvature > 0.0f)
      cubes.emplace_back((cloud[i].getVector3fMap() / side).array().floor().cast<int>(), i);
  std::sort(cubes.begin(), cubes.end(), [](const auto& a, const auto& b) {
    return std::tie(a.first.z(), a.first.y(), a.first.x(), a.second) <
           std::tie(b.first.z(), b.first.y(), b.first.x(), b.second);
  });
  std::vector<std::pair<float, int>> nearest;
  for (std::size_t i = 0; i < cubes.size(); ++i)
    if (i == 0 || cubes[i].first != cubes[i - 1].first)
      nearest.emplace_back(cloud[cubes[i].second].getVector3fMap().norm(), cubes[i].second);
  std::sort(nearest.begin(), nearest.end());
  Points::Ptr result(new Points);
  for (std::size_t i = 0; i < nearest.size() && i < static_cast<std::size_t>(most); ++i)
    result->push_back(cloud[nearest[i].second]);
  return result;
}

template <class Estimation, class Descriptor>
class Shot : public LocalDescription<VectorVocabulary> {
 public:
  explicit Shot(const DescriptionOptions& options)
      : LocalDescription(VectorVocabulary(options.delta)), options_(options) {}

 private:
  std::vector<Features> extract(const Scene& scene) const override {
    const double radius = kSupport * options_.psi;
    const Points::Ptr cloud = thinned(scene, options_.psi, options_.radius);
    if (cloud->empty()) return {{}};
    pcl::search::KdTree<Point>::Ptr tree(new pcl::search::KdTree<Point>);
    tree->setInputCloud(cloud);
    Normals::Ptr normals(new Normals);
    pcl::NormalEstimation<Point, pcl::Normal> normal;
    normal.setInputCloud(cloud);
    normal.setSearchMethod(tree);
    normal.setRadiusSearch(0.6 * radius);
    normal.compute(*normals);
    // SHOT takes normals that are numbers.
    for (pcl::Normal& n : *normals)
      if (!std::isfinite(n.normal_x)) n = pcl::Normal(0.0f, 0.0f, 1.0f);
    const Points::Ptr points = keyPoints(*cloud, *normals, radius, options_.features);
    if (points->empty()) return {{}};
    Estimation estimation;
    estimation.setInputCloud(points);
    estimation.setSearchSurface(cloud);
    estimation.setInputNormals(normals);
    estimation.setSearchMethod(tree);
    estimation.setRadiusSearch(radius);
    pcl::PointCloud<Descriptor> descriptors;
    estimation.compute(descriptors);
    std::vector<Features> all(1);
    for (std::size_t i = 0; i < descriptors.size(); ++i) {
      const auto& values = descriptors[i].descriptor;
      const VectorVocabulary::Word word = toWord(values, std::size(values));
      if (!word.empty()) all[0].push_back({word, std::atan2((*points)[i].y, (*points)[i].x)});
    }
    return all;
  }
  DescriptionOptions options_;
};

}  // namespace

std::unique_ptr<SceneDescription> makeShot(const DescriptionOptions& options) {
  return std::make_unique<Shot<pcl::SHOTEstimation<Point, pcl::Normal, pcl::SHOT352>, pcl::SHOT352>>(options);
}

std::unique_ptr<SceneDescription> makeShotColour(const DescriptionOptions& options) {
  return std::make_unique<Shot<pcl::SHOTColorEstimation<Point, pcl::Normal, pcl::SHOT1344>, pcl::SHOT1344>>(
      options);
}

}  // namespace intensity_place_recognition
