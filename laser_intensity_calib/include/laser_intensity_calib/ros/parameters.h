// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <laser_intensity_calib/incidence.h>
#include <laser_intensity_calib/models.h>
#include <mapping_common/parameters.h>

#include <string>

namespace laser_intensity_calib {

/// What the reflectivity nodelet is started with; config/reflectivity.yaml explains each.
struct ReflectivityParameters {
  std::string calibration_file;
  ModelType model = ModelType::kLut;
  OutsidePolicy outside = OutsidePolicy::kDrop;
  int queue_size = 10;
  ScanIncidenceOptions scan;
  CloudIncidenceOptions cloud;
};

/// @throws std::invalid_argument that names the parameter, its value and the allowed range
ReflectivityParameters readReflectivityParameters(mapping_common::Parameters& parameters);

/// Reads the file, or, if its name is empty, gives intensities as they are, for which the model must be raw.
/// @throws std::invalid_argument that names the parameter, the file and what is wrong with it
Calibration loadFor(ModelType model, const std::string& file);

}  // namespace laser_intensity_calib
