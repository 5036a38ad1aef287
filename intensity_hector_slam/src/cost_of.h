// SPDX-License-Identifier: BSD-3-Clause
//
// Costs that are weighted sums of robust costs of residuals, each of which compares what the map has where a
// beam ends with what the beam measured.
#pragma once

#include <array>
#include <cmath>
#include <tuple>
#include <vector>

#include "cost.h"
#include "interpolation.h"
#include "residuals.h"
#include "window_search.h"

namespace intensity_hector_slam {

/// Where a beam ends, or several: T is float, or Eigen::Array4f of kLanes beams.
template <class T>
struct BeamEnd {
  T map;           ///< M(S_i) or R(S_i), by the residual's channel
  T reflectivity;  ///< rho_i, 0 where it isn't known
  T known;         ///< 1 where it is, else 0
  T valid;         ///< 1; 0 for what fills up the last of several
};

/// Calls `use` for the first beams, kLanes at a time, with the index of the first, both channels of the map
/// where they end (M and R with their derivatives by place), and the derivatives of S_i by the angle, in
/// cells.
template <class Use>
void forBeams(const GridMap& map, const Beams& beams, const Pose& pose, std::size_t count, const Use& use) {
  using Eigen::Array4f;
  // Of kLanes cells, with the ones right of them: P, R, P and R of those right.
  const auto gather = [](const std::array<const GridMap::Cell*, kLanes>& cells) {
    Eigen::Matrix4f values;
    for (int i = 0; i < kLanes; ++i) {
      values.col(i) = Eigen::Map<const Eigen::Vector4f>(&cells[i]->occupancy);
    }
    values.transposeInPlace();
    return values;
  };
  // From the body's frame to coordinates in which cell (0, 0) has its centre at (0, 0): Eq. 3.7 in cells.
  const double cells = 1.0 / map.resolution();
  const float c = cells * std::cos(pose.z()), s = cells * std::sin(pose.z());
  const float u0 = cells * (pose.x() - map.origin().x()) - 0.5,
              v0 = cells * (pose.y() - map.origin().y()) - 0.5;
  const GridMap::Cell* const data = map.cells().data();
  static constexpr GridMap::Cell unknown[2];
  const int width = map.width();
  const unsigned columns = map.width() - 1, rows = map.height() - 1;  // that have another after them
  // Conversion to int cuts off: moved up by one, coordinates from -1 on are rounded down, so that the column
  // and row of what is just outside are -1, not 0. Those of what is far outside stay within the range of int.
  const Array4f max_u = Array4f::Constant(map.width() + 1.0f), max_v = Array4f::Constant(map.height() + 1.0f);
  for (std::size_t first = 0; first < count; first += kLanes) {
    const Eigen::Map<const Array4f> x(&beams.x[first]), y(&beams.y[first]);
    const Array4f dx_dtheta = -s * x - c * y, dy_dtheta = c * x - s * y;
    const Array4f u = dy_dtheta + u0, v = v0 - dx_dtheta;
    const Array4f u1 = (u + 1.0f).max(0.0f).min(max_u), v1 = (v + 1.0f).max(0.0f).min(max_v);
    const Eigen::Array4i column = u1.cast<int>() - 1, row = v1.cast<int>() - 1;
    std::array<const GridMap::Cell*, kLanes> lower, upper;
    for (int i = 0; i < kLanes; ++i) {
      const bool inside = static_cast<unsigned>(column[i]) < columns && static_cast<unsigned>(row[i]) < rows;
      lower[i] = inside ? data + static_cast<std::size_t>(row[i]) * width + column[i] : unknown;
      upper[i] = inside ? lower[i] + width : unknown;
    }
    const Array4f fx = u - column.cast<float>(), fy = v - row.cast<float>();
    const Eigen::Matrix4f low = gather(lower), high = gather(upper);
    const auto interpolate = [&](int k) {
      return Bilinear<Array4f>(low.col(k), low.col(k + 2), high.col(k), high.col(k + 2), fx, fy);
    };
    use(first, interpolate(0), interpolate(1), dx_dtheta, dy_dtheta);
  }
}

/// Each of the Residuals is a class with static members:
///   Channel kChannel;                       what of the map it looks at
///   double weight(const MatcherOptions&)    of its squares, where there are other residuals beside it
///   T residual(const BeamEnd<T>&)           e
///   T or float slope(const BeamEnd<T>&)     -de / dM or -de / dR
///   T counts(const BeamEnd<T>&)             1 for beams that count, else 0
/// Eq. 3.9 follows from these, and so do the search of a window and the covariance.
template <class... Residuals>
class CostOf : public Cost {
 public:
  explicit CostOf(const MatcherOptions& options)
      : options_(options),
        weights_{(sizeof...(Residuals) > 1 ? static_cast<float>(Residuals::weight(options)) : 1.0f)...} {}

