// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <laser_intensity_calib/models.h>

#include <string>

namespace laser_intensity_calib {

/// Writes a calibration as YAML: format, version, what it was made of, the three models, and the CRC-32 of
/// all lines before that of the checksum. Numbers have 6 significant digits.
/// @throws std::runtime_error that names the file
void saveCalibration(const Calibration& calibration, const std::string& path);

/// @throws std::runtime_error that names the file and what is wrong: not there, foreign, of a later version,
///   truncated, changed, or not consistent
Calibration loadCalibration(const std::string& path);

}  // namespace laser_intensity_calib
