// SPDX-License-Identifier: BSD-3-Clause
#include "scan_source.h"

#include <algorithm>
#include <cmath>
#include <limits>

namespace device_emulators {
namespace {

constexpr double kTurn = 2.0 * M_PI;
constexpr int kBeams = 1440;  // of the room, in a full turn

}  // namespace

int beamAt(const Scan& scan, double angle) {
  if (scan.ranges.empty() || scan.angle_increment == 0.0) return -1;
  const int beams = static_cast<int>(scan.ranges[0].size());
  for (const double turn : {0.0, kTurn, -kTurn}) {
    const long beam = std::lround((angle + turn - scan.angle_min) / scan.angle_increment);
    if (beam >= 0 && beam < beams) return static_cast<int>(beam);
  }
  return -1;
}

std::shared_ptr<const Scan> RoomSource::at(Nanoseconds time) {
  constexpr double kFront = 5.0, kBack = 3.0, kSide = 3.0;      // m to the walls
  constexpr double kPillarDistance = 2.0, kPillarRadius = 0.2;  // m
  constexpr double kPeriod = 20.0;                              // s of the pillar
  constexpr float kWallReflectivity = 2000.0f, kPillarReflectivity = 800.0f;

  auto scan = std::make_shared<Scan>();
  scan->angle_min = -M_PI;
  scan->angle_increment = kTurn / kBeams;
  scan->ranges.assign(2, std::vector<float>(kBeams, std::numeric_limits<float>::quiet_NaN()));
  scan->intensities.assign(2, std::vector<float>(kBeams, 0.0f));
  const double pillar = kTurn * std::fmod(static_cast<double>(time) / kSecond, kPeriod) / kPeriod;
  for (int i = 0; i < kBeams; ++i) {
    const double angle = scan->angle_min + i * scan->angle_increment;
    const double c = std::cos(angle), s = std::sin(angle);
    const double to_end = c > 0 ? kFront / c : c < 0 ? -kBack / c : std::numeric_limits<double>::infinity();
    const double to_side = s != 0.0 ? kSide / std::abs(s) : std::numeric_limits<double>::infinity();
    const double wall = std::min(to_end, to_side);
    const double incidence = to_end < to_side ? std::abs(c) : std::abs(s);
    int echo = 0;
    const double off_axis = kPillarDistance * std::sin(angle - pillar);
    if (std::cos(angle - pillar) > 0.0 && std::abs(off_axis) < kPillarRadius) {
      scan->ranges[0][i] = static_cast<float>(kPillarDistance * std::cos(angle - pillar) -
                                              std::sqrt(kPillarRadius * kPillarRadius - off_axis * off_axis));
      scan->intensities[0][i] = kPillarReflectivity;
      echo = 1;
    }
    scan->ranges[echo][i] = static_cast<float>(wall);
    scan->intensities[echo][i] = kWallReflectivity * static_cast<float>(incidence);
  }
  return scan;
}

}  // namespace device_emulators
