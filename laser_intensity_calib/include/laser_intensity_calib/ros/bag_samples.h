// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <laser_intensity_calib/fit.h>
#include <laser_intensity_calib/incidence.h>

#include <Eigen/Geometry>
#include <functional>
#include <limits>
#include <optional>
#include <string>
#include <vector>

namespace laser_intensity_calib {

/// Which measurements of a recording are of the reference surface: those that are in all that is given.
struct Region {
  int first_beam = 0, last_beam = std::numeric_limits<int>::max();  ///< of a scan; of a cloud, points
  std::optional<Eigen::AlignedBox3d> box;                           ///< m, in `frame`
  std::string frame;              ///< of the box, found by the bag's tf; empty: that of the sensor
  bool plane = false;             ///< the largest plane (of a scan: straight line) in it, by RANSAC
  double plane_tolerance = 0.03;  ///< m, from the plane
};

struct BagSamplesOptions {
  std::string topic;  ///< sensor_msgs LaserScan or PointCloud2
  Region region;
  int step = 1;  ///< each n-th message is used
  /// > 0: so many messages at a time are put together in `region.frame` and the normals are those of that
  /// cloud. For scanners that sweep a surface by moving (push-broom).
  int accumulate = 0;
  ScanIncidenceOptions scan;
  CloudIncidenceOptions cloud;

  void describe(mapping_common::OptionList& o) {
    o("step", step, "", "use each N-th message").within(1, 1000000);
    o("accumulate", accumulate, "",
      "above 0: put N messages together in the region's frame: for scanners that sweep it by moving "
      "(push-broom)")
        .within(0, 1000000);
    o("plane_tolerance", region.plane_tolerance, "m", "from the plane").within(0.0001, 10.0);
    o.group("scan", "", scan);
    o.group("cloud", "", cloud);
  }
};

/// What became of the messages and the beams.
struct BagSamplesReport {
  std::size_t messages = 0, malformed = 0, without_transform = 0;
  std::size_t in_region = 0, without_incidence = 0;
  std::string last_problem;  ///< of a message left out
};

/// Collects samples of the reference surface.
/// @param progress is given the share of the bag read, [0, 1]
/// @throws std::runtime_error if the bag can't be read or has no such topic; it then names those there are.
///   std::invalid_argument for options that don't make sense
std::vector<Sample> collectSamples(const std::string& bag, const BagSamplesOptions& options,
                                   BagSamplesReport& report,
                                   const std::function<void(double)>& progress = {});

}  // namespace laser_intensity_calib
