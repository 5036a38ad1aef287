// SPDX-License-Identifier: BSD-3-Clause
#include "laser_intensity_calib/ros/parameters.h"

#include <laser_intensity_calib/calibration_file.h>

#include <stdexcept>

namespace laser_intensity_calib {

Calibration loadFor(ModelType model, const std::string& file) {
  if (file.empty()) {
    if (model == ModelType::kRaw) return Calibration();
    throw std::invalid_argument("~calibration_file is empty, ~model " + toString(model) +
                                " needs a file that calibrate has written");
  }
  Calibration calibration;
  try {
    calibration = loadCalibration(file);
  } catch (const std::runtime_error& e) {
    throw std::invalid_argument(std::string("~calibration_file: ") + e.what());
  }
  if (!calibration.has(model)) {
    throw std::invalid_argument("~model is " + toString(model) + ", which " + file + " doesn't have");
  }
  return calibration;
}

}  // namespace laser_intensity_calib
