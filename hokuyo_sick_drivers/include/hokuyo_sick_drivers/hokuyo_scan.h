// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <mapping_common/options.h>

#include <cstdint>
#include <string>
#include <vector>

#include "hokuyo_sick_drivers/protocol.h"
#include "hokuyo_sick_drivers/scip.h"

namespace hokuyo_sick_drivers {

/// What to measure; may change at any time.
struct HokuyoSettings {
  double angle_min = -3.1416, angle_max = 3.1416;
  int cluster = 1, skip = 0;
  bool intensity = true, multi_echo = false;

  bool operator==(const HokuyoSettings& other) const { return mapping_common::same(*this, other); }

  void describe(mapping_common::OptionList& o) {
    o("angle_min", angle_min, "rad",
      "rays lie from here on, as far as the scanner sees; 0 is ahead, to the left is positive")
        .within(-3.1416, 3.1416)
        .dynamic();
    o("angle_max", angle_max, "rad", "and up to here").within(-3.1416, 3.1416).dynamic();
    o("cluster", cluster, "",
      "neighbouring steps are made one ray in their middle, with the distance of the nearest. Old UTM-30LX "
      "firmware may "
      "stop when asked for intensities over more than 95 degrees with a cluster of 1")
        .within(1, 99)
        .dynamic();
    o("skip", skip, "", "scans are left out after each").within(0, 9).dynamic();
    o("publish_intensity", intensity, "",
      "measures intensities. Where the scanner refuses, it goes on without until the next connection")
        .dynamic();
    o("publish_multiecho", multi_echo, "", "measures up to three echoes per ray, the same way").dynamic();
    o.require(angle_min < angle_max, "angle_min", "less than angle_max");
  }
};

/// Reply to PP: how the device counts.
struct HokuyoGeometry {
  int min_distance = 0, max_distance = 0;  ///< mm; DMIN, DMAX
  int resolution = 0;                      ///< steps of a full turn; ARES
  int first_step = 0, last_step = 0;       ///< AMIN, AMAX
  int front_step = 0;                      ///< AFRT
  int speed = 0;                           ///< revolutions per minute; SCAN

  /// @throws std::runtime_error that says what is missing or makes no sense
  static HokuyoGeometry parse(const scip::KeyValues& reply);
  double angleIncrement() const;    ///< rad per step
  double angle(double step) const;  ///< rad
  Nanoseconds period() const;       ///< of a turn
  Nanoseconds timeOf(double step) const { return static_cast<Nanoseconds>(step / resolution * period()); }
};

/// The steps that lie within the angles asked for, as many as fill whole clusters.
struct HokuyoRequest {
  int first = 0, last = 0, cluster = 1, skip = 0;
  bool intensity = false, multi_echo = false;

  /// @throws std::invalid_argument where not a single cluster lies within the angles
  static HokuyoRequest make(const HokuyoSettings& settings, const HokuyoGeometry& geometry);
  /// MD, ME, ND or NE, for scans without end.
  std::string command() const;
  int rays() const { return (last - first + 1) / cluster; }
  /// Where a ray looks: the middle of its cluster, as a step.
  double step(int ray) const { return first + ray * cluster + 0.5 * (cluster - 1); }
};

/// A scan with one to three echoes per ray, the nearest first.
struct HokuyoScan {
  Nanoseconds stamp = 0;                                           ///< host's time of the first ray
  double angle_min = 0.0, angle_max = 0.0, angle_increment = 0.0;  ///< rad
  double time_increment = 0.0, scan_time = 0.0;                    ///< s
  double range_min = 0.0, range_max = 0.0;                         ///< m
  std::vector<std::uint32_t> first_echo{0};  ///< index of each ray's first one, and of the end
  std::vector<float> ranges;  ///< m; NaN: no valid value, inf: nothing within reach, -inf: too near (REP 117)
  std::vector<float> intensities;  ///< as the device gives them; empty: not measured

  std::size_t rays() const { return first_echo.size() - 1; }
};

enum class Echo { kFirst, kLast, kMostIntense };
/// One echo of each ray.
/// @param[out] ranges, intensities the latter empty where the scan has none
void selectEchoes(const HokuyoScan& scan, Echo echo, std::vector<float>& ranges,
                  std::vector<float>& intensities);

/// A distance as REP 117 wants it, m. Values below DMIN are codes.
float toRange(std::uint32_t distance, const HokuyoGeometry& geometry);

/// All but the stamp.
HokuyoScan describeScan(const HokuyoRequest& request, const HokuyoGeometry& geometry);

/// Fills in ranges and intensities from the characters of the data rows.
/// @return false where they aren't exactly what was asked for; the scan is of no use then
bool decodeScan(const std::string& characters, const HokuyoRequest& request, const HokuyoGeometry& geometry,
                HokuyoScan& scan);

}  // namespace hokuyo_sick_drivers
