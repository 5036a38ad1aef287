// SPDX-License-Identifier: BSD-3-Clause
//
// Residuals of some beams at a time, their robust weights and what they add to the normal equation.
#pragma once

#include <Eigen/Core>

#include "intensity_hector_slam/scan_matcher.h"

namespace intensity_hector_slam {

// Sums over beams of one kind of residual.
class Sums {
 public:
  Sums(RobustKernel kernel, float scale)
      : kernel_(kernel), scale_(scale), inverse_square_(1.0f / (scale * scale)) {}

  // e: residual; dx, dy, dt: J, the derivatives of -e by the pose, in cells and radians; share: 0 to 1, of
  // each beam that counts
  void add(const Eigen::Array4f& e, const Eigen::Array4f& dx, const Eigen::Array4f& dy,
           const Eigen::Array4f& dt, const Eigen::Array4f& share) {
    const Eigen::Array4f square = share * e.square(), w = share * weigh(square);
    const Eigen::Array4f wx = w * dx, wy = w * dy, wt = w * dt;
    xx_ += wx * dx;
    xy_ += wx * dy;
    xt_ += wx * dt;
    yy_ += wy * dy;
    yt_ += wy * dt;
    tt_ += wt * dt;
    xe_ += wx * e;
    ye_ += wy * e;
    te_ += wt * e;
    squares_ += w * e.square();
    weights_ += w;
    beams_ += share;
  }

  double cost() const { return (cost_ + scale_ * scale_ * product_.log()).sum(); }
  double beams() const { return beams_.sum(); }

  // From cells to metres: derivatives by the angle are per radian already.
  void addTo(NormalEquation& equation, double weight, double cells_per_metre) const {
    equation.squares += squares_.sum();
    equation.weights += weights_.sum();
    equation.beams += beams();
    equation.cost += weight * cost();
    const double m = weight * cells_per_metre, mm = m * cells_per_metre;
    Eigen::Matrix3d hessian;
    hessian << mm * xx_.sum(), mm * xy_.sum(), m * xt_.sum(),  //
        mm * xy_.sum(), mm * yy_.sum(), m * yt_.sum(),         //
        m * xt_.sum(), m * yt_.sum(), weight * tt_.sum();
    equation.hessian += hessian;
    equation.gradient += Eigen::Vector3d(m * xe_.sum(), m * ye_.sum(), weight * te_.sum());
  }

 private:
  // The weights of squared residuals, whose robust costs are added up.
  Eigen::Array4f weigh(const Eigen::Array4f& square) {
    const Eigen::Array4f relative = square * inverse_square_;
    switch (kernel_) {
      case RobustKernel::kHuber: {
        const Eigen::Array4f weight = scale_ / square.sqrt().max(scale_);
        cost_ += square * weight * (2.0f - weight);
        return weight;
      }
      case RobustKernel::kCauchy: {
        // s^2 log(1 + (e / s)^2); the logarithm of a product is quicker than one for each residual.
        const Eigen::Array4f factor = 1.0f + relative.min(1e4f);
        product_ *= factor;
        if (++factors_ % 8 == 0) {  // before it overflows
          cost_ += scale_ * scale_ * product_.log();
          product_.setOnes();
        }
        return factor.inverse();
      }
      case RobustKernel::kTukey: {
        const Eigen::Array4f inside = (1.0f - relative).max(0.0f);
        cost_ += scale_ * scale_ / 3.0f * (1.0f - inside.cube());
        return inside.square();
      }
      case RobustKernel::kNone:
        break;
    }
    cost_ += square;
    return Eigen::Array4f::Ones();
  }

  RobustKernel kernel_;
  float scale_, inverse_square_;
  Eigen::Array4f xx_ = Eigen::Array4f::Zero(), xy_ = xx_, xt_ = xx_, yy_ = xx_, yt_ = xx_, tt_ = xx_,
                 xe_ = xx_, ye_ = xx_, te_ = xx_;
  Eigen::Array4f squares_ = xx_, weights_ = xx_, beams_ = xx_, cost_ = xx_, product_ = Eigen::Array4f::Ones();
  int factors_ = 0;
};

}  // namespace intensity_hector_slam
