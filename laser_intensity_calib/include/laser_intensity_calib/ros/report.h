// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <laser_intensity_calib/fit.h>

#include <string>
#include <vector>

namespace laser_intensity_calib {

/// What the figures of a calibration are drawn from: cells.csv, and samples.csv (a selection, each over what
/// the models say).
/// @param folder is made if it isn't there
/// @throws std::runtime_error that names the file
void writeReport(const std::string& folder, const std::vector<Sample>& samples,
                 const Calibration& calibration, const FitOptions& options);

/// The calibration in words: models, residuals and what is missing.
std::string describe(const Calibration& calibration, const Coverage& coverage);

}  // namespace laser_intensity_calib
