// SPDX-License-Identifier: BSD-3-Clause
#include "intensity_hector_slam/scan.h"

namespace intensity_hector_slam {

Scan seenAt(double time, const Scan& scan, const Pose& velocity_in_body) {
  Scan result = scan;
  if (scan.times.empty() || velocity_in_body.isZero()) return result;
  // All points at once, each with the motion from that time to its own.
  const Eigen::Vector3f velocity = velocity_in_body.cast<float>();
  const auto move = [&](const std::vector<float>& times, std::vector<Eigen::Vector2f>& points) {
    if (points.empty()) return;
    const Eigen::Index n = points.size();
    const Eigen::ArrayXf elapsed =
        Eigen::Map<const Eigen::ArrayXf>(times.data(), n) - static_cast<float>(time);
    const Eigen::ArrayXf angle = velocity.z() * elapsed;
    Eigen::ArrayXf c, s;
    if ((angle.abs() < 0.5f).all()) {  // Taylor's series, exact to less than 1e-8 there
      const Eigen::ArrayXf a = angle.square();
      c = 1.0f - a / 2.0f * (1.0f - a / 12.0f * (1.0f - a / 30.0f * (1.0f - a / 56.0f)));
      s = angle * (1.0f - a / 6.0f * (1.0f - a / 20.0f * (1.0f - a / 42.0f)));
    } else {
      c = angle.cos();
      s = angle.sin();
    }
    Eigen::Map<Eigen::Array2Xf> at(points.front().data(), 2, n);
    const Eigen::ArrayXf x = at.row(0), y = at.row(1);
    at.row(0) = (c * x - s * y + velocity.x() * elapsed).transpose();
    at.row(1) = (s * x + c * y + velocity.y() * elapsed).transpose();
  };
  move(scan.times, result.points);
  move(scan.free_times, result.free);
  return result;
}

}  // namespace intensity_hector_slam
