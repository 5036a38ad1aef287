// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstddef>
#include <memory>
#include <vector>

#include "transmitter.h"

namespace device_emulators {

/// What there is to be measured: beams counter-clockwise, REP 103 and REP 117.
struct Scan {
  double angle_min = 0.0, angle_increment = 0.0;  ///< rad
  /// [echo][beam], m; the first echo has all beams, further echoes NaN where there is none
  std::vector<std::vector<float>> ranges;
  std::vector<std::vector<float>> intensities;  ///< [echo][beam]; may be empty
};

class ScanSource {
 public:
  virtual ~ScanSource() = default;
  /// The scan at that time; null if there is none yet. Times mustn't go backwards.
  virtual std::shared_ptr<const Scan> at(Nanoseconds time) = 0;
};

/// The beam of a scan in that direction: the one measured there where increments agree, else the nearest.
/// @return -1 if the scan doesn't reach there
int beamAt(const Scan& scan, double angle);

/// What a scanner sees in a room of 8 m by 6 m in which a half-transparent pillar moves round it.
class RoomSource : public ScanSource {
 public:
  std::shared_ptr<const Scan> at(Nanoseconds time) override;
};

}  // namespace device_emulators
