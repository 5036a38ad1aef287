// SPDX-License-Identifier: BSD-3-Clause
//
// What the map must be equal to: a plain grid of voxels that gets the same updates, written down as directly
// as possible and without a line of the library.
#pragma once

#include <gtest/gtest.h>

#include <cmath>
#include <cstdlib>
#include <map>
#include <random>
#include <set>
#include <vector>

#include "rtree_occupancy_map/occupancy_map.h"

namespace rtree_occupancy_map {

/// Added to the tests' seeds: the environment variable TEST_SEED, for long runs; 0 without.
inline unsigned testSeed() {
  const char* text = std::getenv("TEST_SEED");
  return text != nullptr ? static_cast<unsigned>(std::strtoul(text, nullptr, 10)) : 0;
}

class PlainGrid {
 public:
  explicit PlainGrid(const Options& options) : o_(options) {}

  void insert(const Scan& scan) {
    std::set<Voxel> occupied, free;
    const Voxel origin = voxelOf(scan.origin);
    for (const Eigen::Vector3f& p : scan.hits) {
      if (!p.allFinite() || (p - scan.origin).norm() < o_.min_range) continue;
      const Voxel v = voxelOf(p);
      const Eigen::Vector3f center = centerOf(v);
      if ((center - scan.origin).norm() > static_cast<float>(o_.max_range)) {
        trace(scan.origin, origin, cut(scan.origin, center), free);
        continue;
      }
      if (occupied.insert(v).second) trace(scan.origin, origin, center, free);
    }
    for (const Eigen::Vector3f& p : scan.misses) trace(scan.origin, origin, cut(scan.origin, p), free);
    if (o_.sensor_model == SensorModel::kEndPoint) free.clear();
    for (const Voxel& v : occupied) free.erase(v);
    for (const Voxel& v : occupied) add(v, o_.prob_hit);
    for (const Voxel& v : free) add(v, o_.prob_miss);
  }

  const std::map<Voxel, float>& voxels() const { return voxels_; }

  Voxel voxelOf(const Eigen::Vector3f& p) const {
    Voxel v;
    for (int i = 0; i < 3; ++i) v[i] = static_cast<int>(std::floor(p[i] * (1.0 / o_.resolution)));
    return v;
  }

 private:
  static float logOdds(double p) { return static_cast<float>(std::log(p / (1.0 - p))); }
  Eigen::Vector3f centerOf(const Voxel& v) const {
    return (Eigen::Vector3d(v[0] + 0.5, v[1] + 0.5, v[2] + 0.5) * o_.resolution).cast<float>();
  }
  Eigen::Vector3f cut(const Eigen::Vector3f& from, const Eigen::Vector3f& to) const {
    const auto range = static_cast<float>(o_.max_range);
    return (to - from).norm() > range ? Eigen::Vector3f(from + (to - from).normalized() * range) : to;
  }

  // Eq. 2.7, clamped.
  void add(const Voxel& v, double probability) {
    float& l = voxels_.emplace(v, logOdds(o_.prior)).first->second;
    l = std::min(std::max(l + (logOdds(probability) - logOdds(o_.prior)), logOdds(o_.clamping_min)),
                 logOdds(o_.clamping_max));
  }

  // Textbook Amanatides and Woo.
  void trace(const Eigen::Vector3f& from, const Voxel& from_voxel, const Eigen::Vector3f& to,
             std::set<Voxel>& crossed) const {
    const Voxel end = voxelOf(to);
    Eigen::Vector3f direction = to - from;
    const float length = static_cast<float>(std::sqrt(static_cast<double>(
        direction[0] * direction[0] + direction[1] * direction[1] + direction[2] * direction[2])));
    direction /= length;
    Voxel v = from_voxel;
    double next[3];
    for (int i = 0; i < 3; ++i) {
      const int step = direction[i] > 0 ? 1 : -1;
      const double border = (v[i] + 0.5) * o_.resolution + static_cast<float>(step * o_.resolution * 0.5);
      next[i] = direction[i] == 0 ? 1e300 : (border - from[i]) / direction[i];
    }
    while (v != end) {
      crossed.insert(v);
      const int i = next[0] < next[1] ? (next[0] < next[2] ? 0 : 2) : (next[1] < next[2] ? 1 : 2);
      if (next[i] > length * 1.0001F + o_.resolution) break;
      v[i] += direction[i] > 0 ? 1 : -1;
      next[i] += o_.resolution / std::abs(static_cast<double>(direction[i]));
    }
  }

  Options o_;
  std::map<Voxel, float> voxels_;
};

/// Scans of a world in which nothing is flat on purpose: random points near some centres, and an obstacle
/// that moves.
class RandomScans {
 public:
  explicit RandomScans(unsigned seed) : random_(seed + 1000 * testSeed()) {}

  Scan next(int points) {
    std::normal_distribution<float> normal(0.0F, 1.0F);
    std::uniform_real_distribution<float> uniform(-1.0F, 1.0F);
    Scan scan;
    ++time_;
    const float drift = 0.05F * static_cast<float>(time_);
    scan.origin =
        Eigen::Vector3f(drift + 0.3F * normal(random_), 0.3F * normal(random_), 0.5F * uniform(random_));
    for (int i = 0; i < points; ++i) {
      Eigen::Vector3f p(5.0F * uniform(random_), 5.0F * uniform(random_), 2.0F * uniform(random_));
      switch (i % 4) {
        case 0:
          p.x() = 5.03F;  // walls
          break;
        case 1:
          p.y() = -4.51F;
          break;
        case 2:
          p = Eigen::Vector3f(-3.0F + 2.0F * drift, 2.0F, 0.3F) +
              0.2F * Eigen::Vector3f(normal(random_), normal(random_), normal(random_));
          break;
        default:  // clutter
          break;
      }
      scan.hits.push_back(p);
    }
    for (int i = 0; i < points / 20; ++i) {
      scan.misses.emplace_back(6.0F * uniform(random_), 6.0F * uniform(random_), 3.0F * uniform(random_));
    }
    return scan;
  }

 private:
  std::mt19937 random_;
  int time_ = 0;
};

/// Every voxel of every cell; a voxel in two cells is a failure.
inline std::map<Voxel, float> voxelsOf(const OccupancyMap& map, bool* disjoint) {
  std::map<Voxel, float> voxels;
  *disjoint = true;
  map.tree().visitAll([&](const Cell& c) {
    for (int x = c.box.min[0]; x < c.box.max[0]; ++x) {
      for (int y = c.box.min[1]; y < c.box.max[1]; ++y) {
        for (int z = c.box.min[2]; z < c.box.max[2]; ++z)
          *disjoint &= voxels.emplace(Voxel{x, y, z}, c.log_odds).second;
      }
    }
    return true;
  });
  return voxels;
}
/// The same of a map whose cells have to be disjoint.
inline std::map<Voxel, float> known(const OccupancyMap& map) {
  bool disjoint = false;
  const auto voxels = voxelsOf(map, &disjoint);
  EXPECT_TRUE(disjoint);
  return voxels;
}

inline Cell cellOf(const VoxelBox& box, float log_odds) {
  Cell cell;
  cell.box = box;
  cell.log_odds = log_odds;
  return cell;
}

}  // namespace rtree_occupancy_map
