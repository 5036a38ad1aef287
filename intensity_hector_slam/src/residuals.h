// SPDX-License-Identifier: BSD-3-Clause
//
// Residuals of some beams at a time, their robust weights and what they add to the normal equation.
#pragma once

#include <Eigen/Core>

#include "intensity_hector_slam/scan_matcher.h"

namespace intensity_hector_slam {

constexpr int kLanes = 4;  ///< beams at a time

struct Robust {
  Eigen::Array4f weight, cost;
};

inline Robust robust(RobustKernel kernel, float scale, const Eigen::Array4f& e) {
  const Eigen::Array4f square = e.square(), relative = square / (scale * scale);
  switch (kernel) {
    case RobustKernel::kHuber: {
      const Eigen::Array4f weight = (scale / e.abs().max(scale)).eval();
      return {weight, square * weight * (2.0f - weight)};
    }
    case RobustKernel::kCauchy:
      return {1.0f / (1.0f + relative), scale * scale * (1.0f + relative).log()};
    case RobustKernel::kTukey: {
      const Eigen::Array4f inside = (1.0f - relative).max(0.0f);
      return {inside.square(), scale * scale / 3.0f * (1.0f - inside.cube())};
    }
    case RobustKernel::kNone:
      break;
  }
  return {Eigen::Array4f::Ones(), square};
}

// Sums over beams of one kind of residual.
struct Sums {
  Eigen::Array4f xx = Eigen::Array4f::Zero(), xy = xx, xt = xx, yy = xx, yt = xx, tt = xx, xe = xx, ye = xx,
                 te = xx;
  Eigen::Array4f cost = xx, squares = xx, weights = xx;

  // From cells to metres: derivatives by the angle are per radian already.
  ScanMatcher::NormalEquation equation(double cells_per_metre) const {
    const double m = cells_per_metre, mm = m * m;
    ScanMatcher::NormalEquation equation;
    equation.hessian << mm * xx.sum(), mm * xy.sum(), m * xt.sum(),  //
        mm * xy.sum(), mm * yy.sum(), m * yt.sum(),                  //
        m * xt.sum(), m * yt.sum(), tt.sum();
    equation.gradient << m * xe.sum(), m * ye.sum(), te.sum();
    equation.cost = cost.sum();
    return equation;
  }

  // e: residual; dx, dy, dt: derivatives of the map's value by the pose
  void add(const Eigen::Array4f& e, const Eigen::Array4f& dx, const Eigen::Array4f& dy,
           const Eigen::Array4f& dt, const Eigen::Array4f& factor, const Robust& robust) {
    const Eigen::Array4f w = factor * robust.weight;
    const Eigen::Array4f wx = w * dx, wy = w * dy, wt = w * dt;
    xx += wx * dx;
    xy += wx * dy;
    xt += wx * dt;
    yy += wy * dy;
    yt += wy * dt;
    tt += wt * dt;
    xe += wx * e;
    ye += wy * e;
    te += wt * e;
    cost += factor * robust.cost;
    squares += w * e.square();
    weights += w;
  }
};

}  // namespace intensity_hector_slam
