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
    const Eigen::ArrayXf c = (velocity.z() * elapsed).cos(), s = (velocity.z() * elapsed).sin();
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
