// SPDX-License-Identifier: BSD-3-Clause
//
// Walls in a plane, each with a reflectivity along its length, and a scanner that looks at them.
#pragma once

#include <cmath>
#include <functional>
#include <limits>
#include <random>
#include <vector>

#include "intensity_hector_slam/pose.h"
#include "intensity_hector_slam/scan.h"

namespace intensity_hector_slam {

struct Wall {
  Eigen::Vector2d from, to;
  std::function<double(double)> reflectivity = [](double) {
    return 0.7;
  };  ///< by the distance from `from`, m
};

struct Scanner {
  int beams = 1081;
  double angle_min = -0.75 * M_PI, angle_max = 0.75 * M_PI;
  double max_range = 30.0;
  double range_noise = 0.0, reflectivity_noise = 0.0;  ///< standard deviations
};

inline Wall stripes(const Eigen::Vector2d& from, const Eigen::Vector2d& to, unsigned seed,
                    double width = 0.5) {
  return {from, to, [seed, width](double at) {
            std::minstd_rand random(seed + 7919u * static_cast<unsigned>(at / width));
            random.discard(10);
            return 0.1 + 0.8 * (random() % 1000) / 1000.0;
          }};
}

/// A closed box of walls, with stripes or plain.
inline std::vector<Wall> box(const Eigen::Vector2d& min, const Eigen::Vector2d& max, bool striped = true) {
  const Eigen::Vector2d a = min, b(max.x(), min.y()), c = max, d(min.x(), max.y());
  if (!striped) return {{a, b}, {b, c}, {c, d}, {d, a}};
  return {stripes(a, b, 1), stripes(b, c, 2), stripes(c, d, 3), stripes(d, a, 4)};
}

/// A room of 8.5 m x 5.5 m (as in Fig. 3.6) with a cupboard and a column.
inline std::vector<Wall> furnishedRoom() {
  std::vector<Wall> walls = box({-4.25, -2.75}, {4.25, 2.75});
  for (const auto& [min, max] : {std::pair(Eigen::Vector2d(-4.25, 1.5), Eigen::Vector2d(-3.0, 2.75)),
                                 std::pair(Eigen::Vector2d(2.0, -1.0), Eigen::Vector2d(2.4, -0.6))}) {
    for (Wall& wall : box(min, max)) walls.push_back(wall);
  }
  return walls;
}

/// A scanner in the origin of the body.
inline Scan look(const std::vector<Wall>& walls, const Pose& pose, const Scanner& scanner,
                 unsigned seed = 1) {
  std::mt19937 random(seed);
  std::normal_distribution<double> normal;
  Scan scan;
  for (int i = 0; i < scanner.beams; ++i) {
    const double angle =
        scanner.angle_min + (scanner.angle_max - scanner.angle_min) * i / std::max(1, scanner.beams - 1);
    const Eigen::Vector2d direction(std::cos(pose.z() + angle), std::sin(pose.z() + angle));
    double range = scanner.max_range, reflectivity = -1.0;
    for (const Wall& wall : walls) {
      Eigen::Matrix2d a;
      a << direction, wall.from - wall.to;
      if (std::abs(a.determinant()) < 1e-12) continue;
      const Eigen::Vector2d solution = a.inverse() * (wall.from - pose.head<2>());
      if (solution.x() < 1e-6 || solution.x() >= range || solution.y() < 0.0 || solution.y() > 1.0) continue;
      range = solution.x();
      reflectivity = wall.reflectivity(solution.y() * (wall.to - wall.from).norm());
    }
    const double range_error = scanner.range_noise * normal(random);
    const double reflectivity_error = scanner.reflectivity_noise * normal(random);
    if (reflectivity < 0.0) continue;
    range += range_error;
    scan.points.push_back((range * Eigen::Vector2d(std::cos(angle), std::sin(angle))).cast<float>());
    scan.reflectivities.push_back(static_cast<float>(reflectivity + reflectivity_error));
  }
  return scan;
}

}  // namespace intensity_hector_slam
