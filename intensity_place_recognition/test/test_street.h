// SPDX-License-Identifier: BSD-3-Clause
//
// Streets of houses for tests, as a lidar with 32 rings sees them: walls of random depth and lightness on
// both sides, poles, and ground with light marks. All are mottled, as surfaces are.
#pragma once

#include <cmath>
#include <cstdint>
#include <random>
#include <vector>

#include "intensity_place_recognition/panorama.h"

namespace intensity_place_recognition {

class Street {
 public:
  explicit Street(unsigned seed) {
    std::mt19937 random(seed);
    std::uniform_real_distribution<double> uniform;
    for (const double side : {-1.0, 1.0}) {
      for (double x = -70.0; x < 70.0;) {
        const double width = 4.0 + 9.0 * uniform(random), depth = 7.0 + 6.0 * uniform(random);
        if (uniform(random) < 0.85)
          boxes_.push_back({{x, side > 0 ? depth : -depth - 12.0, -1.8},
                            {x + width, side > 0 ? depth + 12.0 : -depth, 2.0 + 6.0 * uniform(random)},
                            uniform(random)});
        x += width + (uniform(random) < 0.3 ? 3.0 : 0.0);
      }
      for (double x = -60.0; x < 60.0; x += 6.0 + 12.0 * uniform(random))
        boxes_.push_back({{x, side * 5.0, -1.8}, {x + 0.3, side * 5.0 + 0.3, 3.0}, uniform(random)});
    }
  }

  /// @param pose of the sensor in the street, 1.8 m above its ground at z = 0
  Cloud scan(const Eigen::Isometry3d& pose, double noise = 0.01) const {
    std::mt19937 random(3);
    std::normal_distribution<double> normal(0.0, noise);
    Cloud cloud;
    for (int ring = 0; ring < 32; ++ring) {
      const double elevation = (-24.0 + 38.0 * ring / 31.0) * M_PI / 180.0;
      for (int step = 0; step < 900; ++step) {
        const double azimuth = step * 2.0 * M_PI / 900.0;
        const Eigen::Vector3d direction(std::cos(elevation) * std::cos(azimuth),
                                        std::cos(elevation) * std::sin(azimuth), std::sin(elevation));
        float intensity = 0.0f;
        const double range = hit(pose.translation(), pose.linear() * direction, intensity);
        if (range > 100.0) continue;
        pcl::PointXYZI point;
        point.getVector3fMap() = ((range + normal(random)) * direction).cast<float>();
        point.intensity = intensity + static_cast<float>(normal(random));
        cloud.push_back(point);
      }
    }
    return cloud;
  }

  static Eigen::Isometry3d at(double x, double y, double yaw) {
    Eigen::Isometry3d pose(Eigen::AngleAxisd(yaw, Eigen::Vector3d::UnitZ()));
    pose.translation() << x, y, 0.0;
    return pose;
  }

 private:
  struct Box {
    Eigen::Vector3d low, high;
    double light;
  };
  // 0 to 1, another one in each cube of 1.5 m.
  static float mottle(const Eigen::Vector3d& at, unsigned seed) {
    std::uint32_t hash = seed;
    for (int i = 0; i < 3; ++i) {
      hash ^= static_cast<std::uint32_t>(static_cast<std::int32_t>(std::floor(at[i] / 1.5 + 0.01)));
      hash *= 2654435761u;
      hash ^= hash >> 15;
    }
    return static_cast<float>(hash >> 8) / 16777216.0f;
  }
  double hit(const Eigen::Vector3d& origin, const Eigen::Vector3d& ray, float& intensity) const {
    double nearest = 1e9;
    if (ray.z() < 0.0) {
      nearest = (-1.8 - origin.z()) / ray.z();
      const Eigen::Vector3d at = origin + nearest * ray;
      intensity = std::fmod(std::abs(at.x()), 4.0) < 2.0 && std::abs(at.y()) < 0.2
                      ? 0.9f
                      : 0.2f + 0.15f * mottle(at, 0);
    }
    for (const Box& box : boxes_) {
      double enter = 0.0, leave = nearest;
      for (int i = 0; i < 3 && enter < leave; ++i) {
        const double a = (box.low[i] - origin[i]) / ray[i], b = (box.high[i] - origin[i]) / ray[i];
        enter = std::max(enter, std::min(a, b));
        leave = std::min(leave, std::max(a, b));
      }
      if (enter <= 0.0 || enter >= leave) continue;
      nearest = enter;
      intensity = static_cast<float>(0.1 + 0.6 * box.light) +
                  0.2f * mottle(origin + enter * ray, static_cast<unsigned>(1e6 * box.light));
    }
    return nearest;
  }
  std::vector<Box> boxes_;
};

}  // namespace intensity_place_recognition
