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

/// Where kLanes beams end.
struct BeamEnds {
  Eigen::Map<const Eigen::Array4f> reflectivity;  ///< rho_i, 0 where it isn't known
  Eigen::Map<const Eigen::Array4f> known;         ///< 1 where it is, else 0
  Eigen::Map<const Eigen::Array4f> valid;         ///< 1; 0 for what fills up the last of several
};

/// A residual, its derivatives by the place of the beam's end (cells), negative, and the share of the beam
/// that counts.
struct Residual {
  Eigen::Array4f e, dx, dy, share;
};

/// What the map has where beams end. Cells without a hit have no reflectivity. As black ones they make steps
/// at the edges of each wall, which are those of the grid and higher than those between a door and the wall
/// beside it: along a wall that is oblique to the cells, they hold a pose where it is.
struct Layers {
  Bilinear<Eigen::Array4f> occupancy;     ///< M
  Bilinear<Eigen::Array4f> black;         ///< R, cells without a hit as 0
  Bilinear<Eigen::Array4f> coverage;      ///< K, the share of those that have a reflectivity
  Bilinear<Eigen::Array4f> reflectivity;  ///< R between those
};

/// Calls `use` for the beams from `begin` to `end`, kLanes at a time, with the index of the first, the layers
/// of the map where they end, and the derivatives of S_i by the angle, in cells.
/// @tparam kReflectivities whether the layers that are about them are wanted
template <bool kReflectivities, class Use>
void forBeams(const GridMap& map, const Beams& beams, const Pose& pose, std::size_t begin, std::size_t end,
              const Use& use) {
  using Eigen::Array4f;
  // Of kLanes cells, with the ones right of them: P, R, P and R of those right.
  const auto gather = [](const GridMap::Squares& squares, auto cells) {
    Eigen::Matrix4f values;
    for (int i = 0; i < kLanes; ++i) {
      values.col(i) = Eigen::Map<const Eigen::Vector4f>(&(squares[i].*cells)->occupancy);
    }
    values.transposeInPlace();
    return values;
  };
  // From the body's frame to coordinates in which cell (0, 0) has its centre at (0, 0): Eq. 3.7 in cells.
  const double cells = 1.0 / map.resolution();
  const float c = cells * std::cos(pose.z()), s = cells * std::sin(pose.z());
  const float u0 = cells * pose.x() - 0.5, v0 = cells * pose.y() - 0.5;
  static_assert(kLanes == std::tuple_size_v<GridMap::Squares>);
  GridMap::Seams seams;
  Layers layers;
  for (std::size_t first = begin; first < end; first += kLanes) {
    const Eigen::Map<const Array4f> x(&beams.x[first]), y(&beams.y[first]);
    const Array4f dx_dtheta = -s * x - c * y, dy_dtheta = c * x - s * y;
    const Array4f u = dy_dtheta + u0, v = v0 - dx_dtheta;
    Array4f fx, fy;
    const GridMap::Squares squares = map.squares(u, v, fx, fy, seams);
    const Eigen::Matrix4f low = gather(squares, &GridMap::Square::lower),
                          high = gather(squares, &GridMap::Square::upper);
    const auto interpolate = [&](int k) {
      return Bilinear<Array4f>(low.col(k), low.col(k + 2), high.col(k), high.col(k + 2), fx, fy);
    };
    layers.occupancy = interpolate(0);
    if constexpr (kReflectivities) {
      // 1, or 0 without a reflectivity; no select, which isn't vectorised.
      const auto has = [](const Eigen::Matrix4f& cells, int k) -> Array4f {
        return (cells.col(k).array().abs() * 1e30f).min(1.0f);
      };
      const Bilinear<Array4f>& sum = layers.black = interpolate(1);
      Bilinear<Array4f>&k = layers.coverage, &r = layers.reflectivity;
      k = Bilinear<Array4f>(has(low, 1), has(low, 3), has(high, 1), has(high, 3), fx, fy);
      const Array4f inverse = k.value.max(1e-3f).inverse();
      r.value = sum.value * inverse;
      r.dx = (sum.dx - r.value * k.dx) * inverse;
      r.dy = (sum.dy - r.value * k.dy) * inverse;
    }
    use(first, layers, dx_dtheta, dy_dtheta);
  }
}

