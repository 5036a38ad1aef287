// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <algorithm>
#include <cmath>
#include <limits>
#include <vector>

#include "intensity_hector_slam/beams.h"
#include "intensity_hector_slam/grid_map.h"

namespace intensity_hector_slam {

/// The best of all poses around a guess on a grid as fine as the cells, with the nearest cells instead of
/// interpolation.
/// @param options what starts with search_
/// @param square called with the cell that a beam ends in and the beam's index: its squared residuals,
/// weighted
template <class Square>
Pose searchWindow(const GridMap& map, const Beams& beams, const Pose& guess, const MatcherOptions& options,
                  const Square& square) {
  constexpr int kMaxTurns = 1000;  // to each side: with points very far away a cell is a tiny angle
  const double cells = 1.0 / map.resolution();
  const std::size_t stride = (beams.count + options.search_points - 1) / options.search_points;
  const double angle_step = std::max(map.resolution() / beams.mean_range, options.search_angle / kMaxTurns);
  const int steps = static_cast<int>(options.search_distance * cells);
  const int turns = static_cast<int>(options.search_angle / angle_step);

  std::vector<Eigen::Vector2i> ends(beams.count);
  const double used = (beams.count + stride - 1) / stride;
  // What speaks for the guess: see search_prior.
  const auto priorAt = [&](int dx, int dy, int turn) {
    const double distance = std::hypot(dx, dy) / std::max(1, steps), angle = 1.0 * turn / std::max(1, turns);
    return static_cast<float>(options.search_prior * used * (distance * distance + angle * angle));
  };
  const auto costAt = [&](int dx, int dy, float prior, float limit) {
    float sum = prior;
    for (std::size_t i = 0; i < beams.count && sum < limit; i += stride) {
      sum += square(map.cell(ends[i].x() + dx, ends[i].y() + dy), i);
    }
    return sum;
  };
  const auto turnTo = [&](double angle) {
    const Eigen::Isometry2d to_map = isometry({guess.x(), guess.y(), angle});
    for (std::size_t i = 0; i < beams.count; i += stride) {
      ends[i] = map.cellAt(to_map * Eigen::Vector2d(beams.x[i], beams.y[i]));
    }
  };
  turnTo(guess.z());
  Pose best = guess;
  float least = costAt(0, 0, 0.0f, std::numeric_limits<float>::infinity());
  for (int t = -turns; t <= turns; ++t) {
    turnTo(guess.z() + t * angle_step);
    for (int y = -steps; y <= steps; ++y) {
      for (int x = -steps; x <= steps; ++x) {
        const float here = costAt(x, y, priorAt(x, y, t), least);
        if (!(here < least)) continue;
        least = here;
        best = guess + Pose(x / cells, y / cells, t * angle_step);
      }
    }
  }
  return best;
}

}  // namespace intensity_hector_slam