  bool uses(Channel channel) const override {
    bool uses = false;
    forEach([&](auto residual, std::size_t k) {
      uses = uses || (residual.kChannel == channel && weights_[k] > 0.0f);
    });
    return uses;
  }

  Linearization linearize(const GridMap& map, const Beams& beams, const Pose& pose,
                          std::size_t count) const override {
    AllSums sums = noSums();
    forBeams(map, beams, pose, count,
             [&](std::size_t first, const auto& m, const auto& r, const auto& dx, const auto& dy) {
               forEach([&](auto residual, std::size_t k) {
                 if (!(weights_[k] > 0.0f)) return;
                 const auto& there = residual.kChannel == Channel::kOccupancy ? m : r;
                 const auto end = lanesOf(beams, first, there.value);
                 const auto slope = residual.slope(end);
                 const Eigen::Array4f by_x = slope * there.dx, by_y = slope * there.dy;
                 sums[k].add(residual.residual(end), by_x, by_y, by_x * dx + by_y * dy, residual.counts(end));
               });
             });
    Linearization result;
    const double cells = 1.0 / map.resolution();
    forEach([&](auto residual, std::size_t k) {
      sums[k].addTo(result, result.of(residual.kChannel), weights_[k], cells);
    });
    return result;
  }

  Eigen::Vector2d values(const GridMap& map, const Beams& beams, const Pose& pose) const override {
    AllSums sums = noSums();
    forBeams(map, beams, pose, beams.count,
             [&](std::size_t first, const auto& m, const auto& r, const auto&, const auto&) {
               forEach([&](auto residual, std::size_t k) {
                 if (!(weights_[k] > 0.0f)) return;
                 const auto& there = residual.kChannel == Channel::kOccupancy ? m : r;
                 const auto end = lanesOf(beams, first, there.value);
                 sums[k].add(residual.residual(end), residual.counts(end));
               });
             });
    Eigen::Vector2d values = Eigen::Vector2d::Zero();
    forEach([&](auto residual, std::size_t k) {
      values[static_cast<int>(residual.kChannel)] += weights_[k] * sums[k].cost();
    });
    return values;
  }

  Pose search(const GridMap& map, const Beams& beams, const Pose& guess) const override {
    return searchWindow(map, beams, guess, options_, [&](const GridMap::Cell& cell, std::size_t i) {
      float sum = 0.0f;
      forEach([&](auto residual, std::size_t k) {
        const float there = residual.kChannel == Channel::kOccupancy ? cell.occupancy : cell.reflectivity;
        const BeamEnd<float> end{there, beams.reflectivity[i], beams.known[i], beams.valid[i]};
        const float e = residual.residual(end);
        sum += weights_[k] * residual.counts(end) * e * e;
      });
      return sum;
    });
  }

 protected:
  MatcherOptions options_;

 private:
  using AllSums = std::array<Sums, sizeof...(Residuals)>;

  AllSums noSums() const {
    return {(static_cast<void>(sizeof(Residuals)),
             Sums(options_.robust_kernel, static_cast<float>(options_.robust_scale)))...};
  }
  template <class Use>
  static void forEach(const Use& use) {
    std::size_t k = 0;
    (use(Residuals(), k++), ...);
  }
  static BeamEnd<Eigen::Array4f> lanesOf(const Beams& beams, std::size_t first, const Eigen::Array4f& map) {
    const auto lanes = [first](const std::vector<float>& values) {
      return Eigen::Map<const Eigen::Array4f>(&values[first]);
    };
    return {map, lanes(beams.reflectivity), lanes(beams.known), lanes(beams.valid)};
  }

  std::array<float, sizeof...(Residuals)> weights_;
};

}  // namespace intensity_hector_slam