/// Each of the Residuals is a class with
///   Residuals(const MatcherOptions&)
///   static constexpr Channel kChannel
///   static constexpr bool kReflectivities   whether it looks at any
///   float weight                            of its squares, where there are other residuals beside it
///   float scale                             of the robust kernel
///   Residual at(const BeamEnds&, const Layers&)
///   float square(const GridMap::Cell&, float reflectivity, float known): e^2 in the search of a window
/// Eq. 3.9 follows from these, and so do the search and the covariance.
template <class... Residuals>
class CostOf : public Cost {
 public:
  explicit CostOf(const MatcherOptions& options) : options_(options), residuals_(Residuals(options)...) {
    using First = std::tuple_element_t<0, std::tuple<Residuals...>>;
    if constexpr (sizeof...(Residuals) > 1 && First::kChannel == Channel::kOccupancy)
      if (std::get<0>(residuals_).weight > 0.0f) geometry_ = std::make_unique<CostOf<First>>(options);
  }

  const Cost& geometry() const override { return geometry_ ? *geometry_ : static_cast<const Cost&>(*this); }

  bool uses(Channel channel) const override {
    bool uses = false;
    forEach(
        [&](const auto& kind, std::size_t) { uses = uses || (kind.kChannel == channel && isUsed(kind)); });
    return uses;
  }

  Linearization linearize(const GridMap& map, const Beams& beams, const Pose& pose, std::size_t end,
                          std::size_t begin) const override {
    AllSums sums = noSums();
    forBeams<kReflectivities>(map, beams, pose, begin, end,
                              [&](std::size_t first, const Layers& layers, const auto& dx, const auto& dy) {
                                const BeamEnds ends = endsOf(beams, first);
                                forEach([&](const auto& kind, std::size_t k) {
                                  if (!isUsed(kind)) return;
                                  const Residual r = kind.at(ends, layers);
                                  sums[k].add(r.e, r.dx, r.dy, r.dx * dx + r.dy * dy, r.share);
                                });
                              });
    Linearization result;
    forEach([&](const auto& kind, std::size_t k) {
      sums[k].addTo(result.of(kind.kChannel), weightOf(kind), 1.0 / map.resolution());
    });
    return result;
  }

  Pose search(const GridMap& map, const Beams& beams, const Pose& guess) const override {
    return searchWindow(map, beams, guess, options_, [&](const GridMap::Cell& cell, std::size_t i) {
      float sum = 0.0f;
      forEach([&](const auto& kind, std::size_t) {
        if (isUsed(kind)) sum += kind.square(cell, beams.reflectivity[i], beams.known[i]);
      });
      return sum;
    });
  }

 protected:
  MatcherOptions options_;

 private:
  using AllSums = std::array<Sums, sizeof...(Residuals)>;
  static constexpr bool kReflectivities = (Residuals::kReflectivities || ...);

  template <class Kind>
  static float weightOf(const Kind& kind) {
    return sizeof...(Residuals) > 1 ? kind.weight : 1.0f;
  }
  template <class Kind>
  static bool isUsed(const Kind& kind) {
    return weightOf(kind) > 0.0f;
  }
  AllSums noSums() const {
    return std::apply(
        [&](const auto&... kind) { return AllSums{Sums(options_.robust_kernel, kind.scale)...}; },
        residuals_);
  }
  template <class Use>
  void forEach(const Use& use) const {
    std::size_t k = 0;
    std::apply([&](const auto&... kind) { (use(kind, k++), ...); }, residuals_);
  }
  static BeamEnds endsOf(const Beams& beams, std::size_t first) {
    const auto lanes = [first](const std::vector<float>& values) {
      return Eigen::Map<const Eigen::Array4f>(&values[first]);
    };
    return {lanes(beams.reflectivity), lanes(beams.known), lanes(beams.valid)};
  }

  std::tuple<Residuals...> residuals_;
  std::unique_ptr<Cost> geometry_;
};

}  // namespace intensity_hector_slam
