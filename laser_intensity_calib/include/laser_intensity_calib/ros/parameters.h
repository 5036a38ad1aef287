// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <laser_intensity_calib/incidence.h>
#include <laser_intensity_calib/models.h>
#include <mapping_common/options.h>

#include <string>

namespace laser_intensity_calib {

/// What the reflectivity nodelet is started with.
struct ReflectivityParameters {
  std::string calibration_file;
  ModelType model = ModelType::kLut;
  OutsidePolicy outside = OutsidePolicy::kDrop;
  int queue_size = 10;
  ScanIncidenceOptions scan;
  CloudIncidenceOptions cloud;

  void describe(mapping_common::OptionList& o) {
    o("calibration_file", calibration_file, "",
      "path of a calibration that calibrate has written. Empty: only the model raw, which then passes "
      "intensities as "
      "they are")
        .dynamic();
    o("model", model, "", "what intensity the reference surface would have").dynamic();
    o("outside", outside, "", "where the reference surface wasn't seen at a beam's range and angle")
        .dynamic();
    o("queue_size", queue_size, "", "messages of each topic").within(1, 10000);
    o.group("scan", "the angle of incidence in a LaserScan", scan);
    o.group("cloud", "the same in a PointCloud2", cloud);
  }
};

/// Reads the file, or, if its name is empty, gives intensities as they are, for which the model must be raw.
/// @throws std::invalid_argument that names the parameter, the file and what is wrong with it
Calibration loadFor(ModelType model, const std::string& file);

}  // namespace laser_intensity_calib
