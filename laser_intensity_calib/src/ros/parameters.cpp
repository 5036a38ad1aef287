// SPDX-License-Identifier: BSD-3-Clause
#include "laser_intensity_calib/ros/parameters.h"

#include <laser_intensity_calib/calibration_file.h>

#include <cmath>
#include <stdexcept>

namespace laser_intensity_calib {

ReflectivityParameters readReflectivityParameters(mapping_common::Parameters& p) {
  constexpr double kRadians = M_PI / 180.0;
  ReflectivityParameters r;
  r.calibration_file = p.get("calibration_file", r.calibration_file);
  r.model = parseModelType(p.choice("model", toString(r.model), {"raw", "range", "lut"}));
  r.outside = parseOutsidePolicy(p.choice("outside", toString(r.outside), {"drop", "clamp"}));
  r.queue_size = p.get("queue_size", r.queue_size, 1, 10000);
  const auto degrees = [&p](const std::string& name, double& angle, double min, double max) {
    angle = kRadians * p.get(name, angle / kRadians, min, max);
  };
  ScanIncidenceOptions& s = r.scan;
  s.min_window = p.get("scan/min_window", s.min_window, 3, 1000);
  s.min_length = p.get("scan/min_length", s.min_length, 0.0, 100.0);
  degrees("scan/max_incidence_deg", s.max_incidence, 10.0, 89.9);
  s.range_noise = p.get("scan/range_noise", s.range_noise, 0.0, 10.0);
  degrees("scan/max_error_deg", s.max_error, 0.01, 90.0);
  CloudIncidenceOptions& c = r.cloud;
  c.neighbors = p.get("cloud/neighbors", c.neighbors, 4, 1000);
  c.radius = p.get("cloud/radius", c.radius, 1e-3, 1e3);
  c.leaf = p.get("cloud/leaf", c.leaf, 0.0, 100.0);
  c.rows = p.get("cloud/rows", c.rows, 0, 100);
  c.columns = p.get("cloud/columns", c.columns, 1, 1000);
  degrees("cloud/max_error_deg", c.max_error, 0.01, 90.0);
  return r;
}

Calibration loadFor(ModelType model, const std::string& file) {
  if (file.empty()) {
    if (model == ModelType::kRaw) return Calibration();
    throw std::invalid_argument(std::string("~calibration_file is empty, ~model ") + toString(model) +
                                " needs a file that calibrate has written");
  }
  Calibration calibration;
  try {
    calibration = loadCalibration(file);
  } catch (const std::runtime_error& e) {
    throw std::invalid_argument(std::string("~calibration_file: ") + e.what());
  }
  if (!calibration.has(model)) {
    throw std::invalid_argument(std::string("~model is ") + toString(model) + ", which " + file +
                                " doesn't have");
  }
  return calibration;
}

}  // namespace laser_intensity_calib
